"""Layered data association (PARTS 4): features -> parts -> the whole target, then all targets
jointly.

Conflicts: every anchor goes to one target at most, by the joint assignment of highest total
score; it is made twice, first with everybody where they were last, then with everybody where the
first one put them, so that a part that somebody nearer covers counts as hidden. Two targets whose
boxes still all but coincide are told apart by their scores: the lower one (of equals the later
born) gives way and chooses again without that anchor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from replay.trackers.association import assign, iou
from replay.trackers.parts.candidates import Candidates
from replay.trackers.parts.features import DISPLACEMENT, Measured
from replay.trackers.parts.parameters import PartsParameters
from replay.trackers.parts.regions import covered
from replay.trackers.parts.scoring import FULL, Scorer

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Scored:
    """N candidates with their scores.

    Attributes:
        candidates: the candidates.
        measured: their features.
        features: (N, 5, 6) their parts' features' scores, of `FULL`.
        parts: (N, 5) their parts' scores, of `FULL`.
        rectangles: (N, 5, 4) their parts.
        foreground: (N, 5) foreground pixels of the parts.
        empty: (N, 5) bool: where the part should be is hardly any foreground, although there was.
        alike: (N,) bool: the colours by themselves are not all another's.
    """

    candidates: Candidates
    measured: Measured
    features: Ints
    parts: Ints
    rectangles: Floats
    foreground: Floats
    empty: Bools
    alike: Bools

    def kept(self, keep: NDArray[np.bool_] | slice, count: int | None = None) -> Scored:
        """Some of them, of ``count`` anchors (default: as many as before)."""
        return Scored(
            candidates=self.candidates.kept(keep, count),
            measured=self.measured.kept(keep),
            features=self.features[keep],
            parts=self.parts[keep],
            rectangles=self.rectangles[keep],
            foreground=self.foreground[keep],
            empty=self.empty[keep],
            alike=self.alike[keep],
        )


@dataclass(frozen=True)
class Match:
    """A target's place.

    Attributes:
        row: the target.
        candidate: row of the candidate.
        box: its box.
        score: global score, of `FULL`.
        hidden: (5,) parts that nearer targets cover.
        rival: the target that wanted the same anchor and had to give way, -1 for none.
    """

    row: int
    candidate: int
    box: Floats
    score: int
    hidden: Bools
    rival: int = -1


Refine = Callable[[int, Floats, float], Floats | None]
"""(target, box, reach in pixels) -> the box with the head where its image fits best, None if that
tells nothing.
"""


def trunks(boxes: Floats, share: float) -> Floats:
    """What bodies hide: so much of their boxes' (N, 4) width, in the middle."""
    out = boxes.copy()
    out[:, 0] += boxes[:, 2] * (1 - share) / 2
    out[:, 2] *= share
    return out


