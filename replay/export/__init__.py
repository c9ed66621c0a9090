"""An annotated log in other people's formats: text, tables, graphs, annotation tools, video, viewers,
bags.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from recorders.lazy import lazily

if TYPE_CHECKING:
    from replay.export.annotation_tools import write_coco, write_cvat
    from replay.export.clips import write_clips
    from replay.export.graphml import write_graphml
    from replay.export.layout import write_layout
    from replay.export.mot import write_mot
    from replay.export.ros2 import write_ros2
    from replay.export.rrd import write_rrd
    from replay.export.subtitles import write_srt
    from replay.export.tables import write_csv, write_json, write_parquet
    from replay.export.video import VideoOptions, write_video

__all__ = [
    "VideoOptions",
    "write_clips",
    "write_coco",
    "write_csv",
    "write_cvat",
    "write_graphml",
    "write_json",
    "write_layout",
    "write_mot",
    "write_parquet",
    "write_ros2",
    "write_rrd",
    "write_srt",
    "write_video",
]

_PLACES = {
    "replay.export.annotation_tools": "write_coco write_cvat",
    "replay.export.clips": "write_clips",
    "replay.export.graphml": "write_graphml",
    "replay.export.layout": "write_layout",
    "replay.export.mot": "write_mot",
    "replay.export.ros2": "write_ros2",
    "replay.export.rrd": "write_rrd",
    "replay.export.subtitles": "write_srt",
    "replay.export.tables": "write_csv write_json write_parquet",
    "replay.export.video": "VideoOptions write_video",
}
__getattr__ = lazily(_PLACES)
