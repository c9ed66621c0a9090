"""The PARTS tracker: people under heavy occlusion by five parts and layered data association.

Ties: joint assignment by `replay.trackers.association.assign` (targets in the order of their
birth, anchors in the order of the observations); ids are given in the order of birth. Deviations
from the paper are said where they are made (`candidates`, `features`, `heads`, `targets`); here:
a target alone in a blob of its own that fits is matched to it without a comparison of parts,
except every `learn_s`, when its parts are learnt.
"""

from __future__ import annotations

import numpy as np
from msgspec import UNSET

from reasoning.geometry import OUTSIDE
from reasoning.regions import RegionParameters, SceneRegions, default_regions
from recorders.messages import NO_BLOB, Box, Mode, Notice, Regions
from recorders.messages import Target as Answer
from recorders.messages import Targets as Answers
from recorders.segmentation.sizes import SizeModel
from replay.trackers.parts.beginning import Beginning, parse_init
from replay.trackers.parts.candidates import observe
from replay.trackers.parts.features import Room
from replay.trackers.parts.heads import ColourShapeHeads, HeadDetector
from replay.trackers.parts.matching import Matching
from replay.trackers.parts.parameters import PartsParameters
from replay.trackers.parts.regions import PARTS
from replay.trackers.parts.scoring import PartFeatures, Scorer
from replay.trackers.parts.signature import signature
from replay.trackers.parts.targets import BYSTANDERS, TENTATIVE, Targets
from replay.trackers.tracker import Frame, SceneInfo, State

NS = 1e-9
BODY_SPREAD = 0.12
"""Standard deviation of bodies' sizes around the size model, of their height."""


