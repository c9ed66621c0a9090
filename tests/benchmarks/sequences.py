"""Event sequences side by side: what a generated scene's truth gives, and what a replay tells of
the same scene.

The truth's sequence is what the reasoning says of the truth's own boxes, identities and blobs. A
replay's tracks are given the identity of the actor whom each overlaps most over its life, so that
an exchange of two identities shows up as missing and spurious events. An event is right if the
truth has one of the same kind and subjects within a tolerance in time; the edit distance counts
insertions, deletions and substitutions between the two orders of (kind, subjects), whatever the
times.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fixtures.scenes import GeneratedScene
from fixtures.targets import truth_targets
from reasoning.reasoner import Reasoner
from recorders.annotated.reader import AnnotatedLog
from recorders.messages import Box, Event

INTERACTION = ("grouping", "grouped", "splitting", "single")
GROUP = ("group_formed", "group_changed", "group_ended", "group_entered_scene")
RELATION = ("interaction_started", "joined", "separated", "interaction_ended")
SCENE = (
    "entering",
    "entered",
    "exiting",
    "returned",
    "exited",
    "zone_entered",
    "zone_left",
)
KINDS = frozenset((*INTERACTION, *GROUP, *RELATION, *SCENE))
"""What happens between the people; the life of tracks is the tracker's own affair."""


@dataclass(frozen=True, order=True)
class Told:
    """An event without its numbers: when, what, who, and a zone's name."""

    frame: int
    kind: str
    subjects: tuple[int, ...]
    zone: str = ""

    @property
    def token(self) -> tuple[str, tuple[int, ...], str]:
        """What of it is compared whatever the time."""
        return self.kind, self.subjects, self.zone


@dataclass(frozen=True)
class Replayed:
    """A replay in the truth's identities: its events, which track is whom, and how the identities
    went.
    """

    events: list[Told]
    owner: dict[int, int]
    switches: int
    forbidden: int = 0


@dataclass(frozen=True)
class Comparison:
    """Counts; ``missing`` and ``spurious`` in the order of time, ``late`` in frames, one per
    right event.
    """

    right: int
    missing: list[Told]
    spurious: list[Told]
    edits: int
    late: list[int] = field(default_factory=list)


def told(event: Event, owner: dict[int, int] | None = None) -> Told:
    """An event of a log, its subjects by ``owner`` (0: a track that is nobody)."""
    who = sorted(i if owner is None else owner.get(i, 0) for i in event.subjects)
    return Told(event.frame, event.kind, tuple(who), str(event.evidence.get("zone", "")))


def of_truth(scene: GeneratedScene) -> tuple[list[Told], Reasoner]:
    """The truth's sequence and the reasoner as it is at the end."""
    reasoner = Reasoner({}, scene.width, scene.height)
    out: list[Told] = []
    for targets in truth_targets(scene):
        now = scene.time_ns(targets.frame)
        events = reasoner.step(targets.frame, now, targets, scene.truth.regions).events
        out += [told(e) for e in events if e.kind in KINDS]
    return sorted(out), reasoner


def of_replay(scene: GeneratedScene, path: str | Path) -> Replayed:
    """An annotated log's sequence in the identities of the truth."""
    with AnnotatedLog(path) as log:
        frames = list(log.frames(("tracks", "events")))
    votes: dict[int, Counter[int]] = {}
    now: dict[int, int] = {}
    switches = 0
    for f, true in zip(frames, scene.truth.frames, strict=True):
        pairs = sorted(
            (
                (iou(t.box, a.box), t.id, a.id)
                for t in f.tracks
                if t.present
                for a in true.actors
            ),
            reverse=True,
        )
        used: set[int] = set()
        for overlap, track, actor in pairs:
            if overlap < 0.3 or track in used or -actor in used:
                continue
            used |= {track, -actor}
            votes.setdefault(track, Counter())[actor] += 1
            switches += now.get(actor, track) != track
            now[actor] = track
    owner = {t: min(c, key=lambda a: (-c[a], a)) for t, c in votes.items()}
    events = [e for f in frames for e in f.events]
    forbidden = sum(e.rule == "EVENTS 3.1 transition table" for e in events)
    return Replayed(
        sorted(told(e, owner) for e in events if e.kind in KINDS),
        owner,
        switches,
        forbidden,
    )


def iou(a: Box, b: Box) -> float:
    """Intersection over union of two boxes."""
    w = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    h = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    both = max(w, 0.0) * max(h, 0.0)
    return both / (a[2] * a[3] + b[2] * b[3] - both) if both else 0.0


def compare(truth: Sequence[Told], other: Sequence[Told], tolerance: int) -> Comparison:
    """Match events of the same token in the order of time, each with the nearest unused one
    within the tolerance.
    """
    missing: list[Told] = []
    late: list[int] = []
    free = list(other)
    for t in truth:
        near = [
            o for o in free if o.token == t.token and abs(o.frame - t.frame) <= tolerance
        ]
        if not near:
            missing.append(t)
            continue
        best = min(near, key=lambda o: (abs(o.frame - t.frame), o.frame))
        free.remove(best)
        late.append(best.frame - t.frame)
    return Comparison(
        len(late),
        missing,
        free,
        edit_distance([t.token for t in truth], [o.token for o in other]),
        late,
    )


def edit_distance(a: Sequence[object], b: Sequence[object]) -> int:
    """Levenshtein's distance.

    >>> edit_distance("splitting", "sitting")
    2
    """
    row = list(range(len(b) + 1))
    for i, x in enumerate(a, 1):
        previous, row[0] = row[0], i
        for j, y in enumerate(b, 1):
            previous, row[j] = row[j], min(row[j] + 1, row[j - 1] + 1, previous + (x != y))
    return row[-1]


def lines(events: Iterable[Told]) -> Iterator[str]:
    """Events as text."""
    for e in events:
        yield f"{e.frame:5d} {e.kind} {', '.join(map(str, e.subjects))} {e.zone}".rstrip()
