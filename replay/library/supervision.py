"""A frame's tracks for the package ``supervision`` (the extra ``supervision``)."""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec import UNSET

from replay.export.extras import needed
from replay.library.opened import SceneFrame


def to_detections(frame: SceneFrame) -> Any:
    """The tracks that are present as ``supervision.Detections``.

    ``xyxy`` (N, 4) float32 in pixels, ``confidence`` (N,) float32, ``tracker_id`` (N,) int64; where
    any track has a class, ``data["class_name"]`` with "" for the others. ``class_id`` is left
    None: a log knows names, not numbers.

    Raises:
        SceneTraceError: ``supervision`` is not installed.
        RecordingError: the log holds no tracks.
    """
    sv = needed("supervision", "supervision", "supervision", "to_detections")
    tracks = sorted(frame.present, key=lambda t: t.id)
    boxes = np.array([track.box for track in tracks], np.float64).reshape(-1, 4)
    boxes[:, 2:] += boxes[:, :2]
    names = ["" if track.label is UNSET else track.label for track in tracks]
    return sv.Detections(
        xyxy=boxes.astype(np.float32),
        confidence=np.array([track.confidence for track in tracks], np.float32),
        tracker_id=np.array([track.id for track in tracks], np.int64),
        data={"class_name": np.array(names)} if any(names) else {},
    )
