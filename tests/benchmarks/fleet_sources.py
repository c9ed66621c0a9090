"""Short recordings for the benchmarks of a fleet: generated boxes, boxes and pictures cut from
the real recordings, and files that are poison.
"""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SCENETRACE_DATA", ROOT.parent / "shared" / "data"))
SIZE = ["--fps", "25", "--size", "640x480"]
_LARGE = ["--fps", "25", "--size", "1920x1080"]
_BOXES = (
    "mot15/Venice-2/gt.txt",
    "mot15/ADL-Rundle-8/gt.txt",
    "mot15/ETH-Bahnhof/gt.txt",
    "mot15/KITTI-13/gt.txt",
    "tud-campus/gt.txt",
    "pets09-s2l1/gt.txt",
)
_VIDEOS = (
    "pets09-s2l1/video.avi",
    "tud-campus/video.mp4",
    "scenes/two-cyclists/video.mp4",
    "scenes/one-by-one/video.mp4",
    "flies/three_flies.mp4",
)
_CUT_FRAMES, _CUT_PICTURES = 25, 8
_CAMERAS = 20


def generated(path: Path, number: int, frames: int) -> None:
    """Boxes of four people who walk about, as MOTChallenge text."""
    rng = np.random.default_rng(number)
    start = rng.uniform(0, 400, (4, 2))
    speed = rng.uniform(-3, 3, (4, 2))
    lines = []
    for frame in range(frames):
        where = (start + speed * frame) % 440
        lines += [
            f"{frame + 1},-1,{x:.1f},{y:.1f},40,100,1,-1,-1,-1" for x, y in where.tolist()
        ]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")


def boxes_alone(folder: Path, count: int, frames: int) -> list[Path]:
    """So many generated recordings, of twenty cameras."""
    made = []
    for number in range(count):
        path = folder / f"cam{number % _CAMERAS}" / f"{number:06d}.txt"
        generated(path, number, frames)
        made.append(path)
    return made


def mixed(folder: Path, count: int, frames: int) -> list[str]:
    """So many sources of all kinds; the lines of a list for `scenetrace batch`.

    Of twenty, two are videos and one is a folder of pictures, cut from the real recordings; five
    are pieces of real tables of boxes; the others are generated. Without the real recordings all
    are.
    """
    real = _real_boxes()
    lines = []
    for number in range(count):
        place = Path(f"cam{number % _CAMERAS}")
        kind, turn = number % 20, number // 20
        (folder / place).mkdir(parents=True, exist_ok=True)
        options = SIZE
        path = place / f"{number:06d}.txt"
        if kind in (3, 11, 17) and (pictures := _pictures(turn * 3 + kind)):
            options = ["--fps", "7"]
            path = place / f"{number:06d}{'' if kind == 17 else '.avi'}"
            _write_pictures(folder / path, pictures)
        elif kind % 4 == 0 and real:
            options = _LARGE
            _cut_boxes(folder / path, real[number % len(real)], turn * _CUT_FRAMES)
        else:
            generated(folder / path, number, frames)
        lines.append(f"{path} --camera {place.name} {' '.join(options)}")
    return lines


def _real_boxes() -> list[np.ndarray]:
    return [
        np.loadtxt(DATA / name, delimiter=",", usecols=range(6))
        for name in _BOXES
        if (DATA / name).is_file()
    ]


def _cut_boxes(path: Path, table: np.ndarray, first: int) -> None:
    last = int(table[:, 0].max())
    first %= max(1, last - _CUT_FRAMES)
    inside = table[(table[:, 0] > first) & (table[:, 0] <= first + _CUT_FRAMES)]
    path.write_text(
        "".join(
            f"{int(row[0]) - first},-1,{row[2]:.1f},{row[3]:.1f},{row[4]:.1f},{row[5]:.1f},1,-1,-1,-1\n"
            for row in inside
        )
    )


