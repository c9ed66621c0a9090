"""Frames' detections into the fusion, and out of it again."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from msgspec.structs import replace

from recorders.detectors import cut
from recorders.fusion.fusion import Decided, Fusion, sure_of
from recorders.fusion.parameters import FusionParameters
from recorders.messages import NO_BLOB, Detections


class FusedFrames:
    """The detections of frames, fused, in order; a frame's are known `ahead` frames later.

    Args:
        parameters: of the fusion.
        height: of the pictures, px.
        fps: frames per second.
        sample: what the detector finds in frames from all over the recording.
        masks_hold: the masks miss nobody (see `recorders.fusion.holding`): their boxes stay as they
            are, without those that are not believed, and the detector's are put where masks show
            nothing.
    """

    def __init__(
        self,
        parameters: FusionParameters,
        height: int,
        fps: float,
        sample: Iterable[Detections],
        *,
        masks_hold: bool = False,
    ) -> None:
        self._masks_hold = masks_hold
        sure = [sure_of(detected) for detected in sample]
        rate = sum(sure) / len(sure) if sure else 1.0
        self._fusion = Fusion(parameters, height, fps, rate, masks_hold)
        self._waiting: deque[tuple[Detections, Detections]] = deque()

    @property
    def ahead(self) -> int:
        """A frame's detections are known so many frames later."""
        return self._fusion.ahead

    def add(self, masked: Detections, detected: Detections) -> list[Detections]:
        """Take the next frame's detections of both sources, with their blobs; those of the frames
        that are known now.
        """
        self._waiting.append((masked, detected))
        return [self._made(d) for d in self._fusion.add(masked.frame, masked, detected)]

    def finish(self) -> list[Detections]:
        """Those of the frames that were waiting."""
        return [self._made(decided) for decided in self._fusion.finish()]

    def _made(self, decided: list[Decided]) -> Detections:
        masked, detected = self._waiting.popleft()
        if self._masks_hold:
            return _believed(decided, masked, detected)
        boxes, scores, labels, blobs = [], [], [], []
        for one in decided:
            box = cut(one.box, masked.width, masked.height)
            if box is None:
                continue
            boxes.append(box)
            scores.append(one.belief)
            labels.append(one.hypothesis.label)
            blobs.append(_blob(one, masked, detected))
        return Detections(
            frame=masked.frame,
            width=masked.width,
            height=masked.height,
            boxes=boxes,
            scores=scores,
            labels=labels,
            ellipses=[None] * len(boxes),
            blobs=blobs,
            components=masked.components,
            fused=True,
            light=masked.light,
            moved=masked.moved,
        )


def _believed(
    decided: list[Decided], masked: Detections, detected: Detections
) -> Detections:
    """The masks' detections that are believed, with the detector's labels, and its own where masks
    show nothing or nothing that is believed.
    """
    labels = {
        d.hypothesis.row: d.hypothesis.label
        for d in decided
        if d.hypothesis.masked is not None
    }
    rows = sorted(labels)
    blobs = [masked.blobs[row] for row in rows]
    alone = [
        (box, d, _blob(d, masked, detected))
        for d in decided
        if d.hypothesis.masked is None
        and (box := cut(d.box, masked.width, masked.height)) is not None
    ]
    alone = [one for one in alone if one[2] == NO_BLOB]
    return replace(
        masked,
        boxes=[*(masked.boxes[row] for row in rows), *(box for box, _, _ in alone)],
        scores=[*(masked.scores[row] for row in rows), *(d.belief for _, d, _ in alone)],
        labels=[
            *(labels[row] or masked.labels[row] for row in rows),
            *(d.hypothesis.label for _, d, _ in alone),
        ],
        ellipses=[*(masked.ellipses[row] for row in rows), *(None for _ in alone)],
        blobs=[*blobs, *(blob for _, _, blob in alone)],
    )


def _blob(one: Decided, masked: Detections, detected: Detections) -> int:
    """The blob that it lies in, as the masks have it, else by the detector's box."""
    hypothesis = one.hypothesis
    source, row = masked, hypothesis.row
    if hypothesis.masked is None:
        source, row = detected, hypothesis.column
    return source.blobs[row] if source.blobs else NO_BLOB
