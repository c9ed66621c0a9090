"""Detector and masks together: who is believed, where bodies are, and that nothing gets lost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from recorders.detectors.suppression import overlaps
from recorders.fusion import FusedFrames, FusionParameters
from recorders.fusion.belief import SCORES, SHOWN, SIZES, UNTOLD, WAYS, Belief, way_of
from recorders.fusion.chains import Chains
from recorders.fusion.heights import LARGE, SMALL, UNKNOWN, USUAL, Heights
from recorders.fusion.holding import masks_hold
from recorders.fusion.hypotheses import corners_of, covered_ones, hypotheses
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


def test_what_is_usual_are_frequencies_of_three_kinds() -> None:
    for table in (SCORES, SIZES, WAYS):
        assert table.sum(axis=1) == pytest.approx([1.0] * 3)
    assert ((SHOWN > 0) & (SHOWN < 1)).all()


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


# -- poor sources ----------------------------------------------------------------------------------


def walkers(k: int) -> list[Box]:
    """Two who walk and one who comes, stands from the third second on."""
    return [walker(k, 10, 2), (250.0 - 2 * k, 40.0, 26.0, 70.0), walker(min(k, 30), 150, 2)]


def jittered(box: Box, rng: np.random.Generator, share: float) -> Box:
    off = rng.normal(0, share, 4)
    x, y, w, h = box
    grown = np.exp(off[2:])
    return x + w * off[0], y + h * off[1], w * float(grown[0]), h * float(grown[1])


def hits(out: list[Detections], truth: list[list[Box]]) -> tuple[float, float]:
    """The shares of the true boxes that were found, and of what was found that is none, after the
    first two seconds.
    """
    found = none = true = 0
    for d, boxes in list(zip(out, truth, strict=True))[20:]:
        true += len(boxes)
        shares = overlaps(corners_of(d.boxes), corners_of(boxes)) >= 0.5
        found += int(shares.any(axis=0).sum())
        none += int((~shares.any(axis=1)).sum())
    return found / true, none / true


POSTERS: list[Box] = [(290.0, 150.0, 25.0, 70.0), (5.0, 5.0, 25.0, 70.0)]


def poor_detector(kind: str, k: int, rng: np.random.Generator) -> list[tuple[Box, float]]:
    boxes = [jittered(b, rng, 0.03) for b in walkers(k)]
    if kind == "misses half":
        boxes = [b for b in boxes if rng.random() < 0.5]
    if kind == "misses most":
        boxes = [b for b in boxes if rng.random() < 0.2]
    if kind == "shifted":
        boxes = [shifted(b, 0.12 * b[2], -0.05 * b[3]) for b in boxes]
    scores = [float(rng.uniform(0.6, 0.85)) for _ in boxes]
    if kind == "hardly sure":
        scores = [0.7 * score for score in scores]
    if kind == "posters":
        boxes += [jittered(b, rng, 0.01) for b in POSTERS if rng.random() < 0.7]
        scores += [float(rng.uniform(0.45, 0.7)) for _ in boxes[len(scores) :]]
    return list(zip(boxes, scores, strict=True)) if kind != "blind" else []


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    "kind", ["misses half", "misses most", "shifted", "hardly sure", "posters", "blind"]
)
def test_a_poor_detector_does_not_pull_good_masks_down(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames = [(walkers(k), poor_detector(kind, k, rng)) for k in range(90)]
    found, none = hits(fused(frames), [walkers(k) for k in range(90)])
    assert found >= 0.97
    assert none <= 0.03


def poor_masks(kind: str, k: int, rng: np.random.Generator) -> list[Box]:
    boxes = walkers(k)
    if kind == "noise":  # bodies in half of the frames, and flicker
        boxes = [b for b in boxes if rng.random() < 0.5]
        return boxes + [
            (float(rng.uniform(0, 300)), float(rng.uniform(0, 220)), 9.0, 9.0)
            for _ in range(6)
        ]
    if kind == "half the contrast":  # lower halves are lost, and who stands
        return [(x, y, w, 0.55 * h) for x, y, w, h in boxes[:2] if rng.random() < 0.7]
    branches = [(100.0 + 40 * i + 5 * np.sin(k + i), 2.0, 35.0, 60.0) for i in range(4)]
    return boxes + branches  # waving tree


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", ["noise", "half the contrast", "waving tree"])
def test_poor_masks_do_not_pull_a_good_detector_down(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = [walkers(k) for k in range(90)]
    frames: list[Given] = []
    for k in range(90):
        seen = [
            (jittered(b, rng, 0.02), float(rng.uniform(0.7, 0.9)))
            for b in truth[k]
            if rng.random() < 0.95
        ]
        frames.append((poor_masks(kind, k, rng), seen))
    alone = [detector(k, *theirs) for k, (_, theirs) in enumerate(frames)]
    found, none = hits(fused(frames), truth)
    assert found >= hits(alone, truth)[0] - 0.01
    assert none <= 0.03


def test_a_poster_that_never_came_is_less_believed_than_who_came_and_stands() -> None:
    worth = Belief(FPS, 1.0).worth
    stands, came = (way_of(reach, 4.0) for reach in (0.05, 2.0))
    assert worth.ways[1, stands] < 0 < worth.ways[1, came]
    assert way_of(0.05, 0.5) == UNTOLD


def test_who_is_not_seen_for_a_second_goes_on_with_how_far_he_came() -> None:
    chains = Chains(FPS)
    for k in range(30):
        (before,) = chains.link(k, hypotheses(masks(k, walker(k)), detector(k)))
    last = walker(29)
    (after,) = chains.link(40, hypotheses(masks(40), detector(40, (last, 0.9))))
    assert after is not before
    assert after.reach == before.reach > 2
    (late,) = chains.link(90, hypotheses(masks(90), detector(90, (last, 0.9))))
    assert late.reach == 0.0


def test_a_detectors_box_within_a_body_that_both_have_is_covered() -> None:
    body, inside, beside = walker(0), shifted(walker(0), 2, 2), shifted(walker(0), 40)
    inside = (inside[0], inside[1], 20.0, 30.0)
    found = hypotheses(
        masks(0, body), detector(0, (body, 0.9), (inside, 0.5), (beside, 0.8))
    )
    assert [found[k].detected for k in covered_ones(found)] == [inside]


# -- masks that hold -------------------------------------------------------------------------------


def sampled(share: float, many: int = 40) -> tuple[dict[int, list[Box]], list[Detections]]:
    """Pictures with one body each that the detector is sure of; masks have a share of them."""
    there = {k: [walker(k % 10)] if k < share * many else [] for k in range(many)}
    return there, [detector(k, (walker(k % 10), 0.9)) for k in range(many)]


def test_masks_hold_that_have_whom_the_detector_is_sure_of() -> None:
    assert masks_hold(*sampled(1.0))
    assert masks_hold(*sampled(0.95))
    assert not masks_hold(*sampled(0.8))
    assert not masks_hold(*sampled(1.0, many=15))
    assert not masks_hold({}, sampled(1.0)[1])


def test_masks_hold_where_the_detector_finds_next_to_nobody() -> None:
    there = {k: [walker(0), walker(0, 150)] for k in range(40)}
    assert masks_hold(there, [detector(k) for k in range(40)])


def test_masks_that_hold_stay_as_they_are_without_what_is_none() -> None:
    spot, ghost = (200.0, 20.0, 12.0, 9.0), (250.0, 150.0, 30.0, 80.0)
    frames = [
        ([walker(k), spot], [(shifted(walker(k), 4), 0.9), (ghost, 0.41)])
        for k in range(60)
    ]
    given = [(masks(k, *m), detector(k, *d)) for k, (m, d) in enumerate(frames)]
    line = FusedFrames(
        FusionParameters(), HEIGHT, FPS, [d for _, d in given], masks_hold=True
    )
    out = [d for m, d in given for d in line.add(m, d)] + line.finish()
    for k, d in list(enumerate(out))[15:]:
        assert (d.boxes, d.labels, d.blobs, d.fused) == (
            [walker(k)],
            ["person"],
            [1],
            False,
        )
        assert d.components == given[k][0].components


def test_who_melted_into_a_background_that_holds_is_put_where_nothing_is() -> None:
    stands = walker(30)
    given = []
    for k in range(80):
        seen = detector(k, (walker(min(k, 30)), 0.9))
        mine = masks(k, walker(k)) if k <= 30 else masks(k)
        given.append((mine, replace(seen, blobs=[1 if k <= 30 else NO_BLOB])))
    line = FusedFrames(
        FusionParameters(), HEIGHT, FPS, [d for _, d in given], masks_hold=True
    )
    out = [d for m, d in given for d in line.add(m, d)] + line.finish()
    assert [len(d.boxes) for d in out] == [1] * 80
    assert out[-1].boxes[0] == pytest.approx(stands, abs=1)
    assert (out[-1].blobs, out[-1].labels) == ([NO_BLOB], ["person"])