class PartsTracker:
    """The PARTS tracker: see `replay.trackers.tracker.Tracker`.

    Args:
        scene: what is known of the recording.
        parameters: section ``parts``.
        features: section ``part_features``.
        find_heads: another head detector, if wanted.
        region_parameters: section ``regions``: where targets start and end (EVENTS 3.2).

    Raises:
        ConfigError: ``init`` or a feature's model cannot be read.
    """

    def __init__(
        self,
        scene: SceneInfo,
        parameters: PartsParameters,
        features: PartFeatures,
        find_heads: HeadDetector | None = None,
        region_parameters: RegionParameters | None = None,
    ) -> None:
        self._scene = scene
        self._region_parameters = region_parameters or RegionParameters()
        self._regions_message: Regions | None = None
        self._regions = SceneRegions(
            default_regions(scene.width, scene.height, region_parameters), region_parameters
        )
        self._p = parameters
        self._scorer = Scorer(features)
        self._find_heads = find_heads or ColourShapeHeads()
        self._by_hand = parse_init(parameters.init)
        self._targets = Targets(parameters)
        self._next_ids = (1, BYSTANDERS)
        self._time_ns: int | None = None
        self._room = Room((scene.width, scene.height)) if scene.has_masks else None

    def step(self, frame: Frame) -> Answers:
        """Take the next frame, answer with all targets, by id."""
        notices: list[Notice] = []
        self._take_regions(frame.regions)
        dt = 0.0 if self._time_ns is None else (frame.time_ns - self._time_ns) * NS
        self._time_ns = frame.time_ns
        targets = self._targets
        targets.predict(dt)
        self._lean(SizeModel.from_list(frame.detections.size_model))
        for item in targets.items:
            item.begin_frame()
        seen = observe(frame.detections)
        matching = Matching(
            self._scene,
            frame,
            seen,
            targets,
            self._p,
            dt if dt > 0 else self._scene.frame_ns * NS,
            self._room,
        )
        gates = {
            item.id: gate
            for item, gate in zip(targets.items, matching.gates(), strict=True)
            if item.told
        }
        matching.run(self._scorer, self._find_heads, notices)
        begin = Beginning(self._p, targets)
        begin.by_hand(frame, self._by_hand)
        begin.automatic(frame, seen, matching.unexplained(), self._regions)
        matching.learn_new()
        self._next_ids = begin.confirm(frame, self._next_ids, notices, bool(self._by_hand))
        self._age(frame, notices)
        return self._answer(frame, notices, gates)

    def _take_regions(self, regions: Regions | None) -> None:
        if regions is not None and regions != self._regions_message:
            self._regions_message = regions
            self._regions = SceneRegions(regions, self._region_parameters)

    def _lean(self, model: SizeModel | None) -> None:
        """Predicted sizes of targets that are not seen whole lean towards those usual at their
        places.
        """
        rows = np.array(
            [
                k
                for k, t in enumerate(self._targets.items)
                if t.now != "motion" or not t.observed
            ],
            np.intp,
        )
        if model is not None and len(rows):
            boxes = self._targets.boxes[rows]
            heights = model.heights(boxes[:, 1] + boxes[:, 3])
            self._targets.lean(
                rows, np.stack([model.aspect * heights, heights], axis=1), BODY_SPREAD
            )

    def _age(self, frame: Frame, notices: list[Notice]) -> None:
        """Confidence falls while a target is unseen; then it is lost, then removed."""
        kept = []
        p = self._p
        places = self._regions.area_cover(self._targets.boxes)
        for row, item in enumerate(self._targets.items):
            unseen = (frame.time_ns - item.seen_ns) * NS
            if not item.observed:
                self._targets.misses[row] += 1
            if item.id == TENTATIVE:
                if unseen <= p.tentative_s:
                    kept.append(row)
                continue
            mode: Mode = item.now if item.observed else "predicted"
            told = notices if item.told else []
            if mode != item.mode:
                change = {"from": item.mode, "to": mode, "unseen_s": unseen}
                told.append(
                    Notice("mode_changed", [item.id], "PARTS 3.1: occlusion test", change)
                )
                item.mode = mode
            item.confidence = item.quality * 0.5 ** (unseen / p.half_life_s)
            lost = unseen > p.coast_s
            if lost != item.lost:
                kind = "track_lost" if lost else "track_recovered"
                told.append(
                    Notice(
                        kind,
                        [item.id],
                        "PARTS 3: the gate grows until found or lost",
                        {"unseen_s": unseen},
                    )
                )
                item.lost = lost
            why = self._must_go(row, unseen, places[row])
            if why is None:
                kept.append(row)
                continue
            box = self._targets.boxes[row].tolist()
            evidence = {"unseen_s": unseen, "confidence": item.confidence, "box": box}
            # The place stays where the target was last seen: only the speed says that it went on,
            # out of the scene.
            evidence["left_scene"] = (
                self._regions.area_cover(self._targets.onward(row)[None])[0] == OUTSIDE
            )
            told.append(Notice("track_removed", [item.id], why, evidence))
        self._targets.keep(kept)

    def _must_go(self, row: int, unseen: float, place: int) -> str | None:
        """Why a target has to go, None if it may stay. Who was started by hand may be anywhere in
        the picture.
        """
        item = self._targets.items[row]
        if unseen > self._p.keep_s:
            return "PARTS 3: no observation for longer than targets are kept"
        x, y, w, h = self._targets.boxes[row].tolist()
        if not (0 <= x + w / 2 < self._scene.width and 0 <= y + h / 2 < self._scene.height):
            return "PARTS 3: out of the picture"
        if item.manual:
            return None
        return self._regions.reason_to_remove(
            place, item.mode, min(1.0, max(0.0, item.confidence))
        )

    def _answer(
        self, frame: Frame, notices: list[Notice], gates: dict[int, Box]
    ) -> Answers:
        out = []
        targets = self._targets
        for row, item in enumerate(targets.items):
            # Bystanders are there for hindsight, which may find that one of them is a target that
            # was lost.
            if item.id == TENTATIVE or not (item.told or self._p.hindsight):
                continue
            vx, vy = targets.motion.rate[row].tolist()
            x, y, w, h = targets.boxes[row].tolist()
            out.append(
                Answer(
                    item.id,
                    (x, y, max(w, 1.0), max(h, 1.0)),
                    (vx, vy),
                    item.mode,
                    min(1.0, max(0.0, item.confidence)),
                    present=item.told and not item.lost,
                    observed=item.observed,
                    blob=item.blob if item.observed else NO_BLOB,
                    newborn=item.newborn,
                    born_of_split=item.newborn and item.split,
                    hidden_parts=[
                        name
                        for name, hid in zip(
                            PARTS, targets.hidden[row].tolist(), strict=True
                        )
                        if hid
                    ],
                    score=item.score,
                    measured=item.measured,
                    signature=signature(targets.model, row) if item.signed else [],
                    gate=gates.get(item.id, UNSET),
                    centroid=(float(targets.alpha[row]), float(targets.beta[row])),
                )
            )
        return Answers(frame.index, sorted(out, key=lambda t: t.id), None, notices)

    def state(self) -> State:
        """The whole state as plain data."""
        return {
            "next_ids": list(self._next_ids),
            "time_ns": self._time_ns,
            "targets": self._targets.state(),
        }

    def restore(self, state: State) -> None:
        """Continue from what `state` gave."""
        target, bystander = state["next_ids"]
        self._next_ids = (target, bystander)
        self._time_ns = state["time_ns"]
        self._targets.restore(state["targets"])
