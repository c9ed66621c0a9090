"""The PARTS tracker: people under heavy occlusion by five parts and layered data association.

Ties: joint assignment by `replay.trackers.association.assign` (targets in the order of their
birth, anchors in the order of the observations); ids are given in the order of birth. Deviations
from the paper are said where they are made (`candidates`, `features`, `heads`, `targets`).
"""

from __future__ import annotations

from dataclasses import replace as alone

import numpy as np
from msgspec import UNSET
from msgspec.structs import replace
from numpy.typing import NDArray

from reasoning.geometry import middles_inside
from reasoning.regions import RegionParameters
from recorders.messages import NO_BLOB, Box, Notice
from recorders.messages import Target as Answer
from recorders.messages import Targets as Answers
from recorders.segmentation.sizes import SizeModel
from replay.trackers.association import intersection
from replay.trackers.belief import DetectionScores, stamped
from replay.trackers.camera import CameraMotion
from replay.trackers.life import TENTATIVE, Life
from replay.trackers.light import Light
from replay.trackers.parts.beginning import Beginning, parse_init
from replay.trackers.parts.candidates import observe
from replay.trackers.parts.features import Room
from replay.trackers.parts.heads import ColourShapeHeads, HeadColours, HeadDetector
from replay.trackers.parts.matching import Matching
from replay.trackers.parts.parameters import PartsParameters
from replay.trackers.parts.regions import PARTS
from replay.trackers.parts.returning import returned
from replay.trackers.parts.scoring import PartFeatures, Scorer
from replay.trackers.parts.signature import signature
from replay.trackers.parts.targets import BYSTANDERS, PartsTargets
from replay.trackers.parts.typical import Typical
from replay.trackers.tracker import Frame, SceneInfo, State

