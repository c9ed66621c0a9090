"""The objects: identity, colours and last mask of each, and the Kalman bank of their boxes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Box, Ellipse
from recorders.vision import cv2
from replay.trackers.association import boxes_of, sizes_of
from replay.trackers.kalman import KalmanBank
from replay.trackers.life import Living
from replay.trackers.shells.colours import BINS, MEMORY, histogram, without_colours
from replay.trackers.shells.liveliness import Liveliness
from replay.trackers.shells.parameters import ShellsParameters
from replay.trackers.tracker import Image

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

NOBODY = 0
"""In place of an identity: no occluder."""
GRID = 16
"""A last mask is kept on so many cells across and down the object's box."""
COMPONENTS = 4


@dataclass(slots=True)
class Body(Living):
    """One object; what belongs to its identity first, then where it is and how it was found in
    this frame.

    Attributes:
        colours: its colour histogram, None before the first look.
        updates: how often it was learnt.
        aside, aside_updates: the same as it is in the camera's other mode, by infrared or in colours.
        mask: (GRID, GRID) uint8, how often each cell of its box was its own, of 255, lately; None
            before that.
        area: its typical number of pixels when alone.
        centroid: where the mean of its pixels lies from the box's centre, in widths and heights,
            lately.
        visible: share of its area that was its own in the last frame.
        twin_s: for how long its box has all but coincided with that of an object seen better.
        front: the occluder within whose shell it is sought, `NOBODY` for none.
    """

    colours: Floats | None = None
    updates: int = 0
    aside: Floats | None = None
    aside_updates: int = 0
    mask: Image | None = None
    area: float = 0.0
    centroid: tuple[float, float] = (0.0, 0.0)
    misfit_s: float = 0.0
    twin_s: float = 0.0
    visible: float = 1.0
    alone: bool = False
    ellipse: Ellipse | None = None
    front: int = NOBODY

    @property
    def hiding(self) -> bool:
        """Behind somebody who lies where it should be, it can be nowhere else."""
        return self.front != NOBODY

    def begin_frame(self) -> None:
        """Forget what was true of the last frame alone."""
        self.newborn = self.observed = self.alone = self.signed = False
        self.measured = self.ellipse = None

    def learn_colours(self, seen: Floats) -> None:
        """Blend in a frame's histogram: a running mean that forgets after `MEMORY` updates."""
        if self.colours is None:
            self.colours = np.zeros(BINS)
        self.updates += 1
        self.colours = self.colours + (seen - self.colours) / min(self.updates, MEMORY)
        self.signed = True

    def turn(self, *, grey: bool) -> None:
        """The camera shows no colours any more, or shows them again: what it looked like the last
        time holds, or its brightness.
        """
        was, updates = self.colours, self.updates
        self.colours, self.updates = self.aside, self.aside_updates
        self.aside, self.aside_updates = was, updates
        if grey and self.colours is None and was is not None:
            self.colours, self.updates = without_colours(was), 1

    def learn_mask(self, own: NDArray[np.bool_]) -> None:
        """Blend in the mask (h, w) that fills the object's box."""
        cells = cv2.resize(
            own.astype(np.uint8) * np.uint8(255), (GRID, GRID), interpolation=cv2.INTER_AREA
        )
        fresh = np.asarray(cells, np.int16)
        if self.mask is not None:
            old = self.mask.astype(np.int16)
            fresh = old + (fresh - old) // 3
        self.mask = fresh.astype(np.uint8)

    def place_of(self, mean: tuple[float, float], box: Box) -> tuple[float, float]:
        """The centre of its box by the mean of its pixels, E[P]: that of the box (x, y, w, h)
        itself until it is known where in it the mean lies.
        """
        x, y, w, h = box
        if self.mask is None:
            return x + w / 2, y + h / 2
        return mean[0] - self.centroid[0] * w, mean[1] - self.centroid[1] * h

    def learn_centroid(self, mean: tuple[float, float], box: Box) -> None:
        """Blend in where in its box (x, y, w, h) the mean of its pixels lies; before `learn_mask`."""
        x, y, w, h = box
        seen = (mean[0] - x) / w - 0.5, (mean[1] - y) / h - 0.5
        a, b = seen if self.mask is None else self.centroid
        self.centroid = a + (seen[0] - a) / 3, b + (seen[1] - b) / 3

    def learn_area(self, area: float, weight: float) -> None:
        """Blend in the number of pixels of the object seen whole."""
        self.area = area if self.area <= 0 else self.area + weight * (area - self.area)

    def look(self, bins: NDArray[np.uint16], own: NDArray[np.bool_]) -> None:
        """Learn colours from the bins (h, w) of its box and the mask of its own pixels in it."""
        self.learn_colours(histogram(bins, own))


