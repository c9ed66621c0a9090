"""An annotated log in other people's formats: MOTChallenge text, JSON, Parquet, GraphML, video."""

from __future__ import annotations

from replay.export.graphml import write_graphml
from replay.export.mot import write_mot
from replay.export.tables import write_json, write_parquet
from replay.export.video import VideoOptions, write_video

__all__ = [
    "VideoOptions",
    "write_graphml",
    "write_json",
    "write_mot",
    "write_parquet",
    "write_video",
]
