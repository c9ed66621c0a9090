"""Trajectory criteria and errors of place and size: PARTS 5.2 (Table 1) and 5.3 (Table 2).

What the paper leaves open is fixed here. A frame of a trajectory counts as tracked where CLEAR
matches it. Averages per trajectory run over the trajectories that were found at all: the
fractions printed in Table 1 (3.11, 1.44 and 2.33 with one of ten missed) are ninths. Mostly lost
does not include missed, as in the table.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from replay.evaluate.clear import NONE, Matches
from replay.evaluate.identity import Identity
from replay.evaluate.overlap import Overlap
from replay.evaluate.truth import FloatArray, IntArray

MOSTLY_TRACKED = 0.8
MOSTLY_LOST = 0.4


@dataclass(frozen=True)
class Errors:
    """Mean absolute differences of centre x, centre y, width, height, in three normalisations.

    Attributes:
        coordinate: percent of the true value itself (centre x of centre x, width of width): x and
            y hang on where the picture's corner lies. At least one pixel is divided by.
        size: percent of the true size: x and width of the width, y and height of the height.
        pixels: in pixels.
        frames: pairs of boxes that the means run over.
        share: how many percent of the true boxes that is.
    """

    coordinate: tuple[float, float, float, float]
    size: tuple[float, float, float, float]
    pixels: tuple[float, float, float, float]
    frames: int
    share: float

    @property
    def headline(self) -> tuple[float, float, float, float]:
        """Centre x and y by coordinate, width and height by true size, in percent: as in PARTS,
        Table 2.
        """
        return self.coordinate[0], self.coordinate[1], self.size[2], self.size[3]


@dataclass(frozen=True)
class Trajectory:
    """One true trajectory: how it was tracked. Frames count from 0, ids are those of truth and
    result.

    Attributes:
        truth: its identity.
        first_frame, last_frame: where it begins and ends.
        frames: true boxes.
        tracked: of them matched.
        share: percent of `frames` tracked.
        ids: result identities matched to it, by the first frame of each.
        switches: changes from one result identity to another (CLEAR).
        swaps: of them to an identity whose last match was another trajectory (PARTS: ids swapped
            at a meeting).
        fragments: times it was found again after a gap.
        under_segmented: the first identity that it got had belonged to another trajectory before.
        error_px: mean distance of the matched centres in pixels, 0 if never matched.
    """

    truth: int
    first_frame: int
    last_frame: int
    frames: int
    tracked: int
    share: float
    ids: tuple[int, ...]
    switches: int
    swaps: int
    fragments: int
    under_segmented: bool
    error_px: float


@dataclass(frozen=True)
class Trajectories:
    """The nine criteria of PARTS 5.2, the errors of 5.3, and each trajectory.

    Attributes:
        count: true trajectories.
        mostly_tracked: tracked in more than 80 % of their frames.
        mostly_tracked_single_id: of them by one identity all along.
        mostly_lost: tracked in some, but less than 40 % of their frames.
        missed: never tracked.
        under_segmented: taken for a trajectory that existed already.
        over_segmented: given more than one identity.
        swaps_per_trajectory, ids_per_trajectory: means over the trajectories found.
        ids_per_frame: responses per true box that has one; a response is its match, and every
            unmatched result box that overlaps it enough, and no other true box more.
        matched: errors over all matched frames.
        followed: errors over all frames in which a trajectory and the one result identity that the
            identity score gives it both exist, however far apart.
        each: by identity.
    """

    count: int
    mostly_tracked: int
    mostly_tracked_single_id: int
    mostly_lost: int
    missed: int
    under_segmented: int
    over_segmented: int
    swaps_per_trajectory: float
    ids_per_trajectory: float
    ids_per_frame: float
    matched: Errors
    followed: Errors
    each: tuple[Trajectory, ...]


def trajectories(
    both: Overlap, matches: Matches, given: Identity, iou: float
) -> Trajectories:
    """Judge every true trajectory."""
    each = _each(both, matches)
    found = [t for t in each if t.tracked]
    mostly = [t for t in each if t.share > 100 * MOSTLY_TRACKED]
    return Trajectories(
        count=len(each),
        mostly_tracked=len(mostly),
        mostly_tracked_single_id=sum(len(t.ids) == 1 for t in mostly),
        mostly_lost=sum(t.share < 100 * MOSTLY_LOST for t in found),
        missed=len(each) - len(found),
        under_segmented=sum(t.under_segmented for t in each),
        over_segmented=sum(len(t.ids) > 1 for t in each),
        swaps_per_trajectory=sum(t.swaps for t in found) / max(1, len(found)),
        ids_per_trajectory=sum(len(t.ids) for t in found) / max(1, len(found)),
        ids_per_frame=_ids_per_frame(both, matches, iou),
        matched=_errors(both, matches.pairs),
        followed=_errors(both, _given_pairs(both, given)),
        each=tuple(each),
    )


def _each(both: Overlap, matches: Matches) -> list[Trajectory]:
    n, m = both.shape
    names = both.result_names.tolist()
    owner = [NONE] * m
    ids: list[dict[int, None]] = [{} for _ in range(n)]
    swaps, switches, under = [0] * n, [0] * n, [False] * n
    who = both.true_ids[both.true_row[matches.pairs]].tolist()
    by = both.result_ids[both.result_row[matches.pairs]].tolist()
    for i, r, switched in zip(who, by, matches.switched.tolist(), strict=True):
        taken = owner[r] not in (NONE, i)
        under[i] |= taken and not ids[i]
        switches[i] += switched
        swaps[i] += switched and taken
        ids[i][names[r]] = None
        owner[r] = i
    rows = np.bincount(both.true_ids, minlength=n)
    tracked = np.bincount(who, minlength=n)
    first, last = np.full(n, np.iinfo(np.int64).max), np.full(n, -1)
    np.minimum.at(first, both.true_ids, both.truth.frames)
    np.maximum.at(last, both.true_ids, both.truth.frames)
    distance = np.bincount(
        who, centre_distance(both, matches.pairs), minlength=n
    ) / np.maximum(tracked, 1)
    return [
        Trajectory(
            int(both.true_names[index]),
            first_frame=int(first[index]),
            last_frame=int(last[index]),
            frames=int(rows[index]),
            tracked=int(tracked[index]),
            share=100 * float(tracked[index] / rows[index]),
            ids=tuple(ids[index]),
            switches=switches[index],
            swaps=swaps[index],
            fragments=int(matches.fragments[index]),
            under_segmented=under[index],
            error_px=float(distance[index]),
        )
        for index in range(n)
    ]


def centre_distance(both: Overlap, pairs: IntArray) -> FloatArray:
    """Distance in pixels between the centres of each of ``pairs``."""
    d = (
        both.truth.centres[both.true_row[pairs]]
        - both.result.centres[both.result_row[pairs]]
    )
    return np.hypot(d[:, 0], d[:, 1])


def _ids_per_frame(both: Overlap, matches: Matches, iou: float) -> float:
    responses = np.zeros(len(both.truth), np.int64)
    free = np.ones(len(both.result), np.bool_)
    responses[both.true_row[matches.pairs]] = 1
    free[both.result_row[matches.pairs]] = False
    order = np.lexsort((both.true_row, -both.iou))
    order = order[(both.iou[order] >= iou) & free[both.result_row[order]]]
    _, best = np.unique(both.result_row[order], return_index=True)
    np.add.at(responses, both.true_row[order[best]], 1)
    answered = responses[responses > 0]
    return float(answered.mean()) if len(answered) else 0.0


def _given_pairs(both: Overlap, given: Identity) -> IntArray:
    """All pairs of boxes whose identities were given to one another."""
    table = np.full(both.shape[0] + 1, NONE)
    table[given.pairs[:, 0]] = given.pairs[:, 1]
    return np.flatnonzero(
        table[both.true_ids[both.true_row]] == both.result_ids[both.result_row]
    )


def _errors(both: Overlap, pairs: IntArray) -> Errors:
    truth, result = both.truth, both.result
    t, r = both.true_row[pairs], both.result_row[pairs]
    true = np.concatenate([truth.centres[t], truth.boxes[t, 2:]], axis=1)
    off = np.abs(np.concatenate([result.centres[r], result.boxes[r, 2:]], axis=1) - true)
    share = 100 * len(pairs) / max(1, len(truth))
    by_coordinate = 100 * off / np.maximum(np.abs(true), 1.0)
    by_size = 100 * off / np.maximum(true[:, [2, 3, 2, 3]], 1.0)
    return Errors(_mean(by_coordinate), _mean(by_size), _mean(off), len(pairs), share)


def _mean(values: FloatArray) -> tuple[float, float, float, float]:
    if not len(values):
        return 0.0, 0.0, 0.0, 0.0
    x, y, w, h = values.mean(axis=0).tolist()
    return x, y, w, h
