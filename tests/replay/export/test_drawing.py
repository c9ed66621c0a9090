"""Drawing: what must be seen, and that nothing a message holds can break it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recorders.annotated.membership import value_of
from recorders.messages import Event, Group, Relation, Track
from replay.draw import DrawOptions, Overlay, draw_frame, label, part_box
from replay.palette import COLOUR_COUNT, track_bgr
from replay.trackers.parts.regions import PARTS, parts_of
from tests.examples import examples


def track(
    identity: int = 1,
    box: tuple[float, float, float, float] = (20, 20, 20, 40),
    **facts: Any,
) -> Track:
    plain: dict[str, Any] = {
        "ellipse": None, "velocity": (0.0, 0.0), "shell_radius": 25.0, "mode": "motion", "confidence": 0.5,
        "present": True, "observed": True, "blob": -1, "grouping": False, "grouped": False, "splitting": False,
        "grouping_partners": [], "grouped_partners": [], "splitting_partners": [], "group": None, "scene": "inside",
    }  # fmt: skip
    return Track(id=identity, box=box, **{**plain, **facts})


def ground(value: int = 0) -> Any:
    return np.full((120, 160, 3), value, np.uint8)


PLAIN = DrawOptions(1.0, shells=False, labels=False)


@pytest.mark.parametrize("value", [0, 128, 255])
def test_a_box_shows_on_any_ground(value: int) -> None:
    picture = ground(value)
    drawn = draw_frame(picture, Overlay([track()]), PLAIN)
    left_edge = drawn[30:50, 18:23].astype(int)
    assert np.all(picture == value)
    assert np.abs(left_edge - value).max(axis=2).max() > 100
    assert np.all(drawn[30:50, 26:34] == value)


def test_colours_are_the_identitys_own_and_bright() -> None:
    assert track_bgr(5) == track_bgr(5)
    assert len({track_bgr(i) for i in range(40)}) == COLOUR_COUNT
    assert all(max(track_bgr(i)) >= 160 for i in range(40))
    a, b = (draw_frame(ground(), Overlay([track(i)]), PLAIN) for i in (1, 2))
    assert not np.array_equal(a, b)


def test_absent_and_unchosen_tracks_are_not_drawn() -> None:
    absent = Overlay([track(present=False)])
    assert np.array_equal(draw_frame(ground(), absent, PLAIN), ground())
    unchosen = draw_frame(
        ground(), Overlay([track(3)]), DrawOptions(1.0, only=frozenset({4}))
    )
    assert np.array_equal(unchosen, ground())


def test_pixels_and_events_of_the_unchosen_are_not_drawn_either() -> None:
    labels = np.zeros((120, 160), np.uint16)
    labels[20:60, 20:40], labels[20:60, 100:120] = value_of(1), value_of(2)
    tracks = [track(1), track(2, (100, 20, 20, 40))]
    event = Event(1, "entered", [2], 0, 0, "EVENTS 3.2", {}, "Target 2 has entered.")
    overlay = Overlay(tracks, membership=labels, events=[event])
    plain = replace(PLAIN, boxes=False)
    both, one, none = (
        draw_frame(ground(), overlay, replace(plain, only=only, membership=tint))
        for only, tint in ((None, True), (frozenset({1}), True), (frozenset({1}), False))
    )
    assert both[40, 110].any()
    assert both[100:].any(), "the event stands below"
    assert one[40, 30].any()
    assert not one[:, 50:].any()
    assert not none.any()


def test_joint_is_thicker_than_interaction() -> None:
    tracks = [track(1), track(2, (100, 20, 20, 40))]
    counts = []
    for state in ("INTERACTION", "JOINT"):
        edge = Relation(1, 2, state, 0, 0, False, False, False, 0.1)
        drawn = draw_frame(ground(200), Overlay(tracks, [edge]), PLAIN)
        counts.append(int(np.count_nonzero((drawn[:, 60:80] != 200).any(axis=2))))
    assert counts[1] > 1.5 * counts[0] > 0


def test_other_modes_are_dashed_and_named() -> None:
    solid, dashed = (
        np.count_nonzero(draw_frame(ground(), Overlay([track(mode=m)]), PLAIN))
        for m in ("motion", "appearance")
    )
    assert 0 < dashed < solid
    assert label(track(7)) == "7"
    assert label(track(7, mode="appearance", grouping=True)) == "7 appearance 0.50 grouping"


def test_parts_meet_at_the_centroid_that_the_track_tells() -> None:
    box = (10.0, 20.0, 30.0, 70.0)
    upright = track(box=box)
    assert part_box(upright, "head") == pytest.approx((10.0, 20.0, 30.0, 10.0))
    assert part_box(upright, "left_torso") == pytest.approx((10.0, 30.0, 15.0, 30.0))
    assert part_box(upright, "right legs") == pytest.approx((25.0, 60.0, 15.0, 30.0))
    leaning = track(box=box, centroid=(0.4, 0.25))
    found = [part_box(leaning, name) for name in PARTS]
    assert np.array(found) == pytest.approx(
        parts_of(np.array([box]), np.array([0.4]), np.array([0.25]))[0]
    )


def test_the_five_parts_are_drawn_and_hidden_ones_dashed() -> None:
    body: dict[str, Any] = {"box": (20.0, 20.0, 40.0, 70.0), "centroid": (0.3, 0.4)}
    whole = draw_frame(ground(), Overlay([track(**body)]), replace(PLAIN, model=True))
    hidden = draw_frame(
        ground(), Overlay([track(hidden_parts=["left_legs"], **body)]), PLAIN
    )
    # The line between the legs, at x = 32.
    solid, dashed = ((p[58:86, 31:34] != 0).any(axis=(1, 2)) for p in (whole, hidden))
    assert solid.all()
    assert dashed.any()
    assert not dashed.all()
    # And that between the halves of the torso above it, which only the whole model draws.
    assert (whole[34:50, 31:34] != 0).any(axis=(1, 2)).all()
    assert not hidden[34:50, 31:34].any()


def test_a_gate_is_drawn_unless_it_is_left_out() -> None:
    gated, plain = track(gate=(5.0, 5.0, 60.0, 70.0)), track()
    drawn = draw_frame(ground(), Overlay([gated]), PLAIN)
    assert drawn[5, 5:65].any()
    assert not draw_frame(ground(), Overlay([plain]), PLAIN)[5, 5:65].any()
    left_out = replace(PLAIN, gates=False)
    assert not draw_frame(ground(), Overlay([gated]), left_out)[5, 5:65].any()


def test_small_pictures_are_enlarged() -> None:
    assert draw_frame(ground(), Overlay()).shape == (720, 960, 3)
    assert draw_frame(np.zeros((1080, 1920, 3), np.uint8), Overlay()).shape == (
        1080,
        1920,
        3,
    )


def test_labels_keep_apart() -> None:
    """Two tracks in one place: both labels' grounds are to be seen."""
    both = draw_frame(
        ground(), Overlay([track(1), track(2)]), DrawOptions(1.0, boxes=False, shells=False)
    )
    for identity in (1, 2):
        assert np.count_nonzero((both == track_bgr(identity)).all(axis=2)) > 30


wild = st.floats(-1e7, 1e7, allow_nan=False)
sizes = st.floats(1e-3, 1e7, allow_nan=False)


@settings(max_examples=examples(40), deadline=None)
@given(
    st.lists(st.tuples(wild, wild, sizes, sizes), max_size=4), sizes, st.text(max_size=30)
)
def test_nothing_in_a_message_breaks_it(boxes: Any, radius: float, text: str) -> None:
    tracks = [
        track(k, b, shell_radius=radius, hidden_parts=[text], mode="predicted")
        for k, b in enumerate(boxes)
    ]
    edges = [Relation(0, 1, "JOINT", 0, 0, False, True, False, 1.0)]
    groups = [Group(1, list(range(len(boxes))), False, 0, 0)]
    events = [Event(1, "joined", [0], 0, 0, text, text=text)]
    drawn = draw_frame(
        ground(), Overlay(tracks, edges, groups, events, title=text), DrawOptions(1.0)
    )
    assert drawn.shape == (120, 160, 3)
