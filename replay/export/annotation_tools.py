"""Tracks for the tools in which people correct them: COCO JSON, and CVAT's XML for videos.

Both come back through ``record --detections``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import msgspec
from msgspec import UNSET

from recorders.annotated.reader import AnnotatedLog
from recorders.errors import UsageError
from recorders.messages import Track
from replay.export.mot import format_number
from replay.export.output import whole_file
from replay.export.tables import TableSpool

PLAIN_LABEL = "object"
_BLOCK = 10_000
_NOT_OF_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def _label(track: Track) -> str:
    return PLAIN_LABEL if track.label is UNSET or not track.label else track.label


def _size(log: AnnotatedLog, size: tuple[int, int] | None) -> tuple[int, int]:
    found = log.size() or size
    if found is None:
        raise UsageError(f"{log.path}: does not say the picture's size; give --size WxH")
    return found


def write_coco(
    log: AnnotatedLog,
    out: str | Path,
    *,
    size: tuple[int, int] | None = None,
    force: bool = False,
) -> int:
    """Write the present tracks as COCO JSON; returns the number of annotations.

    Each frame is an image, ``000001.jpg`` the first; ``track_id`` and ``score`` stand beside the
    box.

    Raises:
        OutputExistsError: ``out`` exists and ``force`` is not set.
        UsageError: the picture's size is not known.
    """
    width, height = _size(log, size)
    labels = sorted(
        {_label(t) for frame in log.frames(("tracks",)) for t in frame.tracks if t.present}
    )
    categories = {name: k for k, name in enumerate(labels or [PLAIN_LABEL], 1)}
    with whole_file(out, force=force) as file:
        listed = [{"id": category, "name": name} for name, category in categories.items()]
        file.write(b'{"categories": ' + msgspec.json.encode(listed) + b',\n"images": [')
        images = (
            {
                "id": frame.index + 1,
                "file_name": f"{frame.index + 1:06d}.jpg",
                "width": width,
                "height": height,
                "frame": frame.index,
                "time_s": (frame.time_ns - log.start_ns) / 1e9,
            }
            for frame in log.frames(("tracks",))
        )
        for k, image in enumerate(images):
            file.write((b",\n" if k else b"\n") + msgspec.json.encode(image))
        file.write(b'],\n"annotations": [')
        count = 0
        for index, track in _present(log):
            x, y, w, h = (round(v, 3) for v in track.box)
            said = {
                "id": count + 1,
                "image_id": index + 1,
                "category_id": categories[_label(track)],
                "bbox": [x, y, w, h],
                "area": round(w * h, 3),
                "iscrowd": 0,
                "track_id": track.id,
                "score": round(track.confidence, 3),
            }
            file.write((b",\n" if count else b"\n") + msgspec.json.encode(said))
            count += 1
        file.write(b"]}\n")
    return count


def _present(log: AnnotatedLog) -> Iterator[tuple[int, Track]]:
    for frame in log.frames(("tracks",)):
        for track in sorted(frame.tracks, key=lambda t: t.id):
            if track.present:
                yield frame.index, track


def write_cvat(
    log: AnnotatedLog,
    out: str | Path,
    *,
    size: tuple[int, int] | None = None,
    force: bool = False,
) -> int:
    """Write the present tracks as CVAT's XML for videos (1.1); returns the number of boxes.

    Frames count from 0. A box that was not observed is ``occluded``; where a track is not present
    it is ``outside``.

    Raises:
        OutputExistsError: ``out`` exists and ``force`` is not set.
        UsageError: the picture's size is not known.
    """
    width, height = _size(log, size)
    last = max((frame.index for frame in log.frames(("tracks",))), default=-1)
    boxes = 0
    with whole_file(out, force=force) as file, TableSpool(log.path, log.camera) as spool:
        name = escape(_of_xml(log.path.stem))
        file.write(
            '<?xml version="1.0" encoding="utf-8"?>\n<annotations>\n<version>1.1</version>\n'
            f"<meta><task><name>{name}</name><size>{last + 1}</size>"
            f"<original_size><width>{width}</width><height>{height}</height></original_size>"
            "</task></meta>\n".encode()
        )
        rows = _by_track(spool)
        for track, found in groupby(rows, key=lambda row: row["track"]):
            own = list(found)
            label = own[-1]["label"] or PLAIN_LABEL
            head = f'<track id="{track}" label={quoteattr(_of_xml(label))} source="auto">\n'
            lines = [_cvat_box(row, row["frame"], outside=False) for row in own]
            gaps = [
                _cvat_box(a, a["frame"] + 1, outside=True)
                for a, b in zip(own, [*own[1:], None], strict=True)
                if a["frame"] < last and (b is None or b["frame"] > a["frame"] + 1)
            ]
            ordered = "".join(line for _, line in sorted(lines + gaps))
            file.write(f"{head}{ordered}</track>\n".encode())
            boxes += len(own)
        file.write(b"</annotations>\n")
    return boxes


def _of_xml(text: str) -> str:
    """A text without the characters that XML cannot hold."""
    return _NOT_OF_XML.sub("\ufffd", text)


def _by_track(spool: TableSpool) -> Iterator[dict[str, Any]]:
    """The rows of the tracks that are present, by track and frame; sorted on disk if need be."""
    import duckdb

    columns = "frame, track, x, y, w, h, mode, label"
    with duckdb.connect(config={"threads": 1}) as db:
        found = db.execute(
            f"SELECT {columns} FROM read_json($rows, format = 'newline_delimited',"  # noqa: S608
            " columns = {frame: 'BIGINT', track: 'BIGINT', x: 'DOUBLE', y: 'DOUBLE',"
            " w: 'DOUBLE', h: 'DOUBLE', mode: 'VARCHAR', label: 'VARCHAR', present: 'BOOLEAN'})"
            " WHERE present ORDER BY track, frame",
            {"rows": str(spool.path("tracks"))},
        )
        names = columns.split(", ")
        while block := found.fetchmany(_BLOCK):
            for row in block:
                yield dict(zip(names, row, strict=True))


def _cvat_box(row: dict[str, Any], frame: int, *, outside: bool) -> tuple[int, str]:
    x, y, w, h = row["x"], row["y"], row["w"], row["h"]
    places = zip(("xtl", "ytl", "xbr", "ybr"), (x, y, x + w, y + h), strict=True)
    said = " ".join(f'{name}="{format_number(value)}"' for name, value in places)
    hidden = int(row["mode"] == "predicted")
    return frame, (
        f'<box frame="{frame}" outside="{int(outside)}" occluded="{hidden}" keyframe="1"'
        f' {said} z_order="0"></box>\n'
    )
