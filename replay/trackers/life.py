"""A target's life, one for all trackers: tentative, confirmed, seen, lost, found again, removed.

EVENTS 2: a track begins tentative; enough support confirms it; low quality removes it. EVENTS
3.2: it begins in the region of interest and ends outside of region and border. Where a paper
wants another thing, its row of `PAPERS` says so; nothing else differs.

A tracker's own target is a `Living` with more fields. `Living.sighted` takes an observation;
`Life.is_ripe` and `Life.confirm` say who becomes a target; `Life.age` says, once a frame, in
which mode a target is followed, how sure it is that it is there, and whether it is lost or has
to go.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from reasoning.geometry import OUTSIDE
from reasoning.regions import (
    LOW_CONFIDENCE,
    RegionParameters,
    SceneRegions,
    default_regions,
)
from recorders.messages import NO_BLOB, Box, Mode, Notice, Regions, TrackSighting
from replay.trackers.pace import stretch
from replay.trackers.tracker import SceneInfo

Floats = NDArray[np.float64]
NANOS = 1e9
TENTATIVE = -1
"""The identity of who is not confirmed."""
ADRIFT = "ours: where it is by now is not known, and there are no colours to know it by"
HALF_LIFE_S = 0.5
"""The forward pass's confidence in an unseen target halves in this time."""
_REMEMBERED = 10
"""Observations that the quality is a running mean of, at most."""


@dataclass(slots=True)
class Living:
    """What every tracker knows of a target's life.

    Attributes:
        id: identity, `TENTATIVE` before confirmation.
        born: frame of the first observation; born_ns its time.
        seen_ns: time of the last observation.
        hits: observations so far.
        quality: running mean of the observations' scores, in [0, 1].
        mode: how it is followed, as it was told last; confidence: how sure that is, in [0, 1].
        observed: it was observed in this frame.
        blob: the blob that it was observed in.
        newborn: this is the frame of its confirmation.
        lost: held, but no longer said to be present.
        split: it was born of a split.
        measured: the box that it was observed in, in this frame.
        now: how it was observed last.
        signed: its colours were learnt in this frame.
        sightings: while tentative, [frame, x, y, w, h] of every observation: its earlier life.
    """

    id: int
    born: int
    born_ns: int
    seen_ns: int
    hits: int = 1
    quality: float = 1.0
    mode: Mode = "motion"
    confidence: float = 1.0
    observed: bool = True
    blob: int = NO_BLOB
    newborn: bool = False
    lost: bool = False
    split: bool = False
    measured: Box | None = None
    now: Mode = "motion"
    signed: bool = False
    sightings: list[list[float]] = field(default_factory=list)

    @property
    def told(self) -> bool:
        """Whether anything is said of it."""
        return self.id != TENTATIVE

    @property
    def hiding(self) -> bool:
        """Whether it is held to be behind somebody, so that it is not seen for a good reason."""
        return False

    @property
    def kept(self) -> bool:
        """Whether it is not lost, however long it is not seen."""
        return False

    @property
    def anywhere(self) -> bool:
        """Whether it may be outside of the region of interest."""
        return False

    @property
    def adrift(self) -> bool:
        """Whether it may be anywhere by now, so that nothing can be told to be it."""
        return False

    @property
    def way(self) -> Mode:
        """How it is followed in this frame."""
        return self.now if self.observed else "predicted"

    def unseen_s(self, time_ns: int) -> float:
        """Seconds since the last observation."""
        return (time_ns - self.seen_ns) / NANOS

    def sighted(self, time_ns: int, score: float, blob: int, mode: Mode) -> None:
        """Take note of an observation with a score in [0, 1]."""
        self.seen_ns = time_ns
        self.hits += 1
        self.quality += (score - self.quality) / min(self.hits, _REMEMBERED)
        self.observed = True
        self.now = mode
        self.blob = blob


class LifeParameters(Protocol):
    """The parameters of a life, by the names that every tracker's section has."""

    @property
    def confirm_s(self) -> float:
        """Least age of a target that is confirmed, seconds."""
        ...

    @property
    def confirm_hits(self) -> int:
        """And its least number of observations."""
        ...

    @property
    def tentative_s(self) -> float:
        """A tentative target unseen for longer is dropped, seconds."""
        ...

    @property
    def coast_s(self) -> float:
        """A target unseen for longer is lost, seconds."""
        ...

    @property
    def keep_s(self) -> float:
        """A target unseen for longer is removed, seconds."""
        ...


