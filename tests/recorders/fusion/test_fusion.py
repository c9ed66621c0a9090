"""Detector and masks together: who is believed, where bodies are, and that nothing gets lost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from recorders.fusion import FusedFrames, FusionParameters
from recorders.fusion.belief import (
    BODY,
    BODY_SIZES,
    LARGE,
    OTHER,
    OTHER_SIZES,
    SIGNS,
    SMALL,
    UNKNOWN,
    USUAL,
    Heights,
)
from recorders.fusion.chains import Chains
from recorders.fusion.hypotheses import hypotheses
from recorders.fusion.steadiness import Steadiness
from recorders.messages import NO_BLOB, Blob, Box, Detections, Ellipse

FPS, WIDTH, HEIGHT = 10.0, 320, 240

Given = tuple[list[Box], list[tuple[Box, float]]]


def masks(frame: int, *boxes: tuple[float, float, float, float]) -> Detections:
    blobs = [
        Blob(k, box, 100, Ellipse(box[0], box[1], 20, 10, 0.0))
        for k, box in enumerate(boxes, 1)
    ]
    n = len(boxes)
    return Detections(
        frame, WIDTH, HEIGHT, list(boxes), [0.5] * n, ["object"] * n, [None] * n,
        list(range(1, n + 1)), blobs,
    )  # fmt: skip


def detector(
    frame: int, *found: tuple[tuple[float, float, float, float], float]
) -> Detections:
    """Boxes with a score; blob 7 stands for where they lie."""
    n = len(found)
    return Detections(
        frame, WIDTH, HEIGHT, [b for b, _ in found], [s for _, s in found],
        ["person"] * n, [None] * n, [7] * n,
    )  # fmt: skip


def fused(
    frames: Sequence[Given],
    sample: list[Any] | None = None,
    **parameters: Any,
) -> list[Detections]:
    """Frames of (masks' boxes, detector's boxes with scores) -> the detections of each."""
    given = [
        (masks(k, *mine), detector(k, *theirs)) for k, (mine, theirs) in enumerate(frames)
    ]
    sample = [d for _, d in given] if sample is None else sample
    line = FusedFrames(FusionParameters(**parameters), HEIGHT, FPS, sample)
    out = [d for m, d in given for d in line.add(m, d)]
    assert len(out) == max(0, len(frames) - line.ahead)
    out += line.finish()
    assert [d.frame for d in out] == list(range(len(frames)))
    return out


def walker(frame: int, x: int = 20, speed: int = 4) -> tuple[float, float, float, float]:
    return (float(x + speed * frame), 100.0, 30.0, 80.0)


def shifted(
    box: tuple[float, float, float, float], dx: float = 0.0, dy: float = 0.0
) -> tuple[float, float, float, float]:
    return (box[0] + dx, box[1] + dy, box[2], box[3])


def test_what_both_see_is_one_body_with_the_masks_blob_and_the_detectors_label() -> None:
    frames = [([walker(k)], [(shifted(walker(k), 3), 0.8)]) for k in range(40)]
    for k, d in enumerate(fused(frames)):
        ((x, *_),) = d.boxes
        assert walker(k)[0] <= x <= walker(k)[0] + 3
        assert (d.blobs, d.labels, d.fused) == ([1], ["person"], True)
        assert d.scores[0] > 0.9


def test_a_body_that_the_detector_misses_for_a_while_is_kept() -> None:
    frames = [([walker(k)], [] if 20 <= k < 26 else [(walker(k), 0.8)]) for k in range(60)]
    assert [len(d.boxes) for d in fused(frames)] == [1] * 60


def test_who_stands_still_and_melts_into_the_background_is_kept_by_the_detector() -> None:
    frames = []
    for k in range(120):
        box = walker(min(k, 30))
        frames.append(([box] if k <= 35 else [], [(box, 0.9)]))
    out = fused(frames)
    assert [len(d.boxes) for d in out] == [1] * 120
    assert out[-1].blobs == [7]


def test_reflections_that_a_detector_never_sees_go() -> None:
    spot = (200.0, 20.0, 12.0, 9.0)
    frames = [([walker(k), spot], [(walker(k), 0.9)]) for k in range(60)]
    assert all(len(d.boxes) == 1 for d in fused(frames)[15:])


def test_a_detectors_weak_doubles_go_where_the_masks_miss_nobody() -> None:
    ghost = (250.0, 150.0, 30.0, 80.0)
    frames = [
        ([walker(k)], [(walker(k), 0.9)] + ([(ghost, 0.5)] if k % 5 == 0 else []))
        for k in range(60)
    ]
    assert all(len(d.boxes) == 1 for d in fused(frames))


def test_masks_are_believed_where_the_detector_knows_nothing() -> None:
    frames: list[Given] = [([walker(k), walker(k, 60, 3)], []) for k in range(40)]
    assert [len(d.boxes) for d in fused(frames)] == [2] * 40


def test_the_detector_is_believed_where_the_masks_show_nothing() -> None:
    frames: list[Given] = [([], [(walker(k), 0.8)]) for k in range(40)]
    assert [len(d.boxes) for d in fused(frames)] == [1] * 40


def test_a_blob_of_two_who_are_detected_says_nothing_new() -> None:
    frames = []
    for k in range(60):
        a, b = walker(k), walker(k, 60)
        merged = (a[0], a[1], b[0] + b[2] - a[0], a[3])
        together = k >= 30
        frames.append(([merged] if together else [a, b], [(a, 0.9), (b, 0.9)]))
    assert [len(d.boxes) for d in fused(frames)] == [2] * 60


def test_the_steadier_source_counts_more() -> None:
    rng = np.random.default_rng(0)
    steady, shaken = [], []
    for k in range(80):
        box = walker(k, speed=2)
        noise = float(rng.normal(0, 4))
        steady.append(([box], [(shifted(box, noise), 0.9)]))
        shaken.append(([shifted(box, noise)], [(box, 0.9)]))

    def error(
        frames: list[
            tuple[
                list[tuple[float, float, float, float]],
                list[tuple[tuple[float, float, float, float], float]],
            ]
        ],
    ) -> float:
        boxes = [d.boxes[0][0] - walker(k, speed=2)[0] for k, d in enumerate(fused(frames))]
        return float(np.abs(boxes[20:]).mean())

    assert error(steady) < 0.8
    assert error(shaken) < 0.8


def test_boxes_stay_in_the_picture_and_blobs_among_the_components() -> None:
    frames = [([walker(k, 280)], [(walker(k, 285), 0.9)]) for k in range(9)]
    for d in fused(frames):
        assert all(x >= 0 and x + w <= WIDTH for x, _, w, _ in d.boxes)
        assert all(0 < blob <= len(d.components) for blob in d.blobs)


def test_it_does_not_look_further_ahead_than_it_says() -> None:
    frames = [([walker(k)], [(walker(k), 0.9)]) for k in range(30)]
    changed = [*frames[:25], *[([], []) for _ in range(5)]]
    a, b = (fused(f, sample=[], ahead_s=0.5) for f in (frames, changed))
    assert a[:20] == b[:20]


def test_the_same_frames_give_the_same_detections() -> None:
    rng = np.random.default_rng(3)
    frames: Any = [
        (
            [tuple(map(float, rng.integers(5, 90, 4))) for _ in range(4)],
            [(tuple(map(float, rng.integers(5, 90, 4))), float(rng.random()))] * 3,
        )
        for _ in range(40)
    ]
    assert fused(frames) == fused(frames)


@pytest.mark.parametrize("score", [-1.0, 7.5])
def test_scores_on_another_scale_are_of_boxes_that_were_chosen(score: float) -> None:
    frames: list[Given] = [([], [(walker(k), score)]) for k in range(20)]
    assert [len(d.boxes) for d in fused(frames)] == [1] * 20


def test_pairs_are_the_best_overlaps_and_doubles_of_the_detector_are_one() -> None:
    a, b = (10.0, 10.0, 20.0, 40.0), (60.0, 10.0, 20.0, 40.0)
    found = hypotheses(
        masks(0, a, b), detector(0, (shifted(b, 2), 0.9), (shifted(b, 4), 0.8), (a, 0.3))
    )
    assert [(h.row, h.column) for h in found] == [(0, 2), (1, 0)]
    assert [h.score for h in found] == [0.3, 0.9]


def test_weak_boxes_of_the_detector_alone_are_no_hypotheses() -> None:
    found = hypotheses(masks(0), detector(0, (walker(0), 0.39), (walker(0, 200), 0.41)))
    assert [(h.row, h.column) for h in found] == [(NO_BLOB, 1)]


def test_chains_follow_speed_over_a_gap() -> None:
    chains = Chains(FPS)
    first = None
    for k in (0, 1, 2, 3, 6, 7):
        one = hypotheses(masks(k, walker(k, speed=12)), detector(k))
        (chain,) = chains.link(k, one)
        first = first or chain
        assert chain is first


def test_usual_heights_grow_with_the_place_of_the_feet() -> None:
    heights = Heights(HEIGHT)
    assert heights.size_of(200, 80) == UNKNOWN
    for foot in range(60, 240, 10):
        heights.learn(foot, 0.4 * foot, 5.0)
    assert [heights.size_of(foot, 0.4 * foot) for foot in (70, 150, 230)] == [USUAL] * 3
    assert heights.size_of(230, 25) == SMALL
    assert heights.size_of(70, 100) == LARGE


def test_what_is_usual_are_frequencies_of_every_sign() -> None:
    assert len(BODY) == len(OTHER) == SIGNS
    for table in (BODY, OTHER, BODY_SIZES, OTHER_SIZES):
        assert sum(table) == pytest.approx(1.0)


def test_shares_are_even_before_anything_was_seen() -> None:
    assert Steadiness().shares() == pytest.approx([0.5] * 4)


@pytest.mark.parametrize(
    ("detected", "left"),
    [
        ((20.0, 100.0, 30.0, 80.0), [(50.0, 96.0, 40.0, 90.0)]),
        ((60.0, 100.0, 30.0, 80.0), [(16.0, 96.0, 44.0, 90.0)]),
        ((40.0, 100.0, 30.0, 80.0), [(16.0, 96.0, 24.0, 90.0), (70.0, 96.0, 20.0, 90.0)]),
    ],
    ids=["right of it", "left of it", "on both sides, narrow"],
)
def test_what_a_blob_has_beside_a_detected_body_is_another(
    detected: Box, left: list[Box]
) -> None:
    both = (16.0, 96.0, 74.0, 90.0)
    found = hypotheses(masks(0, both), detector(0, (detected, 0.8)))
    beside = [h.masked for h in found if h.masked is not None]
    assert beside == [box for box in left if box[2] >= 0.7 * 30] or beside == [both]


def test_who_rides_behind_one_whom_alone_the_detector_sees_is_kept() -> None:
    frames: list[Given] = []
    for k in range(40):
        front, behind = walker(k, 60), walker(k, 20)
        together = (behind[0], 100.0, 70.0, 80.0)
        mine = [together] if 15 <= k < 25 else [front, behind]
        theirs = [(front, 0.8)] + ([] if 15 <= k < 25 else [(behind, 0.8)])
        frames.append((mine, theirs))
    for k, found in enumerate(fused(frames)):
        assert len(found.boxes) == 2
        assert min(box[0] for box in found.boxes) == pytest.approx(20 + 4 * k, abs=3)


def test_a_box_of_the_masks_that_holds_two_is_nobodys_place() -> None:
    a, b = (40.0, 40.0, 40.0, 100.0), (85.0, 40.0, 30.0, 100.0)
    merged = (40.0, 40.0, 75.0, 100.0)
    found = hypotheses(masks(0, merged), detector(0, (a, 0.9), (b, 0.9)))
    assert [(h.masked, h.detected) for h in found] == [
        (merged, None),
        (None, a),
        (None, b),
    ]