def _pictures(turn: int) -> list[np.ndarray]:
    """Some frames of a real recording, made small."""
    there = [DATA / name for name in _VIDEOS if (DATA / name).is_file()]
    if not there:
        return []
    found = _frames(there[turn % len(there)], turn * 2 % 40, _CUT_PICTURES)
    return [cv2.resize(picture, (240, 180)) for picture in found]


def _frames(path: Path, first: int, count: int) -> list[np.ndarray]:
    video = cv2.VideoCapture(str(path))
    for _ in range(first):
        video.grab()
    read = [video.read() for _ in range(count)]
    video.release()
    return [picture for good, picture in read if good]


def real_video(path: Path, frames: int) -> bool:
    """The beginning of a real recording as a video; whether there is one."""
    source = DATA / _VIDEOS[0]
    if source.is_file():
        _write_pictures(path, _frames(source, 0, frames))
    return source.is_file()


def _write_pictures(path: Path, pictures: list[np.ndarray]) -> None:
    if not path.suffix:
        path.mkdir()
        for number, picture in enumerate(pictures):
            cv2.imwrite(str(path / f"{number:03d}.jpg"), picture)
        return
    height, width = pictures[0].shape[:2]
    code = cv2.VideoWriter.fourcc(*"MJPG")
    video = cv2.VideoWriter(str(path), code, 7, (width, height))
    for picture in pictures:
        video.write(picture)
    video.release()


def poison(folder: Path, endless_frames: int = 300_000) -> list[str]:
    """Five sources that no recording can be made of; the lines of a list.

    Bytes without sense; a log whose chunk claims a terabyte; an XML file that unfolds to
    gigabytes; a picture of 3.6 gigapixels in a hundred bytes; a video that does not end in any
    time that one has.
    """
    (folder / "poison" / "bomb").mkdir(parents=True)
    (folder / "poison" / "noise.mp4").write_bytes(np.random.default_rng(7).bytes(20_000))
    (folder / "poison" / "chunk.mcap").write_bytes(_log_bomb())
    (folder / "poison" / "lol.xml").write_text(_xml_bomb())
    (folder / "poison" / "bomb" / "1.png").write_bytes(_picture_bomb())
    with (folder / "poison" / "endless.y4m").open("wb") as file:
        file.write(b"YUV4MPEG2 W16 H16 F25:1 Ip A1:1 C420jpeg\n")
        some = (b"FRAME\n" + bytes(range(256)) + bytes(128)) * 1000
        for _ in range(endless_frames // 1000):
            file.write(some)
    return [
        "poison/noise.mp4",
        "poison/chunk.mcap",
        "poison/lol.xml",
        "poison/bomb --fps 5",
        "poison/endless.y4m",
    ]


def _log_bomb() -> bytes:
    def record(code: int, content: bytes) -> bytes:
        return bytes([code]) + struct.pack("<Q", len(content)) + content

    def text(word: str) -> bytes:
        return struct.pack("<I", len(word)) + word.encode()

    packed = zlib.compress(bytes(1000))
    chunk = struct.pack("<QQQI", 0, 0, 1 << 40, 0) + text("zstd")
    chunk += struct.pack("<Q", len(packed)) + packed
    magic = b"\x89MCAP0\r\n"
    end = record(2, struct.pack("<QQI", 0, 0, 0)) + magic
    return magic + record(1, text("") + text("")) + record(6, chunk) + end


def _xml_bomb() -> str:
    names = [f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 11)]
    return (
        f'<?xml version="1.0"?><!DOCTYPE d [<!ENTITY a0 "lol">{"".join(names)}]>'
        "<dataset>&a10;</dataset>"
    )


def _picture_bomb() -> bytes:
    def chunk(kind: bytes, content: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + content))
        return struct.pack(">I", len(content)) + kind + content + check

    head = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(bytes(1000)))
        + chunk(b"IEND", b"")
    )


def write_list(folder: Path, lines: list[str], name: str) -> Path:
    """A list of sources beside them."""
    path = folder / name
    path.write_text("\n".join(lines) + "\n")
    return path