@dataclass(frozen=True)
class Paper:
    """Where one tracker's lives differ from the others'.

    Attributes:
        confirmed, lost, found, kept, mode: the rules that its notices name.
        roi: who may be confirmed outside of the region of interest: nobody; anybody unless
            somebody has drawn the region; anybody.
        picture: the rule by which a target goes whose centre has left the picture, "" for none.
        faith: the confidence of who is hiding falls slower, as its patience is greater.
    """

    confirmed: str
    lost: str
    found: str
    kept: str
    mode: str
    roi: Literal["nobody", "unless drawn", "anybody"]
    picture: str
    faith: bool


_KEPT = "no observation for longer than targets are kept"
PAPERS: Mapping[str, Paper] = {
    "events": Paper(
        confirmed="EVENTS 2: enough support, at least partly in the region of interest",
        lost="EVENTS 2: no observation for too long",
        found="EVENTS 2, matching case 1: an observation where it was expected",
        kept=f"EVENTS 2: {_KEPT}",
        mode="EVENTS 2, matching case {case}",
        roi="nobody",
        picture="",
        faith=True,
    ),
    # The default region leaves out the picture's rim, along which animals in a dish or tank live.
    "shells": Paper(
        confirmed="EVENTS 2: enough support",
        lost="EVENTS 2: unseen for too long",
        found="EVENTS 2: seen again where it was expected",
        kept=f"EVENTS 2: {_KEPT}",
        mode="EVENTS 2: matching case",
        roi="unless drawn",
        picture="EVENTS 3.2, ours: its centre has left the picture",
        faith=False,
    ),
    "parts": Paper(
        confirmed="PARTS 3: a new blob or a split",
        lost="PARTS 3: the gate grows until found or lost",
        found="PARTS 3: the gate grows until found or lost",
        kept=f"PARTS 3: {_KEPT}",
        mode="PARTS 3.1: occlusion test",
        roi="anybody",
        picture="PARTS 3: out of the picture",
        faith=False,
    ),
}
"""The trackers' differences."""
_CASES: Mapping[Mode, int] = {"motion": 1, "appearance": 3, "predicted": 3}


