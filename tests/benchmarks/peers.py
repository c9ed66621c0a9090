"""Peers on boxes alone, each as its paper has it, in one frame of their parts: what the product's
trackers are compared with.

| name | paper | what it adds to overlap and one assignment |
|---|---|---|
| iou | Bochinski et al. 2017 | nothing: no motion, a track without a detection ends |
| sort | Bewley et al. 2016 | constant velocity (`plain_sort`) |
| byte | Zhang et al. 2022 | low detections go on with tracks, never begin one |
| ocsort | Cao et al. 2023 | the direction of motion, and a second look from the last observation |
| cbiou | Yang et al. 2023 | no filter: widened boxes, twice |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from replay.trackers.association import assign, iou, sizes_of, widened_iou

Floats = NDArray[np.float64]
Told = list[tuple[int, tuple[float, float, float, float]]]
LONGEST, HITS = 30, 3
"""Frames for which a track is kept, and the least sightings of one that is told."""


@dataclass
class _Track:
    """Where it was observed last, where it is expected, and how it moves by frame."""

    id: int
    seen: Floats
    box: Floats
    speed: Floats = field(default_factory=lambda: np.zeros(4))
    hits: int = 1
    missed: int = 0

    def take(self, box: Floats) -> None:
        """Observed again: half of what is new counts."""
        step = (box - self.seen) / (self.missed + 1)
        self.speed = step if self.hits == 1 else 0.7 * self.speed + 0.3 * step
        self.speed[2:] = 0.0
        self.seen = self.box = box
        self.hits += 1
        self.missed = 0


class Peer:
    """One of `PEERS` but sort: boxes and scores in, (id, box) of those who are seen out."""

    def __init__(self, name: str, high: float = 0.0) -> None:
        """``high``: detections of lower scores begin no track (byte)."""
        self._name, self._high = name, high
        self._tracks: list[_Track] = []
        self._next = 1
        self._longest = 1 if name == "iou" else LONGEST

    def step(self, boxes: Floats, scores: Floats) -> Told:
        """One frame's detections (M, 4) with their scores (M,)."""
        for track in self._tracks:
            track.missed += 1
            if self._name not in ("iou", "cbiou"):
                track.box = track.box + track.speed
        high = scores >= self._high
        sure = np.flatnonzero(high)
        free, left = self._match(self._tracks, boxes, sure, 0.3, self._first)
        if self._name == "byte":
            low = np.flatnonzero(~high)
            recent = [t for t in left if t.missed == 1]
            self._match(recent, boxes, low, 0.5, self._first)
        elif self._name in ("ocsort", "cbiou"):
            free, _ = self._match(left, boxes, free, 0.3, self._second)
        for column in free.tolist():
            self._tracks.append(_Track(0, boxes[column], boxes[column]))
        self._tracks = [t for t in self._tracks if t.missed < self._longest]
        told: Told = []
        for track in self._tracks:
            if track.missed == 0 and track.hits >= HITS:
                if not track.id:
                    track.id, self._next = self._next, self._next + 1
                x, y, w, h = track.seen.tolist()
                told.append((track.id, (x, y, w, h)))
        return told

    def _match(
        self,
        tracks: list[_Track],
        boxes: Floats,
        columns: NDArray[np.intp],
        least: float,
        overlap: Callable[[list[_Track], Floats], tuple[Floats, Floats]],
    ) -> tuple[NDArray[np.intp], list[_Track]]:
        """Observe tracks in some columns; the columns and tracks that are left."""
        if not tracks or not len(columns):
            return columns, tracks
        shared, worth = overlap(tracks, boxes[columns])
        pairs = assign(-worth, shared >= least)
        for row, column in pairs:
            tracks[row].take(boxes[columns[column]])
        rows, taken = {r for r, _ in pairs}, {c for _, c in pairs}
        rest = [k for k in range(len(columns)) if k not in taken]
        return columns[rest], [t for k, t in enumerate(tracks) if k not in rows]

    def _first(self, tracks: list[_Track], boxes: Floats) -> tuple[Floats, Floats]:
        expected = np.array([t.box for t in tracks])
        if self._name == "cbiou":
            shared = widened_iou(expected, boxes, 0.3 * expected[:, 2:])
            return shared, shared
        shared = iou(expected, boxes)
        if self._name != "ocsort":
            return shared, shared
        speed = np.array([t.speed[:2] for t in tracks])
        seen = np.array([t.seen[:2] + t.seen[2:] / 2 for t in tracks])
        way = boxes[None, :, :2] + boxes[None, :, 2:] / 2 - seen[:, None]
        norms = np.hypot(*np.moveaxis(way, 2, 0)) * np.hypot(*speed.T)[:, None]
        same = (way * speed[:, None]).sum(axis=2) / np.maximum(norms, 1e-6)
        far = norms > 0.05 * sizes_of(boxes)[None] ** 2 * 0.01
        return shared, shared + 0.2 * np.where(far, same, 0.0)

    def _second(self, tracks: list[_Track], boxes: Floats) -> tuple[Floats, Floats]:
        last = np.array([t.seen for t in tracks])
        wide = 0.5 * last[:, 2:] if self._name == "cbiou" else np.zeros((len(last), 2))
        shared = widened_iou(last, boxes, wide)
        return shared, shared


PEERS = ("iou", "byte", "ocsort", "cbiou")
