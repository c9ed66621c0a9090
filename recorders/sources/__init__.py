"""Sources of a recording: video files, folders of images, logs of others, detections in files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from recorders.lazy import lazily

if TYPE_CHECKING:
    from recorders.sources.live import LiveSource
    from recorders.sources.log_source import LogOptions, LogSource
    from recorders.sources.objects import ObjectSource
    from recorders.sources.opening import open_cameras, open_source
    from recorders.sources.regions import read_regions
    from recorders.sources.source import Source, SourceFrame, parse_fps

__all__ = [
    "LiveSource",
    "LogOptions",
    "LogSource",
    "ObjectSource",
    "Source",
    "SourceFrame",
    "open_cameras",
    "open_source",
    "parse_fps",
    "read_regions",
]

_PLACES = {
    "recorders.sources.live": "LiveSource",
    "recorders.sources.log_source": "LogOptions LogSource",
    "recorders.sources.objects": "ObjectSource",
    "recorders.sources.opening": "open_cameras open_source",
    "recorders.sources.regions": "read_regions",
    "recorders.sources.source": "Source SourceFrame parse_fps",
}
__getattr__ = lazily(_PLACES)
