"""A source of frames into a scene log: `record`."""

from recorders.recording.finding import with_blobs
from recorders.recording.options import SECTIONS, RecordOptions
from recorders.recording.recording import InterruptedRecordingError, record, record_scenes
from recorders.recording.scene_writer import RecordSummary, utf8

__all__ = [
    "SECTIONS",
    "InterruptedRecordingError",
    "RecordOptions",
    "RecordSummary",
    "record",
    "record_scenes",
    "utf8",
    "with_blobs",
]
