"""Scene events (EVENTS 3.2): region of interest, security border, outer zone, named zones.

The rules are pure functions of the regions, a box and a status, so that trackers and the event
reasoning share them: who may be born (`SceneRegions.may_start_low_level`,
`SceneRegions.may_start_high_level`), who must go (`SceneRegions.must_remove`), and how a target's
status goes on (`next_status`).

Rules of ours where the paper is silent:

- A target that was born partly outside ROI and border stays *entering* until it has come in; it
  is *exiting* only if it was wholly inside ROI and border before.
- *returned* is told when a target that was exiting lies wholly inside the ROI again, not as soon
  as it is back in the border: the border is there to keep one who stands on an edge from coming
  and going all the time.
- A target that was wholly outside and was not removed enters anew when it reaches the ROI.
- A target that disappears while exiting has exited.
- A target that disappeared within the scene and comes back wholly inside the ROI under its old
  identity had not left: it takes up its status again. Anywhere else it enters anew.
- Named zones ask where the target stands: the middle of its box's lower side, or its centre.
- Who is in a named zone has left it when that point lies `EDGE_SIZES` of its size beyond the
  edge, so that one who stands on the edge comes and goes once.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from reasoning.geometry import OUTSIDE, PARTLY, WHOLLY, Area, Bools, Floats
from recorders.messages import Box, Mode, Regions, SceneStatus
from recorders.parameters import Parameters, param

Boxes = Floats | Sequence[Box]
"""N boxes: an array (N, 4), or plain numbers."""

EDGE_SIZES = 0.1
"""How far beyond an edge one must be to be held to have crossed it, in own sizes (the diagonal of
the box): a box's foot moves by less from frame to frame while its owner stands.
"""


@dataclasses.dataclass(frozen=True)
class RegionParameters(Parameters):
    """Default regions and rules of removal (EVENTS 3.2)."""

    roi_inset: float = param(
        0.04,
        "default region of interest: the picture less this share of its shorter side",
        low=0.0,
        high=0.4,
    )
    border_inset: float = param(
        0.01,
        "default border's outer edge: the picture less this share of its shorter side",
        low=0.0,
        high=0.4,
    )
    low_confidence: float = param(
        0.3,
        "a target partly in the outer zone and tracked by appearance under this confidence"
        " is removed",
        low=0.0,
        high=1.0,
        source="EVENTS 3.2 (value ours)",
    )
    zone_point: str = param(
        "foot",
        "where a target stands for named zones: foot of its box, or centre",
        choices=("foot", "centre"),
    )


def default_regions(
    width: int, height: int, parameters: RegionParameters | None = None
) -> Regions:
    """Regions for a scene without a regions file: two rectangles inside the picture, ``source``
    is ``default``.
    """
    p = parameters if parameters is not None else RegionParameters()
    side = min(width, height)
    roi, border = (
        _inset(width, height, share * side)
        for share in (max(p.roi_inset, p.border_inset), p.border_inset)
    )
    return Regions(width, height, [roi], [border], source="default")


def _inset(width: int, height: int, by: float) -> list[tuple[float, float]]:
    x1, y1 = width - by, height - by
    return [(by, by), (x1, by), (x1, y1), (by, y1)]


LOW_CONFIDENCE = (
    "EVENTS 3.2: partly in the outer zone, tracked by appearance with low confidence"
)
"""Why a target goes that is partly outside and no longer followed with any faith."""


@dataclasses.dataclass(frozen=True)
class Places:
    """Where N boxes lie: ``roi`` and ``area`` (ROI and border together) as `OUTSIDE`, `PARTLY`,
    `WHOLLY`.
    """

    roi: list[int]
    area: list[int]


class SceneRegions:
    """The three regions and the named zones of a scene, ready to be asked."""

    def __init__(
        self, regions: Regions, parameters: RegionParameters | None = None
    ) -> None:
        self.message = regions
        self._p = parameters if parameters is not None else RegionParameters()
        self._roi = Area(regions.roi)
        self._area = _union(regions)
        self._zones = [(zone.name, Area([zone.polygon])) for zone in regions.zones]

    @property
    def low_confidence(self) -> float:
        """Under this confidence who is partly outside has to go."""
        return self._p.low_confidence

    @property
    def zone_names(self) -> list[str]:
        """Names of the zones as given."""
        return [name for name, _ in self._zones]

    def may_start_low_level(self, centroid: tuple[float, float]) -> bool:
        """A detection is made and a low-level track starts where the centroid lies in ROI or
        border.
        """
        return bool(self._area.contains([centroid])[0])

    def may_start_low_level_all(self, centroids: Floats) -> Bools:
        """The same for centroids (N, 2), (N,) bool."""
        return self._area.contains(centroids)

    def may_start_high_level(self, box: Box) -> bool:
        """A high-level tracker starts where the target is at least partly in the ROI."""
        return self._roi.covers([box])[0] != OUTSIDE

    def must_remove(self, box: Box, mode: Mode, confidence: float) -> str | None:
        """Why a tracker must go, None if it may stay: wholly outside ROI and border, or partly
        outside and followed without motion (appearance or prediction) with low confidence.
        """
        return self.reason_to_remove(self._area.covers([box])[0], mode, confidence)

    def reason_to_remove(self, place: int, mode: Mode, confidence: float) -> str | None:
        """The same for a target of which it is known how it lies in ROI and border
        (`area_cover`).
        """
        if place == OUTSIDE:
            return "EVENTS 3.2: wholly outside region of interest and border"
        if place == PARTLY and mode != "motion" and confidence < self._p.low_confidence:
            return LOW_CONFIDENCE
        return None

    def area_cover(self, boxes: Boxes) -> list[int]:
        """How each of boxes (N, 4) lies in ROI and border together."""
        plain = boxes.tolist() if isinstance(boxes, np.ndarray) else boxes
        return self._area.covers(plain)

    def places(self, boxes: Boxes) -> Places:
        """Where boxes (N, 4) lie."""
        plain = boxes.tolist() if isinstance(boxes, np.ndarray) else boxes
        return Places(self._roi.covers(plain), self._area.covers(plain))

    def margins(self, box: Box) -> tuple[float, float]:
        """How far a box lies within the ROI, and how far it reaches beyond ROI and border,
        pixels; by its corners.

        The first is negative where a corner is outside, the second 0 where none is.
        """
        x, y, w, h = box
        corners = [(x, y), (x + w, y), (x, y + h), (x + w, y + h)]
        return float(self._roi.depth(corners).min()), max(
            0.0, -float(self._area.depth(corners).min())
        )

    def depth_in_zone(self, zone: str, box: Box) -> float:
        """How far within a named zone a target stands, pixels; negative: so far outside; nan:
        there is no such zone any more.
        """
        area = dict(self._zones).get(zone)
        if area is None:
            return float("nan")
        down = 1.0 if self._p.zone_point == "foot" else 0.5
        point = (box[0] + 0.5 * box[2], box[1] + down * box[3])
        return float(area.depth([point])[0])

    def zones_of(
        self, boxes: Boxes, before: Sequence[Collection[str]] | None = None
    ) -> list[list[str]]:
        """The named zones in which each target of boxes (N, 4) stands; ``before`` are those in
        which it stood, which it leaves beyond their edge alone.
        """
        if not self._zones:
            return [[]] * len(boxes)
        boxes = np.asarray(boxes, np.float64).reshape(-1, 4)
        points = foot_points(boxes, 1.0 if self._p.zone_point == "foot" else 0.5)
        edges = EDGE_SIZES * np.hypot(boxes[:, 2], boxes[:, 3])
        inside = []
        for name, area in self._zones:
            yes = area.contains(points)
            if before is not None and any(name in zones for zones in before):
                was = np.array([name in zones for zones in before], np.bool_)
                yes |= was & (area.depth(points) >= -edges)
            inside.append((name, yes.tolist()))
        return [[name for name, yes in inside if yes[index]] for index in range(len(boxes))]


def foot_points(boxes: Floats, down: float = 1.0) -> Floats:
    """Where those of boxes (N, 4) stand, (N, 2): in the middle of the box, so far down in it."""
    return np.stack(
        [boxes[:, 0] + 0.5 * boxes[:, 2], boxes[:, 1] + down * boxes[:, 3]], axis=1
    )


def _union(regions: Regions) -> Area:
    """ROI and border together; an upright rectangle that holds the ROI's vertices holds it too,
    and is faster.
    """
    border = Area(regions.border)
    if border.is_rectangle and all(
        bool(border.contains(p).all()) for p in regions.roi if len(p)
    ):
        return border
    return Area([*regions.roi, *regions.border])


def first_status(born_of_split: bool) -> SceneStatus:
    """A target starts as entering, unless it comes from a group that has split."""
    return "inside" if born_of_split else "entering"


_COMES_IN: Mapping[SceneStatus, SceneStatus] = {
    "entering": "inside",
    "exiting": "returned",
    "outside": "entering",
}


def next_status(status: SceneStatus, been_in: bool, roi: int, area: int) -> SceneStatus:
    """A target's status in the next frame.

    Args:
        status: its status so far.
        been_in: it was wholly inside ROI and border before.
        roi: how its box lies in the ROI: `OUTSIDE`, `PARTLY` or `WHOLLY`.
        area: how its box lies in ROI and border together.

    >>> next_status("inside", True, PARTLY, PARTLY), next_status("exiting", True, PARTLY, WHOLLY)
    ('exiting', 'exiting')
    """
    if area == OUTSIDE:
        return "outside"
    if roi == WHOLLY:
        return _COMES_IN.get(status, status)
    if status == "outside":
        return "entering" if roi != OUTSIDE else "outside"
    if area == PARTLY and been_in and status != "exiting":
        return "exiting"
    return status


STATUS_EVENTS: dict[tuple[SceneStatus, SceneStatus], str] = {
    ("entering", "inside"): "entered",
    ("entering", "exiting"): "exiting",
    ("inside", "exiting"): "exiting",
    ("returned", "exiting"): "exiting",
    ("exiting", "returned"): "returned",
    ("entering", "outside"): "exited",
    ("inside", "outside"): "exited",
    ("returned", "outside"): "exited",
    ("exiting", "outside"): "exited",
    ("outside", "entering"): "entering",
}
"""Which event tells a change of status."""


@dataclasses.dataclass(slots=True)
class Standing:
    """A target's standing in the scene: its status since when, whether it has been wholly inside,
    zones since when.
    """

    status: SceneStatus
    since_ns: int
    been_in: bool
    zones: dict[str, int]


@dataclasses.dataclass(frozen=True, slots=True)
class RegionEvent:
    """A scene event of one target; ``zone`` for zone events; ``lasted_ns``: status or time in the
    zone before.
    """

    kind: str
    id: int
    before: str
    roi: int
    area: int
    lasted_ns: int
    zone: str = ""
    reason: str = ""


class SceneBook:
    """Every target's scene status and zones over time."""

    def __init__(self) -> None:
        self.targets: dict[int, Standing] = {}
        self._away: dict[int, SceneStatus] = {}

    def step(
        self,
        time_ns: int,
        regions: SceneRegions,
        ids: Sequence[int],
        boxes: Boxes,
        born_of_split: Sequence[bool],
        present: Sequence[bool],
        leaving: Collection[int] = (),
    ) -> list[RegionEvent]:
        """Take a frame's targets (N ids ascending, boxes (N, 4)); answer with every change, by
        id, zones by name.

        A target that is not in the picture keeps its status and zones, except that its place may
        lie wholly outside. Those who are ``leaving`` have disappeared and stay among the targets
        for this frame alone.
        """
        stood = [
            self.targets[identity].zones if identity in self.targets else ()
            for identity in ids
        ]
        places, zones = regions.places(boxes), regions.zones_of(boxes, stood)
        changes: list[RegionEvent] = []
        for i in sorted(self.targets.keys() - set(ids) | set(leaving)):
            changes += self._vanish(i, time_ns, i in leaving)
        for index, i in enumerate(ids):
            if i in leaving:
                continue
            at = places.roi[index], places.area[index]
            held = self.targets.get(i)
            if held is None:
                was = self._away.pop(i, None)
                back = was is not None and at[0] == WHOLLY
                held = Standing(
                    was if was is not None and back else first_status(born_of_split[index]),
                    time_ns,
                    at[1] == WHOLLY,
                    {},
                )
                self.targets[i] = held
                if held.status == "entering" and not back:
                    changes.append(RegionEvent("entering", i, "", *at, 0))
            elif present[index] or at[1] == OUTSIDE:
                changes += self._move(i, held, time_ns, at)
            if present[index] and (zones[index] or held.zones):
                changes += self._zones(i, held, time_ns, zones[index], at)
        return changes

    def _move(
        self, i: int, held: Standing, ns: int, at: tuple[int, int]
    ) -> list[RegionEvent]:
        status = next_status(held.status, held.been_in, *at)
        held.been_in = (held.been_in or at[1] == WHOLLY) and status != "outside"
        if status == held.status:
            return []
        change = RegionEvent(
            STATUS_EVENTS[held.status, status], i, held.status, *at, ns - held.since_ns
        )
        held.status, held.since_ns = status, ns
        return [change]

    def _zones(
        self, i: int, held: Standing, ns: int, zones: list[str], at: tuple[int, int]
    ) -> list[RegionEvent]:
        left = [zone for zone in sorted(held.zones) if zone not in zones]
        come = [zone for zone in sorted(zones) if zone not in held.zones]
        changes = [
            RegionEvent("zone_left", i, "", *at, ns - held.zones.pop(z), z) for z in left
        ]
        held.zones.update(dict.fromkeys(come, ns))
        return changes + [RegionEvent("zone_entered", i, "", *at, 0, z) for z in come]

    def _vanish(self, i: int, ns: int, stays: bool) -> list[RegionEvent]:
        held = self.targets.pop(i)
        if held.status not in ("exiting", "outside"):
            self._away[i] = held.status
        if stays:
            self.targets[i] = Standing(
                "outside" if held.status == "exiting" else held.status, ns, held.been_in, {}
            )
        why = "the track ended here"
        changes = [
            RegionEvent(
                "zone_left",
                id=i,
                before="",
                roi=PARTLY,
                area=PARTLY,
                lasted_ns=ns - begun,
                zone=z,
                reason=why,
            )
            for z, begun in sorted(held.zones.items())
        ]
        if held.status == "exiting":
            changes.append(
                RegionEvent(
                    "exited",
                    id=i,
                    before="exiting",
                    roi=PARTLY,
                    area=PARTLY,
                    lasted_ns=ns - held.since_ns,
                    zone="",
                    reason=why,
                )
            )
        return changes

    def state(self) -> dict[str, Any]:
        """The whole book as plain data."""
        return {
            "targets": [
                [
                    i,
                    target.status,
                    target.since_ns,
                    target.been_in,
                    [[z, ns] for z, ns in sorted(target.zones.items())],
                ]
                for i, target in sorted(self.targets.items())
            ],
            "away": [[i, status] for i, status in sorted(self._away.items())],
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from what `state` gave."""
        self.targets = {
            i: Standing(s, ns, been, dict(z)) for i, s, ns, been, z in state["targets"]
        }
        self._away = dict(state["away"])
