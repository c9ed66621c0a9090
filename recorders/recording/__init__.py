"""A source of frames into a scene log: `record`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from recorders.lazy import lazily

if TYPE_CHECKING:
    from recorders.recording.finding import with_blobs
    from recorders.recording.options import RecordOptions
    from recorders.recording.recording import (
        InterruptedRecordingError,
        record,
        record_scenes,
    )
    from recorders.recording.scene_writer import RecordSummary
    from recorders.recording.sections import SECTIONS

__all__ = [
    "SECTIONS",
    "InterruptedRecordingError",
    "RecordOptions",
    "RecordSummary",
    "record",
    "record_scenes",
    "with_blobs",
]

_PLACES = {
    "recorders.recording.finding": "with_blobs",
    "recorders.recording.options": "RecordOptions",
    "recorders.recording.recording": "InterruptedRecordingError record record_scenes",
    "recorders.recording.scene_writer": "RecordSummary",
    "recorders.recording.sections": "SECTIONS",
}
__getattr__ = lazily(_PLACES)
