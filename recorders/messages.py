"""The shared vocabulary: one typed message per channel of a scene, no I/O.

Units: pixels with pixel centres at integers + 0.5, x right and y down; times in integer
nanoseconds; angles in radians from the x axis to the major axis, in (-pi/2, pi/2]. A box is (x,
y, w, h): top left corner and size. Frames count from 0.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

Box = tuple[float, float, float, float]
Count = Annotated[int, Meta(ge=0)]
Identity = Annotated[int, Meta(ge=0)]

Mode = Literal["motion", "appearance", "predicted"]
RelationState = Literal["INTERACTION", "JOINT"]
SceneStatus = Literal["entering", "inside", "exiting", "returned", "outside"]

NO_BLOB = -1
NO_CLASS = ("", "object")
"""Labels of detections that say nothing of what was detected."""

EVENT_WORDS = {
    "track_confirmed": ("is confirmed", "are confirmed"),
    "track_lost": ("is lost", "are lost"),
    "track_recovered": ("is recovered", "are recovered"),
    "track_removed": ("is removed", "are removed"),
    "entering": ("is entering", "are entering"),
    "entered": ("has entered", "have entered"),
    "exiting": ("is exiting", "are exiting"),
    "returned": ("returns", "return"),
    "exited": ("exits", "exit"),
    "interaction_started": ("begins to interact", "begin to interact"),
    "joined": ("joins", "join"),
    "separated": ("separates", "separate"),
    "interaction_ended": ("ends its interaction", "end their interaction"),
    "grouping": ("is grouping", "are grouping"),
    "grouped": ("is grouped", "are grouped"),
    "splitting": ("splits", "split"),
    "single": ("is single", "are single"),
    "group_formed": ("forms", "form"),
    "group_changed": ("changes", "change"),
    "group_ended": ("ends", "end"),
    "group_entered_scene": ("enters as a group", "enter as a group"),
    "mode_changed": ("changes its mode", "change their modes"),
    "disagreement": (
        "is judged differently by the two papers",
        "are judged differently by the two papers",
    ),
    "anomaly": ("shows an anomaly", "show an anomaly"),
    "zone_entered": ("enters a zone", "enter a zone"),
    "zone_left": ("leaves a zone", "leave a zone"),
    "occluded": ("is behind another", "are behind others"),
    "identity": ("may be another", "may be others"),
    "scene_changed": ("changes as a whole", "change as a whole"),
}
"""Every kind of event: what one subject does, what several do."""

EVENT_KINDS = tuple(EVENT_WORDS)
CHANGES = (
    "light",
    "infrared",
    "colour",
    "moved",
    "panned",
    "signal_lost",
    "frozen",
    "signal_back",
    "gap",
)
"""Kinds of what a ``scene_changed`` tells, its evidence's ``kind``."""
EVENT_LEVELS = {
    "track_confirmed": "DEBUG",
    "track_lost": "DEBUG",
    "track_recovered": "DEBUG",
    "track_removed": "DEBUG",
    "mode_changed": "DEBUG",
    "occluded": "DEBUG",
    "disagreement": "WARNING",
    "anomaly": "WARNING",
    "scene_changed": "WARNING",
}
"""Levels of the log's lines that are not INFO: what a tracker says of itself is DEBUG, what
contradicts itself is WARNING.
"""


class Ellipse(Struct, frozen=True):
    """A blob's first and second moments (EVENTS 2): centre (x, y), major axis h, minor axis w,
    angle theta.

    ``h`` and ``w`` are full axis lengths in pixels, ``theta`` is in radians.
    """

    x: float
    y: float
    h: float
    w: float
    theta: float


class Blob(Struct, frozen=True):
    """A connected component of the foreground mask.

    ``id`` is the component's label in ``cv2.connectedComponents(mask, connectivity=8)`` on the
    recorded mask (labels from 1), so that a blob's pixels are always found again from the mask
    alone.
    """

    id: Count
    box: Box
    area: Count
    ellipse: Ellipse


DARKEST_LIGHT, BRIGHTEST_LIGHT = 0.02, 50.0
"""A picture's light lies between these factors of what is usual."""


class Detections(Struct, frozen=True):
    """What was detected in one frame; row k of each list belongs to detection k.

    ``blobs[k]`` is the id of the blob that detection k came from, `NO_BLOB` where there is no
    mask; several detections may come from one blob. ``components`` holds the blobs as they are in
    the mask, whatever boxes were drawn into them. ``labels[k]`` is what detection k shows, as its
    detector calls it; those of `NO_CLASS` where nothing is known of that. ``size_model`` holds the numbers of the size
    model that the segmentation had learnt (`recorders.segmentation.sizes.SizeModel.from_list`),
    empty where there is none. ``fused`` says that a detector and the masks both went into the
    boxes: then they say where bodies are, and the mask only which of them share a blob.
    ``light`` holds how much brighter blue, green and red are than in the background, as factors;
    empty where they are as usual or it is not known. ``moved`` holds by how many pixels right and
    down the whole picture lies further than that of the frame before; empty where it does not, or
    it is not known.
    """

    frame: Count
    width: Count
    height: Count
    boxes: list[Box] = []
    scores: list[float] = []
    labels: list[str] = []
    ellipses: list[Ellipse | None] = []
    blobs: list[int] = []
    components: list[Blob] = []
    size_model: list[float] = []
    fused: bool = False
    light: list[float] = []
    moved: list[int] = []


