"""Who is who after two were at one place, by the paths before and after."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorders.evidence import unlike
from recorders.messages import Target, Targets
from recorders.parameters import configure
from recorders.scene import SceneInfo
from replay.hindsight import SECTIONS, rewrite
from replay.hindsight.crossings import Crossing, Crossings, named, near, uncrossed

FRAME_NS = 100_000_000
LENGTH, MET = 60, range(24, 36)
Place = tuple[float, float]


def _target(identity: int, place: Place, height: float, *, seen: bool = True) -> Target:
    x, y = place
    box = (x - height / 4, y - height / 2, height / 2, height)
    return Target(
        identity, box, (0.0, 0.0), measured=box if seen else None, observed=seen, likely=0.9
    )


def _pass(
    places: tuple[Sequence[Place], Sequence[Place]],
    heights: tuple[float, float],
    exchanged: bool,
) -> list[Targets]:
    """Two who meet, the second unseen meanwhile; whether each has the other's number afterwards."""
    frames = []
    for k in range(LENGTH):
        one, two = (2, 1) if exchanged and k >= MET.stop else (1, 2)
        here = [
            _target(one, places[0][k], heights[0]),
            _target(two, places[1][k], heights[1], seen=k not in MET),
        ]
        frames.append(Targets(k, sorted(here, key=lambda t: t.id)))
    return frames


def _across(by: float = 6.0) -> tuple[list[Place], list[Place]]:
    """One walks to the right, the other one to the left, behind him."""
    middle = (LENGTH - 1) / 2
    ways = [[(300 + s * by * (k - middle), 200.0) for k in range(LENGTH)] for s in (1, -1)]
    return ways[0], ways[1]


def _asked(frames: list[Targets]) -> Crossings:
    crossings = Crossings([k * FRAME_NS for k in range(len(frames))])
    assert list(crossings.watch(iter(frames))) == frames
    return crossings


@pytest.mark.parametrize("exchanged", [False, True])
@pytest.mark.parametrize("heights", [(80.0, 80.0), (60.0, 80.0)])
def test_who_goes_straight_on_is_who_he_was(
    exchanged: bool, heights: tuple[float, float]
) -> None:
    frames = _pass(_across(), heights, exchanged)
    found = _asked(frames).found
    assert [c.exchanged for c in found] == [True] * exchanged, (
        "who is plainly himself is not kept"
    )
    assert all(c.at in MET for c in found)
    mended = list(uncrossed(iter(frames), found))
    right = _pass(_across(), heights, False)
    # Until he is seen again it does not matter whose number is expected where.
    assert [mended[k] for k in (0, 20, 40, 59)] == [right[k] for k in (0, 20, 40, 59)]


def test_where_neither_reading_is_plain_the_trackers_word_stands_and_is_unsure() -> None:
    """Alike, and slow: they may have passed or turned back."""
    frames = _pass(_across(0.3), (80.0, 80.0), True)
    (crossing,) = _asked(frames).found
    assert not crossing.exchanged
    assert abs(crossing.straight - crossing.across) < 1.0
    assert crossing.odds > 0.05


def test_sizes_tell_where_paths_do_not() -> None:
    frames = _pass(_across(0.3), (60.0, 90.0), True)
    (crossing,) = _asked(frames).found
    assert crossing.exchanged


def _another() -> list[Targets]:
    """The second one comes out elsewhere, and much smaller."""
    ways = _across()
    far = [(x, y if k < MET.stop else y + 400.0) for k, (x, y) in enumerate(ways[1])]
    frames = _pass((ways[0], far), (80.0, 80.0), False)
    return frames[: MET.stop] + [
        Targets(k, [frames[k].targets[0], _target(2, far[k], 30.0)])
        for k in range(MET.stop, LENGTH)
    ]


def test_where_both_readings_are_dear_somebody_else_may_have_come_out() -> None:
    (crossing,) = _asked(_another()).found
    assert not crossing.exchanged
    assert crossing.odds > 0.2


