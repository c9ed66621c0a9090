"""Who is in front of whom: a frame's evidence, and what is told of it over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fixtures.logs import record_scene
from fixtures.scenes import generate
from recorders.messages import Notice
from replay.trackers.shells.depth import Depth
from replay.trackers.shells.foreground import Cut
from replay.trackers.shells.membership import Claimants
from replay.trackers.shells.order import Order, confidence
from replay.trackers.shells.parameters import ShellsParameters

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"
FULL = np.full((16, 16), 255, np.uint8)
DT = 0.04


def overlapping(front: int) -> Depth:
    """Two squares of 20 pixels that overlap by half, the overlap's pixels those of claimant
    ``front``.
    """
    boxes = np.array([[5.0, 5.0, 20.0, 20.0], [15.0, 5.0, 20.0, 20.0]])
    owner = np.zeros((30, 40), np.uint16)
    for k in (1 - front, front):
        x, y, w, h = boxes[k].astype(int)
        owner[y : y + h, x : x + w] = k + 1
    who = Claimants(boxes, np.array([30.0, 30.0]), [None, None], [FULL, FULL])
    return Depth(
        who, owner, Cut(owner > 0, owner == 0, (owner > 0).astype(np.uint16), 0, 0)
    )


@pytest.mark.parametrize("front", [0, 1])
def test_who_has_its_whole_area_and_the_overlaps_pixels_is_in_front(front: int) -> None:
    depth = overlapping(front)
    visible = [1.0, 0.5] if front == 0 else [0.5, 1.0]
    lead = depth.lead(0, 1, visible)
    assert lead is not None
    assert (lead > 0.5) if front == 0 else (lead < -0.5)
    assert depth.lead(1, 0, visible) == pytest.approx(-lead)
    pixels_alone = depth.lead(0, 1, [1.0, 1.0])
    assert pixels_alone is not None
    assert (pixels_alone > 0) == (front == 0)


def test_who_does_not_overlap_tells_nothing() -> None:
    boxes = np.array([[0.0, 0.0, 10.0, 10.0], [20.0, 0.0, 10.0, 10.0]])
    owner = np.zeros((20, 40), np.uint16)
    who = Claimants(boxes, np.array([9.0, 9.0]), [None, None], [FULL, FULL])
    cut = Cut(owner > 0, owner == 0, owner.astype(np.uint16), 0, 0)
    assert Depth(who, owner, cut).lead(0, 1, [1.0, 0.2]) is None


def told(order: Order, lead: float | None, frames: int) -> list[Notice]:
    leads = {} if lead is None else {(3, 7): lead}
    return [n for _ in range(frames) for n in order.step([(3, 7)], leads, DT)]


def test_verdicts_wait_for_agreeing_frames_change_with_the_evidence_and_end_with_the_joint() -> (
    None
):
    order = Order(ShellsParameters())
    assert not told(order, 0.6, 3)
    first = told(order, 0.6, 30)
    assert [n.subjects for n in first] == [[7, 3]]  # the first subject is behind
    assert first[0].kind == "occluded"
    assert 0.8 < first[0].evidence["confidence"] < 0.95
    other = Order(ShellsParameters())
    other.restore(order.state())
    for o in (order, other):
        assert [n.subjects for n in told(o, -0.6, 60)] == [[3, 7]]
        assert not told(o, None, 20)
    assert not order.step([], {}, DT)
    assert not told(order, -0.6, 3)  # another JOINT begins anew
    assert not told(Order(ShellsParameters()), 0.1, 500)


def test_confidence_grows_with_the_evidence_and_is_never_certain() -> None:
    levels = [confidence(e) for e in (0.0, 0.1, 0.3, 1.0)]
    assert levels[0] == 0.5
    assert levels == sorted(levels)
    assert levels[-1] < 0.95


@pytest.mark.parametrize(("name", "seed"), [("pass_by", 20), ("full_occlusion", 21)])
def test_generated_people_are_told_the_right_way_round(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, seed: int
) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import shells_measures

    scene = generate(name, seed=seed)
    result = shells_measures.judge_order(
        scene, record_scene(scene, tmp_path / "scene.mcap")
    )
    assert result.right >= 1
    assert result.wrong == result.neither == 0
    assert result.told >= 1
