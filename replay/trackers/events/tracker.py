"""EVENTS 2: low-level tracks by gated association, high-level targets that outlive them.

Ties: association by `replay.trackers.association.assign` (tracks in the order of their birth, detections in the order
of the recording); tentative tracks are confirmed, and ids given, in the order of their birth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Notice, Target, Targets
from replay.trackers.association import assign, iou
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.tracks import TENTATIVE, Track, Tracks, centred
from replay.trackers.tracker import Frame, SceneInfo, State

Floats = NDArray[np.float64]
NS = 1e-9


class EventsTracker:
    """The EVENTS tracker: see `replay.trackers.tracker.Tracker`."""

    def __init__(self, scene: SceneInfo, parameters: EventsParameters) -> None:
        self._scene = scene
        self._p = parameters
        self._tracks = Tracks(parameters)
        self._next_id = 1
        self._time_ns: int | None = None

    def step(self, frame: Frame) -> Targets:
        """Take the next frame, answer with all targets, by id."""
        notices: list[Notice] = []
        before = 0 if self._time_ns is None else frame.time_ns - self._time_ns
        self._time_ns = frame.time_ns
        self._tracks.predict(before * NS)
        for track in self._tracks.items:
            track.newborn = track.observed = False
            track.measured = None
        used = self._associate(frame)
        self._start(frame, used)
        self._confirm(frame, notices)
        self._age(frame, notices)
        return self._answer(frame, notices)

    def _associate(self, frame: Frame) -> list[bool]:
        """Two stages: confirmed and tentative tracks to detections of high score, the rest to the others."""
        boxes = frame.boxes
        scores = np.array(frame.detections.scores or [1.0] * len(boxes), np.float64)
        used = np.zeros(len(boxes), bool)
        free = np.ones(len(self._tracks), bool)
        confirmed = np.array([t.id != TENTATIVE for t in self._tracks.items], bool)
        high = scores >= self._p.high_score
        for rows, columns in ((confirmed, high), (confirmed, ~high), (~confirmed, high)):
            r, c = np.flatnonzero(rows & free), np.flatnonzero(columns & ~used)
            for i, j in self._match(r, boxes[c]):
                free[r[i]] = False
                used[c[j]] = True
                self._observe(int(r[i]), frame, int(c[j]), float(scores[c[j]]))
        return [bool(u) for u in used]

    def _match(self, rows: NDArray[np.intp], boxes: Floats) -> list[tuple[int, int]]:
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

    def _observe(self, row: int, frame: Frame, column: int, score: float) -> None:
        self._tracks.correct(np.array([row]), frame.boxes[column][None])
        track = self._tracks.items[row]
        track.seen_ns = frame.time_ns
        track.hits += 1
        track.quality += (score - track.quality) / min(track.hits, 10)
        track.observed = True
        x, y, w, h = frame.boxes[column].tolist()
        track.measured = (x, y, w, h)
        track.blob = frame.detections.blobs[column] if frame.detections.blobs else -1
        if track.id == TENTATIVE:
            track.sightings.append([float(frame.index), x, y, w, h])

    def _start(self, frame: Frame, used: list[bool]) -> None:
        scores = frame.detections.scores or [1.0] * len(used)
        for column, taken in enumerate(used):
            if taken or scores[column] < self._p.high_score:
                continue
            track = Track(TENTATIVE, frame.index, frame.time_ns, frame.time_ns, quality=scores[column])
            track.blob = frame.detections.blobs[column] if frame.detections.blobs else -1
            self._tracks.start(frame.boxes[column], track)
            track.sightings.append([float(frame.index), *self._tracks.box(len(self._tracks) - 1)])

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
            mode = "motion" if track.observed else "predicted"
            if mode != track.mode:
                change = {"from": track.mode, "to": mode, "unseen_s": unseen}
                notices.append(Notice("mode_changed", [track.id], "EVENTS 2: matching case", change))
                track.mode = "motion" if track.observed else "predicted"
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
                    blob=track.blob if track.observed else -1,
                    newborn=track.newborn,
                    measured=track.measured,
                )
            )
        return Targets(frame.index, sorted(targets, key=lambda t: t.id), None, notices)

    def state(self) -> State:
        """The whole state as plain data."""
        return {"next_id": self._next_id, "time_ns": self._time_ns, "tracks": self._tracks.state()}

    def restore(self, state: State) -> None:
        """Continue from what `state` gave."""
        self._next_id = state["next_id"]
        self._time_ns = state["time_ns"]
        self._tracks.restore(state["tracks"])