class Association:
    """One frame's layered association."""

    def __init__(
        self, scored: Scored, scorer: Scorer, p: PartsParameters, refine: Refine | None
    ) -> None:
        self._s, self._scorer, self._p, self._refine = scored, scorer, p, refine
        self._hidden_score = round(p.hidden_score * FULL)
        self._least = round(p.match_score * FULL)

    def solve(self, rows: NDArray[np.intp], boxes: Floats, taken: Floats) -> list[Match]:
        """Match targets and candidates.

        Args:
            rows: (T,) the targets that take part, in the order of their birth.
            boxes: (T, 4) where they were last.
            taken: (M, 4) boxes of targets that have been placed already.
        """
        if not len(rows) or not len(self._s.candidates.rows):
            return []
        where = {int(row): box for row, box in zip(rows, boxes, strict=True)}
        # What things in the scene hide is not there to be compared either.
        gone = self._s.empty & self._s.candidates.fitting[:, None]
        hidden = self._hidden(where, taken)
        matches = self._assign(
            rows,
            self._scorer.whole(self._s.parts, hidden | gone, self._hidden_score),
            hidden,
        )
        # Where nothing else is hidden than before, as where nobody else takes part, a second time
        # would be the same.
        if len(rows) == 1:
            return matches
        before, hidden = (
            hidden,
            self._hidden({**where, **{match.row: match.box for match in matches}}, taken),
        )
        if np.array_equal(before, hidden):
            return matches
        return self._assign(
            rows,
            self._scorer.whole(self._s.parts, hidden | gone, self._hidden_score),
            hidden,
        )

    def _hidden(self, where: dict[int, Floats], taken: Floats) -> Bools:
        """Which parts of each candidate nearer targets cover."""
        c = self._s.candidates
        if not self._s.measured.known[:DISPLACEMENT].any():
            # Boxes alone: a detection is there whoever stands before it.
            return np.zeros(self._s.parts.shape, bool)
        others = np.concatenate([np.array(list(where.values())).reshape(-1, 4), taken])
        owner = np.array([*where, *[-1] * len(taken)])
        foot = c.boxes[:, 1] + c.boxes[:, 3]
        nearer = (others[:, 1] + others[:, 3])[None, :] > (
            foot + self._p.nearer * c.boxes[:, 3]
        )[:, None]
        nearer &= owner[None, :] != c.rows[:, None]
        return (
            covered(self._s.rectangles, trunks(others, self._p.trunk), nearer)
            >= self._p.hidden_cover
        )

    def _assign(self, rows: NDArray[np.intp], scores: Ints, hidden: Bools) -> list[Match]:
        c = self._s.candidates
        best = self._best(rows, scores)
        value = np.where(best >= 0, scores[best], -1)
        boxes = c.boxes
        told = (
            np.zeros(value.shape, bool)
            if self._refine is None
            else self._prune(rows, best, value, boxes)
        )
        visible = (~hidden * self._scorer.gamma).sum(axis=1) >= self._p.min_visible * int(
            self._scorer.gamma.sum()
        )
        visible &= self._filled(hidden)
        allowed = ((value >= self._least) | told) & visible[best]
        wanted = np.where(
            allowed.any(axis=1), np.argmax(np.where(allowed, value, -1), axis=1), -1
        )
        while True:
            pairs = assign(-value / FULL, allowed)
            loser = _coinciding(pairs, best, boxes, value, self._p.coincide)
            if loser is None:
                break
            allowed[loser] = False
        pairs += self._left(pairs, best, value, visible & ~hidden.any(axis=1))
        taker = {a: t for t, a in pairs}
        out = []
        for t, a in pairs:
            k = int(best[t, a])
            rivals = [
                u
                for u in range(len(rows))
                if u != t and wanted[u] == a and taker.get(a) == t
            ]
            rival = int(rows[rivals[0]]) if rivals else -1
            out.append(Match(int(rows[t]), k, boxes[k], int(scores[k]), hidden[k], rival))
        return out

    def _best(self, rows: NDArray[np.intp], scores: Ints) -> Ints:
        """Every target's best candidate at every anchor, of equals the first, (T, A); -1 where it
        has none.
        """
        c = self._s.candidates
        order = {r: t for t, r in enumerate(rows.tolist())}
        best = [[-1] * c.count for _ in order]
        value = scores.tolist()
        for k, (row, anchor) in enumerate(
            zip(c.rows.tolist(), c.anchors.tolist(), strict=True)
        ):
            mine = best[order[row]]
            if mine[anchor] < 0 or value[k] > value[mine[anchor]]:
                mine[anchor] = k
        return np.array(best, np.int64)

    def _left(
        self, pairs: list[tuple[int, int]], best: Ints, value: Ints, good: Bools
    ) -> list[tuple[int, int]]:
        """Targets that found nothing, and whole blobs of their size that nobody took and no other
        of them may take.

        What others have left of a target's parts counts for less there than that nobody else can
        be that blob.
        """
        free = (
            (best >= 0)
            & self._s.candidates.whole[best]
            & good[best]
            & self._s.alike[best]
            & (value >= round(self._p.whole * self._least))
        )
        for t, a in pairs:
            free[t] = False
            free[:, a] = False
        single = free & (free.sum(axis=0) == 1)[None, :] & (free.sum(axis=1) == 1)[:, None]
        return [(int(t), int(a)) for t, a in np.argwhere(single)]

    def _filled(self, hidden: Bools) -> Bools:
        """Whether there is foreground enough in the parts that are to be seen, (N,)."""
        seen = self._s.rectangles[:, :, 2] * self._s.rectangles[:, :, 3] * ~hidden
        return np.asarray(
            (self._s.foreground * ~hidden).sum(axis=1)
            >= self._p.min_fill * seen.sum(axis=1)
        )

    def _prune(
        self, rows: NDArray[np.intp], best: Ints, value: Ints, boxes: Floats
    ) -> Bools:
        """Multiple responses: candidates nearby that are near-equal, or all weak, are decided by
        the head's image.

        PARTS 4.1. Deviations: candidates are judged by where the head's image is found, but stay
        where they are: what hangs from the image's own place is worse on TUD-Campus
        (docs/parts.md). Without an image of the head, or with one that is found nowhere, the best
        score wins whatever its ratio over the runner-up.

        Returns:
            What the head told, (T, A) bool: a match even where its score is weak. ``value`` ranks
            it first.
        """
        assert self._refine is not None
        told = np.zeros(value.shape, bool)
        tops = value.max(axis=1)
        doubtful = (value * self._p.ratio >= tops[:, None]).sum(axis=1) >= 2
        for t in np.flatnonzero(doubtful & (tops >= self._p.weak * self._least)).tolist():
            top = int(tops[t])
            near = np.flatnonzero(value[t] * self._p.ratio >= top)
            first = near[int(np.argmax(value[t, near]))]
            box = boxes[best[t, first]]
            away = np.abs(boxes[best[t, near], :2] - box[:2]).max(axis=1)
            close = away <= self._p.nearby * box[3]
            near, away = near[close], away[close]
            if len(near) < 2:
                continue
            refined = self._refine(
                int(rows[t]),
                box,
                float(away.max()) + 0.1 * float(box[3]),
            )
            if refined is None:
                continue
            middle = boxes[best[t, near], 0] + boxes[best[t, near], 2] / 2
            off = np.abs(middle - refined[0] - refined[2] / 2) + np.abs(
                boxes[best[t, near], 1] - refined[1]
            )
            winner = near[int(np.argmin(off))]
            others = near[near != winner]
            value[t, winner] = top
            told[t, winner] = True
            value[t, others] = (value[t, others] / self._p.ratio).astype(np.int64)
        return told


def _coinciding(
    pairs: list[tuple[int, int]], best: Ints, boxes: Floats, value: Ints, least: float
) -> tuple[int, int] | None:
    """The pair that has to give way, None if no two boxes all but coincide."""
    if len(pairs) < 2:
        return None
    placed = boxes[[best[t, a] for t, a in pairs]]
    overlap = np.triu(iou(placed, placed), 1)
    if float(overlap.max()) < least:
        return None
    i, j = np.unravel_index(int(np.argmax(overlap)), overlap.shape)
    return pairs[int(i)] if value[pairs[int(i)]] < value[pairs[int(j)]] else pairs[int(j)]
