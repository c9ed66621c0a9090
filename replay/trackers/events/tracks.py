"""Low-level tracks: a bank of Kalman filters, and what is known of each track (EVENTS 2).

The bank's components are the box's centre, width and height, and the ellipse's major and minor
axis and orientation. Only the centre has a rate: a size that went on changing while nobody can
see it would soon be nonsense.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recorders.messages import NO_BLOB, Box, Ellipse, Mode
from replay.trackers.appearance import Colours
from replay.trackers.association import boxes_of, sizes_of
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.kalman import KalmanBank
from replay.trackers.life import TENTATIVE, Living

Floats = NDArray[np.float64]
COMPONENTS = 7
_PLACE, _SHAPE = slice(0, 2), slice(2, 7)
_CALM, _CALM_LOOKS = 0.08, 20
"""What a calm scene's targets are off by, in sizes, and how many looks that is worth."""
ADRIFT = 0.4
"""By so many sizes (standard deviation) a place may be off that still tells who somebody is."""
_TURN = 0.2
"""Standard deviation of a measured orientation, radians, and of its change in a second."""


@dataclass(slots=True)
class EventsTrack(Living):
    """One track's bookkeeping; its place and size are a row of the Kalman bank.

    Attributes:
        company: [id, frame, squared distance in pixels] of those with whom it shared a blob since
            its colours last proved who it is, and of when they were nearest.
        apart_ns: when it last shared one, in frame ``apart``.
        fresh: its colours since then, to be compared with those that it had before.
        regions: [time in ns, x, y, w, h] of the regions of pixels that it lately lay in: who is
            born there was in one of them.
        known: [frame, time in ns, x, y, w, h] of when and where its colours last were its own.
        front: the target that it was last hidden behind, `TENTATIVE` once it is seen.
        members: of a group tracker, the targets that it was born over.
        found_ns: when it last had a detection or blob, or was hidden.
        grouped: it lies under a group tracker that is observed in this frame.
        held: it has come apart from others just now, and still counts as being in one region with
            them.
        loose: unseen for so long in so restless a scene that its place tells nothing.
        stranger: other colours that its blob has had since frame `since`.
    """

    loose: bool = False
    sized: bool = True
    misfit_s: float = 0.0
    hidden: bool = False
    front: int = TENTATIVE
    members: list[int] = field(default_factory=list)
    grouped: bool = False
    found_ns: int = 0
    column: int = -1
    alone: bool = False
    colours: Colours | None = None
    company: list[list[float]] = field(default_factory=list)
    apart_ns: int = 0
    apart: int = 0
    fresh: Colours | None = None
    regions: list[list[float]] = field(default_factory=list)
    known: list[float] = field(default_factory=list)
    stranger: Colours | None = None
    since: int = 0
    held: bool = False

    def begin_frame(self) -> None:
        """Forget what was true of the last frame alone."""
        self.newborn = self.observed = False
        self.sized = self.alone = self.signed = False
        self.measured = None
        self.hidden = self.held = self.grouped = False
        self.blob, self.column = NO_BLOB, -1

    @property
    def hiding(self) -> bool:
        """Behind somebody who explains the pixels where it should be, it can be nowhere else."""
        return self.hidden

    @property
    def adrift(self) -> bool:
        """Whether it may be anywhere by now."""
        return self.loose

    @property
    def kept(self) -> bool:
        """As long as its group is observed, it is not lost (EVENTS 3.1)."""
        return self.grouped

    @property
    def way(self) -> Mode:
        """How it is followed in this frame."""
        if self.hidden or (self.observed and self.held):
            return "appearance"
        return self.now if self.observed else "predicted"