class SceneChange(Struct, frozen=True):
    """The picture changed as a whole: light, infrared, a moved or turned camera, a lost signal.

    ``kind`` is one of `CHANGES`; ``evidence`` holds the measured values and their limits, by the
    names of `recorders.evidence`; ``text`` says it in words.
    """

    frame: Count
    kind: str
    evidence: dict[str, Any] = {}
    text: str = ""


class Zone(Struct, frozen=True):
    """A named polygon, vertices (x, y) in pixels, in order, not closed."""

    name: str
    polygon: list[tuple[float, float]]


class Regions(Struct, frozen=True):
    """The scene's regions (EVENTS 3.2): region of interest, security border around it, named zones.

    ``roi`` and ``border`` are lists of polygons; the border's polygons enclose the ROI (they are
    the outer outline of ROI and border together). Whatever lies in neither is the outer zone.
    ``source`` says where they come from: ``file`` or ``default``.
    """

    width: Count
    height: Count
    roi: list[list[tuple[float, float]]]
    border: list[list[tuple[float, float]]]
    zones: list[Zone] = []
    source: str = "file"


class Target(Struct, frozen=True):
    """One target in one frame, as a tracker holds it: the input of the reasoning.

    Attributes:
        id: the target's identity, never reused.
        box: (x, y, w, h) in pixels.
        ellipse: its ellipse, if the tracker keeps one.
        velocity: (vx, vy) in pixels per second.
        mode: how it was tracked in this frame (EVENTS 2).
        confidence: in [0, 1].
        present: the tracker holds it to be in the picture in this frame (what ``export --to mot``
            writes).
        observed: an observation (detection, blob, pixels) was associated in this frame.
        blob: id of the region of pixels it lies in; two targets with the same non-negative blob
            share one. A tracker without masks uses its own numbers for shared detections.
        newborn: first frame of its confirmed life.
        born_of_split: it was born out of a group's region (EVENTS 3.1, 3.2).
        shell_radius: its shell's radius in pixels, None to have it computed from box and velocity
            (SHELLS 2.2).
        hidden_parts: names of the parts held to be occluded (PARTS 2.2), empty without a part
            model.
        score: the association's or appearance's raw score, for explanations.
        likely: how likely the detection that it was observed in is somebody, in [0, 1]; None
            where it was not observed, or pixels of its own speak for it.
        measured: the box that was measured in this frame, before any filter, for the hindsight
            step.
        signature: a compact histogram of its colours where one was taken in this frame, for the
            hindsight step: counts, always in the same order within a recording.
        gate: (x, y, w, h) of the rectangle in which its centre was looked for (PARTS 3.1); left
            out of the message where the tracker has none.
        centroid: (alpha, beta), where in the box the part model's centroid lies, from which the
            five parts follow (PARTS 2.1); left out of the message where the tracker has no such
            model.
    """

    id: Identity
    box: Box
    velocity: tuple[float, float] = (0.0, 0.0)
    mode: Mode = "motion"
    confidence: float = 1.0
    present: bool = True
    observed: bool = True
    blob: int = NO_BLOB
    newborn: bool = False
    born_of_split: bool = False
    ellipse: Ellipse | None = None
    shell_radius: float | None = None
    hidden_parts: list[str] = []
    score: float | None = None
    likely: float | None = None
    measured: Box | None = None
    signature: list[int] = []
    gate: Box | UnsetType = UNSET
    centroid: tuple[float, float] | UnsetType = UNSET
    identity: float = 1.0


class GroupTrack(Struct, frozen=True):
    """A low-level track that a tracker holds over several targets (EVENTS 3.1: a group tracker).

    ``id`` is the tracker's own number for it (not the group's label), ``observed`` says whether
    it has an associated observation in this frame, ``newborn`` whether it started in this frame.
    ``members`` are the targets that the tracker knows to lie over it; empty: whoever lies over it
    by place.
    """

    id: Identity
    box: Box
    observed: bool
    newborn: bool = False
    members: list[int] = []


class TrackSighting(Struct, frozen=True, array_like=True):
    """A target was seen in a frame, in a box."""

    frame: int
    box: Box


class Notice(Struct, frozen=True):
    """Something a tracker tells of itself: becomes an `Event` with id and time.

    Attributes:
        kind: one of `EVENT_KINDS`.
        subjects: ids of the targets.
        rule: paper and case, or ours.
        evidence: the measured values and their limits, by the names of `recorders.evidence`.
        text: in words, "" for the kind's own.
        sightings: of ``track_confirmed``: where it was seen before, for hindsight.
        left_scene: of ``track_removed``: it went where hindsight need not look for it any more.
        since_frame: of ``track_recovered`` with two subjects: from this frame on until now each
            had the other's id, for hindsight to undo.
    """

    kind: str
    subjects: list[int]
    rule: str
    evidence: dict[str, Any] = {}
    text: str = ""
    sightings: list[TrackSighting] = []
    left_scene: bool = False
    since_frame: int | None = None


