"""The life of an object: where it may start, when it is confirmed, found again, lost, removed
(EVENTS 2, 3.2).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reasoning.regions import RegionParameters, SceneRegions, default_regions
from recorders.messages import Mode, Notice, Regions
from replay.trackers.shells import births
from replay.trackers.shells.objects import TENTATIVE, Bodies, Body
from replay.trackers.shells.parameters import ShellsParameters
from replay.trackers.tracker import Frame, SceneInfo

Floats = NDArray[np.float64]
NS = 1e-9


class Life:
    """Gives ids, and decides who starts, is confirmed, lost and removed."""

    def __init__(
        self,
        scene: SceneInfo,
        bodies: Bodies,
        parameters: ShellsParameters,
        k_s: float,
        regions: RegionParameters,
    ) -> None:
        self._bodies = bodies
        self._p = parameters
        self._k_s = k_s
        self._region_parameters = regions
        self._width, self._height = scene.width, scene.height
        self._drawn: Regions | None = None
        self._regions = SceneRegions(
            default_regions(scene.width, scene.height, regions), regions
        )
        self._next_id = 1

    def take_regions(self, regions: Regions | None) -> None:
        """Take a frame's regions; None leaves those of the picture."""
        if regions is not None and regions != self._drawn:
            self._drawn = regions
            self._regions = SceneRegions(regions, self._region_parameters)

    def may_start(self, boxes: Floats) -> NDArray[np.bool_]:
        """Which of boxes (N, 4) may start an object: their centres lie in the region of interest
        or the border.
        """
        return self._regions.may_start_low_level_all(boxes[:, :2] + boxes[:, 2:] / 2)

    def confirm(self, frame: Frame) -> list[Notice]:
        """New objects with enough support get an identity, their own or that of one who had been
        lost.
        """
        notices: list[Notice] = []
        for row, body in enumerate(self._bodies.items):
            if (
                body.id != TENTATIVE
                or not body.observed
                or body.hits < self._p.confirm_hits
            ):
                continue
            if (frame.time_ns - body.born_ns) * NS < self._p.confirm_s:
                continue
            if self._returns(row, frame, notices) or not self._may_confirm(row):
                continue
            body.id = self._next_id
            self._next_id += 1
            body.newborn = True
            if body.area <= 0:
                body.area = births.area_of(self._bodies.box(row), body.blob, frame)
            evidence = {
                "hits": body.hits,
                "first_frame": body.born,
                "sightings": body.sightings[:-1],
            }
            notices.append(
                Notice("track_confirmed", [body.id], "EVENTS 2: enough support", evidence)
            )
            body.sightings = []
        return notices

    def _may_confirm(self, row: int) -> bool:
        """Where somebody has drawn the regions, a target starts at least partly in the region of
        interest (EVENTS 3.2).

        The default one leaves out the picture's rim, along which animals in a dish or tank live:
        there they start too.
        """
        default = self._drawn is None or self._drawn.source == "default"
        return default or self._regions.may_start_high_level(self._bodies.box(row))

    def _returns(self, row: int, frame: Frame, notices: list[Notice]) -> bool:
        """Whether a new object is one that was lost: then that one takes its place, and the new
        one is dropped.
        """
        body = self._bodies.items[row]
        known = births.returned(
            body, row, self._bodies, self._bodies.radii(self._k_s), frame, self._p
        )
        if known is None:
            return False
        old = self._bodies.items[known.row]
        self._bodies.exchange(known.row, row)
        old.lost, old.mode, old.hits = False, "motion", old.hits + body.hits
        # The place that it was lost at is of no more use.
        body.observed, body.seen_ns = False, body.seen_ns - round(60 * self._p.keep_s / NS)
        what = "colour_distance" if known.by_colours else "path_cost"
        evidence = {what: known.cost, "limit": known.limit, "unseen_s": known.unseen_s}
        told = "of its own colours" if known.by_colours else "on its own path"
        rule = f"SHELLS 2.3, ours: reappears within reach, {told}"
        notices.append(Notice("track_recovered", [old.id], rule, evidence))
        return True

    def age(self, frame: Frame) -> list[Notice]:
        """Confidence falls while an object is unseen; then it is lost, then removed."""
        notices: list[Notice] = []
        kept = []
        for row, body in enumerate(self._bodies.items):
            unseen = (frame.time_ns - body.seen_ns) * NS
            if body.id == TENTATIVE:
                if unseen <= self._p.tentative_s:
                    kept.append(row)
                continue
            mode: Mode = body.now if body.observed else "predicted"
            if mode != body.mode:
                change = {"from": body.mode, "to": mode, "unseen_s": unseen}
                notices.append(
                    Notice("mode_changed", [body.id], "EVENTS 2: matching case", change)
                )
                body.mode = mode
            body.confidence = body.quality * 0.5 ** (unseen / self._p.half_life_s)
            # Behind somebody who lies where it should be, an object can be nowhere else.
            patience = self._p.hidden_patience if body.front else 1.0
            lost = unseen > patience * self._p.coast_s
            if lost != body.lost:
                kind = "track_lost" if lost else "track_recovered"
                notices.append(
                    Notice(
                        kind,
                        [body.id],
                        "EVENTS 2: unseen for too long",
                        {"unseen_s": unseen},
                    )
                )
                body.lost = lost
            why = self._must_go(row, body, unseen)
            if why is not None:
                evidence = {
                    "unseen_s": unseen,
                    "confidence": body.confidence,
                    "box": list(self._bodies.box(row)),
                }
                notices.append(Notice("track_removed", [body.id], why, evidence))
                continue
            kept.append(row)
        self._bodies.keep(kept)
        return notices

    def _must_go(self, row: int, body: Body, unseen: float) -> str | None:
        if unseen > self._p.keep_s:
            return "EVENTS 2: no observation for longer than targets are kept"
        cx, cy = self._bodies.bank.value[row, :2].tolist()
        if not (0 <= cx < self._width and 0 <= cy < self._height):
            return "EVENTS 3.2, ours: its centre has left the picture"
        return self._regions.must_remove(
            self._bodies.box(row), body.mode, min(1.0, max(0.0, body.confidence))
        )

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {"next_id": self._next_id}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._next_id = state["next_id"]
