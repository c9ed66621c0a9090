"""Differences of features from frame to frame: of the same target, and of what it could be taken
for.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recorders.errors import SceneTraceError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.scene import Frame, SceneLog
from replay.evaluate.truth import MotTable, fit_truth, read_truth
from replay.sealing.manifest import file_digest
from replay.trackers.association import intersection
from replay.trackers.parts.features import (
    FEATURES,
    ONE,
    Measured,
    PartsModel,
    Pixels,
    differences,
    measure,
)
from replay.trackers.parts.parameters import PartsParameters
from replay.trackers.parts.regions import ALPHA, BETA, PARTS, parts_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

COVERED = 0.15
"""Targets that a nearer one covers more than this are left out: what would be compared is the
other's.
"""
SHIFTS = ((-0.6, 0.0), (0.6, 0.0), (0.0, -0.25), (0.0, 0.25), (-0.4, 0.15), (0.4, -0.15))
"""Misaligned candidates, in widths and heights."""
LATER_S = 1.0
"""How old what was learnt is when the weights are judged, in seconds."""
UNSURE = ((0.5, 0.0), (0.0, 0.0), (0.0, 0.5), (-0.5, 0.0), (0.0, 0.0), (0.0, -0.5))
"""How far the last place then is off, in half gates, in turn."""
UNSURE_PLACE = 0.09
"""What a tracker's place is off, in heights: the filter's and the measurement's."""
OFF = (
    (0.1, 0.03, 1.0),
    (-0.1, 0.0, 0.95),
    (0.05, -0.03, 1.05),
    (0.0, 0.05, 1.0),
    (-0.05, -0.02, 1.05),
    (0.1, 0.0, 0.9),
)
"""How far a tracker's boxes are off, in turn: in widths, in heights, and in size. Truth alone
would be too strict.
"""
MOST = 400
"""Pairs of frames from one recording, so that none outweighs the others."""
NEAR = 2.0
"""Others within this many heights could be taken for the target."""


@dataclass(frozen=True)
class FeatureSamples:
    """Differences of one or several recordings.

    Attributes:
        steps: (S, 5, 6) in [0, 255]: the same target in frames that follow one another, which the
            models are fitted to.
        step_folds: (S,) part of the cross-validation: the recording, or the half of its truth
            where there is only one.
        differences: (N, 5, 6) of candidates against what was learnt `LATER_S` before, from a
            place that is not exactly known, as after an occlusion: what the weights are fitted
            to.
        groups: (N,) target and frame that the row belongs to; rows of a group follow one another,
            the match first.
        folds: (N,) as ``step_folds``.
        names: the recordings, with what was taken from each.
    """

    steps: Ints
    step_folds: Ints
    differences: Ints
    groups: Ints
    folds: Ints
    names: tuple[str, ...]

    @property
    def matching(self) -> NDArray[np.bool_]:
        """Which of ``differences`` are the same target, (N,) bool."""
        return np.asarray(np.diff(self.groups, prepend=-1) > 0)