class Bodies:
    """All objects, new ones too, in the order of their birth; row k of the bank belongs to item k.

    The bank's components are the box's centre x and y, width and height, pixels.
    """

    def __init__(self, parameters: ShellsParameters, has_pixels: bool = True) -> None:
        self._p = p = parameters
        self._agility = p.agility if has_pixels else p.box_agility
        self.manner = (
            Liveliness(p.box_noise, p.box_agility, p.speed)
            if p.box_lively and not has_pixels
            else None
        )
        self.bank = KalmanBank(COMPONENTS)
        self.items: list[Body] = []

    def __len__(self) -> int:
        return len(self.items)

    @property
    def sizes(self) -> Floats:
        """Square root of width times height, (N,) pixels."""
        return sizes_of(self.bank.value)

    @property
    def boxes(self) -> Floats:
        """Estimated boxes, (N, 4): x, y, w, h in pixels."""
        return boxes_of(self.bank.value)

    def box(self, row: int) -> Box:
        """The estimated box of one object."""
        cx, cy, w, h = self.bank.value[row].tolist()
        return (cx - w / 2, cy - h / 2, w, h)

    def radii(self, k_s: float) -> Floats:
        """Shell radii r_min + k |v| (SHELLS 2.2), (N,) pixels: r_min is the smallest disc around
        the box.
        """
        v, r = self.bank.value, self.bank.rate
        smallest = 0.5 * np.sqrt(v[:, 2] * v[:, 2] + v[:, 3] * v[:, 3])
        return np.asarray(smallest + k_s * np.sqrt(r[:, 0] * r[:, 0] + r[:, 1] * r[:, 1]))

    def predict(self, dt: float) -> None:
        """Advance all objects by dt seconds: places move on, sizes stay and become less certain."""
        if not self.items or dt <= 0:
            return
        sizes = self.sizes[:, None]
        agility = self._agility
        if self.manner is not None:
            self.manner.predict(dt, sizes[:, 0])
            agility = self.manner.agility
        self.bank.predict(dt, (sizes * np.array([agility, agility, 0.0, 0.0])) ** 2)
        self.bank.rate[:, 2:] = 0.0
        self.bank.p00[:, 2:] += (sizes * 0.1) ** 2 * dt

    def move(self, row: int, place: tuple[float, float], a: float) -> None:
        """Position update (SHELLS, equation 9): C = a E[P] + (1 - a) prediction, and the speed
        that follows from it.
        """
        variance = self.bank.p00[row] * ((1 - a) / a)
        variance[2:] = 1e12
        measured = self.bank.value[row].copy()
        measured[:2] = place
        self.bank.update_row(row, measured, variance)

    def resize(self, row: int, width: float, height: float, a: float) -> None:
        """The same blend for width and height."""
        value = self.bank.value
        value[row, 2] += a * (width - value[row, 2])
        value[row, 3] += a * (height - value[row, 3])
        self.bank.p00[row, 2:] *= 1 - a

    def correct(self, row: int, box: Box) -> None:
        """Equation 9 with the filter's own gain in place of a: a measured box whose error is
        known.
        """
        x, y, w, h = box
        noise = self._p.box_noise if self.manner is None else self.manner.noise
        bank, variance = self.bank, max(w * h, 1.0) * noise * noise
        measured = np.array([x + w / 2, y + h / 2, w, h])
        bank.update_row(row, measured, variance)

    def start(self, box: Box, body: Body) -> None:
        """Append an object at a measured box."""
        x, y, w, h = box
        size = max(w * h, 1.0) ** 0.5
        rate = (size * np.array([self._p.speed] * 2 + [0.0] * 2)) ** 2
        self.bank.add(
            np.array([[x + w / 2, y + h / 2, w, h]]), (0.1 * size) ** 2, rate[None]
        )
        self.items.append(body)
        if self.manner is not None:
            self.manner.start((x + w / 2, y + h / 2), size)

    def keep(self, kept: list[int]) -> None:
        """Keep the given rows, in that order."""
        if len(kept) != len(self.items):
            self._keep(np.array(kept, np.intp))
            self.items = [self.items[row] for row in kept]

    def exchange(self, a: int, b: int) -> None:
        """Two objects change places: identity and colours stay, everything of the place moves."""
        one, two = self.items[a], self.items[b]
        for name in _OF_THE_PLACE:
            mine, theirs = getattr(one, name), getattr(two, name)
            setattr(one, name, theirs)
            setattr(two, name, mine)
        order = np.arange(len(self.items))
        order[[a, b]] = [b, a]
        self._keep(order)

    def _keep(self, rows: Rows) -> None:
        self.bank.keep(rows)
        if self.manner is not None:
            self.manner.keep(rows)

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        manner = None if self.manner is None else self.manner.state()
        return {
            "bank": self.bank.state(),
            "items": [_plain(item) for item in self.items],
            "manner": manner,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self.bank.restore(state["bank"])
        self.items = [_body(saved) for saved in state["items"]]
        if self.manner is not None:
            self.manner.restore(state["manner"])


_OF_THE_PLACE = (
    "seen_ns", "mask", "area", "centroid", "misfit_s", "twin_s", "visible", "observed", "alone", "now", "blob",
    "measured", "ellipse", "front",
)  # fmt: skip


def _plain(body: Body) -> dict[str, Any]:
    out = {field.name: getattr(body, field.name) for field in fields(body)}
    out["colours"] = None if body.colours is None else body.colours.copy()
    out["aside"] = None if body.aside is None else body.aside.copy()
    out["mask"] = None if body.mask is None else body.mask.copy()
    out["measured"] = None if body.measured is None else list(body.measured)
    e = body.ellipse
    out["ellipse"] = None if e is None else [e.x, e.y, e.h, e.w, e.theta]
    out["centroid"] = list(body.centroid)
    out["sightings"] = [list(sighting) for sighting in body.sightings]
    return out


def _body(state: Mapping[str, Any]) -> Body:
    plain = dict(state)
    plain["colours"] = (
        None if plain["colours"] is None else np.array(plain["colours"], np.float64)
    )
    plain["aside"] = (
        None if plain["aside"] is None else np.array(plain["aside"], np.float64)
    )
    plain["mask"] = None if plain["mask"] is None else np.array(plain["mask"], np.uint8)
    plain["measured"] = None if plain["measured"] is None else tuple(plain["measured"])
    plain["ellipse"] = None if plain["ellipse"] is None else Ellipse(*plain["ellipse"])
    plain["centroid"] = tuple(plain["centroid"])
    plain["sightings"] = [list(saved) for saved in plain["sightings"]]
    return Body(**plain)
