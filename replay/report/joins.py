"""Where a track's identity rests on a join: the last sight before it and the first after, side
by side.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from reasoning.questions.joins import IdentityJoin
from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.messages import Box
from recorders.pictures import Image
from recorders.vision import cv2
from replay.palette import track_bgr
from replay.report.pictures import drawn

_SIDE = 320
_MARGIN = 0.8
"""So much of the body's larger side is shown around it."""
_LINE = 22
_GAP = 8


def join_picture(log: AnnotatedLog, join: IdentityJoin) -> Image | None:
    """Two cut-outs of one height, (height, width, 3) BGR, each with what it is beneath; None
    without a sight on both sides, or without pictures.
    """
    sides = _sides(log, join) if log.has_pictures else None
    if sides is None:
        return None
    pictures = [image for _, image in drawn(log, [frame for frame, _ in sides], bare=True)]
    words = ("last seen", "seen again")
    cut = [
        _cut_out(image, box, join.track, f"{word} {_time(log, frame)}")
        for image, (frame, box), word in zip(pictures, sides, words, strict=True)
    ]
    gap = np.full((cut[0].shape[0], _GAP, 3), 255, np.uint8)
    return np.hstack([cut[0], gap, cut[1]])


def _sides(
    log: AnnotatedLog, join: IdentityJoin
) -> tuple[tuple[AnnotatedFrame, Box], tuple[AnnotatedFrame, Box]] | None:
    before: tuple[AnnotatedFrame, Box] | None = None
    for frame, box in _sights(log, join.track):
        if frame.index >= join.frame:
            return None if before is None else (before, (frame, box))
        before = frame, box
    return None


def _sights(log: AnnotatedLog, track: int) -> Iterator[tuple[AnnotatedFrame, Box]]:
    for frame in log.frames(("tracks",)):
        for t in frame.tracks:
            if t.id == track and t.observed and t.present:
                yield frame, t.box


def _time(log: AnnotatedLog, frame: AnnotatedFrame) -> str:
    return f"{(frame.time_ns - log.start_ns) / 1e9:.2f} s, frame {frame.index}"


def _cut_out(image: Image, box: Box, track: int, text: str) -> Image:
    """A square around a box, with the box and a line of text beneath."""
    x, y, w, h = box
    half = max(w, h) * (0.5 + _MARGIN)
    scale = _SIDE / (2 * half)
    left, top = x + w / 2 - half, y + h / 2 - half
    edge = int(half * 2) + 2
    padded = cv2.copyMakeBorder(
        image, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=(96, 96, 96)
    )
    a, b = (round(v) + edge for v in (left, top))
    a, b = (min(max(v, 0), n - 1) for v, n in zip((a, b), padded.shape[1::-1], strict=True))
    piece = padded[b : b + max(2, round(2 * half)), a : a + max(2, round(2 * half))]
    shown = cv2.resize(piece, (_SIDE, _SIDE), interpolation=cv2.INTER_LINEAR)
    corner = [
        round(_MARGIN * max(w, h) * scale + (max(w, h) - v) / 2 * scale) for v in (w, h)
    ]
    size = round(w * scale), round(h * scale)
    cv2.rectangle(shown, (corner[0], corner[1], *size), track_bgr(track), 1, cv2.LINE_AA)
    strip = np.full((_LINE, _SIDE, 3), 255, np.uint8)
    cv2.putText(
        strip, f"target {track} {text}", (4, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (20, 20, 20), 1,
        cv2.LINE_AA,
    )  # fmt: skip
    return np.vstack([np.asarray(shown, np.uint8), strip])
