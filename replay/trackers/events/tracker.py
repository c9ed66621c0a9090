"""EVENTS 2: low-level tracks by gated association, high-level targets that outlive them.

Ties: association by `replay.trackers.association.assign` (tracks in the order of their birth, detections in the order
of the recording); tentative tracks are confirmed, and ids given, in the order of their birth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.messages import NO_BLOB, Mode, Notice, Target, Targets
from recorders.segmentation.sizes import SizeModel
from replay.trackers.association import assign, iou
from replay.trackers.events.colours import learn, likenesses
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.places import Cut, Expected, Foreground, Likeness, Place, place, unexplained
from replay.trackers.events.tracks import TENTATIVE, Track, Tracks, centred
from replay.trackers.tracker import Frame, SceneInfo, State

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
NS = 1e-9


@dataclass(frozen=True)
class Seen:
    """Detections of one frame that may still be associated: boxes (N, 4), scores (N,), blobs (N,)."""

    boxes: Floats
    scores: Floats
    blobs: NDArray[np.int64]


class EventsTracker:
    """The EVENTS tracker: see `replay.trackers.tracker.Tracker`."""

    def __init__(self, scene: SceneInfo, parameters: EventsParameters) -> None:
        self._scene = scene
        self._p = parameters
        self._tracks = Tracks(parameters)
        self._learn_every = max(1, round(parameters.learn_s / max(1e-3, scene.frame_ns * NS)))
        self._next_id = 1
        self._time_ns: int | None = None

    def step(self, frame: Frame) -> Targets:
        """Take the next frame, answer with all targets, by id."""
        notices: list[Notice] = []
        before = 0 if self._time_ns is None else frame.time_ns - self._time_ns
        self._time_ns = frame.time_ns
        self._tracks.predict(before * NS)
        self._lean(SizeModel.from_list(frame.detections.size_model))
        for track in self._tracks.items:
            track.begin_frame()
        seen = _seen(frame)
        if frame.mask is not None:
            seen = self._place(frame, frame.mask, seen)
        self._start(frame, seen, self._associate(frame, seen))
        self._learn(frame)
        self._confirm(frame, notices)
        self._age(frame, notices)
        return self._answer(frame, notices)

    def _place(self, frame: Frame, mask: NDArray[np.uint8], seen: Seen) -> Seen:
        """Let the confirmed targets explain the foreground; what is left over are the detections of others."""
        fg = Foreground(mask, frame.detections.components, self._p)
        items = self._tracks.items
        rows = np.array([k for k, t in enumerate(items) if t.id != TENTATIVE and not t.lost], np.intp)
        bank = self._tracks.bank
        doubt = np.sqrt(bank.p00[rows])
        patient = np.array([items[r].misfit_s > self._p.patience_s for r in rows], bool)
        expected = Expected(self._tracks.boxes[rows], doubt[:, :2].max(axis=1, initial=0.0), doubt[:, 2:], patient)

        def look(which: list[int], cut: Cut) -> list[Likeness]:
            image = frame.image
            targets = [items[rows[k]] for k in which]
            return [None] * len(which) if image is None else likenesses(targets, image, cut)

        found = place(fg, expected, seen.boxes, seen.blobs, look, self._p)
        for r, at in zip(rows.tolist(), found, strict=True):
            if at is not None:
                self._settle(r, frame, at)
        if not len(seen.boxes):
            return seen
        kept = [at for at, r in zip(found, rows.tolist(), strict=True) if at is not None and items[r].observed]
        free = unexplained(fg, kept, seen.boxes) >= self._p.min_unexplained
        blob_boxes = {k + 1: b for k, b in enumerate(fg.boxes)}
        only = np.bincount(np.clip(seen.blobs, 0, None), minlength=len(fg.boxes) + 1)
        taken = {at.blob for at in kept}
        whole = [int(b) > 0 and only[b] == 1 and int(b) not in taken for b in seen.blobs]
        boxes = np.array(
            [blob_boxes[int(b)] if w else box for b, w, box in zip(seen.blobs, whole, seen.boxes, strict=True)]
        )
        # What nobody explains may start a track whatever its score: the score of a body in a blob means little here.
        return Seen(boxes.reshape(-1, 4)[free], np.maximum(seen.scores, self._p.high_score)[free], seen.blobs[free])

    def _lean(self, model: SizeModel | None) -> None:
        """Targets whose size was not measured in the last frame lean towards the size usual at their place."""
        rows = np.array([k for k, t in enumerate(self._tracks.items) if not t.sized], np.intp)
        if model is not None and len(rows):
            boxes = self._tracks.boxes[rows]
            heights = model.heights(boxes[:, 1] + boxes[:, 3])
            self._tracks.lean(rows, np.stack([model.aspect * heights, heights], axis=1))

    def _settle(self, row: int, frame: Frame, at: Place) -> None:
        """Take a place as an observation if enough foreground supports it."""
        track = self._tracks.items[row]
        track.hidden = at.shared
        if at.alone:
            track.misfit_s = 0.0
            track.alone = True
            self._observe(row, frame, at.box, 1.0, at.blob, "motion")
        elif at.own >= self._p.min_own:
            support = min(1.0, (at.own + 0.5 * at.shared) / 0.6)
            self._observe(row, frame, at.box, support, at.blob, "appearance")

    def _learn(self, frame: Frame) -> None:
        """Every so often, learn the colours of all targets that are alone."""
        if not self._scene.has_images or frame.index % self._learn_every:
            return
        for track in self._tracks.items:
            if track.alone and track.measured is not None and frame.image is not None:
                learn(track, frame.image, frame.mask, track.measured)

    def _associate(self, frame: Frame, seen: Seen) -> NDArray[np.bool_]:
        """Two stages: confirmed and tentative tracks to detections of high score, the rest to the others."""
        used = np.zeros(len(seen.boxes), bool)
        items = self._tracks.items
        free = np.array([not t.observed for t in items], bool)
        confirmed = np.array([t.id != TENTATIVE for t in items], bool)
        high = seen.scores >= self._p.high_score
        for rows, columns in ((confirmed, high), (confirmed, ~high), (~confirmed, high)):
            r, c = np.flatnonzero(rows & free), np.flatnonzero(columns & ~used)
            for i, j in self._match(r, seen.boxes[c]):
                free[r[i]] = False
                used[c[j]] = True
                x, y, w, h = seen.boxes[c[j]].tolist()
                self._observe(int(r[i]), frame, (x, y, w, h), float(seen.scores[c[j]]), int(seen.blobs[c[j]]), "motion")
        return used

    def _match(self, rows: Rows, boxes: Floats) -> list[tuple[int, int]]:
        if not len(rows) or not len(boxes):
            return []
        measured = centred(boxes)
        bank = self._tracks.bank
        variance = self._tracks.measurement_variance(np.sqrt(np.maximum(measured[:, 2] * measured[:, 3], 1.0)))
        residual = measured[None, :, :] - bank.value[rows][:, None, :]
        d2 = residual * residual / (bank.p00[rows][:, None, :] + variance[None])
        place = d2[:, :, 0] + d2[:, :, 1]
        overlap = iou(self._tracks.boxes[rows], boxes)
        gate2 = self._p.gate * self._p.gate
        allowed = (place <= gate2) & (overlap >= self._p.min_overlap)
        cost = (1.0 - overlap) + place / gate2
        return assign(cost, allowed)

    def _observe(
        self, row: int, frame: Frame, box: tuple[float, float, float, float], score: float, blob: int, mode: Mode
    ) -> None:
        track = self._tracks.items[row]
        self._tracks.correct(row, np.array(box), sized=mode == "motion")
        track.seen_ns = frame.time_ns
        track.hits += 1
        track.quality += (score - track.quality) / min(track.hits, 10)
        track.observed = True
        track.now = mode
        track.sized = mode == "motion"
        track.measured = box if mode == "motion" else self._tracks.box(row)
        track.blob = blob
        if track.id == TENTATIVE:
            track.sightings.append([float(frame.index), *box])

    def _start(self, frame: Frame, seen: Seen, used: NDArray[np.bool_]) -> None:
        for column in np.flatnonzero(~used & (seen.scores >= self._p.high_score)).tolist():
            track = Track(TENTATIVE, frame.index, frame.time_ns, frame.time_ns, quality=float(seen.scores[column]))
            track.blob = int(seen.blobs[column])
            self._tracks.start(seen.boxes[column], track)
            track.sightings.append([float(frame.index), *seen.boxes[column].tolist()])

    def _confirm(self, frame: Frame, notices: list[Notice]) -> None:
        for track in self._tracks.items:
            if track.id != TENTATIVE or not track.observed or track.hits < self._p.confirm_hits:
                continue
            if (frame.time_ns - track.born_ns) * NS < self._p.confirm_s:
                continue
            track.id = self._next_id
            self._next_id += 1
            track.newborn = True
            evidence = {"hits": track.hits, "first_frame": track.born, "sightings": track.sightings[:-1]}
            notices.append(Notice("track_confirmed", [track.id], "EVENTS 2: enough support", evidence))
            track.sightings = []

    def _age(self, frame: Frame, notices: list[Notice]) -> None:
        """Confidence falls while a target is unseen; then it is lost, then removed."""
        kept = []
        for row, track in enumerate(self._tracks.items):
            unseen = (frame.time_ns - track.seen_ns) * NS
            if track.id == TENTATIVE:
                if unseen <= self._p.tentative_s:
                    kept.append(row)
                continue
            mode: Mode = track.now if track.observed else "predicted"
            if mode != track.mode:
                change = {"from": track.mode, "to": mode, "unseen_s": unseen}
                notices.append(Notice("mode_changed", [track.id], "EVENTS 2: matching case", change))
                track.mode = mode
            track.confidence = track.quality * 0.5 ** (unseen / self._p.half_life_s)
            lost = unseen > self._p.coast_s
            if lost != track.lost:
                kind = "track_lost" if lost else "track_recovered"
                notices.append(Notice(kind, [track.id], "EVENTS 2: unseen for too long", {"unseen_s": unseen}))
                track.lost = lost
            if unseen > self._p.keep_s or self._outside(row):
                evidence = {"unseen_s": unseen, "box": list(self._tracks.box(row))}
                notices.append(Notice("track_removed", [track.id], "EVENTS 2: low quality", evidence))
                continue
            kept.append(row)
        self._tracks.keep(kept)

    def _outside(self, row: int) -> bool:
        cx, cy = self._tracks.bank.value[row, :2].tolist()
        return not (0 <= cx < self._scene.width and 0 <= cy < self._scene.height)

    def _answer(self, frame: Frame, notices: list[Notice]) -> Targets:
        targets = []
        for row, track in enumerate(self._tracks.items):
            if track.id == TENTATIVE:
                continue
            vx, vy = self._tracks.bank.rate[row, :2].tolist()
            targets.append(
                Target(
                    track.id,
                    self._tracks.box(row),
                    (vx, vy),
                    track.mode,
                    min(1.0, max(0.0, track.confidence)),
                    present=not track.lost,
                    observed=track.observed,
                    blob=track.blob if track.observed else NO_BLOB,
                    newborn=track.newborn,
                    measured=track.measured,
                    signature=track.colours.signature() if track.signed and track.colours is not None else [],
                )
            )
        return Targets(frame.index, sorted(targets, key=lambda t: t.id), None, notices)

    def state(self) -> State:
        """The whole state as plain data."""
        return {
            "next_id": self._next_id,
            "time_ns": self._time_ns,
            "tracks": self._tracks.state(),
        }

    def restore(self, state: State) -> None:
        """Continue from what `state` gave."""
        self._next_id = state["next_id"]
        self._time_ns = state["time_ns"]
        self._tracks.restore(state["tracks"])


def _seen(frame: Frame) -> Seen:
    d = frame.detections
    n = len(d.boxes)
    return Seen(
        frame.boxes,
        np.array(d.scores if d.scores else [1.0] * n, np.float64),
        np.array(d.blobs if d.blobs else [NO_BLOB] * n, np.int64),
    )
