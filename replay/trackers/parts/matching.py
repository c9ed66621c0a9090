"""One frame's matching of targets with what is observed: who is alone, who is contested, who comes back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Box, Mode, Notice
from replay.trackers.association import intersection, iou
from replay.trackers.parts.candidates import Candidates, Heads, Observed, gather
from replay.trackers.parts.features import AREA, DISPLACEMENT, OVERLAP, Measured, Pixels, differences, measure
from replay.trackers.parts.heads import CLEAR_PX, HeadDetector
from replay.trackers.parts.layers import NEARER, Association, Match, Scored, trunks
from replay.trackers.parts.parameters import PartsParameters
from replay.trackers.parts.pieces import held_by_pieces
from replay.trackers.parts.regions import HEAD, PARTS, covered
from replay.trackers.parts.scoring import FULL, Scorer
from replay.trackers.parts.targets import TENTATIVE, Targets
from replay.trackers.parts.template import patches, refine
from replay.trackers.tracker import Frame, SceneInfo

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

LINKED_SHARE = 0.08
"""A blob with this share of a target's box in foreground concerns the target."""
FAR = 0.8
"""Boxes alone match up to this mean of the way in gates and the overlap that is missing."""


class Matching:
    """Matches the targets of one frame and updates them."""

    def __init__(
        self, scene: SceneInfo, frame: Frame, seen: Observed, targets: Targets, p: PartsParameters, dt: float
    ) -> None:
        self._scene, self._frame, self._seen, self._targets, self._p = scene, frame, seen, targets, p
        mask = frame.mask if scene.has_masks else None
        self._pixels = Pixels(None, mask, (scene.width, scene.height))
        self._expected = targets.expected()
        self._gates = targets.gates(dt)
        self._before = targets.boxes.copy()
        self._gone: dict[int, NDArray[np.bool_]] = {}

    def run(self, scorer: Scorer, find_heads: HeadDetector, notices: list[Notice]) -> None:
        """Match and update every target: those alone first, then the contested, the new, and the lost."""
        items = self._targets.items
        tentative = np.array([t.id == TENTATIVE for t in items], bool)
        lost = np.array([t.lost for t in items], bool)
        self._scorer = scorer
        use = self._p.use_heads and self._scene.has_masks
        self._heads = Heads(find_heads if use else None, self._image, self._pixels.mask)
        self._alone(np.flatnonzero(~lost))
        for rows in (~tentative & ~lost, tentative):
            free = np.array([not t.observed for t in items], bool)
            chosen = np.flatnonzero(rows & free)
            if len(chosen):
                self._contested(chosen, back=False, notices=notices)
        self._standing(np.flatnonzero(~tentative & ~lost))
        # The lost one by one, in the order of their birth: each may be another of those who have appeared since.
        for row in np.flatnonzero(~tentative & lost).tolist():
            self._contested(np.array([row], np.intp), back=True, notices=notices)
        self._hide()

    def gates(self) -> list[Box]:
        """Every target's gate, the rectangle in which its centre is looked for."""
        centres = self._expected[:, :2] + self._expected[:, 2:] / 2
        out: list[Box] = []
        for (x, y), half in zip(centres.tolist(), self._gates.tolist(), strict=True):
            out.append((x - half, y - half, 2 * half, 2 * half))
        return out

    def _image(self) -> NDArray[np.uint8] | None:
        if self._pixels.image is None and self._scene.has_images:
            self._pixels.image = self._frame.image
        return self._pixels.image

    def _alone(self, rows: Rows) -> None:
        """Targets whose blob is theirs alone and of their size: taken as measured, their parts learnt when due."""
        blobs = self._seen.blob_boxes
        if not len(rows) or not len(blobs):
            return
        at = self._expected[rows]
        linked = self._links(at, blobs) >= LINKED_SHARE * np.maximum(at[:, 2] * at[:, 3], 1.0)[:, None]
        tenants = linked.sum(axis=0)
        due: list[tuple[int, int]] = []
        for t in np.flatnonzero(linked.sum(axis=1) == 1).tolist():
            b = int(np.argmax(linked[t]))
            change = blobs[b, 2:] / np.maximum(at[t, 2:], 1.0)
            near = np.abs(blobs[b, :2] + blobs[b, 2:] / 2 - at[t, :2] - at[t, 2:] / 2).max() <= self._gates[rows[t]]
            fits = change[1] <= 1 + self._p.alone_change and change[0] <= 1 + self._p.occlusion
            fits = fits and bool((change >= 1 - self._p.occlusion).all())
            if tenants[b] != 1 or self._seen.held[b + 1] > 1 or not near or not fits:
                continue
            row = int(rows[t])
            self._targets.items[row].matched_ns = self._frame.time_ns
            self._observe(row, blobs[b], b + 1, "motion", None, tuple(self._seen.centroids[b].tolist()))
            item = self._targets.items[row]
            if (self._frame.time_ns - item.learnt_ns) * 1e-9 >= self._p.learn_s or item.learnt_ns < 0:
                item.learnt_ns = self._frame.time_ns
                due.append((row, b))
        if due:
            self._learn(due)

    def _links(self, boxes: Floats, blobs: Floats) -> Floats:
        """Foreground pixels of each blob's box within each box, (N, M)."""
        if self._pixels.area is None:
            return intersection(boxes, blobs)
        a, b = boxes[:, None, :], blobs[None, :, :]
        corner = np.maximum(a[..., :2], b[..., :2])
        size = np.maximum(np.minimum(a[..., :2] + a[..., 2:], b[..., :2] + b[..., 2:]) - corner, 0.0)
        counts = self._pixels.sums(self._pixels.area, np.concatenate([corner, size], axis=2))
        return np.asarray(np.where((size > 0).all(axis=2), counts, 0), np.float64)

    def _standing(self, rows: Rows) -> None:
        """Targets that stand behind something that nobody tracks: alive, and in their place, while pieces are seen."""
        blobs, area = self._seen.blob_boxes, self._pixels.area
        still = self._targets.speeds <= self._p.stands * self._targets.boxes[:, 3]
        items, now = self._targets.items, self._frame.time_ns
        left = [row for row in rows.tolist() if still[row] and not items[row].observed]
        # Whatever was left there, a shadow's edge or a thing that was put down, is not somebody for ever.
        left = [row for row in left if now - items[row].matched_ns <= self._p.pieces_s * 1e9]
        if not left or not len(blobs) or area is None:
            return
        filled = self._pixels.sums(area, blobs).astype(np.float64)
        for row in left:
            found = held_by_pieces(self._expected[row], blobs, filled, self._taken(), self._p)
            if found is None:
                continue
            box, piece = found
            only = np.array([row], np.intp)
            self._gone[row] = self._empty(only, self._measure(only, box[None])[0])[0]
            # As sure as the weakest match: that the pieces are this target's is only likely.
            self._observe(row, box, piece + 1, "appearance", round(self._p.match_score * FULL), None)

    def _measure(self, rows: Rows, boxes: Floats) -> tuple[Measured, Floats]:
        """Features of boxes (N, 4) for their targets, and their parts."""
        self._image()
        parts = self._targets.parts(rows, boxes)
        before = self._targets.parts(rows, self._before[rows])
        expected = self._targets.parts(rows, self._expected[rows])
        return measure(self._pixels, parts, expected, before, np.maximum(self._gates[rows], 1.0)), parts

    def _learn(self, due: list[tuple[int, int]]) -> None:
        rows = np.array([r for r, _ in due], np.intp)
        boxes = self._seen.blob_boxes[[b for _, b in due]]
        m, _ = self._measure(rows, boxes)
        scores = self._scorer.parts(differences(self._targets.model, rows, m), m.known)
        for k, row in enumerate(rows.tolist()):
            # A part that does not match is learnt too, slowly: nobody else is there whom it might belong to.
            least = np.maximum(scores[k], round(0.3 * FULL))
            self._targets.learn(row, m, k, least, np.ones(len(PARTS), bool))
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
        m = measure(self._pixels, parts, parts, parts, np.maximum(targets.boxes[rows, 3], 1.0))
        for k, row in enumerate(rows.tolist()):
            targets.learn(row, m, k, np.full(len(PARTS), FULL), np.ones(len(PARTS), bool))
        self._learn_heads(rows, targets.boxes[rows])

    def _learn_heads(self, rows: Rows, boxes: Floats) -> None:
        """Keep the images of heads that are seen free."""
        image = self._image()
        if image is None:
            return
        tops = np.stack([boxes[:, 0] + self._targets.alpha[rows] * boxes[:, 2], boxes[:, 1]], axis=1)
        seen, whole = patches(image, tops, HEAD * boxes[:, 3])
        self._targets.template[rows[whole]] = seen[whole]
        self._targets.has_template[rows[whole]] = True

    def _contested(self, rows: Rows, back: bool, notices: list[Notice]) -> None:
        """Layered association of some targets among the candidates that are left."""
        targets = self._targets
        taken = self._taken()
        found = gather(
            self._seen, rows, self._expected[rows], targets.alpha[rows], self._gates[rows], self._heads, self._p
        )
        found = self._free(found, taken)
        if not len(found.rows):
            return
        m, parts = self._measure(found.rows, found.boxes)
        known = m.known.copy()
        if not self._p.use_parts:
            known[AREA:4] = False
        if back:
            known[4 : OVERLAP + 1] = not known[:4].any()
        scores = self._scorer.parts(differences(targets.model, found.rows, m), known)
        if not m.known[:DISPLACEMENT].any():
            scores[:] = self._by_place(found)[:, None]
        area = self._pixels.area
        filled = parts[..., 2] * parts[..., 3] if area is None else self._pixels.sums(area, parts).astype(np.float64)
        scored = Scored(found, m, scores, parts, filled, self._empty(found.rows, m))
        pruner = self._refine if self._p.use_pruning and self._scene.has_images else None
        matches = Association(scored, self._scorer, self._p, pruner).solve(rows, self._expected[rows], taken)
        for match in matches:
            self._take(match, scored, notices)

    def _empty(self, rows: Rows, m: Measured) -> NDArray[np.bool_]:
        """Where a part should be is hardly any foreground: hidden by things that nobody tracks, (N, 5)."""
        known = self._targets.model
        return np.asarray((m.area < self._p.empty * known.area[rows]) & (known.seen[rows] > 0) & bool(m.known[0]))

    def _by_place(self, found: Candidates) -> NDArray[np.int64]:
        """Scores where there are boxes alone: 1 where the filters expect the target, the least match far from there."""
        expected = self._expected[found.rows]
        expected[:, :2] = self._targets.motion.value[found.rows] - expected[:, 2:] / 2
        off = found.boxes[:, :2] + found.boxes[:, 2:] / 2 - self._targets.motion.value[found.rows]
        far = np.minimum(np.sqrt((off * off).sum(axis=1)) / np.maximum(self._gates[found.rows], 1.0), 1.0)
        apart = 1.0 - np.array([iou(a[None], b[None])[0, 0] for a, b in zip(expected, found.boxes, strict=True)])
        worst = (1 - self._p.match_score) / FAR
        return np.asarray(np.rint(FULL * (1 - worst * (far + apart) / 2)), np.int64)

    def _taken(self) -> Floats:
        """Boxes of the targets that have been placed."""
        return self._targets.boxes[[k for k, t in enumerate(self._targets.items) if t.observed]]

    def _free(self, found: Candidates, taken: Floats) -> Candidates:
        """The candidates that nobody has taken."""
        if not len(taken) or not len(found.rows):
            return found
        keep = np.flatnonzero(iou(found.boxes, taken).max(axis=1) < 0.6)
        return Candidates(
            found.rows[keep], found.boxes[keep], found.anchors[keep], found.blobs[keep], found.direct[keep],
            found.sources[keep], found.whole[keep], found.fitting[keep], found.count,
        )  # fmt: skip

    def _refine(self, row: int, box: Floats, reach: float) -> Floats | None:
        """The box with the head where its image fits best."""
        targets, image = self._targets, self._image()
        if image is None or not targets.has_template[row]:
            return None
        x, y, w, h = box.tolist()
        if HEAD * h < CLEAR_PX:
            return None
        alpha = float(targets.alpha[row])
        (tx, ty), away = refine(image, targets.template[row], (x + alpha * w, y), HEAD * h, min(reach, 0.5 * h))
        return np.array([tx - alpha * w, ty, w, h]) if away <= self._p.head_levels else None

    def _take(self, match: Match, s: Scored, notices: list[Notice]) -> None:
        """A match becomes an observation; its parts are updated one by one (PARTS 4.2)."""
        targets, k, row = self._targets, match.candidate, match.row
        direct = bool(s.candidates.direct[k]) and not match.hidden.any()
        blob = int(s.candidates.blobs[k])
        source = int(s.candidates.sources[k])
        centroid = None
        if direct and source >= 0 and not np.isnan(self._seen.centroids[source]).any():
            centroid = tuple(self._seen.centroids[source].tolist())
        mode: Mode = "motion" if direct else "appearance"
        targets.items[row].matched_ns = self._frame.time_ns
        self._observe(row, match.box, blob, mode, match.score, centroid)
        matched = (s.parts[k] >= round(self._p.part_score * FULL)) & ~match.hidden
        # By things that nobody tracks: where a part should be there is hardly any foreground.
        self._gone[row] = s.empty[k] & (s.parts[k] < round(self._p.part_score * FULL))
        targets.learn(row, s.measured, k, s.parts[k], matched)
        targets.items[row].signed = bool(matched[1:].any())
        if match.rival >= 0:
            rival, mine = targets.items[match.rival], targets.items[row]
            if rival.told and mine.told:
                self._tell_conflict(mine.id, rival.id, match, notices)

    def _tell_conflict(self, mine: int, rival: int, match: Match, notices: list[Notice]) -> None:
        evidence = {"score": match.score / FULL, "gave_way": rival}
        text = f"Targets {mine} and {rival} fit the same place best; {mine} was given it."
        notices.append(Notice("disagreement", [mine, rival], "PARTS 4: joint assignment", evidence, text))

    def _observe(
        self, row: int, box: Floats, blob: int, mode: Mode, score: int | None, centroid: tuple[float, ...] | None
    ) -> None:
        targets = self._targets
        item = targets.items[row]
        occluded = mode != "motion"
        at = None if centroid is None else (centroid[0], centroid[1])
        targets.correct(row, box, at, occluded)
        x, y, w, h = box.tolist()
        item.measured = (x, y, w, h)
        item.seen_ns = self._frame.time_ns
        item.hits += 1
        value = 1.0 if score is None else min(1.0, score / FULL / 0.7)
        item.quality += (value - item.quality) / min(item.hits, 10)
        item.score = None if score is None else score / FULL
        item.observed = True
        item.now = mode
        item.blob = blob
        if item.id == TENTATIVE:
            item.sightings.append([float(self._frame.index), x, y, w, h])

    def _hide(self) -> None:
        """Which parts are hidden now that everybody has a place: those that nearer targets cover, and those gone.

        Of an unseen target every part that anybody covers is hidden where the target is expected.
        """
        targets = self._targets
        if not len(targets):
            return
        boxes = targets.boxes
        here = np.array([not t.lost and t.id != TENTATIVE for t in targets.items], bool)
        seen = np.array([t.observed for t in targets.items], bool)
        foot = boxes[:, 1] + boxes[:, 3]
        nearer = foot[None, :] > (foot + NEARER * boxes[:, 3])[:, None]
        nearer |= ~seen[:, None] & seen[None, :]
        nearer &= here[None, :] & ~np.eye(len(targets), dtype=bool)
        parts = targets.parts(np.arange(len(targets)), boxes)
        targets.hidden[:] = covered(parts, trunks(boxes), nearer) >= self._p.hidden_cover
        for row in sorted(self._gone):
            targets.hidden[row] |= self._gone[row]

    def unexplained(self) -> Floats:
        """Share of each observation's foreground that no placed target explains, (K,)."""
        boxes, taken = self._seen.boxes, self._taken()
        if not len(boxes):
            return np.zeros(0)
        if self._pixels.mask is None:
            share = intersection(boxes, taken) / np.maximum(boxes[:, 2] * boxes[:, 3], 1.0)[:, None]
            return np.asarray(1.0 - np.minimum(share.max(axis=1, initial=0.0), 1.0))
        rest = self._pixels.mask.copy()
        for x, y, w, h in taken.tolist():
            x1, y1 = max(0, round(x - 0.1 * w)), max(0, round(y - 0.05 * h))
            rest[y1 : max(0, round(y + 1.05 * h)), x1 : max(0, round(x + 1.1 * w))] = 0
        assert self._pixels.area is not None
        left = Pixels(None, rest, (self._scene.width, self._scene.height))
        assert left.area is not None
        total = self._pixels.sums(self._pixels.area, boxes)
        return np.asarray(left.sums(left.area, boxes) / np.maximum(total, 1))
