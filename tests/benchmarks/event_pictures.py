"""A picture per kind of event, cut out of the recording where it happens, and rows of moments
like EVENTS, Figure 5.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.messages import EVENT_KINDS, Box, Event
from recorders.pictures import Image
from recorders.vision import cv2
from replay.draw import DrawOptions, draw_frame
from replay.export.video import frame_overlay
from replay.report.pictures import chosen_frames, drawn

TILE = (340, 255)
QUALITY = 72
SCALE = 2.0
SHEETS = {
    "tracks": ("track_confirmed", "mode_changed", "track_lost", "track_recovered", "track_removed", "anomaly"),
    "scene": ("entering", "entered", "exiting", "returned", "exited", "zone_entered", "zone_left"),
    "interaction": ("interaction_started", "grouping", "joined", "grouped", "separated", "splitting", "single",
                    "interaction_ended"),
    "groups": ("group_formed", "group_changed", "group_ended", "group_entered_scene", "disagreement"),
}  # fmt: skip


def choose(
    logs: Sequence[Path],
) -> dict[str, tuple[Path, AnnotatedFrame, Event, list[Box]]]:
    """For each kind the event that is seen best: few other events in its frame, few people near,
    large subjects.
    """
    best: dict[str, tuple[float, tuple[Path, AnnotatedFrame, Event, list[Box]]]] = {}
    for path in logs:
        with AnnotatedLog(path) as log:
            before: dict[int, Box] = {}
            for frame in log.frames():
                boxes = {t.id: t.box for t in frame.tracks}
                for event in frame.events:
                    places = [boxes.get(i, before.get(i)) for i in event.subjects]
                    found = [b for b in places if b is not None]
                    if not found or frame.index == 0:
                        continue
                    worth = (
                        min(b[3] for b in found)
                        - 12 * len(frame.tracks)
                        - 4 * len(frame.events)
                    )
                    if event.kind not in best or worth > best[event.kind][0]:
                        best[event.kind] = worth, (path, frame, event, found)
                before = boxes
    return {kind: best[kind][1] for kind in EVENT_KINDS if kind in best}


def picture(path: Path, frame: AnnotatedFrame, event: Event, boxes: Sequence[Box]) -> Image:
    """The event's frame around its subjects, with what it says beneath."""
    with AnnotatedLog(path) as log:
        (_, image), *_ = drawn(log, [frame], bare=True)
        present = {t.id for t in frame.tracks if t.present}
        marks = [
            (b, f"{i}: last seen")
            for i, b in zip(event.subjects, boxes, strict=False)
            if i not in present
        ]
        overlay = replace(
            frame_overlay(log, replace(frame, events=[])), events=(), title="", marks=marks
        )
        canvas = draw_frame(image, overlay, DrawOptions(scale=SCALE))
    x0, y0 = min(b[0] for b in boxes), min(b[1] for b in boxes)
    x1, y1 = max(b[0] + b[2] for b in boxes), max(b[1] + b[3] for b in boxes)
    high, wide = canvas.shape[:2]
    width = min(
        max(1.8 * (x1 - x0), 2.4 * (y1 - y0), 0.45 * wide / SCALE) * SCALE,
        wide,
        high * TILE[0] / TILE[1],
    )
    height = width * TILE[1] / TILE[0]
    left = round(min(max((x0 + x1) / 2 * SCALE - width / 2, 0), wide - width))
    top = round(min(max((y0 + y1) / 2 * SCALE - height / 2, 0), high - height))
    part = canvas[top : top + round(height), left : left + round(width)]
    return captioned(
        part, f"{event.kind}: {event.text}", f"frame {event.frame}; {event.rule}"
    )


def captioned(part: Image, text: str, rule: str) -> Image:
    """A tile of one size with three lines of text beneath."""
    tile = np.asarray(cv2.resize(part, TILE, interpolation=cv2.INTER_AREA), np.uint8)
    words = [*textwrap.wrap(text, 54)[:3]]
    words += [""] * (3 - len(words)) + [rule if len(rule) <= 56 else rule[:53] + "..."]
    ground = np.full((74, TILE[0], 3), 250, np.uint8)
    for k, line in enumerate(words):
        colour = (20, 20, 20) if k < 3 else (120, 70, 20)
        cv2.putText(
            ground,
            line,
            (5, 15 + 17 * k),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.38,
            colour,
            1,
            cv2.LINE_AA,
        )
    return np.vstack([tile, ground])


def save(path: Path, image: Image) -> None:
    """Write a JPEG, or a PNG where the name says so."""
    options = [cv2.IMWRITE_JPEG_QUALITY, QUALITY] if path.suffix == ".jpg" else []
    path.write_bytes(bytes(cv2.imencode(path.suffix, image, options)[1]))


def sheet(tiles: Sequence[Image], columns: int) -> Image:
    """Tiles side by side, row by row."""
    blank = np.full_like(tiles[0], 250)
    filled = [*tiles, *[blank] * (-len(tiles) % columns)]
    rows = [np.hstack(filled[k : k + columns]) for k in range(0, len(filled), columns)]
    return np.asarray(np.vstack(rows), np.uint8)


def per_kind(logs: Sequence[Path], folder: Path, suffix: str) -> list[str]:
    """Write a picture per kind and a sheet per family; returns the kinds that do not occur."""
    folder.mkdir(parents=True, exist_ok=True)
    chosen = choose(logs)
    tiles = {kind: picture(*found) for kind, found in chosen.items()}
    for kind, tile in tiles.items():
        save(folder / f"{kind}{suffix}", tile)
    for name, kinds in SHEETS.items():
        shown = [tiles[k] for k in kinds if k in tiles]
        if shown:
            save(folder / f"sheet_{name}{suffix}", sheet(shown, 3))
    return [k for k in EVENT_KINDS if k not in chosen]


def moments(
    path: Path, frames: Sequence[int], window: tuple[int, int, int, int], columns: int = 3
) -> Image:
    """Frames of a recording in rows, cut to a window (x, y, w, h), lettered like EVENTS, Figure
    5.
    """
    x, y, w, h = (round(v * SCALE) for v in window)
    tiles = []
    with AnnotatedLog(path) as log:
        found = [replace(f, events=[]) for f in chosen_frames(log, frames)]
        for k, (frame, image) in enumerate(
            drawn(log, found, DrawOptions(scale=SCALE, regions=False))
        ):
            part = np.ascontiguousarray(image[y : y + h, x : x + w])
            label = f"({chr(97 + k)}) frame {frame.index}"
            cv2.rectangle(part, (0, h - 22), (140, h), (250, 250, 250), -1)
            cv2.putText(
                part,
                label,
                (6, h - 6),
                cv2.FONT_HERSHEY_SIMPLEX,
                0.48,
                (20, 20, 20),
                1,
                cv2.LINE_AA,
            )
            tiles.append(part)
    return sheet(tiles, columns)