@given(
    exchanges=st.lists(
        st.tuples(st.integers(1, 4), st.integers(1, 4)).filter(lambda p: p[0] < p[1]),
        max_size=6,
    )
)
def test_exchanges_add_up(exchanges: list[tuple[int, int]]) -> None:
    """Whatever was exchanged: undone, every body keeps the number that it began with."""
    body = {k: k for k in range(1, 5)}  # number -> body
    crossings, frames = [], []
    for at in range(len(exchanges) + 1):
        if at:
            a, b = exchanges[at - 1]
            body[a], body[b] = body[b], body[a]
            crossings.append(Crossing(a, b, at, 9.0, 0.0))
        here = [_target(k, (100.0 * body[k], 200.0), 80.0) for k in sorted(body)]
        frames.append(Targets(at, here))
    for answer in uncrossed(iter(frames), crossings):
        assert [(t.id, t.box[0]) for t in answer.targets] == [
            (k, 100.0 * k - 20.0) for k in range(1, 5)
        ]
    # A crossing's own names are those of the bodies before it.
    for found, (a, b) in zip(named(crossings[:1]), exchanges, strict=False):
        assert (found.a, found.b) == (a, b)


@given(
    boxes=st.lists(
        st.tuples(
            *(st.floats(0, 300, width=16) for _ in range(2)), *(st.floats(1, 90),) * 2
        ),
        max_size=8,
    )
)
def test_pairs_at_one_place_are_those_that_all_pairs_give(
    boxes: list[tuple[float, float, float, float]],
) -> None:
    rows = list(enumerate(boxes, 1))
    every = [
        (i, j)
        for i, (x, y, w, h) in rows
        for j, (u, v, wide, high) in rows
        if i < j
        and math.hypot(u + wide / 2 - x - w / 2, v + high / 2 - y - h / 2)
        < 0.7 * max(math.sqrt(max(w * h, 1.0)), math.sqrt(max(wide * high, 1.0)))
    ]
    assert near(rows) == every


@pytest.mark.parametrize("pictures", [False, True])
def test_hindsight_tells_of_an_exchange_and_is_less_sure(pictures: bool) -> None:
    """Where there are pictures colours tell, as the tracker has looked at them."""
    frames = _pass(_across(), (60.0, 80.0), True)
    scene = SceneInfo(640, 480, FRAME_NS, pictures, False)
    times = [k * FRAME_NS for k in range(LENGTH)]
    out = list(rewrite(lambda: iter(frames), scene, times, configure(SECTIONS, None, ())))
    right = {
        t.id for k in (50, 55) for t in out[k].targets if (t.box[3] < 70) == (t.id == 1)
    }
    assert right == (set() if pictures else {1, 2})
    told = [
        n for f in out for n in f.notices if n.kind == "identity" and "with" in n.evidence
    ]
    told = [n for n in told if "price_exchanged" in n.evidence]
    assert [n.subjects for n in told] == ([] if pictures else [[1], [2]])
    assert all(
        n.evidence["price_exchanged"] < n.evidence["price_as_themselves"] for n in told
    )
    assert not any(unlike(n.kind, n.evidence) for n in told)
    left = [t.identity for f in out for t in f.targets if t.id == 1]
    assert left == sorted(left, reverse=True)
    assert pictures or left[-1] < 1.0


def test_hindsight_tells_where_it_is_unsure_who_came_out() -> None:
    """Neither reading fits, and the others stand in the log."""
    frames = _another()
    times = [k * FRAME_NS for k in range(LENGTH)]
    scene = SceneInfo(640, 480, FRAME_NS, False, False)
    out = list(rewrite(lambda: iter(frames), scene, times, configure(SECTIONS, None, ())))
    told = [n for f in out for n in f.notices if "price_exchanged" in n.evidence]
    assert [(n.subjects, n.evidence["with"]) for n in told] == [([1], [2]), ([2], [1])]
    assert not any(unlike(n.kind, n.evidence) for n in told)
    assert all("exchanged" in n.evidence["alternative"] for n in told)