class Withheld(Struct, frozen=True):
    """Something that was followed and is not told.

    Attributes:
        box: where it was seen.
        reason: in words, with the value and the limit.
        likely: how likely its detection is somebody, None where no score speaks of it.
    """

    box: Box
    reason: str
    likely: float | None = None


class Targets(Struct, frozen=True):
    """A tracker's whole answer for one frame; ``group_tracks`` None means: derive groups from
    shared blobs. ``held_back`` is what hindsight does not tell.
    """

    frame: Count
    targets: list[Target] = []
    group_tracks: list[GroupTrack] | None = None
    notices: list[Notice] = []
    held_back: list[Withheld] | UnsetType = UNSET


class Track(Struct, frozen=True):
    """A target with everything the reasoning found about it in this frame.

    ``confidence`` is the probability that it is somebody, ``identity`` that it is still whom its id
    began as. ``label`` is the class that its sightings have voted for so far; left out where no
    detector said any.
    """

    id: Identity
    box: Box
    ellipse: Ellipse | None
    velocity: tuple[float, float]
    shell_radius: float
    mode: Mode
    confidence: float
    present: bool
    observed: bool
    blob: int
    grouping: bool
    grouped: bool
    splitting: bool
    grouping_partners: list[int]
    grouped_partners: list[int]
    splitting_partners: list[int]
    group: int | None
    scene: SceneStatus
    zones: list[str] = []
    hidden_parts: list[str] = []
    gate: Box | UnsetType = UNSET
    centroid: tuple[float, float] | UnsetType = UNSET
    label: str | UnsetType = UNSET
    identity: float = 1.0


class HeldBack(Struct, frozen=True):
    """What was followed in a frame and is not told; written for frames that have any."""

    frame: Count
    withheld: list[Withheld]


class Tracks(Struct, frozen=True):
    """All tracks of a frame, by id."""

    frame: Count
    tracks: list[Track] = []


class Relation(Struct, frozen=True):
    """An edge that is not INDEPENDENT; a < b; ``since_frame`` is the first frame of the present
    state.

    ``met_frame`` and ``met_ns``: since when they have not been INDEPENDENT.
    ``partners_since_frame`` and ``partners_since_ns``: since when they have been grouping,
    grouped or splitting, whichever holds now; None where none does.
    """

    a: Identity
    b: Identity
    state: RelationState
    since_frame: Count
    since_ns: int
    grouping: bool
    grouped: bool
    splitting: bool
    shell_overlap: float
    rule: str = ""
    met_frame: Count = 0
    met_ns: int = 0
    partners_since_frame: int | None = None
    partners_since_ns: int | None = None


class Relations(Struct, frozen=True):
    """All edges of a frame, by (a, b)."""

    frame: Count
    relations: list[Relation] = []


class Group(Struct, frozen=True):
    """A group: label, members by id, whether it has an observation in this frame, where it came
    from.

    ``formed_from`` are the labels of the groups that ended for it, ``former_members`` whom each
    of them had, in the same order. ``entered_as_one``: it was understood only as it split, in
    frame ``since_frame``.
    """

    label: Identity
    members: list[int]
    observed: bool
    since_frame: Count
    since_ns: int
    formed_from: list[int] = []
    former_members: list[list[int]] = []
    entered_as_one: bool = False


class Groups(Struct, frozen=True):
    """All groups of a frame, by label."""

    frame: Count
    groups: list[Group] = []


class Event(Struct, frozen=True):
    """Something that happened: ids count from 1 in the order of happening.

    ``subjects`` are track ids; ``groups`` are group labels; ``rule`` names paper and case;
    ``evidence`` holds the measured values and their thresholds; ``text`` says it in words.
    """

    id: Count
    kind: str
    subjects: list[int]
    frame: Count
    time_ns: int
    rule: str
    evidence: dict[str, Any] = {}
    text: str = ""
    groups: list[int] = []


class Graph(Struct, frozen=True):
    """The interaction graph as networkx node-link data, nodes and edges sorted."""

    frame: Count
    directed: bool
    multigraph: bool
    graph: dict[str, Any]
    nodes: list[dict[str, Any]]
    edges: list[dict[str, Any]]


class Digest(Struct, frozen=True):
    """One link of the digest chain, written with every frame.

    ``recorded`` is the SHA-256 of the frame's recorded messages; ``channels`` maps each annotated
    channel to the SHA-256 of its payloads in this frame; ``link`` hashes the link before, the
    frame, its time, ``recorded`` and ``channels``. All are hexadecimal. The last link is the
    log's output digest.
    """

    frame: Count
    recorded: str
    channels: dict[str, str]
    link: str


def to_json(message: Struct) -> bytes:
    """Encode a message canonically: fields in the order of their definition, shortest exact
    floats.
    """
    return msgspec.json.encode(message)
