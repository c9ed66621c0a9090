"""Frames' detections into the fusion, and out of it again."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

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
    """

    def __init__(
        self,
        parameters: FusionParameters,
        height: int,
        fps: float,
        sample: Iterable[Detections],
    ) -> None:
        sure = [sure_of(detected) for detected in sample]
        rate = sum(sure) / len(sure) if sure else 1.0
        self._fusion = Fusion(parameters, height, fps, rate)
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


def _blob(one: Decided, masked: Detections, detected: Detections) -> int:
    """The blob that it lies in, as the masks have it, else by the detector's box."""
    hypothesis = one.hypothesis
    source, row = masked, hypothesis.row
    if hypothesis.masked is None:
        source, row = detected, hypothesis.column
    return source.blobs[row] if source.blobs else NO_BLOB