NS = 1e-9
NEAR = 0.6
"""Largest half side of a gate, in heights, where there are no pixels: whoever is further away may
be anybody.
"""


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
        self._life = Life("parts", scene, parameters, region_parameters)
        self._p = parameters
        self._scorer = Scorer(features)
        self._typical = Typical(self._scorer.usual)
        self._find_heads = find_heads
        self._head_colours = HeadColours()
        self._by_hand = parse_init(parameters.init)
        if not scene.has_masks:  # nothing but its place tells who a box is
            parameters = alone(parameters, gate_most=min(parameters.gate_most, NEAR))
            self._p = parameters
        self._targets = PartsTargets(parameters)
        self._next_bystander = BYSTANDERS
        self._scores = DetectionScores()
        self._camera = CameraMotion()
        self._light = Light()
        self._time_ns: int | None = None
        self._room = Room((scene.width, scene.height)) if scene.has_masks else None

    def step(self, frame: Frame) -> Answers:
        """Take the next frame, answer with all targets, by id."""
        notices: list[Notice] = []
        frame = self._light.lit(frame)
        self._life.take_regions(frame.regions)
        dt = 0.0 if self._time_ns is None else (frame.time_ns - self._time_ns) * NS
        self._time_ns = frame.time_ns
        targets = self._targets
        targets.predict(dt)
        self._move(frame.detections.moved or 0)
        self._lean(SizeModel.from_list(frame.detections.size_model))
        for item in targets.items:
            item.begin_frame()
        detections, likely = frame.detections, None
        if not self._scene.has_masks:
            likely = self._scores.take(detections)
            detections = replace(detections, scores=likely.tolist())
            moved = self._camera.follow(targets.items, targets.ahead(), frame.boxes, likely)
            self._move(moved)
        elif detections.fused:
            likely = self._scores.take(detections)
        seen = observe(detections)
        matching = Matching(
            self._scene,
            frame,
            seen,
            targets,
            self._p,
            dt=dt if dt > 0 else self._scene.frame_ns * NS,
            room=self._room,
            learnt=(self._typical, self._head_colours),
            light=self._light,
        )
        gates = {
            item.id: gate
            for item, gate in zip(targets.items, matching.gates(), strict=True)
            if item.told
        }
        heads = self._find_heads or ColourShapeHeads(colours=self._head_colours.tell)
        matching.run(self._scorer, heads, notices)
        begin = Beginning(self._p, targets)
        begin.by_hand(frame, self._by_hand)
        begin.automatic(frame, seen, matching.unexplained(), self._life.regions)
        matching.learn_new()
        if self._scene.has_masks:
            returned(matching, targets, self._life, self._p, frame.time_ns)
        self._next_bystander, begun = begin.confirm(
            frame, self._life, self._next_bystander, bool(self._by_hand)
        )
        notices += begun + self._age(frame)
        told = self._answer(frame, notices, gates)
        return told if likely is None else stamped(told, frame.boxes, likely)

    def _move(self, by: NDArray[np.float64] | list[int] | int) -> None:
        """The whole picture moved by so many pixels, right and down."""
        self._targets.boxes[:, :2] += by
        self._targets.motion.value += by

    def _lean(self, model: SizeModel | None) -> None:
        """Predicted sizes of targets that are not seen whole lean towards those usual at their
        places.
        """
        rows = np.array(
            [
                k
                for k, item in enumerate(self._targets.items)
                if item.now != "motion" or not item.observed
            ],
            np.intp,
        )
        if model is not None and len(rows):
            boxes = self._targets.boxes[rows]
            heights = model.heights(boxes[:, 1] + boxes[:, 3])
            self._targets.lean(
                rows,
                np.stack([model.aspect * heights, heights], axis=1),
                self._p.body_spread,
            )

    def _age(self, frame: Frame) -> list[Notice]:
        """Confidence falls while a target is unseen; then it is lost, then removed.

        The place stays where the target was last seen: only the speed says that it went on, out
        of the scene.
        """
        targets = self._targets
        for row, item in enumerate(targets.items):
            targets.misses[row] += not item.observed
        kept, notices = self._life.age(
            targets.items, targets.boxes, frame.time_ns, targets.onward
        )
        targets.keep(kept)
        return notices

    def _blobs(self) -> list[int]:
        """The blob of every target, by row: where it was found; of one who is not seen, that of
        whom its middle lies under, of several the one that it lies under most.
        """
        items, boxes = self._targets.items, self._targets.boxes
        blobs = [item.blob if item.observed else NO_BLOB for item in items]
        seen = [k for k, item in enumerate(items) if item.told and item.observed]
        gone = [
            k
            for k, item in enumerate(items)
            if item.told and not (item.observed or item.lost)
        ]
        if not seen or not gone:
            return blobs
        cover = intersection(boxes[gone], boxes[seen])
        for row, under in zip(gone, cover, strict=True):
            front = seen[int(np.argmax(under))]
            if middles_inside(boxes[row : row + 1], boxes[front : front + 1])[0]:
                blobs[row] = items[front].blob
        return blobs

    def _answer(
        self, frame: Frame, notices: list[Notice], gates: dict[int, Box]
    ) -> Answers:
        out = []
        targets, blobs = self._targets, self._blobs()
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
                    blob=blobs[row],
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
            "life": self._life.state(),
            "next_bystander": self._next_bystander,
            "time_ns": self._time_ns,
            "targets": self._targets.state(),
            "scores": self._scores.state(),
            "camera": self._camera.state(),
            "light": self._light.state(),
            "typical": self._typical.state(),
            "head_colours": self._head_colours.state(),
        }

    def restore(self, state: State) -> None:
        """Continue from what `state` gave."""
        self._life.restore(state["life"])
        self._next_bystander = state["next_bystander"]
        self._time_ns = state["time_ns"]
        self._targets.restore(state["targets"])
        self._scores.restore(state["scores"])
        self._camera.restore(state["camera"])
        self._light.restore(state["light"])
        self._typical.restore(state["typical"])
        self._head_colours.restore(state["head_colours"])
