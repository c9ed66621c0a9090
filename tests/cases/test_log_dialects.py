"""Logs of others in other words: encodings, lines around boxes, messages that lack their picture."""

from __future__ import annotations

import base64
import bz2
import gzip
import json
import lzma
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
import lz4.frame
import numpy as np
import pytest

from recorders.errors import SourceError
from recorders.messages import Box
from recorders.pictures import Image
from recorders.sources import Source, open_source
from replay.cli import main

WIDTH, HEIGHT, FRAMES, STEP = 64, 48, 40, 40_000_000
START = 1_750_000_000_000_000_000
Sent = tuple[int, str, Any]
"""Time, topic, payload as JSON or bytes of a picture."""


def picture(k: int) -> Image:
    image = np.full((HEIGHT, WIDTH, 3), 100, np.uint8)
    image[20:40, 4 + k : 12 + k] = (40, 60, 200)
    return image


def boxes(k: int) -> list[Box]:
    return [(4.0 + k, 20.0, 8.0, 20.0), (30.0, 10.0, 12.0, 30.0)]


def encoded(k: int, ending: str = ".png") -> bytes:
    return bytes(cv2.imencode(ending, picture(k))[1])


def stamp(time_ns: int) -> dict[str, int]:
    return {"sec": time_ns // 10**9, "nsec": time_ns % 10**9}


def still(k: int, data: str | None = None, kind: str = "png") -> dict[str, Any]:
    plain = base64.b64encode(encoded(k)).decode() if data is None else data
    return {"timestamp": stamp(START + k * STEP), "format": kind, "data": plain}


def drawn(
    k: int, outline: Callable[[Box], list[tuple[float, float]]], kind: Any = 2
) -> Any:
    lines = [
        {
            "timestamp": stamp(START + k * STEP),
            "type": kind,
            "points": [{"x": x, "y": y} for x, y in outline(box)],
        }
        for box in boxes(k)
    ]
    return {"points": lines, "texts": [], "circles": []}


def corners(box: Box) -> list[tuple[float, float]]:
    x, y, w, h = box
    return [(x, y), (x + w, y), (x + w, y + h), (x, y + h)]


def edges(box: Box) -> list[tuple[float, float]]:
    a, b, c, d = corners(box)
    return [a, b, b, c, c, d, d, a]


def found(k: int, which: slice = slice(None)) -> dict[str, Any]:
    return {"width": WIDTH, "height": HEIGHT, "frame": k, "boxes": boxes(k)[which]}


SCHEMAS = {
    "/cam/image": "foxglove.CompressedImage",
    "/cam/raw": "foxglove.RawImage",
    "/cam/boxes": "foxglove.ImageAnnotations",
    "/cam/detections": "scenetrace.Detections",
}


def write(path: Path, sent: Iterable[Sent], encoding: str = "json") -> Path:
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        known: dict[str, int] = {}
        for time_ns, topic, payload in sorted(sent, key=lambda one: one[:2]):
            if topic not in known:
                schema = writer.register_schema(SCHEMAS[topic], "jsonschema", b"{}")
                known[topic] = writer.register_channel(topic, encoding, schema)
            data = json.dumps(payload).encode()
            writer.add_message(known[topic], time_ns, data, time_ns)
        writer.finish()
    return path


def every(topic: str, make: Callable[[int], Any], late: int = 0) -> list[Sent]:
    return [(START + k * STEP + late, topic, make(k)) for k in range(FRAMES)]


PICTURES = every("/cam/image", still)
DETECTIONS = every("/cam/detections", found)


def assert_same(source: Source, missing: Iterable[int] = ()) -> None:
    frames = list(source.frames())
    assert len(frames) == FRAMES
    assert source.losses == []
    without = set(missing)
    for k, frame in enumerate(frames):
        assert frame.detections is not None
        assert sorted(frame.detections.boxes) == sorted(boxes(k))
        assert (frame.image is None) == (k in without)
        if frame.image is not None:
            assert np.abs(frame.image.astype(int) - picture(k)).mean() < 4


STILLS: dict[str, Callable[[int], Any]] = {
    "for addresses": lambda k: still(
        k, base64.urlsafe_b64encode(encoded(k)).decode().rstrip("=")
    ),
    "as browsers have it": lambda k: still(
        k, "data:image/png;base64," + base64.b64encode(encoded(k)).decode()
    ),
    "in lines": lambda k: still(k, base64.encodebytes(encoded(k)).decode()),
    "avif": lambda k: still(k, base64.b64encode(encoded(k, ".avif")).decode(), "avif"),
}


@pytest.mark.parametrize("name", STILLS)
def test_pictures_in_json(tmp_path: Path, name: str) -> None:
    if name == "avif" and not cv2.haveImageWriter("a.avif"):
        pytest.skip("OpenCV was built without AVIF")
    sent = every("/cam/image", STILLS[name]) + DETECTIONS
    assert_same(open_source(write(tmp_path / "a.mcap", sent)))


@pytest.mark.parametrize("encoding", ["RGB8", "i420", "YUV420P", "yv12"])
def test_pixels_by_other_names(tmp_path: Path, encoding: str) -> None:
    code = {"RGB8": cv2.COLOR_BGR2RGB, "yv12": cv2.COLOR_BGR2YUV_YV12}.get(
        encoding, cv2.COLOR_BGR2YUV_I420
    )

    def raw(k: int) -> dict[str, Any]:
        pixels = cv2.cvtColor(picture(k), code)
        step = WIDTH * (3 if encoding == "RGB8" else 1)
        size = {"width": WIDTH, "height": HEIGHT, "step": step, "encoding": encoding}
        data = base64.b64encode(pixels.tobytes()).decode()
        return {"timestamp": stamp(START + k * STEP), "data": data, **size}

    sent = every("/cam/raw", raw) + DETECTIONS
    assert_same(open_source(write(tmp_path / "a.mcap", sent)))


OUTLINES: dict[str, Callable[[int], Any]] = {
    "edges": lambda k: drawn(k, edges, 4),
    "edges by name": lambda k: drawn(k, edges, "LINE_LIST"),
    "from below": lambda k: drawn(k, lambda b: corners(b)[::-1]),
}


@pytest.mark.parametrize("name", OUTLINES)
def test_lines_around_boxes(tmp_path: Path, name: str) -> None:
    sent = PICTURES + every("/cam/boxes", OUTLINES[name])
    assert_same(open_source(write(tmp_path / "a.mcap", sent)))


def test_a_turned_box_has_the_box_around_it_and_other_lines_are_told(
    tmp_path: Path,
) -> None:
    def turned(box: Box) -> list[tuple[float, float]]:
        x, y, w, h = box
        a = w / 3  # corners on each side of the upright box, the diagonals alike
        b = (h - (h * h - 4 * a * (w - a)) ** 0.5) / 2
        return [(x + a, y), (x + w, y + h - b), (x + w - a, y + h), (x, y + b)]

    def lines(k: int) -> Any:
        one = drawn(k, turned)
        line = {"type": 3, "points": [{"x": 1, "y": 2}, {"x": 30, "y": 2}]}
        return {**one, "points": [*one["points"], line]}

    source = open_source(write(tmp_path / "a.mcap", PICTURES + every("/cam/boxes", lines)))
    for k, frame in enumerate(source.frames()):
        assert frame.detections is not None
        for got, wanted in zip(frame.detections.boxes, boxes(k), strict=True):
            assert got == pytest.approx(wanted)
    said = f"{FRAMES} messages of /cam/boxes draw more than boxes"
    assert any(note.startswith(said) for note in source.notes)


@pytest.mark.parametrize(
    ("text", "label", "score"),
    [
        ("person 0.87", "person", 0.87),
        ("traffic light: 61%", "traffic light", 0.61),
        ("id 7 (0.5)", "id 7", 0.5),
        ("person", "person", 1.0),
        ("line 4", "line 4", 1.0),
    ],
)
@pytest.mark.parametrize("over", [0, 6])
def test_a_text_at_a_box_is_its_class(
    tmp_path: Path, text: str, label: str, score: float, over: int
) -> None:
    def labelled(k: int) -> Any:
        x, y, *_ = boxes(k)[0]
        texts = [{"position": {"x": x, "y": y - over}, "text": text}]
        return {**drawn(k, corners), "texts": texts}

    source = open_source(
        write(tmp_path / "a.mcap", PICTURES + every("/cam/boxes", labelled))
    )
    first = next(iter(source.frames())).detections
    assert first is not None
    assert (first.labels[0], first.scores[0]) == (label, score)
    assert first.labels[1] == ""


@pytest.mark.parametrize("late", [0, 3_000_000])
def test_detections_whose_picture_was_dropped_are_frames(tmp_path: Path, late: int) -> None:
    kept = [one for k, one in enumerate(PICTURES) if k % 10 != 4]
    sent = kept + every("/cam/detections", found, late)
    source = open_source(write(tmp_path / "a.mcap", sent))
    assert_same(source, missing=range(4, FRAMES, 10))
    assert "4 frames have detections and no picture" in " ".join(source.notes)
    times = [frame.time_ns for frame in source.frames()]
    assert times == [k * STEP for k in range(FRAMES)]


@pytest.mark.parametrize("by", ["time", "stamp"])
def test_a_message_for_each_box_is_joined(tmp_path: Path, by: str) -> None:
    sent = list(PICTURES)
    for k in range(FRAMES):
        for j in (0, 1):
            one = found(k, slice(j, j + 1))
            if by == "stamp":
                one["timestamp"] = stamp(START + k * STEP)
            late = (7 + 5 * j) * 1_000_000 if by == "stamp" else 0
            sent.append((START + k * STEP + late, "/cam/detections", one))
    source = open_source(write(tmp_path / "a.mcap", sent))
    assert_same(source)
    assert "several messages of detections belong to one picture" in " ".join(source.notes)


def test_detections_that_nobody_can_read_are_refused_by_name(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", DETECTIONS, encoding="msgpack")
    with pytest.raises(SourceError, match=r"no message of /cam/detections .* msgpack"):
        open_source(path)


NO_LOG: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "gzip": (gzip.compress, "`gunzip`"),
    "bzip2": (bz2.compress, "`bunzip2`"),
    "xz": (lzma.compress, "`unxz`"),
    "lz4": (lz4.frame.compress, "`lz4 -d`"),
    "zip": (lambda data: b"PK\x03\x04" + data, "`unzip`"),
    "text mode": (lambda data: data.replace(b"\n", b"\r\n"), "line ends were translated"),
    "text mode, back": (
        lambda data: data.replace(b"\r\n", b"\n"), "line ends were translated",
    ),
    "a page": (lambda _: b"<html>502 Bad Gateway</html>", "as servers send"),
}  # fmt: skip


@pytest.mark.parametrize("name", NO_LOG)
@pytest.mark.parametrize("command", ["record", "recover"])
def test_what_is_no_log_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, command: str
) -> None:
    change, said = NO_LOG[name]
    path = write(tmp_path / "a.mcap", DETECTIONS)
    path.write_bytes(change(path.read_bytes()))
    out = tmp_path / "out.mcap"
    if command == "recover" and name.startswith(("zip", "text mode")):
        return  # its end is a log's, or may be: what is whole of it is kept
    assert main([command, str(path), "-o", str(out)]) == 1
    error = capsys.readouterr().err
    assert "this is not an MCAP file: it" in error
    assert said in error
    assert not out.exists()
