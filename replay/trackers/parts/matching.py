"""One frame's matching of targets with what is observed: who is alone, who is contested, who
comes back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Box, Mode, Notice
from replay.trackers.association import intersection, iou, iou_of_pairs
from replay.trackers.belief import LIKELY
from replay.trackers.life import TENTATIVE
from replay.trackers.light import Light
from replay.trackers.parts.candidates import (
    Candidates,
    Expected,
    Heads,
    Observed,
    gather,
    same_anchor,
)
from replay.trackers.parts.features import (
    AREA,
    DISPLACEMENT,
    FEATURES,
    HSV,
    XYZ,
    Measured,
    Pixels,
    Room,
    differences,
    head_and_body,
    measure,
)
from replay.trackers.parts.heads import CLEAR_PX, UPRIGHT, HeadColours, HeadDetector
from replay.trackers.parts.layers import Association, Match, Scored, trunks
from replay.trackers.parts.parameters import PartsParameters
from replay.trackers.parts.pieces import held_by_pieces
from replay.trackers.parts.regions import HEAD, PARTS, covered
from replay.trackers.parts.scoring import FULL, Scorer
from replay.trackers.parts.targets import PartsTargets
from replay.trackers.parts.template import patches, refine
from replay.trackers.parts.typical import Typical
from replay.trackers.tracker import Frame, SceneInfo

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Rows = NDArray[np.intp]
PATIENCE_S = 0.6
"""Whoever has had a blob of another size to himself for longer is of that size."""


class Matching:
    """Matches the targets of one frame and updates them."""

    def __init__(
        self,
        scene: SceneInfo,
        frame: Frame,
        seen: Observed,
        targets: PartsTargets,
        p: PartsParameters,
        *,
        dt: float,
        room: Room | None,
        learnt: tuple[Typical, HeadColours],
        light: Light,
    ) -> None:
        self._scene, self._frame, self._seen, self._targets, self._p = (
            scene,
            frame,
            seen,
            targets,
            p,
        )
        mask = frame.mask if scene.has_masks else None
        self._pixels = Pixels(None, mask, (scene.width, scene.height), room)
        self.dt = dt
        self._light = light
        self._typical, self._head_colours = learnt
        self._expected = targets.expected() if scene.has_masks else targets.ahead()
        self._gates = targets.gates(dt)
        self._before = targets.boxes.copy()
        self._gone: dict[int, NDArray[np.bool_]] = {}

    def run(self, scorer: Scorer, find_heads: HeadDetector, notices: list[Notice]) -> None:
        """Match and update every target: those alone first, then the contested, the new, and the
        lost.
        """
        items = self._targets.items
        tentative = np.array([item.id == TENTATIVE for item in items], bool)
        lost = np.array([item.lost for item in items], bool)
        self._scorer = scorer
        use = self._p.use_heads and self._scene.has_masks
        self._heads = Heads(find_heads if use else None, self._image, self._pixels.mask)
        self._alone(np.flatnonzero(~lost))
        free = ~np.array([item.observed for item in items], bool)
        # The lost one by one, in the order of their birth: each may be another of those who have
        # appeared since.
        back = np.flatnonzero(~tentative & lost)
        stages = [
            np.flatnonzero(~tentative & ~lost & free),
            np.flatnonzero(tentative & free),
            *back[:, None],
        ]
        sure, new, *returned = self._evaluate(stages, back)
        self._contested(stages[0], self._likely(sure), notices)
        if self._pixels.mask is None and sure is not None:
            left = np.array([not items[k].observed for k in stages[0].tolist()], bool)
            rest = sure.kept(np.isin(sure.candidates.rows, stages[0][left]))
            self._contested(stages[0][left], rest, notices)
        self._contested(stages[1], self._likely(new), notices)
        self._standing(stages[0])
        for rows, found in zip(stages[2:], returned, strict=True):
            self._contested(rows, self._likely(found), notices)
        self._hide()

    def _likely(self, found: Scored | None) -> Scored | None:
        """Candidates that are more likely somebody than not, where detections alone say so; with
        pixels all: who fits says more than a score.
        """
        if found is None or self._pixels.mask is not None or not len(found.parts):
            return found
        return found.kept(self._seen.scores[found.candidates.sources] >= LIKELY)

    def gates(self) -> list[Box]:
        """Every target's gate, the rectangle in which its centre is looked for."""
        centres = self._expected[:, :2] + self._expected[:, 2:] / 2
        out: list[Box] = []
        for (x, y), half in zip(centres.tolist(), self._gates.tolist(), strict=True):
            out.append((x - half, y - half, 2 * half, 2 * half))
        return out

    def _image(self) -> NDArray[np.uint8] | None:
        if self._pixels.image is None and self._scene.has_images:
            self._pixels.image = self._frame.evenly_lit
            self._pixels.grey = self._light.grey
        return self._pixels.image

    def _alone(self, rows: Rows) -> None:
        """Targets whose blob is theirs alone, of their size, and of their likeness: taken as
        measured.
        """
        found, theirs = self._lone(rows)
        if not len(found):
            return
        boxes = self._seen.blob_boxes[theirs]
        m = self._measure(found, boxes)[0]
        scores, alike = self._likeness(found, m)
        # Nobody else can be that blob, unless its colours are all others; and of whom nothing is
        # known, nothing can be unlike.
        like = scores >= round(self._p.whole * self._p.match_score * FULL)
        like &= alike | (scores >= round(self._p.match_score * FULL))
        like |= ~self._targets.model.seen[found].any(axis=1)
        # Long enough, and it is they who are of another size than was thought.
        other = np.array(
            [self._targets.items[row].misfit_ns >= 0 for row in found.tolist()]
        )
        if other.any():
            like = np.where(other, alike, like)
            grown = other & like
            self._targets.resize(found[grown], boxes[grown])
            for row in found[grown].tolist():
                self._targets.items[row].misfit_ns = self._targets.items[row].learnt_ns = -1
        found, theirs, boxes, m = found[like], theirs[like], boxes[like], m.kept(like)
        self._observe(
            found,
            boxes,
            theirs + 1,
            ["motion"] * len(found),
            [None] * len(found),
            self._seen.centroids[theirs],
        )
        now = self._frame.time_ns
        due = np.zeros(len(found), bool)
        for k, (row, score) in enumerate(
            zip(found.tolist(), scores[like].tolist(), strict=True)
        ):
            item = self._targets.items[row]
            item.matched_ns, item.score = now, score / FULL
            if (now - item.learnt_ns) * 1e-9 >= self._p.learn_s or item.learnt_ns < 0:
                item.learnt_ns = now
                due[k] = True
        if due.any():
            self._learn(found[due], boxes[due], m.kept(due))
        # What lies or drives has no head in its top seventh: it says nothing of heads' colours.
        clear = due & (HEAD * boxes[:, 3] >= CLEAR_PX)
        clear &= boxes[:, 3] >= UPRIGHT * boxes[:, 2]
        if clear.any() and self._image() is not None:
            parts = self._targets.parts(found[clear], boxes[clear])
            self._head_colours.take(*head_and_body(self._pixels, parts))

    def _likeness(
        self, rows: Rows, m: Measured
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Global scores (PARTS eq. 13) of targets (M,) in what was measured for each, (M,) of
        `FULL`, and whether the colours are alike; parts that are hidden by what nobody tracks
        count a constant.
        """
        known = m.known.copy()
        if not self._p.use_parts:
            known[AREA:DISPLACEMENT] = False
        apart = differences(self._targets.model, rows, m)
        learnt = np.repeat(self._targets.model.seen[rows][..., None] > 0, len(FEATURES), 2)
        learnt[..., HSV : XYZ + 1] &= m.coloured[..., None]
        self._typical.take(apart, learnt)
        features = self._scorer.features(self._typical.scaled(apart))
        parts = self._scorer.parts(features, known)
        hidden_score = round(self._p.hidden_score * FULL)
        empty = self._empty(rows, m)
        scores = self._scorer.whole(parts, empty, hidden_score)
        return scores, self._alike(features, known, empty)

    def _alike(
        self,
        features: NDArray[np.int64],
        known: NDArray[np.bool_],
        empty: NDArray[np.bool_],
    ) -> NDArray[np.bool_]:
        """Whether the colours of candidates (N, 5, 6) by themselves are not all others', (N,)."""
        colours = np.zeros(len(FEATURES), bool)
        colours[HSV : XYZ + 1] = known[HSV : XYZ + 1]
        if not colours.any():
            return np.ones(len(features), bool)
        parts = self._scorer.parts(features, colours)
        least, hidden_score = (
            round(v * FULL) for v in (self._p.colours, self._p.hidden_score)
        )
        return np.asarray(self._scorer.whole(parts, empty, hidden_score) >= least)

    def likeness_anywhere(self, rows: Rows, boxes: Floats) -> NDArray[np.int64]:
        """Global scores of targets (M,) in boxes (M, 4), whatever the way there, (M,) of `FULL`."""
        m = self._measured(rows, boxes, boxes)
        known = m.known.copy()
        known[DISPLACEMENT:] = not known[:DISPLACEMENT].any()
        features = self._scorer.features(
            self._typical.scaled(differences(self._targets.model, rows, m))
        )
        parts, empty = self._scorer.parts(features, known), self._empty(rows, m)
        scores = self._scorer.whole(parts, empty, round(self._p.hidden_score * FULL))
        return np.where(self._alike(features, known, empty), scores, 0)

    def place(self, row: int, newcomer: int, score: int) -> None:
        """A missing target is where a newcomer was seen."""
        other, one = self._targets.items[newcomer], np.array([row], np.intp)
        box = np.array([other.measured], np.float64)
        self._observe(
            one, box, np.array([other.blob]), [other.now], [score], np.full((1, 2), np.nan)
        )
        self._targets.items[row].matched_ns = self._frame.time_ns

    def _measured(self, rows: Rows, boxes: Floats, expected: Floats) -> Measured:
        """Features of boxes (M, 4) for targets (M,) whose places do not count."""
        self._image()
        parts = self._targets.parts(rows, boxes)
        return measure(
            self._pixels,
            parts,
            self._targets.parts(rows, expected),
            parts,
            np.maximum(boxes[:, 3], 1.0),
        )

    def _lone(self, rows: Rows) -> tuple[Rows, Rows]:
        """Targets that have a blob of their size for themselves, (M,), and the blobs, (M,)."""
        blobs = self._seen.blob_boxes
        if not len(rows) or not len(blobs):
            for row in rows.tolist():
                self._targets.items[row].misfit_ns = -1
            return np.zeros(0, np.intp), np.zeros(0, np.intp)
        at = self._expected[rows]
        linked = (
            self._links(at, blobs)
            >= self._p.linked * np.maximum(at[:, 2] * at[:, 3], 1.0)[:, None]
        )
        lone = np.flatnonzero(linked.sum(axis=1) == 1)
        theirs = np.argmax(linked[lone], axis=1)
        box, expected = blobs[theirs], at[lone]
        change = box[:, 2:] / np.maximum(expected[:, 2:], 1.0)
        away = np.abs(
            box[:, :2] + box[:, 2:] / 2 - expected[:, :2] - expected[:, 2:] / 2
        ).max(axis=1)
        fits = (change[:, 1] <= 1 + self._p.alone_change) & (
            change[:, 0] <= 1 + self._p.occlusion
        )
        fits &= (change >= 1 - self._p.occlusion).all(axis=1)
        theirs_alone = away <= self._gates[rows[lone]]
        theirs_alone &= linked.sum(axis=0)[theirs] == 1
        theirs_alone &= self._seen.held[theirs + 1] <= 1
        fits = theirs_alone & (fits | self._outgrown(rows, lone, theirs_alone & ~fits))
        return rows[lone[fits]], theirs[fits]

    def _outgrown(self, rows: Rows, lone: Rows, misfit: Bools) -> Bools:
        """Which of the lone have had a blob of another size to themselves for so long that it is
        theirs, (M,).
        """
        now, items = self._frame.time_ns, self._targets.items
        differ = {int(rows[k]) for k in lone[misfit].tolist()}
        for row in rows.tolist():
            if row not in differ:
                items[row].misfit_ns = -1
            elif items[row].misfit_ns < 0:
                items[row].misfit_ns = now
        long = [now - items[int(k)].misfit_ns > PATIENCE_S * 1e9 for k in rows[lone]]
        return np.asarray(misfit & np.array(long, bool))

    def _links(self, boxes: Floats, blobs: Floats) -> Floats:
        """Foreground pixels of each blob's box within each box, (N, M)."""
        if self._pixels.area is None:
            return intersection(boxes, blobs)
        a, b = boxes[:, None, :], blobs[None, :, :]
        corner = np.maximum(a[..., :2], b[..., :2])
        size = np.maximum(
            np.minimum(a[..., :2] + a[..., 2:], b[..., :2] + b[..., 2:]) - corner, 0.0
        )
        counts = self._pixels.sums(
            self._pixels.area, np.concatenate([corner, size], axis=2)
        )
        return np.asarray(np.where((size > 0).all(axis=2), counts, 0), np.float64)

    def _standing(self, rows: Rows) -> None:
        """Targets that stand behind something that nobody tracks: alive, and in their place,
        while pieces are seen.
        """
        blobs, area = self._seen.blob_boxes, self._pixels.area
        still = self._targets.speeds <= self._p.stands * self._targets.boxes[:, 3]
        items, now = self._targets.items, self._frame.time_ns
        left = [row for row in rows.tolist() if still[row] and not items[row].observed]
        # Whatever was left there, a shadow's edge or a thing that was put down, is not somebody
        # for ever.
        left = [
            row for row in left if now - items[row].matched_ns <= self._p.pieces_s * 1e9
        ]
        if not left or not len(blobs) or area is None:
            return
        filled = self._pixels.sums(area, blobs).astype(np.float64)
        for row in left:
            found = held_by_pieces(
                self._expected[row], blobs, filled, self._taken(), self._p
            )
            if found is None:
                continue
            box, piece = found
            only = np.array([row], np.intp)
            self._gone[row] = self._empty(only, self._measure(only, box[None])[0])[0]
            # As sure as the weakest match: that the pieces are this target's is only likely.
            least = round(self._p.match_score * FULL)
            self._observe(
                only,
                box[None],
                np.array([piece + 1]),
                ["appearance"],
                [least],
                np.full((1, 2), np.nan),
            )

    def _measure(self, rows: Rows, boxes: Floats) -> tuple[Measured, Floats]:
        """Features of boxes (N, 4) for their targets, and their parts."""
        self._image()
        places = np.concatenate([boxes, self._before[rows], self._expected[rows]])
        every = self._targets.parts(np.concatenate([rows, rows, rows]), places)
        parts, before, expected = every.reshape(3, len(rows), *every.shape[1:])
        return measure(
            self._pixels,
            parts,
            expected,
            before,
            np.maximum(self._gates[rows], 1.0),
            self._targets.model.centroid[rows],
        ), parts

    def _learn(self, rows: Rows, boxes: Floats, m: Measured) -> None:
        """Learn the parts of targets (M,) that are alone in their boxes (M, 4)."""
        scores = self._scorer.features(
            self._typical.scaled(differences(self._targets.model, rows, m))
        )
        # A part that does not match is learnt too, slowly: nobody else is there whom it might
        # belong to.
        least = np.maximum(scores, round(self._p.learn_alone * FULL))
        self._targets.learn(
            rows, m, np.arange(len(rows)), least, np.ones(least.shape[:2], bool)
        )
        for row in rows.tolist():
            self._targets.items[row].signed = True
        self._learn_heads(rows, boxes)

    def learn_new(self) -> None:
        """Learn the parts of the targets that have just begun, of whom nothing is known."""
        targets = self._targets
        rows = np.flatnonzero(~targets.model.seen.any(axis=1))
        if not len(rows):
            return
        self._image()
        parts = targets.parts(rows, targets.boxes[rows])
        m = measure(
            self._pixels, parts, parts, parts, np.maximum(targets.boxes[rows, 3], 1.0)
        )
        everything = np.ones((len(rows), len(PARTS)), bool)
        certain = np.full((*everything.shape, len(FEATURES)), FULL)
        targets.learn(rows, m, np.arange(len(rows)), certain, everything)
        self._learn_heads(rows, targets.boxes[rows])

    def _learn_heads(self, rows: Rows, boxes: Floats) -> None:
        """Keep the images of heads that are seen free and are large enough to be told by them."""
        clear = HEAD * boxes[:, 3] >= CLEAR_PX
        image = self._image() if clear.any() else None
        if image is None:
            return
        rows, boxes = rows[clear], boxes[clear]
        tops = np.stack(
            [boxes[:, 0] + self._targets.alpha[rows] * boxes[:, 2], boxes[:, 1]], axis=1
        )
        seen, whole = patches(image, tops, HEAD * boxes[:, 3])
        self._targets.template[rows[whole]] = seen[whole]
        self._targets.has_template[rows[whole]] = True

    def _evaluate(self, stages: list[Rows], back: Rows) -> list[Scored | None]:
        """Measure all that has to be compared in this frame, at once.

        Args:
            stages: targets that are associated together.
            back: targets that were lost: place and overlap tell nothing of them.

        Returns:
            The candidates of each stage with their scores, None where there are none at all.
        """
        targets, rows = self._targets, np.concatenate(stages)
        if not len(rows):
            return [None] * len(stages)
        at = Expected(self._expected[rows], targets.alpha[rows], self._gates[rows])
        found, counts = gather(self._seen, stages, at, self._heads, self._p)
        m, parts = self._measure(found.rows, found.boxes)
        known = np.repeat(m.known[None], len(found.rows), axis=0)
        if not self._p.use_parts:
            known[:, AREA:DISPLACEMENT] = False
        known[np.isin(found.rows, back), DISPLACEMENT:] = not known[:1, :DISPLACEMENT].any()
        features = self._scorer.features(
            self._typical.scaled(differences(targets.model, found.rows, m))
        )
        scores = self._scorer.parts(features, known)
        if not m.known[:DISPLACEMENT].any():
            scores[:] = self._by_place(found)[:, None]
        filled = (
            m.foreground.astype(np.float64)
            if m.known[AREA]
            else parts[..., 2] * parts[..., 3]
        )
        empty = self._empty(found.rows, m)
        alike = self._alike(features, known[0] if len(known) else m.known, empty)
        scored = Scored(
            candidates=found,
            measured=m,
            features=features,
            parts=scores,
            rectangles=parts,
            foreground=filled,
            empty=empty,
            alike=alike,
        )
        ends = np.searchsorted(found.stage, np.arange(len(stages) + 1)).tolist()
        return [
            scored.kept(slice(*ends[k : k + 2]), count) for k, count in enumerate(counts)
        ]

    def _contested(self, rows: Rows, found: Scored | None, notices: list[Notice]) -> None:
        """Layered association of some targets among their candidates that nobody has taken."""
        if found is None or not len(found.parts):
            return
        taken = self._taken()
        if len(taken):
            free = iou(found.candidates.boxes, taken).max(axis=1) < self._p.taken
            # Nor does anybody hang from a head that was given.
            free &= found.candidates.direct | ~same_anchor(
                found.candidates.boxes, taken, self._p.crowd_change
            )
            if not free.any():
                return
            found = found.kept(free)
        pruner = self._refine if self._p.use_pruning and self._scene.has_images else None
        matches = Association(found, self._scorer, self._p, pruner).solve(
            rows, self._expected[rows], taken
        )
        if matches:
            self._take(matches, found, notices)

    def _empty(self, rows: Rows, m: Measured) -> NDArray[np.bool_]:
        """Where a part should be is hardly any foreground: hidden by things that nobody tracks,
        (N, 5).
        """
        known = self._targets.model
        return np.asarray(
            (m.area < self._p.empty * known.area[rows])
            & (known.seen[rows] > 0)
            & bool(m.known[0])
        )

    def _by_place(self, found: Candidates) -> NDArray[np.int64]:
        """Scores where there are boxes alone: 1 where the filters expect the target, the least
        match far from there.
        """
        expected = self._expected[found.rows]
        off = (
            found.boxes[:, :2]
            + found.boxes[:, 2:] / 2
            - expected[:, :2]
            - expected[:, 2:] / 2
        )
        far = np.minimum(
            np.sqrt((off * off).sum(axis=1)) / np.maximum(self._gates[found.rows], 1.0), 1.0
        )
        apart = 1.0 - iou_of_pairs(expected, found.boxes)
        worst = (1 - self._p.match_score) / self._p.far
        return np.asarray(np.rint(FULL * (1 - worst * (far + apart) / 2)), np.int64)

    def _taken(self) -> Floats:
        """Boxes of the targets that have been placed."""
        return self._targets.boxes[
            [k for k, item in enumerate(self._targets.items) if item.observed]
        ]

    def _refine(self, row: int, box: Floats, reach: float) -> Floats | None:
        """The box with the head where its image fits best."""
        targets, image = self._targets, self._image()
        if image is None or not targets.has_template[row]:
            return None
        x, y, w, h = box.tolist()
        if HEAD * h < CLEAR_PX:
            return None
        alpha = float(targets.alpha[row])
        (tx, ty), away = refine(
            image, targets.template[row], (x + alpha * w, y), HEAD * h, min(reach, 0.5 * h)
        )
        return np.array([tx - alpha * w, ty, w, h]) if away <= self._p.head_levels else None

    def _take(self, matches: list[Match], s: Scored, notices: list[Notice]) -> None:
        """Matches become observations; the targets' parts are updated one by one (PARTS 4.2)."""
        targets, c = self._targets, s.candidates
        rows, k = (
            np.array([m.row for m in matches], np.intp),
            np.array([m.candidate for m in matches], np.intp),
        )
        hidden = np.array([m.hidden for m in matches])
        direct = c.direct[k] & ~hidden.any(axis=1)
        centroids = np.where(
            (direct & (c.sources[k] >= 0))[:, None],
            self._seen.centroids[c.sources[k]],
            np.nan,
        )
        modes: list[Mode] = ["motion" if d else "appearance" for d in direct.tolist()]
        boxes = np.array([m.box for m in matches])
        self._observe(rows, boxes, c.blobs[k], modes, [m.score for m in matches], centroids)
        like = s.parts[k] >= round(self._p.part_score * FULL)
        matched = like & ~hidden
        targets.learn(rows, s.measured, k, s.features[k], matched)
        # By things that nobody tracks: where a part should be there is hardly any foreground.
        gone = s.empty[k] & ~like
        signed = matched[:, 1:].any(axis=1).tolist()
        for n, match in enumerate(matches):
            mine = targets.items[match.row]
            mine.matched_ns, mine.signed = self._frame.time_ns, signed[n]
            self._gone[match.row] = gone[n]
            if match.rival >= 0:
                rival = targets.items[match.rival]
                if rival.told and mine.told:
                    self._tell_conflict(mine.id, rival.id, match, notices)

    def _tell_conflict(
        self, mine: int, rival: int, match: Match, notices: list[Notice]
    ) -> None:
        evidence = {
            "score": match.score / FULL,
            "score_at_least": self._p.whole * self._p.match_score,
            "gave_way": rival,
        }
        text = f"Targets {mine} and {rival} fit the same place best; {mine} was given it."
        notices.append(
            Notice(
                "disagreement", [mine, rival], "PARTS 4: joint assignment", evidence, text
            )
        )

    def _observe(
        self,
        rows: Rows,
        boxes: Floats,
        blobs: NDArray[np.int64],
        modes: list[Mode],
        scores: list[int | None] | list[int] | list[None],
        centroids: Floats,
    ) -> None:
        """Different targets (M,) were seen in boxes (M, 4) of blobs (M,); centroids (M, 2) are
        nan where unknown.
        """
        targets = self._targets
        targets.correct(
            rows, boxes, centroids, np.array([mode != "motion" for mode in modes], bool)
        )
        seen = zip(
            rows.tolist(), boxes.tolist(), blobs.tolist(), modes, scores, strict=True
        )
        for row, (x, y, w, h), blob, mode, score in seen:
            item = targets.items[row]
            item.measured = (x, y, w, h)
            value = 1.0 if score is None else min(1.0, score / FULL / self._p.sure_score)
            item.sighted(self._frame.time_ns, value, blob, mode)
            item.score = None if score is None else score / FULL
            if item.id == TENTATIVE:
                item.sightings.append([float(self._frame.index), x, y, w, h])

    def _hide(self) -> None:
        """Which parts are hidden now that everybody has a place: those that nearer targets cover,
        and those gone.

        Of an unseen target every part that anybody covers is hidden where the target is expected.
        """
        targets = self._targets
        if not len(targets):
            return
        boxes = targets.boxes
        here = np.array(
            [not item.lost and item.id != TENTATIVE for item in targets.items], bool
        )
        seen = np.array([item.observed for item in targets.items], bool)
        foot = boxes[:, 1] + boxes[:, 3]
        nearer = foot[None, :] > (foot + self._p.nearer * boxes[:, 3])[:, None]
        nearer |= ~seen[:, None] & seen[None, :]
        nearer &= here[None, :] & ~np.eye(len(targets), dtype=bool)
        parts = targets.parts(np.arange(len(targets)), boxes)
        targets.hidden[:] = (
            covered(parts, trunks(boxes, self._p.trunk), nearer) >= self._p.hidden_cover
        )
        for row in sorted(self._gone):
            targets.hidden[row] |= self._gone[row]

    def unexplained(self) -> Floats:
        """Share of each observation's foreground that no placed target explains, (K,)."""
        boxes, taken = self._seen.boxes, self._taken()
        if not len(boxes):
            return np.zeros(0)
        if self._pixels.mask is None:
            share = (
                intersection(boxes, taken)
                / np.maximum(boxes[:, 2] * boxes[:, 3], 1.0)[:, None]
            )
            return np.asarray(1.0 - np.minimum(share.max(axis=1, initial=0.0), 1.0))
        rest = self._pixels.copied_mask()
        for x, y, w, h in taken.tolist():
            x1, y1 = max(0, round(x - 0.1 * w)), max(0, round(y - 0.05 * h))
            rest[y1 : max(0, round(y + 1.05 * h)), x1 : max(0, round(x + 1.1 * w))] = 0
        return self._pixels.shares(rest, boxes)