def collect(
    pairs: Sequence[tuple[Path, Path]],
    truth_sizes: Sequence[tuple[int, int] | None] | None = None,
    camera: str | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> FeatureSamples:
    """Read annotated recordings.

    Args:
        pairs: scene log and truth of each.
        truth_sizes: (width, height) of the picture that each truth was labelled in, None: its
            recording's.
        camera: which camera, where the logs have several.
        limits: what a log may ask for.

    Raises:
        SceneTraceError: a recording has no pictures or masks, or no truth that can be used.
    """
    steps: list[Ints] = []
    step_folds: list[int] = []
    rows: list[Ints] = []
    folds: list[int] = []
    names: list[str] = []
    _all_different([scene for scene, _ in pairs])
    sizes = truth_sizes or [None] * len(pairs)
    for fold, ((scene, truth), size) in enumerate(zip(pairs, sizes, strict=True)):
        found: list[tuple[int, Ints, Ints]] = []
        with SceneLog(scene, camera, limits) as log:
            if not (log.info.has_images and log.info.has_masks):
                raise SceneTraceError(
                    f"{scene}: no pictures or no foreground masks; the features are made of"
                    " them"
                )
            table = fit_truth(read_truth(truth), (log.info.width, log.info.height), size)
            for window in _windows(log, table):
                half = int(window[-1].share * 2) if len(pairs) == 1 else fold
                found += [(half, step, group) for step, group in _of_frame(window)]
        if not found:
            raise SceneTraceError(
                f"{truth}: no target is seen free in two frames of {scene} that follow one"
                " another"
            )
        every = -(-len(found) // MOST)
        for half, step, group in found[::every]:
            steps.append(step)
            step_folds.append(half)
            rows.append(group)
            folds += [half] * len(group)
        names.append(
            f"{scene.name} with {truth.name} ({len(found[::every])} pairs of frames)"
        )
    groups = np.repeat(np.arange(len(rows)), [len(row) for row in rows])
    return FeatureSamples(
        np.stack(steps), np.array(step_folds, np.int64), np.concatenate(rows), groups, np.array(folds, np.int64),
        tuple(names),
    )  # fmt: skip


def _all_different(scenes: list[Path]) -> None:
    """Refuse a recording that is given twice: what is held out would have been fitted on."""
    known: dict[str, Path] = {}
    for path in scenes:
        _, digest = file_digest(path)
        if digest in known:
            raise SceneTraceError(
                f"{path}: the same recording as {known[digest]}; give each once"
            )
        known[digest] = path


@dataclass(frozen=True)
class _SeenBody:
    """One frame's truth: ids, boxes (T, 4), gates (T,), who is free (T,); its pixels; its place
    in the recording.
    """

    index: int
    ids: list[int]
    boxes: Floats
    gates: Floats
    free: NDArray[np.bool_]
    pixels: Pixels
    share: float

    def is_free(self, identity: int) -> bool:
        """Whether the target is there and nobody covers it."""
        return identity in self.ids and bool(self.free[self.ids.index(identity)])

    def box(self, identity: int) -> Floats:
        """The target's box."""
        return np.asarray(self.boxes[self.ids.index(identity)])

    def gate(self, identity: int) -> float:
        """Half side of its gate."""
        return float(self.gates[self.ids.index(identity)])


def _windows(log: SceneLog, table: MotTable) -> Iterator[list[_SeenBody]]:
    """Every frame from the second on, with those of the `LATER_S` before it, oldest first."""
    frame_s = log.info.frame_ns * 1e-9
    window: deque[_SeenBody] = deque(maxlen=max(2, round(LATER_S / max(frame_s, 1e-3))) + 1)
    # The truth may reach beyond the recording, on either side.
    shared = table.frames[
        np.isin(table.frames, [index for index, _ in enumerate(log.frame_times())])
    ]
    span = (int(shared[0]), int(shared[-1]) + 1) if len(shared) else (0, 1)
    for frame in log.frames():
        window.append(_look(frame, table, frame_s, span))
        if len(window) > 1:
            yield list(window)


def _look(
    frame: Frame, table: MotTable, frame_s: float, span: tuple[int, int]
) -> _SeenBody:
    low, high = np.searchsorted(table.frames, [frame.index, frame.index + 1])
    boxes = table.boxes[low:high]
    ids = table.ids[low:high].tolist()
    earlier_low, earlier_high = np.searchsorted(
        table.frames, [frame.index - 1, frame.index]
    )
    last_ids = table.ids[earlier_low:earlier_high].tolist()
    earlier = dict(zip(last_ids, table.centres[earlier_low:earlier_high], strict=True))
    speed = np.array(
        [0.0 if identity not in earlier else float(np.hypot(*(centre - earlier[identity]))) / frame_s
         for identity, centre in zip(ids, table.centres[low:high], strict=True)]
    )  # fmt: skip
    parameters = PartsParameters()
    gates = np.minimum(
        parameters.gate_speeds * speed * frame_s
        + parameters.gate_sigmas * UNSURE_PLACE * boxes[:, 3],
        parameters.gate_most * boxes[:, 3],
    )
    foot = boxes[:, 1] + boxes[:, 3]
    share = intersection(boxes, boxes) / np.maximum(boxes[:, 2] * boxes[:, 3], 1.0)[:, None]
    np.fill_diagonal(share, 0.0)
    free = (share * (foot[None, :] >= foot[:, None])).max(axis=1, initial=0.0) <= COVERED
    assert frame.mask is not None
    pixels = Pixels(
        frame.evenly_lit, frame.mask, (frame.mask.shape[1], frame.mask.shape[0])
    )
    place = min(max((frame.index - span[0]) / (span[1] - span[0]), 0.0), 0.999)
    return _SeenBody(frame.index, ids, boxes, gates, free, pixels, place)


def _of_frame(window: list[_SeenBody]) -> Iterator[tuple[Ints, Ints]]:
    """For every target that is free in this frame and the one before: its step, and its
    candidates.
    """
    now, before = window[-1], window[-2]
    for index, identity in enumerate(now.ids):
        if not now.free[index] or not before.is_free(identity):
            continue
        box, old, gate = (
            _off(now.boxes[index], now.index + identity),
            before.box(identity),
            before.gate(identity),
        )
        one = np.zeros(1, np.intp)
        recent = _learnt(before, window[-3] if len(window) > 2 else before, identity)
        step = _measured(
            now.pixels, box[None], old[None], old[None], np.array([gate]), recent.centroid
        )
        oldest = next(index for index, seen in enumerate(window) if seen.is_free(identity))
        learnt = _learnt(window[oldest], window[max(oldest - 1, 0)], identity)
        away = np.abs(now.boxes[:, :2] - box[:2]).max(axis=1)
        others = [j for j in range(len(now.ids)) if j != index and away[j] <= NEAR * box[3]]
        shifted = [
            box + np.array([dx * box[2], dy * box[3], 0.0, 0.0]) for dx, dy in SHIFTS
        ]
        tried = np.concatenate([box[None], now.boxes[others], np.array(shifted)])
        dx, dy = UNSURE[(now.index + identity) % len(UNSURE)]
        was = np.repeat(
            (old + np.array([dx * gate, dy * gate, 0.0, 0.0]))[None], len(tried), axis=0
        )
        centroid = np.repeat(learnt.centroid, len(tried), axis=0)
        m = _measured(now.pixels, tried, was, was, np.full(len(tried), gate), centroid)
        yield (
            differences(recent, one, step)[0],
            differences(learnt, np.zeros(len(tried), np.intp), m),
        )


def _off(box: Floats, turn: int) -> Floats:
    """A box as a tracker might have found it."""
    dx, dy, size = OFF[turn % len(OFF)]
    x, y, w, h = box.tolist()
    return np.array(
        [
            x + dx * w + w * (1 - size) / 2,
            y + dy * h + h * (1 - size) / 2,
            w * size,
            h * size,
        ]
    )


def _learnt(seen: _SeenBody, before: _SeenBody, identity: int) -> PartsModel:
    """The parts model after one frame."""
    box = seen.box(identity)
    old = before.box(identity) if identity in before.ids else box
    model = PartsModel.empty(1)
    m = _measured(
        seen.pixels, box[None], box[None], old[None], np.array([seen.gate(identity)])
    )
    row = np.zeros(1, np.intp)
    model.learn(row, m, row, np.full((1, len(PARTS), len(FEATURES)), ONE, np.int64))
    return model


def _measured(
    pixels: Pixels,
    boxes: Floats,
    expected: Floats,
    before: Floats,
    gates: Floats,
    was: Ints | None = None,
) -> Measured:
    alpha, beta = np.full(len(boxes), ALPHA), np.full(len(boxes), BETA)
    return measure(
        pixels,
        parts_of(boxes, alpha, beta),
        parts_of(expected, alpha, beta),
        parts_of(before, alpha, beta),
        gates,
        was,
    )
