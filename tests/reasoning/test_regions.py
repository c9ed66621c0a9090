"""Scene events (EVENTS 3.2): who may be born, entering, entered, exiting, returned, exited,
removal, named zones.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from reasoning.geometry import OUTSIDE, PARTLY, WHOLLY
from reasoning.regions import (
    STATUS_EVENTS,
    RegionParameters,
    SceneBook,
    SceneRegions,
    default_regions,
    first_status,
    next_status,
)
from recorders.messages import Mode, Regions, SceneStatus, Zone


def square(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float]]:
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


REGIONS = Regions(
    200, 200, [square(50.0, 50.0, 150.0, 150.0)], [square(30.0, 30.0, 170.0, 170.0)]
)
SCENE = SceneRegions(REGIONS)


@pytest.mark.parametrize(
    ("centroid", "may"),
    [((100, 100), True), ((40, 100), True), ((30, 30), True), ((20, 100), False)],
)
def test_a_low_level_track_starts_in_roi_or_border(
    centroid: tuple[int, int], may: bool
) -> None:
    assert SCENE.may_start_low_level(centroid) is may
    assert SCENE.may_start_low_level_all(np.array([centroid], np.float64)).tolist() == [may]


@pytest.mark.parametrize(
    ("box", "may"),
    [
        ((60, 60, 20, 20), True),
        ((40, 60, 20, 20), True),
        ((30, 60, 20, 20), False),
        ((0, 0, 5, 5), False),
    ],
)
def test_a_high_level_tracker_starts_at_least_partly_in_the_roi(
    box: tuple[int, int, int, int], may: bool
) -> None:
    assert SCENE.may_start_high_level(box) is may


@pytest.mark.parametrize(
    ("box", "mode", "confidence", "removed"),
    [
        ((60, 60, 20, 20), "appearance", 0.0, False),
        ((32, 60, 10, 10), "appearance", 0.0, False),  # in the border
        ((20, 60, 20, 20), "appearance", 0.1, True),
        ((20, 60, 20, 20), "predicted", 0.1, True),
        ((20, 60, 20, 20), "appearance", 0.9, False),
        ((20, 60, 20, 20), "motion", 0.1, False),
        ((0, 60, 20, 20), "motion", 1.0, True),
    ],
)
def test_removal(
    box: tuple[int, int, int, int], mode: Mode, confidence: float, removed: bool
) -> None:
    reason = SCENE.must_remove(box, mode, confidence)
    assert (reason is not None) is removed
    assert reason is None or reason.startswith("EVENTS 3.2")


@pytest.mark.parametrize(
    ("status", "been_in", "roi", "area", "after"),
    [
        ("entering", True, PARTLY, WHOLLY, "entering"),
        ("entering", True, WHOLLY, WHOLLY, "inside"),
        ("entering", False, PARTLY, PARTLY, "entering"),  # born on the edge: still coming
        ("entering", True, PARTLY, PARTLY, "exiting"),  # had come in, goes out again
        ("entering", False, OUTSIDE, OUTSIDE, "outside"),
        ("inside", True, PARTLY, WHOLLY, "inside"),  # in the border: nothing happens
        ("inside", True, OUTSIDE, WHOLLY, "inside"),
        ("inside", True, PARTLY, PARTLY, "exiting"),
        ("inside", True, OUTSIDE, OUTSIDE, "outside"),
        ("exiting", True, PARTLY, PARTLY, "exiting"),
        ("exiting", True, PARTLY, WHOLLY, "exiting"),
        ("exiting", True, WHOLLY, WHOLLY, "returned"),
        ("exiting", True, OUTSIDE, OUTSIDE, "outside"),
        ("returned", True, PARTLY, WHOLLY, "returned"),
        ("returned", True, PARTLY, PARTLY, "exiting"),
        ("returned", True, OUTSIDE, OUTSIDE, "outside"),
        ("outside", False, OUTSIDE, OUTSIDE, "outside"),
        ("outside", False, OUTSIDE, PARTLY, "outside"),
        ("outside", False, PARTLY, WHOLLY, "entering"),
        ("outside", False, WHOLLY, WHOLLY, "entering"),
    ],
)
def test_every_row_of_the_status_table(
    status: SceneStatus, been_in: bool, roi: int, area: int, after: str
) -> None:
    assert next_status(status, been_in, roi, area) == after
    assert status == after or (status, after) in STATUS_EVENTS


def test_every_change_that_can_happen_has_its_event() -> None:
    statuses: tuple[SceneStatus, ...] = (
        "entering",
        "inside",
        "exiting",
        "returned",
        "outside",
    )
    places = [
        (OUTSIDE, OUTSIDE),
        (OUTSIDE, PARTLY),
        (OUTSIDE, WHOLLY),
        (PARTLY, PARTLY),
        (PARTLY, WHOLLY),
        (WHOLLY, WHOLLY),
    ]
    seen = {
        (s, next_status(s, b, *p)) for s in statuses for b in (False, True) for p in places
    }
    assert {c for c in seen if c[0] != c[1]} == set(STATUS_EVENTS)


def test_who_is_born_of_a_split_is_not_entering() -> None:
    assert first_status(born_of_split=False) == "entering"
    assert first_status(born_of_split=True) == "inside"


class Walk:
    def __init__(self, regions: Regions = REGIONS, **parameters: Any) -> None:
        self.scene = SceneRegions(regions, RegionParameters(**parameters))
        self.book = SceneBook()
        self.frame = -1

    def step(
        self,
        boxes: dict[int, tuple[int, int, int, int]],
        split: tuple[int, ...] = (),
        absent: tuple[int, ...] = (),
    ) -> list[tuple[str | int, ...]]:
        self.frame += 1
        ids = sorted(boxes)
        changes = self.book.step(
            self.frame * 1_000_000_000,
            self.scene,
            ids,
            np.array([boxes[i] for i in ids], np.float64).reshape(-1, 4),
            [i in split for i in ids],
            [i not in absent for i in ids],
        )
        return [(c.kind, c.id) + ((c.zone,) if c.zone else ()) for c in changes]


def test_in_and_out() -> None:
    walk = Walk()
    assert walk.step({1: (40, 90, 20, 20)}) == [("entering", 1)]
    assert walk.step({1: (45, 90, 20, 20)}) == []
    assert walk.step({1: (50, 90, 20, 20)}) == [("entered", 1)]
    assert walk.step({1: (32, 90, 20, 20)}) == []
    assert walk.step({1: (20, 90, 20, 20)}) == [("exiting", 1)]
    assert walk.step({1: (0, 90, 20, 20)}) == [("exited", 1)]
    assert walk.step({}) == []


def test_back_from_the_edge_and_gone_from_it() -> None:
    walk = Walk()
    walk.step({1: (60, 90, 20, 20)})
    walk.step({1: (60, 90, 20, 20)})
    assert walk.step({1: (20, 90, 20, 20)}) == [("exiting", 1)]
    assert walk.step({1: (60, 90, 20, 20)}) == [("returned", 1)]
    assert walk.step({1: (20, 90, 20, 20)}) == [("exiting", 1)]
    assert walk.step({}) == [("exited", 1)]


def test_who_stands_on_the_rois_edge_makes_one_entry_and_no_more() -> None:
    walk = Walk()
    kinds = [k for f in range(40) for k in walk.step({1: (45 + 6 * (f % 2), 90, 20, 20)})]
    assert kinds == [("entering", 1), ("entered", 1)]


def test_who_stands_on_the_outer_edge_does_not_come_and_go() -> None:
    walk = Walk()
    walk.step({1: (60, 90, 20, 20)})
    walk.step({1: (60, 90, 20, 20)})
    kinds = [k for f in range(40) for k in walk.step({1: (28 + 4 * (f % 2), 90, 20, 20)})]
    assert kinds == [("exiting", 1)]


def test_outside_and_in_again_without_removal() -> None:
    walk = Walk()
    walk.step({1: (60, 90, 20, 20)})
    walk.step({1: (60, 90, 20, 20)})
    assert walk.step({1: (0, 90, 20, 20)}) == [("exited", 1)]
    assert walk.step({1: (20, 90, 20, 20)}) == []
    assert walk.step({1: (40, 90, 20, 20)}) == [("entering", 1)]
    assert walk.step({1: (60, 90, 20, 20)}) == [("entered", 1)]


def test_who_is_not_in_the_picture_keeps_its_status_until_wholly_outside() -> None:
    walk = Walk()
    walk.step({1: (60, 90, 20, 20)})
    walk.step({1: (60, 90, 20, 20)})
    assert walk.step({1: (20, 90, 20, 20)}, absent=(1,)) == []
    assert walk.step({1: (0, 90, 20, 20)}, absent=(1,)) == [("exited", 1)]


ZONES = Regions(
    200,
    200,
    REGIONS.roi,
    REGIONS.border,
    [Zone("shop", square(50, 50, 100, 150)), Zone("door", square(90, 50, 120, 150))],
)


def test_named_zones_and_the_time_in_them() -> None:
    walk = Walk(ZONES)
    assert walk.step({1: (60, 90, 20, 20)}) == [
        ("entering", 1),
        ("zone_entered", 1, "shop"),
    ]
    assert walk.step({1: (85, 90, 20, 20)}) == [("entered", 1), ("zone_entered", 1, "door")]
    assert walk.step({1: (105, 90, 20, 20)}) == [("zone_left", 1, "shop")]
    walk.frame += 1
    changes = walk.book.step(3_000_000_000, walk.scene, [], np.zeros((0, 4)), [], [])
    assert [(c.kind, c.zone, c.lasted_ns, c.reason) for c in changes] == [
        ("zone_left", "door", 2_000_000_000, "the track ended here")
    ]


def test_a_target_stands_at_its_foot_unless_told_otherwise() -> None:
    tall = {1: (60, 40, 20, 120)}  # foot at 160, under the zone; centre in it
    assert ("zone_entered", 1, "shop") not in Walk(ZONES).step(tall)
    assert ("zone_entered", 1, "shop") in Walk(ZONES, zone_point="centre").step(tall)


def test_default_regions_follow_the_picture() -> None:
    regions = default_regions(768, 576)
    assert regions.source == "default"
    assert regions.border == [square(5.76, 5.76, 768 - 5.76, 576 - 5.76)]
    assert regions.roi[0][0] == (0.04 * 576, 0.04 * 576)
    tight = default_regions(768, 576, RegionParameters(roi_inset=0.0, border_inset=0.1))
    assert tight.roi == tight.border


def test_a_border_that_does_not_hold_the_roi_is_joined_with_it() -> None:
    scene = SceneRegions(
        Regions(
            200, 200, [square(0.0, 0.0, 100.0, 100.0)], [square(100.0, 0.0, 120.0, 100.0)]
        )
    )
    assert scene.places(np.array([[80.0, 10, 40, 20]])).area == [WHOLLY]
    assert scene.must_remove((80, 10, 60, 20), "appearance", 0.0) is not None


def test_a_roi_of_several_slanted_polygons() -> None:
    roi = [
        [(0.0, 0.0), (40.0, 0.0), (60.0, 100.0), (0.0, 100.0)],
        [(40.0, 0.0), (100.0, 0.0), (100.0, 100.0), (60.0, 100.0)],
    ]
    walk = Walk(Regions(200, 200, roi, []))
    assert walk.step({1: (30, 20, 40, 40)}) == [("entering", 1)]
    assert walk.step({1: (30, 20, 40, 40)}) == [("entered", 1)]


def test_state_is_plain_and_continues() -> None:
    walk, twin = Walk(ZONES), Walk(ZONES)
    walk.step({1: (60, 90, 20, 20), 2: (100, 60, 9, 9)}, split=(2,))
    twin.book.restore(json.loads(json.dumps(walk.book.state())))
    twin.frame = walk.frame
    for boxes in ({1: (85, 90, 20, 20)}, {1: (20, 90, 20, 20)}, {}):
        assert walk.step(boxes) == twin.step(boxes)
        assert walk.book.state() == twin.book.state()
