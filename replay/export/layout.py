"""A layout for Lichtblick and Foxglove: pictures with the drawings over them, the events, plots."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from recorders import channels
from recorders.annotated.frames import annotated_cameras
from recorders.annotated.reader import AnnotatedLog
from recorders.log import LogReader
from replay.export.output import whole_file

_INFO = 2
"""The viewers' number of the lowest level of the log's lines that are shown."""


def write_layout(log: AnnotatedLog, out: str | Path, *, force: bool = False) -> int:
    """Write a layout for all cameras of the log; returns how many panels it has.

    Raises:
        OutputExistsError: ``out`` exists and ``force`` is not set.
    """
    with LogReader(log.path, log.limits) as reader:
        cameras = annotated_cameras(reader)
        present = {
            channel.topic: "" if channel.schema is None else channel.schema.name
            for channel in reader.channels
        }
    layout = layout_of(cameras, present)
    with whole_file(out, force=force) as file:
        file.write(json.dumps(layout, indent=1, sort_keys=True).encode() + b"\n")
    return len(layout["configById"])


def layout_of(cameras: Sequence[str], present: dict[str, str]) -> dict[str, Any]:
    """The layout.

    Args:
        cameras: their names.
        present: topics to the names of their schemas.
    """
    panels: dict[str, Any] = {}
    left, right = [], []
    for camera in cameras:
        left += _pictures(camera, present, panels)
        right += _facts(camera, panels)
    rows = _split("row", [_split("column", left), _split("column", right)], 50)
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": rows,
    }


def _pictures(camera: str, present: dict[str, str], panels: dict[str, Any]) -> list[str]:
    image, mask, drawn = (
        channels.topic(camera, name) for name in ("image", "foreground", "annotations")
    )
    names = [f"Image!{camera}_image"]
    panels[names[0]] = {
        "imageMode": {
            "imageTopic": image,
            "annotations": {drawn: {"visible": True}},
            # A viewer shows the picture that it decoded last: after a jump in a video that is one
            # of another moment, unless it has to match the drawings.
            "synchronize": "Video" in present.get(image, ""),
        },
        "foxglovePanelTitle": camera,
    }
    if mask in present:
        names.append(f"Image!{camera}_foreground")
        panels[names[1]] = {
            "imageMode": {"imageTopic": mask, "annotations": {}},
            "foxglovePanelTitle": f"{camera}: foreground",
        }
    return names


def _facts(camera: str, panels: dict[str, Any]) -> list[str]:
    def at(name: str) -> str:
        return channels.topic(camera, name)

    events, states, plot = (
        f"{kind}!{camera}_{name}"
        for kind, name in (
            ("RosOut", "log"),
            ("StateTransitions", "events"),
            ("Plot", "counts"),
        )
    )
    panels[events] = {
        "searchTerms": [],
        "minLogLevel": _INFO,
        "topicToRender": at("log"),
        "foxglovePanelTitle": f"{camera}: events",
    }
    panels[states] = {
        "paths": [
            {
                "value": f"{at('events')}.kind",
                "timestampMethod": "receiveTime",
                "label": "event",
            }
        ],
        "isSynced": True,
    }
    counted = ("tracks", "relations", "groups")
    panels[plot] = {
        "paths": [
            {
                "value": f"{at(name)}.{name}.length",
                "enabled": True,
                "timestampMethod": "receiveTime",
                "label": name,
            }
            for name in counted
        ],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showPlotValuesInLegend": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 240,
        "foxglovePanelTitle": f"{camera}: how many",
    }
    raw = f"RawMessages!{camera}_relations"
    panels[raw] = {
        "topicPath": f"{at('relations')}.relations[:]",
        "diffEnabled": False,
        "diffMethod": "previous message",
        "diffTopicPath": "",
        "showFullMessageForDiff": False,
        "expansion": "all",
    }
    return [events, raw, plot, states]


def _split(direction: str, panels: list[Any], percentage: int | None = None) -> Any:
    """Panels beside or below one another, all as large unless told."""
    if len(panels) == 1:
        return panels[0]
    return {
        "direction": direction,
        "splitPercentage": percentage or round(100 / len(panels)),
        "first": panels[0],
        "second": _split(direction, panels[1:]),
    }
