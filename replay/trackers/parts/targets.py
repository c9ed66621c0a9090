"""The targets: global model, parts model, the two Kalman filters, the head's template (PARTS 2
and 3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from replay.trackers.kalman import KalmanBank
from replay.trackers.life import Living
from replay.trackers.parts.features import ONE, Measured, PartsModel
from replay.trackers.parts.parameters import PartsParameters
from replay.trackers.parts.regions import ALPHA, BETA, PARTS, alpha_of, beta_of, parts_of
from replay.trackers.parts.template import SIDE

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Rows = NDArray[np.intp]
BYSTANDERS = 1 << 30
"""First identity of those who are followed, but not told of, because targets are started by hand.
"""
_MODEL = ("area", "perimeter", "overlap", "colours", "centroid", "seen")


@dataclass(slots=True)
class PartsTarget(Living):
    """One target's bookkeeping; its numbers are a row of `Targets`' arrays.

    Attributes:
        id: identity, `TENTATIVE` before confirmation, from `BYSTANDERS` on for those who are not
            told of.
        manual: started by hand.
        matched_ns: time of the last observation that was more than pieces of it.
        misfit_ns: since when it has had a blob of another size to itself, -1 where it has not.
    """

    manual: bool = False
    score: float | None = None
    learnt_ns: int = -1
    matched_ns: int = -1
    misfit_ns: int = -1

    @property
    def anywhere(self) -> bool:
        """Who was started by hand may be anywhere in the picture."""
        return self.manual

    @property
    def told(self) -> bool:
        """Whether anything is said of it: it is confirmed, and no bystander."""
        return 0 < self.id < BYSTANDERS

    def begin_frame(self) -> None:
        """Forget what was true of the last frame alone."""
        self.newborn = self.observed = self.signed = False
        self.measured = self.score = None


class PartsTargets:
    """All targets in the order of their birth; row k of every array belongs to item k.

    Attributes:
        motion: KF1 over the box's centre: gives the speed, not the place (eq. 7).
        size: KF2 over (h, w) (eq. 8).
        boxes: (N, 4) the last validated box.
        alpha, beta: (N,) running means of the centroid's place in the box.
        misses: (N,) frames since the last observation.
        hidden: (N, 5) parts held to be hidden.
        model: the parts models.
        template: (N, SIDE * SIDE, 3) uint8 image of the head, with ``has_template`` (N,).
    """

    def __init__(self, parameters: PartsParameters) -> None:
        self._p = parameters
        self.items: list[PartsTarget] = []
        self.motion, self.size = KalmanBank(2), KalmanBank(2)
        self.boxes: Floats = np.zeros((0, 4))
        self.alpha: Floats = np.zeros(0)
        self.beta: Floats = np.zeros(0)
        self.misses = np.zeros(0, np.int64)
        self.hidden = np.zeros((0, len(PARTS)), bool)
        self.model = PartsModel.empty()
        self.template: Bytes = np.zeros((0, SIDE * SIDE, 3), np.uint8)
        self.has_template = np.zeros(0, bool)

    def __len__(self) -> int:
        return len(self.items)

    @property
    def speeds(self) -> Floats:
        """Magnitudes of the speeds, (N,) pixels per second."""
        return np.asarray(np.sqrt((self.motion.rate**2).sum(axis=1)))

    def predict(self, dt: float) -> None:
        """Advance both filters by dt seconds. The places stay: no direction is assumed (PARTS 3)."""
        if not self.items or dt <= 0:
            return
        h = self.boxes[:, 3:4]
        self.motion.predict(dt, (h * self._p.agility) ** 2)
        self.size.predict(dt, (h * self._p.size_agility) ** 2)
        # A size that went on changing while nobody can see it would soon be nonsense.
        unsure = np.array(
            [item.now != "motion" or not item.observed for item in self.items], bool
        )
        self.size.rate[unsure] = 0.0

    def expected(self) -> Floats:
        """Boxes of the predicted sizes at the last places, the foot's middle kept, (N, 4)."""
        w, h = (
            np.maximum(self.size.value[:, 1], 2.0),
            np.maximum(self.size.value[:, 0], 4.0),
        )
        b = self.boxes
        return np.stack([b[:, 0] + (b[:, 2] - w) / 2, b[:, 1] + b[:, 3] - h, w, h], axis=1)

    def ahead(self) -> Floats:
        """Boxes of the predicted sizes where KF1's speed has brought them, (N, 4): without pixels
        there is nothing but its path to tell a target by.
        """
        size = np.maximum(self.size.value[:, ::-1], (2.0, 4.0))
        return np.concatenate([self.motion.value - size / 2, size], axis=1)

    def onward(self, row: int) -> Floats:
        """Where a target is if it went on at KF1's speed since it was last seen, (4,)."""
        size = self.boxes[row, 2:]
        return np.concatenate([self.motion.value[row] - size / 2, size])

    def gates(self, dt: float) -> Floats:
        """Half sides of the gates, (N,) pixels: by speed, doubled for every frame missed."""
        p, h = self._p, self.boxes[:, 3]
        half = self._near(dt)
        return np.asarray(
            np.minimum(half * 2.0 ** np.minimum(self.misses, 8), p.gate_most * h)
        )

    def _near(self, dt: float) -> Floats:
        """Half sides of the gates of who was seen in the frame before, (N,) pixels: the way at the
        filter's speed, and what its place may be off.
        """
        p, h = self._p, self.boxes[:, 3]
        unsure = np.sqrt(self.motion.p00.mean(axis=1) + (p.place_noise * h) ** 2)
        return np.asarray(p.gate_speeds * self.speeds * dt + p.gate_sigmas * unsure)

    def reach(self, rows: Rows, dt: float, unseen_s: Floats) -> Floats:
        """How far targets (M,) may be from where they were last, after so many seconds (M,)."""
        far = self._near(dt)[rows] + self.speeds[rows] * unseen_s
        return np.asarray(np.minimum(far, self._p.gate_most * self.boxes[rows, 3]))

    def lean(self, rows: Rows, sizes: Floats, spread: float) -> None:
        """Let predicted sizes lean towards those that are usual at their places, (M, 2) width and
        height.
        """
        usual = sizes[:, ::-1]
        self.size.update(rows, usual, (spread * usual[:, :1]) ** 2)

    def start(self, box: Floats, target: PartsTarget) -> None:
        """Append a target at a box."""
        x, y, w, h = box.tolist()
        p = self._p
        place = np.array([[x + w / 2, y + h / 2]])
        self.motion.add(place, np.array((h * p.place_noise) ** 2), np.array(h**2))
        self.size.add(
            np.array([[h, w]]), np.array((h * p.size_noise) ** 2), np.array((0.03 * h) ** 2)
        )
        self.boxes = np.concatenate([self.boxes, box[None]])
        self.alpha, self.beta = np.append(self.alpha, ALPHA), np.append(self.beta, BETA)
        self.misses = np.append(self.misses, 0)
        self.hidden = np.concatenate([self.hidden, np.zeros((1, len(PARTS)), bool)])
        self.model.append(PartsModel.empty(1))
        self.template = np.concatenate(
            [self.template, np.zeros((1, SIDE * SIDE, 3), np.uint8)]
        )
        self.has_template = np.append(self.has_template, False)
        self.items.append(target)

    def resize(self, rows: Rows, boxes: Floats) -> None:
        """Targets (M,) that are of another size than was thought, that of boxes (M, 4): what is
        known of their parts is of a part of them, and is forgotten.
        """
        self.size.value[rows] = boxes[:, :1:-1]
        self.size.rate[rows] = 0.0
        self.model.seen[rows] = 0

    def correct(
        self, rows: Rows, boxes: Floats, centroids: Floats, occluded: NDArray[np.bool_]
    ) -> None:
        """Update the global models (PARTS 4.2): replaced if unoccluded, else averaged over time.

        The average over a sliding window is that of alpha and beta, and KF2's for the size, which
        hangs from the top of what was seen. The place is where the target was seen: a mean of
        places would lag behind, and one along its path would assume a direction.

        Args:
            rows: (M,) different targets.
            boxes: (M, 4) where they were seen.
            centroids: (M, 2) of what was seen, nan where it is not known.
            occluded: (M,) bool.
        """
        p = self._p
        h = boxes[:, 3]
        k = np.where(occluded, 4.0, 1.0)
        self.size.update(
            rows, boxes[:, :1:-1], (k * k * k * (h * p.size_noise) ** 2)[:, None]
        )
        free = np.flatnonzero(~occluded & ~np.isnan(centroids).any(axis=1))
        if len(free):
            at, gain = rows[free], 1.0 / p.centroid_frames
            self.alpha[at] += gain * (
                alpha_of(boxes[free], centroids[free, 0]) - self.alpha[at]
            )
            self.beta[at] += gain * (
                beta_of(boxes[free], centroids[free, 1]) - self.beta[at]
            )
        self.motion.update(
            rows, boxes[:, :2] + boxes[:, 2:] / 2, (k * (h * p.place_noise) ** 2)[:, None]
        )
        self.boxes[rows] = boxes
        hidden = rows[occluded]
        if len(hidden):
            size, seen = self.size.value[hidden, ::-1], boxes[occluded]
            left = seen[:, 0] + (seen[:, 2] - size[:, 0]) / 2
            self.boxes[hidden] = np.concatenate([left[:, None], seen[:, 1:2], size], axis=1)
        self.misses[rows] = 0

    def parts(self, rows: Rows, boxes: Floats) -> Floats:
        """Parts (N, 5, 4) of boxes (N, 4), split where the targets of these rows usually have
        their centroids.
        """
        return parts_of(boxes, self.alpha[rows], self.beta[rows])

    def learn(
        self,
        rows: Rows,
        m: Measured,
        k: Rows,
        scores: NDArray[np.int64],
        matched: NDArray[np.bool_],
    ) -> None:
        """Blend matched parts (M, 5) of candidates k (M,) into the models of different targets
        (M,): each feature's weight grows with its score (M, 5, 6), of 1000 (PARTS 4.2).
        """
        most = round(self._p.learn_most * ONE)
        self.model.learn(rows, m, k, np.where(matched[..., None], scores * most // 1000, 0))

    def keep(self, kept: list[int]) -> None:
        """Keep the given rows, in that order."""
        if len(kept) == len(self.items):
            return
        rows = np.array(kept, np.intp)
        self.motion.keep(rows)
        self.size.keep(rows)
        self.items = [self.items[k] for k in kept]
        self.model = self.model.take(rows)
        for name in (
            "boxes",
            "alpha",
            "beta",
            "misses",
            "hidden",
            "template",
            "has_template",
        ):
            setattr(self, name, getattr(self, name)[rows])

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        names = ("boxes", "alpha", "beta", "misses", "hidden", "template", "has_template")
        return {
            "items": [_plain(item) for item in self.items],
            "motion": self.motion.state(),
            "size": self.size.state(),
            **{name: getattr(self, name).copy() for name in names},
            "model": {name: getattr(self.model, name).copy() for name in _MODEL},
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self.items = [_target(t) for t in state["items"]]
        self.motion.restore(state["motion"])
        self.size.restore(state["size"])
        n, empty = len(self.items), PartsTargets(self._p)
        for name in (
            "boxes",
            "alpha",
            "beta",
            "misses",
            "hidden",
            "template",
            "has_template",
        ):
            like = getattr(empty, name)
            setattr(
                self, name, np.array(state[name], like.dtype).reshape(n, *like.shape[1:])
            )
        for name in _MODEL:
            like = getattr(empty.model, name)
            setattr(
                self.model,
                name,
                np.array(state["model"][name], like.dtype).reshape(n, *like.shape[1:]),
            )


def _plain(target: PartsTarget) -> dict[str, Any]:
    out = {field.name: getattr(target, field.name) for field in fields(target)}
    out["measured"] = None if target.measured is None else list(target.measured)
    out["sightings"] = [list(sighting) for sighting in target.sightings]
    return out


def _target(state: Mapping[str, Any]) -> PartsTarget:
    plain = dict(state)
    plain["measured"] = None if plain["measured"] is None else tuple(plain["measured"])
    plain["sightings"] = [list(s) for s in plain["sightings"]]
    return PartsTarget(**plain)