class Unrest:
    """How much further than their measurements' noise targets are off their predictions here.

    A camera that moves, or few frames in a second, put everybody off in every frame; the gates of
    such a recording have to be wider than those of a calm one.
    """

    def __init__(self) -> None:
        self._squares: Floats = np.full(2, _CALM_LOOKS * _CALM * _CALM)
        self._looks = float(_CALM_LOOKS)

    @property
    def off(self) -> Floats:
        """Standard deviation along x and y, (2,), in units of a target's size."""
        return np.asarray(
            np.sqrt(np.maximum(self._squares / self._looks - _CALM * _CALM, 0.0))
        )

    def take(self, off: Floats) -> None:
        """Learn from targets (N, 2) that were off so much, in sizes."""
        self._squares += (off * off).sum(axis=0)
        self._looks += len(off)

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {"squares": self._squares.copy(), "looks": self._looks}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._squares = np.array(state["squares"], np.float64)
        self._looks = float(state["looks"])


class EventsTracks:
    """All tracks, tentative and confirmed, in the order of their birth; row k of the bank belongs
    to item k.
    """

    def __init__(self, parameters: EventsParameters) -> None:
        self._p = p = parameters
        self._noise = np.array([p.place_noise] * 2 + [p.size_noise] * 4 + [0.0])
        self._agility = np.array([p.agility] * 2 + [0.0] * 5)
        self.bank = KalmanBank(COMPONENTS)
        self.items: list[EventsTrack] = []
        self.unrest = Unrest()

    def __len__(self) -> int:
        return len(self.items)

    @property
    def sizes(self) -> Floats:
        """The targets' sizes: square root of width times height, (N,) pixels."""
        return sizes_of(self.bank.value)

    @property
    def boxes(self) -> Floats:
        """Estimated boxes, (N, 4): x, y, w, h in pixels."""
        return boxes_of(self.bank.value)

    def behind(self, row: int) -> int | None:
        """The row of the target that a lost one was last hidden behind, if it is still there."""
        track = self.items[row]
        if not track.lost or track.front == TENTATIVE:
            return None
        return next(
            (index for index, item in enumerate(self.items) if item.id == track.front), None
        )

    def box(self, row: int) -> Box:
        """The estimated box of one track."""
        cx, cy, w, h = self.bank.value[row, :4].tolist()
        return (cx - w / 2, cy - h / 2, w, h)

    def shapes(self) -> list[tuple[Box, Ellipse, tuple[float, float]]]:
        """The estimated boxes and ellipses of all tracks, angles in (-pi/2, pi/2], and their
        velocities in pixels per second.
        """
        found: list[tuple[Box, Ellipse, tuple[float, float]]] = []
        for state, rate in zip(
            self.bank.value.tolist(), self.bank.rate.tolist(), strict=True
        ):
            cx, cy, w, h, major, minor, theta = state
            turned = theta - math.pi * math.ceil(theta / math.pi - 0.5)
            ellipse = Ellipse(cx, cy, max(major, minor), min(major, minor), turned)
            found.append(((cx - w / 2, cy - h / 2, w, h), ellipse, (rate[0], rate[1])))
        return found

    def measurement_variance(self, sizes: Floats) -> Floats:
        """Variances of all components as measured on targets of the given sizes, (N, COMPONENTS)."""
        out = np.asarray((sizes[:, None] * self._noise) ** 2)
        out[:, 6] = _TURN * _TURN
        return out

    def place_variance(self, sizes: Floats) -> Floats:
        """Variance of a coordinate of the centre as measured on targets of the given sizes, (N,)."""
        return np.asarray((sizes * self._p.place_noise) ** 2)

    def doubt(self, rows: NDArray[np.intp]) -> Floats:
        """Standard deviation of the places (M, 2) of some rows, pixels, beyond a measurement's."""
        known = self.place_variance(self.sizes[rows])[:, None]
        return np.asarray(np.sqrt(np.maximum(self.bank.p00[rows, :2] - known, 0.0)))

    def predict(self, dt: float) -> None:
        """Advance all tracks by dt seconds: places move on, shapes stay and become less certain."""
        if not self.items or dt <= 0:
            return
        p = self._p
        sizes = self.sizes[:, None]
        self.bank.predict(dt, (sizes * self._agility) ** 2)
        self.bank.p00[:, 2:6] += (sizes * p.size_drift) ** 2 * dt
        self.bank.p00[:, 6] += _TURN * _TURN * dt

    def loosen(self, time_ns: int, frame_s: float) -> None:
        """Note whose place is not known any more: the scene's unrest adds up while one is unseen."""
        off = float(self.unrest.off.max())
        for track in self.items:
            frames = track.unseen_s(time_ns) / frame_s
            track.loose = off * off * frames > ADRIFT * ADRIFT

    def lean(self, rows: NDArray[np.intp], expected: Floats, dt: float) -> None:
        """Let sizes that were not measured lean towards those that are expected at their places
        (M, 2).
        """
        bank = self.bank
        # What is usual there says the same in every frame, so it counts once in a while only.
        noise = (self._p.body_spread * expected[:, 1:]) ** 2 * max(
            1.0, self._p.lean_s / max(dt, 1e-9)
        )
        gain = bank.p00[rows, 2:4] / (bank.p00[rows, 2:4] + noise)
        foot = bank.value[rows, 1] + bank.value[rows, 3] / 2
        bank.value[rows, 2:4] += gain * (expected - bank.value[rows, 2:4])
        bank.p00[rows, 2:4] *= 1 - gain
        bank.value[rows, 1] = foot - bank.value[rows, 3] / 2

    def correct(
        self, row: int, box: Box, ellipse: Ellipse | None, sized: bool = True
    ) -> None:
        """Correct a row with a measured box and ellipse; ``sized`` False: the shape tells
        nothing, the place less.
        """
        measured = _measured(box, ellipse, float(self.bank.value[row, 6]))
        variance = (math.sqrt(max(box[2] * box[3], 1.0)) * self._noise) ** 2
        variance[6] = _TURN * _TURN
        if not sized:
            variance[:2] *= self._p.looseness * self._p.looseness
            variance[2:] = 1e12
        else:
            # The shape of a blob is its target's own, that of a detector's box is noise more often.
            self._wake(
                row,
                measured,
                variance,
                (_PLACE, _SHAPE) if ellipse is not None else (_PLACE,),
            )
        self.bank.update_row(row, measured, variance)

    def correct_all(
        self, rows: Sequence[int], boxes: Floats, ellipses: Sequence[Ellipse | None]
    ) -> None:
        """`correct` with sizes, for several rows at once, each named once: boxes (M, 4)."""
        bank, at = self.bank, np.array(rows, np.intp)
        state = bank.value[at]
        measured = np.array(
            [
                _plain_measured(*m)
                for m in zip(boxes.tolist(), ellipses, state[:, 6].tolist(), strict=True)
            ]
        )
        variance = self.measurement_variance(sizes_of(boxes))
        residual = measured - state
        surprise = (
            residual
            * residual
            / ((bank.p00[at] + variance) * (self._p.surprise * self._p.surprise))
        )
        factor = np.ones(surprise.shape)
        factor[:, _PLACE] = _awakening(surprise[:, _PLACE])
        shaped = [index for index, ellipse in enumerate(ellipses) if ellipse is not None]
        if shaped:
            factor[shaped, 2:] = _awakening(surprise[shaped, 2:])
        if shaped or bool((factor != 1.0).any()):
            for table in (bank.p00, bank.p01, bank.p11):
                table[at] *= factor
        bank.update(at, measured, variance)

    def _wake(
        self, row: int, measured: Floats, variance: Floats, parts: Sequence[slice]
    ) -> None:
        """A target that turns or starts off surprises its filter: believe the prediction less, by
        the surprise.
        """
        bank = self.bank
        residual = measured - bank.value[row]
        spread = (bank.p00[row] + variance) * (self._p.surprise * self._p.surprise)
        surprise = residual * residual / spread
        for part in parts:
            factor = float(surprise[part].max())
            if factor > 1.0:
                for table in (bank.p00, bank.p01, bank.p11):
                    table[row, part] *= min(factor, 25.0)

    def launch(self, row: int, box: Box, dt: float) -> None:
        """A row is seen ``dt`` seconds on so far off that it must be as fast as that: no speed
        was too great for it. The correction that follows gives it the speed.
        """
        x, y, w, h = box
        step = np.array([x + w / 2, y + h / 2]) - self.bank.value[row, :2]
        speed2 = max(float((step * step).sum()), 1.0) * (2.0 / dt) ** 2
        self.bank.p11[row, :2] += speed2
        self.bank.p01[row, :2] += speed2 * dt
        self.bank.p00[row, :2] += speed2 * dt * dt

    def start(self, box: Box, ellipse: Ellipse | None, track: EventsTrack) -> None:
        """Append a track at a measured box and ellipse."""
        size = math.sqrt(max(box[2] * box[3], 1.0))
        variance = self.measurement_variance(np.array([size]))
        speed = np.array([self._p.speed] * 2 + [0.0] * 5)
        self.bank.add(
            _measured(box, ellipse, math.pi / 2)[None], variance, (size * speed) ** 2
        )
        self.items.append(track)

    def keep(self, kept: list[int]) -> None:
        """Keep the given rows, in that order."""
        if len(kept) != len(self.items):
            self.bank.keep(np.array(kept, np.intp))
            self.items = [self.items[row] for row in kept]

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {
            "bank": self.bank.state(),
            "items": [_plain(item) for item in self.items],
            "unrest": self.unrest.state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self.bank.restore(state["bank"])
        self.items = [_track(t) for t in state["items"]]
        self.unrest.restore(state["unrest"])


def _awakening(surprise: Floats) -> Floats:
    """What to multiply the covariance of components (N, D) by that were surprised so much, (N,
    1).
    """
    most = np.maximum.reduce(surprise, axis=1, keepdims=True)
    return np.asarray(np.where(most > 1.0, np.minimum(most, 25.0), 1.0))


def _plain(track: EventsTrack) -> dict[str, Any]:
    out = {f.name: getattr(track, f.name) for f in fields(track)}
    out["colours"] = None if track.colours is None else track.colours.state()
    out["measured"] = None if track.measured is None else list(track.measured)
    out["fresh"] = None if track.fresh is None else track.fresh.state()
    out["stranger"] = None if track.stranger is None else track.stranger.state()
    out["known"] = list(track.known)
    out["members"] = list(track.members)
    out["company"] = [list(column) for column in track.company]
    out["sightings"] = [list(sighting) for sighting in track.sightings]
    out["regions"] = [list(region) for region in track.regions]
    return out


def _track(state: Mapping[str, Any]) -> EventsTrack:
    plain = dict(state)
    plain["colours"] = (
        None if plain["colours"] is None else Colours.from_state(plain["colours"])
    )
    plain["measured"] = None if plain["measured"] is None else tuple(plain["measured"])
    plain["fresh"] = None if plain["fresh"] is None else Colours.from_state(plain["fresh"])
    plain["stranger"] = (
        None if plain["stranger"] is None else Colours.from_state(plain["stranger"])
    )
    plain["known"] = list(plain["known"])
    plain["members"] = list(plain["members"])
    plain["company"] = [list(column) for column in plain["company"]]
    plain["sightings"] = [list(s) for s in plain["sightings"]]
    plain["regions"] = [list(row) for row in plain["regions"]]
    return EventsTrack(**plain)


def _measured(box: Box, ellipse: Ellipse | None, near: float) -> Floats:
    """The bank's components of a box and its ellipse, the angle unwrapped to the half turn around
    ``near``.
    """
    return np.array(_plain_measured(box, ellipse, near))


def _plain_measured(
    box: Sequence[float], ellipse: Ellipse | None, near: float
) -> tuple[float, ...]:
    """`_measured` as plain numbers."""
    x, y, w, h = box
    major, minor, theta = (max(w, h), min(w, h), math.pi / 2 if h >= w else 0.0)
    if ellipse is not None:
        major, minor, theta = ellipse.h, ellipse.w, ellipse.theta
    theta += math.pi * math.floor((near - theta) / math.pi + 0.5)
    return x + w / 2, y + h / 2, w, h, major, minor, theta
