"""SHELLS: virtual shells, event resolution, pixel membership; straight through, without joint
objects.

Per frame: predict; resolve the relations' cases I to V on the predicted shells and the blobs
below them; then who is alone and who shares with whom it is related to (`resolve`), pixels where
they are shared (`membership`); move every object by equation 9; settle identities after a JOINT
(`identity`); learn from who is alone. What nobody explains may start new objects.

Ties: objects in the order of their birth, detections and blobs in the order of the recording.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from reasoning.geometry import hidden_by
from reasoning.regions import RegionParameters
from reasoning.relations import Objects, RelationBook, RelationParameters
from reasoning.shells import ShellParameters
from recorders.annotated.membership import PATCHES, Patches
from recorders.messages import NO_BLOB, Box, Notice, Target, Targets
from recorders.segmentation.sizes import SizeModel
from replay.trackers.association import assign, iou
from replay.trackers.belief import LIKELY, DetectionScores, stamped
from replay.trackers.camera import CameraMotion
from replay.trackers.life import TENTATIVE, Life
from replay.trackers.light import Light
from replay.trackers.shells import births, boxes
from replay.trackers.shells.births import Free
from replay.trackers.shells.colours import bins_of, histogram, signature
from replay.trackers.shells.foreground import Foreground, touches
from replay.trackers.shells.identity import Doubts
from replay.trackers.shells.objects import NOBODY, Bodies, Body
from replay.trackers.shells.order import Order
from replay.trackers.shells.parameters import ShellsParameters
from replay.trackers.shells.resolve import Resolved, Resolver, SeenFrame
from replay.trackers.tracker import Frame, Payloads, SceneInfo, State

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
NS = 1e-9


class ShellsTracker:
    """The SHELLS tracker: see `replay.trackers.tracker.Tracker`."""

    def __init__(
        self,
        scene: SceneInfo,
        parameters: ShellsParameters,
        shell: ShellParameters,
        relation: RelationParameters,
        regions: RegionParameters,
    ) -> None:
        self._scene = scene
        self._p = parameters
        self._k_s = shell.k_s
        self._bodies = Bodies(parameters, scene.has_masks)
        self._book = RelationBook(relation)
        self._doubts = Doubts()
        self._scores = DetectionScores()
        self._camera = CameraMotion()
        self._light = Light()
        self._order = Order(parameters)
        frame_s = max(1e-3, scene.frame_ns * NS)
        self._learn_every = max(1, round(parameters.learn_s / frame_s))
        self._look_frames = max(2, round(0.5 * parameters.probation_s / frame_s))
        self._life = Life("shells", scene, parameters, regions, parameters.hidden_patience)
        self._time_ns: int | None = None
        self._dt = frame_s
        self._patches: Patches | None = None

    # -- the frame
    # -------------------------------------------------------------------------------------------------

    def step(self, frame: Frame) -> Targets:
        """Take the next frame, answer with all targets, by id."""
        notices: list[Notice] = []
        frame = self._light.lit(frame, self._turn)
        dt = 0.0 if self._time_ns is None else (frame.time_ns - self._time_ns) * NS
        self._time_ns = frame.time_ns
        self._dt = dt if dt > 0 else max(1e-3, self._scene.frame_ns * NS)
        self._life.take_regions(frame.regions)
        self._bodies.predict(dt)
        self._bodies.bank.value[:, :2] += frame.detections.moved or 0
        model = SizeModel.from_list(frame.detections.size_model)
        self._unsized = model is None
        self._lean(model)
        for body in self._bodies.items:
            body.begin_frame()
        radii = self._bodies.radii(self._k_s)
        resolver = self._resolve(frame, radii, dt)
        likely = None
        if resolver is None:
            likely = self._scores.take(frame.detections)
            self._bodies.bank.value[:, :2] += self._camera.follow(
                self._bodies.items, self._bodies.boxes, frame.boxes, likely
            )
            free = births.boxes_alone(frame, likely)
        else:
            free = births.unexplained(frame, resolver, self._p)
            if frame.detections.fused:
                likely = self._scores.take(frame.detections)
        taken = (
            self._follow_boxes(frame, free, radii)
            if resolver is None
            else self._associate(frame, free, radii)
        )
        taken |= self._start(frame, free, taken)
        found: dict[int, Resolved] = {}
        if resolver is not None:
            found = resolver.found
            for column in np.flatnonzero(free.whole).tolist():
                if column not in taken:
                    continue  # outside of the scene
                found[taken[column]] = resolver.whole(
                    taken[column], int(free.blobs[column]) - 1
                )
        notices += births.confirm(self._bodies, self._life, radii, frame, self._p)
        found = self._settle(frame, found, notices)
        if resolver is None:
            self._relate(frame, self._blobs())
        notices += self._tell_depth(resolver, dt)
        self._learn(frame, found)
        self._patches = self._own_pixels(frame, found)
        kept, told = self._life.age(self._bodies.items, self._bodies.boxes, frame.time_ns)
        self._bodies.keep(kept)
        notices += told
        answer = self._answer(frame, notices)
        return answer if likely is None else stamped(answer, frame.boxes, likely)

    def _turn(self) -> None:
        """The camera went over to infrared, or back."""
        for body in self._bodies.items:
            body.turn(grey=self._light.grey)
        self._doubts.restart()

    def extra_payloads(self, *, finished: bool) -> Payloads:
        """The membership channel's payload for the last frame; unfinished, it is painted once
        hindsight has settled the identities.
        """
        if self._patches is None:
            return ()
        if finished:
            return (("membership", self._patches.payload()),)
        return ((PATCHES, self._patches.packed()),)

    def _lean(self, model: SizeModel | None) -> None:
        """Objects whose size was not measured in the last frame lean towards the size usual at
        their place.
        """
        if model is None:
            return
        bank = self._bodies.bank
        rows = np.array(
            [
                index
                for index, item in enumerate(self._bodies.items)
                if not (item.alone and item.observed)
            ],
            np.intp,
        )
        if not len(rows):
            return
        foot = bank.value[rows, 1] + bank.value[rows, 3] / 2
        height = model.heights(foot)
        expected = np.stack([model.aspect * height, height], axis=1)
        noise = ((self._p.body_spread * height) ** 2)[:, None]
        gain = bank.p00[rows, 2:] / (bank.p00[rows, 2:] + noise)
        bank.value[rows, 2:] += gain * (expected - bank.value[rows, 2:])
        bank.p00[rows, 2:] *= 1 - gain
        bank.value[rows, 1] = foot - bank.value[rows, 3] / 2

    def _resolve(self, frame: Frame, radii: Floats, dt: float) -> Resolver | None:
        """Find the confirmed objects in the foreground; None where there is none."""
        mask, labels = frame.mask, frame.labels
        if mask is None or labels is None:
            return None
        items = self._bodies.items
        rows = np.array(
            [
                index
                for index, item in enumerate(items)
                if item.id != TENTATIVE and (not item.lost or item.front)
            ],
            np.intp,
        )
        blobs = np.array(frame.detections.blobs or [NO_BLOB] * len(frame.boxes), np.int64)
        seen = SeenFrame(
            Foreground(mask, labels, frame.detections.components),
            frame.boxes,
            blobs,
            lambda: frame.evenly_lit,
            self._unsized,
        )
        resolver = Resolver(seen, self._bodies, rows, radii, self._are_related, self._p)
        below = resolver.blobs()
        self._relate(frame, [below.get(k, NO_BLOB) for k in range(len(items))])
        resolver.resolve()
        self._hide_twins(resolver, dt)
        for row, at in sorted(resolver.found.items()):
            self._observe(row, frame, at, dt)
        for row, front in resolver.fronts.items():
            items[row].front = front
        self._follow(radii)
        return resolver

    def _hide_twins(self, resolver: Resolver, dt: float) -> None:
        """Of two objects that claim one body for long, hide the one that is seen worse, of equals
        the younger.

        It may come back as itself wherever a body of its colours shows up in the other's shell.
        """
        found, items, p = resolver.found, self._bodies.items, self._p
        rows = sorted(
            (k for k in found if not found[k].alone), key=lambda k: (-found[k].visible, k)
        )
        boxes = np.array([found[k].box for k in rows], np.float64).reshape(-1, 4)
        overlap = iou(boxes, boxes).tolist()
        for index, row in enumerate(rows):
            # Of equals the first.
            share, better = max(
                ((overlap[index][j], -j) for j in range(index)), default=(0.0, 0)
            )
            if row in resolver.behind:
                continue
            if share < p.twin_overlap:
                items[row].twin_s = 0.0
                continue
            items[row].twin_s += dt
            if items[row].twin_s > p.twin_s:
                resolver.fronts[row] = items[rows[-better]].id
                del found[row]
        for row in sorted(resolver.behind):
            items[row].twin_s += dt
        for row, at in found.items():
            if at.alone:
                items[row].twin_s = 0.0

    def _are_related(self, a: int, b: int) -> bool:
        return self._book.get(a, b) is not None

    def _follow(self, radii: Floats) -> None:
        """What is hidden stays within the shell of who hides it (SHELLS 2.3, case III), and goes
        along with it.
        """
        rows = dict(self._rows_by_id())
        bank = self._bodies.bank
        for row, body in enumerate(self._bodies.items):
            front = rows.get(body.front)
            if body.observed or front is None:
                continue
            d = bank.value[row, :2] - bank.value[front, :2]
            away, reach = (
                float(np.sqrt(d[0] * d[0] + d[1] * d[1])),
                0.7 * float(radii[front]),
            )
            if away > reach:
                bank.value[row, :2] = bank.value[front, :2] + d * (reach / away)
            if self._scene.has_masks:
                bank.rate[row, :2] = bank.rate[front, :2]

    def _observe(self, row: int, frame: Frame, at: Resolved, dt: float) -> None:
        """Take what was found of an object (SHELLS 2.5)."""
        body, p = self._bodies.items[row], self._p
        _, _, w, h = at.box
        self._bodies.move(row, at.place, self._gain(p.blend) * at.weight)
        if at.sized:
            self._bodies.resize(row, w, h, self._gain(p.size_blend))
        body.misfit_s = body.misfit_s + dt if at.misfit else 0.0
        body.sighted(
            frame.time_ns, at.visible, at.blob, "motion" if at.alone else "appearance"
        )
        body.alone, body.visible = at.alone, at.visible
        body.ellipse, body.front = at.ellipse, NOBODY
        body.measured = at.box if at.sized else self._bodies.box(row)

    def _gain(self, weight: float) -> float:
        """A weight of the measurement against the prediction in this frame, so that the same is
        forgotten per second at any frame rate from 1 / `blend_s` on.
        """
        return 1.0 - math.pow(1.0 - weight, min(1.0, self._dt / self._p.blend_s))

    def _associate(self, frame: Frame, free: Free, radii: Floats) -> dict[int, int]:
        """What was not found takes what is free within its shell, confirmed objects first;
        {column: row}.
        """
        taken: dict[int, int] = {}
        items = self._bodies.items
        stages = (
            [
                index
                for index, item in enumerate(items)
                if item.id != TENTATIVE and not item.observed and not item.lost
            ],
            [row for row, item in enumerate(items) if item.id == TENTATIVE],
        )
        for stage in stages:
            columns = [column for column in range(len(free.boxes)) if column not in taken]
            for i, j in self._match(np.array(stage, np.intp), free.boxes[columns], radii):
                taken[columns[j]] = stage[i]
                self._sight(stage[i], frame, free, columns[j])
        return taken

    def _follow_boxes(self, frame: Frame, free: Free, radii: Floats) -> dict[int, int]:
        """The same where boxes are all there is; {column: row}."""
        seeing = self._scene.has_images and self._p.box_colour > 0
        looks = boxes.BoxColours(free.boxes, (lambda: frame.evenly_lit) if seeing else None)
        taken = {
            column: row for row, column in boxes.match(self._bodies, free, looks, self._p)
        }
        boxes.learn(self._bodies, taken, free, looks, frame.index % self._learn_every == 0)
        for column, row in taken.items():
            self._sight(row, frame, free, column)
        boxes.hide(self._bodies, self._p)
        self._follow(radii)
        return taken

    def _match(self, rows: Rows, boxes: Floats, radii: Floats) -> list[tuple[int, int]]:
        if not len(rows) or not len(boxes):
            return []
        centre = self._bodies.bank.value[rows, :2]
        away = centre[:, None] - (boxes[:, :2] + boxes[:, 2:] / 2)[None]
        gap = (
            np.sqrt(away[..., 0] * away[..., 0] + away[..., 1] * away[..., 1])
            / radii[rows][:, None]
        )
        size = self._bodies.bank.value[rows, 2] * self._bodies.bank.value[rows, 3]
        ratio = np.abs(
            np.log(np.maximum(size, 1.0)[:, None] / (boxes[:, 2] * boxes[:, 3])[None])
        )
        allowed = (gap <= 1.0) & (ratio <= 1.4)
        return assign(
            gap + 1.0 - iou(self._bodies.boxes[rows], boxes) + 0.3 * ratio, allowed
        )

    def _sight(self, row: int, frame: Frame, free: Free, column: int) -> None:
        """An observation as a whole box: a blob, or a detection where there are no masks."""
        body, p = self._bodies.items[row], self._p
        x, y, w, h = free.boxes[column].tolist()
        if frame.mask is None:
            self._bodies.correct(row, (x, y, w, h))
        else:
            self._bodies.move(row, (x + w / 2, y + h / 2), self._gain(p.blend))
            self._bodies.resize(row, w, h, self._gain(p.size_blend))
        body.sighted(frame.time_ns, 1.0, int(free.blobs[column]), "motion")
        body.measured, body.visible, body.front = (x, y, w, h), 1.0, NOBODY
        if body.id == TENTATIVE:
            body.sightings.append([float(frame.index), x, y, w, h])

    def _start(self, frame: Frame, free: Free, taken: dict[int, int]) -> dict[int, int]:
        """Start an object at everything that is left within the scene (EVENTS 3.2); {column:
        row}.
        """
        begun: dict[int, int] = {}
        centres = free.boxes[:, :2] + free.boxes[:, 2:] / 2
        inside = self._life.regions.may_start_low_level_all(centres)
        inside &= free.scores >= LIKELY
        for column in range(len(free.boxes)):
            if column in taken or not inside[column]:
                continue
            x, y, w, h = free.boxes[column].tolist()
            body = Body(
                TENTATIVE,
                frame.index,
                frame.time_ns,
                frame.time_ns,
                blob=int(free.blobs[column]),
            )
            body.sightings.append([float(frame.index), x, y, w, h])
            begun[column] = len(self._bodies)
            self._bodies.start((x, y, w, h), body)
        return begun

    # -- relations, identities, learning
    # ---------------------------------------------------------------------------

    def _rows_by_id(self) -> list[tuple[int, int]]:
        """(id, row) of the confirmed objects, by id."""
        return sorted(
            (item.id, index)
            for index, item in enumerate(self._bodies.items)
            if item.id != TENTATIVE
        )

    def _relate(self, frame: Frame, blobs: list[int]) -> None:
        """Event resolution (SHELLS 2.3) on shells and blobs, by row; pairs that are JOINT come
        into doubt.
        """
        pairs = self._rows_by_id()
        rows = np.array([row for _, row in pairs], np.intp)
        items = [self._bodies.items[row] for row in rows.tolist()]
        objects = Objects(
            [item.id for item in items],
            self._bodies.bank.value[rows, :2],
            self._bodies.radii(self._k_s)[rows],
            [blobs[row] for row in rows.tolist()],
            [blobs[row] != NO_BLOB for row in rows.tolist()],
            [not item.lost for item in items],
        )
        self._book.step(frame.index, frame.time_ns, objects)
        self._doubts.keep([item.id for item in items])
        for edge in self._book.edges:
            if edge.state == "JOINT":
                self._doubts.joined(edge.a, edge.b, frame.index, edge.distance)

    def _blobs(self) -> list[int]:
        """B_i by row: the blob that each object was found in. Who is hidden lies in the one that it
        is hidden in, as long as its occluder is seen and its middle lies under that one.
        """
        items = self._bodies.items
        rows = dict(self._rows_by_id())
        blobs = [item.blob if item.observed else NO_BLOB for item in items]
        for row, body in enumerate(items):
            front = rows.get(body.front)
            if body.observed or front is None or not items[front].observed:
                continue
            if hidden_by(self._bodies.box(row), self._bodies.box(front)):
                blobs[row] = items[front].blob
        return blobs

    def _tell_depth(self, resolver: Resolver | None, dt: float) -> list[Notice]:
        """Tell once in every JOINT, and when it changes, who is behind whom."""
        joint = [(edge.a, edge.b) for edge in self._book.edges if edge.state == "JOINT"]
        return self._order.step(joint, {} if resolver is None else resolver.leads, dt)

    def _learn(self, frame: Frame, found: dict[int, Resolved]) -> None:
        """Learn mask, area and colours of who is alone, nothing in JOINT, no colours while
        identities are in doubt.
        """
        doubtful = set(self._doubts.alone())
        joint = {
            identity
            for edge in self._book.edges
            if edge.state == "JOINT"
            for identity in (edge.a, edge.b)
        }
        due = frame.index % self._learn_every == 0
        for row, at in sorted(found.items()):
            body = self._bodies.items[row]
            if not at.alone or body.id in joint:
                continue
            # Who comes in is as large as what is seen of him; who has differed for long, too.
            grown = at.pixels > body.area and self._unsized and self._cut(at.box)
            slowly = 0.3 if body.misfit_s else 0.1
            body.learn_area(float(at.pixels), 1.0 if at.misfit or grown else slowly)
            if not due and body.mask is not None:
                continue
            if at.ellipse is not None:
                body.learn_centroid((at.ellipse.x, at.ellipse.y), at.box)
            body.learn_mask(at.own)
            if self._scene.has_images and body.id not in doubtful:
                self._look(body, frame, at)

    def _cut(self, box: Box) -> bool:
        """Whether the picture's border cuts a box."""
        one = np.array([box], np.float64)
        return bool(touches(one, self._scene.width, self._scene.height)[0])

    def _look(self, body: Body, frame: Frame, at: Resolved) -> None:
        bins = self._bins(frame, at)
        if bins is not None:
            body.look(bins, at.own)

    def _bins(self, frame: Frame, at: Resolved) -> NDArray[np.uint16] | None:
        image = frame.evenly_lit
        if image is None:
            return None
        h, w = at.own.shape
        return bins_of(image[at.top : at.top + h, at.left : at.left + w])

    def _settle(
        self, frame: Frame, found: dict[int, Resolved], notices: list[Notice]
    ) -> dict[int, Resolved]:
        """Who is who among those that were JOINT and have blobs of their own again; what was
        found, by row, then.
        """
        in_doubt = self._doubts.alone()
        if not in_doubt or not self._scene.has_images:
            return found
        items = self._bodies.items
        looks: dict[int, Floats] = {}
        for row, at in sorted(found.items()):
            if at.alone and items[row].id in in_doubt:
                bins = self._bins(frame, at)
                if bins is not None:
                    looks[items[row].id] = histogram(bins, at.own)
        self._doubts.see(looks)
        rows = dict(self._rows_by_id())
        apart = {
            (a, b)
            for a in in_doubt
            for b in in_doubt
            if a < b and a in rows and b in rows and self._book.get(a, b) is None
        }
        known = {identity: items[k] for identity, k in rows.items()}
        for verdict in self._doubts.decide(
            known, apart, self._look_frames, self._p.exchange
        ):
            if verdict.exchanged:
                a, b = rows[verdict.a], rows[verdict.b]
                self._bodies.exchange(a, b)
                found = {{a: b, b: a}.get(row, row): at for row, at in found.items()}
                evidence = {
                    "log_likelihood": verdict.evidence,
                    "log_likelihood_under": -self._p.exchange,
                    "frames": verdict.frames,
                    "since_frame": verdict.since,
                }
                rule = "SHELLS 2.3, ours: identities follow the colours after a JOINT"
                notices.append(
                    Notice(
                        "track_recovered",
                        [verdict.a, verdict.b],
                        rule,
                        evidence,
                        since_frame=verdict.since,
                    )
                )
        return found

    # -- the answer
    # ------------------------------------------------------------------------------------------------

    def _own_pixels(self, frame: Frame, found: dict[int, Resolved]) -> Patches | None:
        """Each object's pixels, by id."""
        if not self._p.membership or frame.mask is None:
            return None
        by_id = {self._bodies.items[row].id: at for row, at in found.items()}
        by_id.pop(TENTATIVE, None)
        patches = [
            Patches.patch(identity, at.own, at.left, at.top)
            for identity, at in sorted(by_id.items())
        ]
        return Patches(self._scene.width, self._scene.height, frame.time_ns, patches)

    def _answer(self, frame: Frame, notices: list[Notice]) -> Targets:
        targets = []
        radii, blobs = self._bodies.radii(self._k_s), self._blobs()
        for row, body in enumerate(self._bodies.items):
            if body.id == TENTATIVE:
                continue
            vx, vy = self._bodies.bank.rate[row, :2].tolist()
            box: Box = self._bodies.box(row)
            targets.append(
                Target(
                    body.id,
                    box,
                    (vx, vy),
                    body.mode,
                    min(1.0, max(0.0, body.confidence)),
                    present=not body.lost,
                    observed=body.observed,
                    blob=blobs[row],
                    newborn=body.newborn,
                    ellipse=body.ellipse,
                    shell_radius=float(radii[row]),
                    measured=body.measured,
                    signature=(
                        signature(body.colours)
                        if body.signed and body.colours is not None
                        else []
                    ),
                )
            )
        return Targets(
            frame.index, sorted(targets, key=lambda target: target.id), None, notices
        )

    def state(self) -> State:
        """The whole state as plain data."""
        return {
            "life": self._life.state(),
            "time_ns": self._time_ns,
            "bodies": self._bodies.state(),
            "book": self._book.state(),
            "doubts": self._doubts.state(),
            "order": self._order.state(),
            "scores": self._scores.state(),
            "camera": self._camera.state(),
            "light": self._light.state(),
        }

    def restore(self, state: State) -> None:
        """Continue from what `state` gave; the regions come with the next frame."""
        self._life.restore(state["life"])
        self._time_ns = state["time_ns"]
        self._bodies.restore(state["bodies"])
        self._book.restore(state["book"])
        self._doubts.restore(state["doubts"])
        self._order.restore(state["order"])
        self._scores.restore(state["scores"])
        self._camera.restore(state["camera"])
        self._light.restore(state["light"])