class Life:
    """Gives identities, and decides who is confirmed, lost and removed.

    Attributes:
        regions: the scene's regions in this frame.
    """

    def __init__(
        self,
        paper: str,
        scene: SceneInfo,
        parameters: LifeParameters,
        regions: RegionParameters | None = None,
        hidden_patience: float = 1.0,
    ) -> None:
        """``hidden_patience``: who is hiding is held so many times longer."""
        self._paper = PAPERS[paper]
        self._p = parameters
        self._patience = hidden_patience
        self._region_parameters = regions
        self._size = (scene.width, scene.height)
        self._half_life_s = HALF_LIFE_S * stretch(scene.frame_ns)
        self._drawn: Regions | None = None
        self._next_id = 1
        self.regions = SceneRegions(
            default_regions(scene.width, scene.height, regions), regions
        )

    def take_regions(self, regions: Regions | None) -> None:
        """Take a frame's regions; None leaves those that there are."""
        if regions is not None and regions != self._drawn:
            self._drawn = regions
            self.regions = SceneRegions(regions, self._region_parameters)

    def new_id(self) -> int:
        """The next identity; none is ever given twice."""
        self._next_id += 1
        return self._next_id - 1

    def is_ripe(self, item: Living, time_ns: int) -> bool:
        """Whether a tentative target has had enough support, and has it now."""
        return (
            item.id == TENTATIVE
            and item.observed
            and item.hits >= self._p.confirm_hits
            and (time_ns - item.born_ns) / NANOS >= self._p.confirm_s
        )

    def may_confirm(self, box: Box) -> bool:
        """Whether a target may begin here: at least partly in the region of interest (EVENTS
        3.2).
        """
        roi = self._paper.roi
        drawn = self._drawn is not None and self._drawn.source != "default"
        if roi == "anybody" or (roi == "unless drawn" and not drawn):
            return True
        return self.regions.may_start_high_level(box)

    def confirm(self, item: Living, time_ns: int, rule: str = "") -> Notice:
        """Make a tentative target one of the targets; ``rule``: why, where that is special."""
        item.id, item.newborn = self.new_id(), True
        earlier, item.sightings = item.sightings[:-1], []
        evidence: dict[str, Any] = {"hits": item.hits}
        if not rule:
            evidence["hits_at_least"] = self._p.confirm_hits
        evidence["age_s"] = (time_ns - item.born_ns) / NANOS
        if not rule:
            evidence["age_s_at_least"] = self._p.confirm_s
        evidence["first_frame"] = item.born
        return Notice(
            "track_confirmed",
            [item.id],
            rule or self._paper.confirmed,
            evidence,
            sightings=sightings_of(earlier),
        )

    def age(
        self,
        items: Sequence[Living],
        boxes: Floats,
        time_ns: int,
        onward: Callable[[int], Floats] | None = None,
    ) -> tuple[list[int], list[Notice]]:
        """End a frame for all targets: modes and confidences, who is lost, found, removed.

        Args:
            items: all targets, tentative ones too.
            boxes: (N, 4) theirs.
            time_ns: the frame's time.
            onward: (row) -> the box (4,) where a target that is not seen should be by now, if
                that is not its box.

        Returns:
            The rows that stay, and what is to be told, by row.
        """
        kept: list[int] = []
        notices: list[Notice] = []
        plain: list[Box] = boxes.tolist()
        places = self.regions.area_cover(plain)
        for row, item in enumerate(items):
            unseen = item.unseen_s(time_ns)
            if item.id == TENTATIVE:
                if unseen <= self._p.tentative_s:
                    kept.append(row)
                continue
            told = self._mode(item, unseen) + self._lost(item, unseen)
            box = plain[row]
            why = self._must_go(item, box, places[row], unseen)
            if why is None:
                kept.append(row)
            else:
                left = places[row] == OUTSIDE
                if onward is not None:
                    left = self.regions.area_cover([onward(row).tolist()])[0] == OUTSIDE
                told.append(self._removed(item, unseen, box, why, left))
            notices += told if item.told else []
        return kept, notices

    def _mode(self, item: Living, unseen: float) -> list[Notice]:
        patience = self._patience if item.hiding and self._paper.faith else 1.0
        item.confidence = item.quality * 0.5 ** (unseen / (patience * self._half_life_s))
        mode = item.way
        if mode == item.mode:
            return []
        evidence = {
            "from": item.mode,
            "to": mode,
            "unseen_s": unseen,
            **({"unseen_s_over": 0.0} if mode == "predicted" else {}),
            "confidence": item.confidence,
        }
        item.mode = mode
        rule = self._paper.mode.format(case=_CASES[mode])
        return [Notice("mode_changed", [item.id], rule, evidence)]

    def _lost(self, item: Living, unseen: float) -> list[Notice]:
        limit = (self._patience if item.hiding else 1.0) * self._p.coast_s
        lost = unseen > limit and not item.kept
        if lost == item.lost:
            return []
        item.lost = lost
        kind, rule, held = (
            ("track_lost", self._paper.lost, "over")
            if lost
            else ("track_recovered", self._paper.found, "at_most")
        )
        evidence = {
            "unseen_s": unseen,
            f"unseen_s_{held}": limit,
            "confidence": item.confidence,
        }
        return [Notice(kind, [item.id], rule, evidence)]

    def _must_go(self, item: Living, box: Box, place: int, unseen: float) -> str | None:
        if unseen > self._p.keep_s:
            return self._paper.kept
        if item.lost and item.adrift:
            return ADRIFT
        if self._paper.picture:
            x, y, w, h = box
            width, height = self._size
            if not (0 <= x + w / 2 < width and 0 <= y + h / 2 < height):
                return self._paper.picture
        if item.anywhere:
            return None
        return self.regions.reason_to_remove(
            place, item.mode, min(1.0, max(0.0, item.confidence))
        )

    def _removed(
        self, item: Living, unseen: float, box: Box, why: str, left: bool
    ) -> Notice:
        evidence: dict[str, Any] = {"unseen_s": unseen}
        if why == self._paper.kept:
            evidence["unseen_s_over"] = self._p.keep_s
        evidence["confidence"] = item.confidence
        if why == LOW_CONFIDENCE:
            evidence["confidence_under"] = self.regions.low_confidence
        evidence |= {"box": list(box), "left_scene": left}
        return Notice("track_removed", [item.id], why, evidence, left_scene=left)

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint; the regions come with the next frame."""
        return {"next_id": self._next_id}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._next_id = state["next_id"]


def sightings_of(rows: Sequence[Sequence[float]]) -> list[TrackSighting]:
    """[frame, x, y, w, h] as messages have it."""
    return [TrackSighting(int(k), (x, y, w, h)) for k, x, y, w, h in rows]
