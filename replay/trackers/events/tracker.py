"""EVENTS 2: low-level tracks by gated association, high-level targets that outlive them, three
matching cases.

1. A target that is alone in its blob, or has a detection of its own, is followed by motion; its
colours are learnt. 2. An orphan takes over a new low-level track that looks like it (`recover`).
3. Whatever else is expected is looked for top-down: within the blob that it shares (`places`), or
where its colours are (`orphans`); with a confidence that falls while little or nothing supports
it.

Ties: association by `replay.trackers.association.assign` (tracks in the order of their birth,
detections in the order of the recording); tentative tracks are confirmed, and ids given, in the
order of their birth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reasoning.geometry import WHOLLY
from reasoning.regions import RegionParameters
from recorders.messages import NO_BLOB, Box, Ellipse, Mode, Notice, Targets
from recorders.segmentation.sizes import SizeModel
from replay.trackers.association import intersection
from replay.trackers.belief import LIKELY, DetectionScores, stamped
from replay.trackers.camera import CameraMotion
from replay.trackers.events.answer import answer, shared_regions
from replay.trackers.events.associate import SeenDetections, first_steps, match, one_each
from replay.trackers.events.colours import alike, learn, likenesses, look_at
from replay.trackers.events.groups import GroupTracks, SharedBlob, hold_members, members_of
from replay.trackers.events.identity import keep_company, verify
from replay.trackers.events.lifecycle import confirm, reclaim
from replay.trackers.events.orphans import follow_colours, orphans, share_detections
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.places import (
    ExpectedPlaces,
    FrameForeground,
    Likeness,
    MaskCut,
    Place,
    Rest,
    place,
)
from replay.trackers.events.splits import came_from, remember_regions
from replay.trackers.events.strangers import estranged, part
from replay.trackers.events.tracks import EventsTrack, EventsTracks
from replay.trackers.life import TENTATIVE, Life
from replay.trackers.pace import stretch
from replay.trackers.tracker import Frame, SceneInfo

Floats = NDArray[np.float64]
NS = 1e-9
UNEXPLAINED = 0.7
"""Least score of a detection whose foreground nobody explains."""


class EventsTracker:
    """The EVENTS tracker: see `replay.trackers.tracker.Tracker`."""

    def __init__(
        self,
        scene: SceneInfo,
        parameters: EventsParameters,
        region_parameters: RegionParameters | None = None,
    ) -> None:
        self._scene = scene
        self._p = parameters
        self._tracks = EventsTracks(parameters)
        self._scores = DetectionScores()
        self._camera = CameraMotion()
        self._groups = GroupTracks(parameters.tentative_s)
        self._together = SharedBlob(parameters.hold_s)
        # Blobs flicker; a detection says itself how likely it is somebody.
        lived = parameters if scene.has_masks else replace(parameters, confirm_s=0.0)
        self._life = Life(
            "events", scene, lived, region_parameters, parameters.hidden_patience
        )
        self._learn_every = max(
            1, round(parameters.learn_s / max(1e-3, scene.frame_ns * NS))
        )
        self._rare = stretch(scene.frame_ns) > 1.0
        self._divided = False
        self._time_ns: int | None = None

    def step(self, frame: Frame) -> Targets:
        """Take the next frame, answer with all targets, by id."""
        dt = 0.0 if self._time_ns is None else (frame.time_ns - self._time_ns) * NS
        self._time_ns = frame.time_ns
        self._life.take_regions(frame.regions)
        self._tracks.predict(dt)
        self._tracks.bank.value[:, :2] += frame.detections.moved or 0
        self._lean(SizeModel.from_list(frame.detections.size_model), dt)
        for track in self._tracks.items:
            track.begin_frame()
        seen, likely = _seen(frame, self._scene.has_images), None
        mask = frame.mask if self._scene.has_masks else None
        if mask is not None:
            if frame.detections.fused:
                likely = self._scores.take(frame.detections)
            seen = self._explain(frame, mask, seen, dt)
        else:
            likely = self._scores.take(frame.detections)
            seen = replace(seen, scores=likely)
            self._tracks.bank.value[:, :2] += self._camera.follow(
                self._tracks.items, self._tracks.boxes, seen.boxes, likely
            )
        used = self._associate(frame, seen)
        if mask is None:
            share_detections(self._tracks, seen, used, self._p)
        for track in self._tracks.items:
            if track.observed or track.hidden:
                track.found_ns = frame.time_ns
        if self._scene.has_images and self._p.top_down_s > 0:
            self._follow_colours(frame)
        hold_members(self._tracks)
        self._note_fronts()
        self._start(frame, seen, used)
        notices = self._learn(frame)
        notices += confirm(self._tracks, self._life, frame, self._p)
        self._together.step(self._tracks, frame.time_ns)
        if not self._scene.has_images:
            self._tracks.loosen(frame.time_ns, max(1e-3, self._scene.frame_ns * NS))
        kept, ended = self._life.age(self._tracks.items, self._places(), frame.time_ns)
        self._tracks.keep(kept)
        notices += ended
        shared = shared_regions(self._tracks, frame)
        keep_company(
            self._tracks, [members for members, _ in shared], frame.index, frame.time_ns
        )
        notices += verify(self._tracks, frame.time_ns, self._p)
        notices += reclaim(self._tracks, frame.time_ns, self._p)
        remember_regions(self._tracks, frame.detections.components, frame.time_ns)
        shared = shared_regions(self._tracks, frame)
        groups = self._groups.step(frame.time_ns, shared)
        told = answer(self._tracks, frame, groups, notices)
        return told if likely is None else stamped(told, frame.boxes, likely)

    def _follow_colours(self, frame: Frame) -> None:
        """Matching case 3 (EVENTS 2): who has neither a detection nor a blob is looked for by its
        colours alone.
        """
        if not orphans(self._tracks) or frame.evenly_lit is None:
            return
        for row, box, score in follow_colours(
            self._tracks, frame.evenly_lit, frame.time_ns, self._p
        ):
            self._observe(row, frame, box, score, NO_BLOB, "appearance", sized=False)

    def _lean(self, model: SizeModel | None, dt: float) -> None:
        """Targets whose size was not measured in the last frame lean towards the size usual at
        their place.
        """
        if model is None:
            return
        rows = np.array(
            [index for index, item in enumerate(self._tracks.items) if not item.sized],
            np.intp,
        )
        if len(rows):
            boxes = self._tracks.boxes[rows]
            heights = model.heights(boxes[:, 1] + boxes[:, 3])
            self._tracks.lean(rows, np.stack([model.aspect * heights, heights], axis=1), dt)

    def _explain(
        self, frame: Frame, mask: NDArray[np.uint8], seen: SeenDetections, dt: float
    ) -> SeenDetections:
        """Let the confirmed targets explain the foreground; what is left over are the detections
        of others.
        """
        labels = frame.labels
        assert labels is not None
        blobs = frame.detections.components
        centres = np.array([(blob.ellipse.x, blob.ellipse.y) for blob in blobs]).reshape(
            -1, 2
        )
        inside = self._life.regions.may_start_low_level_all(centres)
        fg = FrameForeground(mask, labels, blobs, self._p, inside)
        items, bank = self._tracks.items, self._tracks.bank
        rows = [
            index
            for index, item in enumerate(items)
            if item.id != TENTATIVE and not item.lost
        ]
        doubt = np.sqrt(bank.p00[rows])
        reach = np.hypot(
            doubt[:, :2].max(axis=1, initial=0.0),
            self._p.place_noise * self._tracks.sizes[rows],
        )
        patient = np.array([items[r].misfit_s > self._p.patience_s for r in rows], bool)
        model = SizeModel.from_list(frame.detections.size_model)
        expected = ExpectedPlaces(
            self._tracks.boxes[rows],
            reach,
            doubt[:, 2:4],
            patient,
            bank.value[rows, 4:6],
            upright=model is not None,
        )

        def look(which: list[int], cut: MaskCut) -> list[Likeness]:
            if not self._scene.has_images or frame.evenly_lit is None:
                return [None] * len(which)
            return likenesses([items[rows[row]] for row in which], frame.evenly_lit, cut)

        found = place(fg, expected, seen.boxes, seen.blobs, look, self._p)
        told = one_each(
            self._tracks, rows, fg, seen, self._p, divided=self._divides(seen, model)
        )
        for k, (row, at) in enumerate(zip(rows, found, strict=True)):
            if row in told:
                found[k] = self._take(row, frame, seen, told[row])
            elif at is not None:
                near = [
                    items[r]
                    for r, other in zip(rows, found, strict=True)
                    if r != row and other is not None and other.blob == at.blob
                ]
                seen_of_it = self._alike(row, frame, mask, at, near)
                self._settle(row, frame, at, seen_of_it, dt)
        kept = [
            at
            for at, r in zip(found, rows, strict=True)
            if at is not None and items[r].observed
        ]
        return _left_over(fg, kept, seen, model, self._p)

    def _divides(self, seen: SeenDetections, model: SizeModel | None) -> bool:
        """Whether the segmentation divides blobs of bodies that are no upright people, as it once
        did: what a detector or a source says has no ellipses.
        """
        if model is not None or seen.fused or None in seen.ellipses:
            return False
        mine = seen.blobs[seen.blobs != NO_BLOB]
        self._divided |= len(np.unique(mine)) < len(mine)
        return self._divided

    def _places(self) -> Floats:
        """Boxes (N, 4) where the targets may be: who is lost, was hidden, and would be on its way
        out by now, may still be behind whom it was.
        """
        boxes = self._tracks.boxes
        cover = self._life.regions.area_cover(boxes)
        for row, lies in enumerate(cover):
            front = self._tracks.behind(row) if lies != WHOLLY else None
            if front is not None:
                boxes[row] = boxes[front]
        return boxes

    def _note_fronts(self) -> None:
        """Take note of who was last hidden behind whom: the nearest one that is seen in the blob."""
        items, bank = self._tracks.items, self._tracks.bank
        told = [index for index, item in enumerate(items) if item.told]
        for row in told:
            track = items[row]
            if track.observed:
                track.front = TENTATIVE
            elif track.hidden:
                seen = [
                    r for r in told if items[r].observed and items[r].blob == track.blob
                ]
                away = bank.value[seen, :2] - bank.value[row, :2]
                if seen:
                    track.front = items[seen[int(np.argmin((away * away).sum(axis=1)))]].id

    def _take(self, row: int, frame: Frame, seen: SeenDetections, column: int) -> Place:
        """Take a detection of one of those who share a blob as this one's."""
        x, y, w, h = seen.boxes[column].tolist()
        blob = int(seen.blobs[column])
        self._tracks.items[row].misfit_s = 0.0
        self._observe(
            row, frame, (x, y, w, h), float(seen.scores[column]), blob, "appearance"
        )
        return Place((x, y, w, h), False, 1.0, 0.0, blob, company=True)

    def _alike(
        self,
        row: int,
        frame: Frame,
        mask: NDArray[np.uint8],
        at: Place,
        rivals: list[EventsTrack],
    ) -> float:
        """How much of a target's own colours is seen where it was placed in a shared blob; 1
        where nobody knows.
        """
        if not at.company or not rivals or not self._scene.has_images:
            return 1.0
        look = None if frame.evenly_lit is None else look_at(frame.evenly_lit, mask, at.box)
        found = None if look is None else alike(self._tracks.items[row], rivals, look)
        return 1.0 if found is None else found

    def _settle(self, row: int, frame: Frame, at: Place, seen: float, dt: float) -> None:
        """Take a place as an observation if enough foreground supports it, and enough of the
        target's colours, ``seen``, are there.
        """
        track = self._tracks.items[row]
        track.misfit_s = track.misfit_s + dt if at.tenant else 0.0
        if at.alone:
            track.misfit_s = 0.0
            track.alone = True
            self._observe(
                row,
                frame,
                at.box,
                1.0,
                at.blob,
                "motion",
                ellipse=frame.detections.components[at.blob - 1].ellipse,
            )
        elif at.own >= self._p.min_own and seen >= self._p.min_alike:
            mode: Mode = "appearance" if at.company else "motion"
            score = min(seen, (at.own + 0.5 * at.shared) / 0.6)
            self._observe(row, frame, at.box, score, at.blob, mode, sized=False)
        elif at.own + at.shared >= self._p.min_own:
            track.hidden, track.blob = True, at.blob

    def _associate(self, frame: Frame, seen: SeenDetections) -> NDArray[np.bool_]:
        """In stages: those who are followed to detections of high, then of low score; the lost;
        the tentative.
        """
        # Whose centroid lies outside of region of interest and border is no detection (EVENTS 3.2).
        centres = seen.boxes[:, :2] + seen.boxes[:, 2:] / 2
        used = ~self._life.regions.may_start_low_level_all(centres)
        items = self._tracks.items
        followed = [
            index
            for index, item in enumerate(items)
            if item.id != TENTATIVE and not item.lost
        ]
        missing = [
            row for row, item in enumerate(items) if item.id != TENTATIVE and item.lost
        ]
        tentative = [row for row, item in enumerate(items) if item.id == TENTATIVE]
        high = seen.scores >= LIKELY
        for who, which in (
            (followed, high),
            (followed, ~high),
            (missing, high),
            (tentative, high),
        ):
            rows = [row for row in who if not items[row].observed]
            if not rows:
                continue
            columns = (which & ~used).nonzero()[0]
            if not len(columns):
                continue
            pairs = match(self._tracks, np.array(rows, np.intp), seen, columns, self._p)
            used[[column for _, column in pairs]] = True
            self._follow(frame, seen, pairs)
        self._take_first_steps(frame, seen, used)
        return used

    def _take_first_steps(
        self, frame: Frame, seen: SeenDetections, used: NDArray[np.bool_]
    ) -> None:
        """Those whose motion is not known yet may have gone further than an overlap tells: who
        was seen once, and in time lapse everybody. Whoever does go so far goes on so, and has the
        place and speed that his first step gave him; pieces of bodies do not. A detector's boxes
        of a film need no such help, and jump too much for it.
        """
        if not self._rare and (seen.fused or not self._scene.has_masks):
            return
        young = [
            row
            for row, item in enumerate(self._tracks.items)
            if not item.observed and not item.lost and (self._rare or item.hits == 1)
        ]
        free = np.flatnonzero((seen.scores >= LIKELY) & ~used)
        pairs = first_steps(self._tracks, np.array(young, np.intp), seen, free)
        for row, column in pairs:
            x, y, w, h = seen.boxes[column].tolist()
            dt = (frame.time_ns - self._tracks.items[row].seen_ns) * NS
            self._tracks.launch(row, (x, y, w, h), dt)
            used[column] = True
        self._follow(frame, seen, pairs)

    def _follow(
        self, frame: Frame, seen: SeenDetections, pairs: list[tuple[int, int]]
    ) -> None:
        """Take the detections of (row, column) pairs as observations."""
        if not pairs:
            return
        rows, columns = [row for row, _ in pairs], [column for _, column in pairs]
        boxes = seen.boxes[columns]
        self._tracks.correct_all(rows, boxes, [seen.ellipses[column] for column in columns])
        scores, blobs = seen.scores[columns].tolist(), seen.blobs[columns].tolist()
        for index, (x, y, w, h) in enumerate(boxes.tolist()):
            track = self._tracks.items[rows[index]]
            track.sized, track.column = True, columns[index]
            self._note(
                track,
                frame,
                (x, y, w, h),
                scores[index],
                blobs[index],
                "motion",
                (x, y, w, h),
            )

    def _observe(
        self,
        row: int,
        frame: Frame,
        box: Box,
        score: float,
        blob: int,
        mode: Mode,
        *,
        ellipse: Ellipse | None = None,
        sized: bool = True,
    ) -> None:
        track = self._tracks.items[row]
        track.sized = sized
        self._tracks.correct(row, box, ellipse, track.sized)
        self._note(
            track,
            frame,
            box,
            score,
            blob,
            mode,
            box if track.sized else self._tracks.box(row),
        )

    @staticmethod
    def _note(
        track: EventsTrack,
        frame: Frame,
        box: Box,
        score: float,
        blob: int,
        mode: Mode,
        measured: Box,
    ) -> None:
        track.measured = measured
        track.sighted(frame.time_ns, score, blob, mode)
        if track.id == TENTATIVE:
            track.sightings.append([float(frame.index), *box])

    def _start(self, frame: Frame, seen: SeenDetections, used: NDArray[np.bool_]) -> None:
        """A tentative track for every unassociated detection whose centroid lies in ROI or border
        (EVENTS 3.2); one over a collision zone is a group tracker (3.1).
        """
        columns = np.flatnonzero(~used & (seen.scores >= LIKELY))
        if not len(columns):
            return
        boxes = seen.boxes[columns]
        from_split = came_from(self._tracks, boxes)
        for index, column in enumerate(columns.tolist()):
            x, y, w, h = boxes[index].tolist()
            track = EventsTrack(
                TENTATIVE,
                frame.index,
                frame.time_ns,
                frame.time_ns,
                quality=float(seen.scores[column]),
            )
            track.blob, track.column, track.measured = (
                int(seen.blobs[column]),
                column,
                (x, y, w, h),
            )
            track.split = bool(from_split[index])
            track.members = members_of(self._tracks, boxes[index], self._p)
            track.sightings.append([float(frame.index), x, y, w, h])
            self._tracks.start((x, y, w, h), seen.ellipses[column], track)

    def _learn(self, frame: Frame) -> list[Notice]:
        """Every so often, learn the colours of all targets alone in their blob, or with a box to
        themselves.
        """
        if not self._scene.has_images or frame.index % self._learn_every:
            return []
        items = self._tracks.items
        rows = [
            index
            for index, item in enumerate(items)
            if item.measured is not None and item.sized
        ]
        if not rows or frame.evenly_lit is None:
            return []
        # Fused boxes leave out few: where a box is, who is only thought to be there is not.
        fused = frame.detections.fused
        others = [
            k
            for k, item in enumerate(items)
            if not item.lost and (item.observed or not fused)
        ]
        boxes = self._tracks.boxes
        shared = (
            intersection(boxes[rows], boxes[others])
            / np.maximum(boxes[rows, 2] * boxes[rows, 3], 1.0)[:, None]
        )
        mask = frame.mask if self._scene.has_masks else None
        changed: list[int] = []
        for k, row in enumerate(rows):
            mine = np.array([o == row for o in others], bool)
            box = items[row].measured
            if box is None or not (
                items[row].alone or float(shared[k][~mine].max(initial=0.0)) <= 0.1
            ):
                continue
            look = look_at(frame.evenly_lit, mask, box)
            other = None
            if look is not None and items[row].alone and items[row].id != TENTATIVE:
                other = estranged(items[row], look, box, frame.index, frame.time_ns)
            if other:
                changed.append(row)
            elif look is not None and other is None:
                learn(items[row], look)
        return [
            notice
            for row in changed
            for notice in part(
                self._tracks, row, self._life.new_id(), frame.index, self._p.keep_s
            )
        ]

    def state(self) -> Mapping[str, Any]:
        """The whole state as plain data."""
        return {
            "time_ns": self._time_ns,
            "divided": self._divided,
            "tracks": self._tracks.state(),
            "scores": self._scores.state(),
            "camera": self._camera.state(),
            "groups": self._groups.state(),
            "together": self._together.state(),
            "life": self._life.state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave; the regions come with the next frame."""
        self._time_ns = state["time_ns"]
        self._divided = state["divided"]
        self._tracks.restore(state["tracks"])
        self._scores.restore(state["scores"])
        self._camera.restore(state["camera"])
        self._groups.restore(state["groups"])
        self._together.restore(state["together"])
        self._life.restore(state["life"])


def _seen(frame: Frame, has_images: bool) -> SeenDetections:
    d = frame.detections
    count = len(d.boxes)
    return SeenDetections(
        frame.boxes,
        np.array(d.scores if d.scores else [1.0] * count, np.float64),
        np.array(d.blobs if d.blobs else [NO_BLOB] * count, np.int64),
        d.ellipses if d.ellipses else [None] * count,
        _Looks(frame) if has_images else None,
        d.fused,
    )


class _Looks:
    """Colours of a frame's detections, each looked at when first asked for."""

    def __init__(self, frame: Frame) -> None:
        self._frame = frame
        self._known: dict[int, Floats | None] = {}

    def __call__(self, column: int) -> Floats | None:
        if column not in self._known:
            image = self._frame.evenly_lit
            x, y, w, h = self._frame.boxes[column].tolist()
            self._known[column] = (
                None if image is None else look_at(image, None, (x, y, w, h))
            )
        return self._known[column]


def _left_over(
    fg: FrameForeground,
    kept: list[Place],
    seen: SeenDetections,
    model: SizeModel | None,
    events_parameters: EventsParameters,
) -> SeenDetections:
    """The detections that no placed target explains, and blobs that were overlooked.

    The only detection of a blob that nobody claims is the blob itself, unless that is a part of
    the body at most.
    """
    rest = Rest(fg)
    rest.take(at.box for at in kept)
    free = np.flatnonzero(rest.share(seen.boxes) >= events_parameters.min_unexplained)
    holds = np.bincount(np.clip(seen.blobs, 0, None), minlength=len(fg.boxes) + 1)
    claimed = [at.blob for at in kept]
    boxes = seen.boxes.copy()
    for k in free.tolist():
        blob = int(seen.blobs[k])
        whole = (
            blob > 0
            and fg.boxes[blob - 1, 3] * (1.0 + 2.0 * events_parameters.size_tolerance)
            >= boxes[k, 3]
        )
        if whole and holds[blob] == 1 and blob not in claimed:
            boxes[k] = fg.boxes[blob - 1]
    # What nobody explains may start a track whatever its score: how well a body's shape fits says
    # little here.
    scores = np.maximum(seen.scores, UNEXPLAINED)
    ellipses = [seen.ellipses[row] for row in free.tolist()]
    more, bodies = _overlooked(fg, rest, claimed, seen.boxes, model, events_parameters)
    return SeenDetections(
        np.concatenate([boxes[free], bodies]),
        np.concatenate([scores[free], np.full(len(more), UNEXPLAINED)]),
        np.concatenate([seen.blobs[free], np.array(more, np.int64) + 1]),
        ellipses + [None] * len(more),
        None,
    )


def _overlooked(
    fg: FrameForeground,
    rest: Rest,
    claimed: list[int],
    detections: Floats,
    model: SizeModel | None,
    events_parameters: EventsParameters,
) -> tuple[list[int], Floats]:
    """Blobs, by row, that neither targets nor recorded detections explain, and the bodies that
    they may belong to.

    What is smaller than a body may be its lower part: the upper one has the background's colours,
    or is hidden.
    """
    if model is None or not len(fg.boxes):
        return [], np.zeros((0, 4))
    b = fg.boxes
    bodies = model.boxes(b[:, 0] + b[:, 2] / 2, b[:, 1] + b[:, 3])
    part = (b[:, 2] >= 0.6 * bodies[:, 2]) & (b[:, 2] <= 1.7 * bodies[:, 2])
    part &= (b[:, 3] >= events_parameters.min_part * bodies[:, 3]) & (
        b[:, 3] <= 1.3 * bodies[:, 3]
    )
    part[[blob - 1 for blob in claimed if blob != NO_BLOB]] = False
    if not part.any():
        return [], np.zeros((0, 4))
    rest.take((x, y, w, h) for x, y, w, h in detections.tolist())
    rows = np.flatnonzero(part & (rest.share(b) >= events_parameters.min_unexplained))
    return rows.tolist(), bodies[rows]
