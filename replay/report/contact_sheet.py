"""A contact sheet: a thumbnail of each target that was found, on one page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from reasoning.questions import Case
from recorders.errors import SceneTraceError
from recorders.limits import Limits
from recorders.pictures import Image, encode_jpeg
from recorders.scene import SceneLog
from recorders.vision import cv2
from replay.export.output import check_folder, whole_folder

INDEX = "index.html"
_MARGIN = 0.15
_TALL = 240


@dataclass(frozen=True)
class Crop:
    """A target's picture, (height, width, 3) BGR."""

    image: Image


def check_sheet(folder: Path, *, force: bool) -> None:
    """That a sheet may be written there.

    Raises:
        OutputExistsError, UsageError: it may not.
    """
    check_folder(folder, INDEX, force=force)


def crops(
    case: Case, columns: Sequence[str], rows: Sequence[tuple[Any, ...]]
) -> Iterator[Crop | str]:
    """For each row the picture of its target where it is seen best, or why there is none.

    ``columns`` have recording, frame, x, y, w and h.
    """
    at = [columns.index(c) for c in ("recording", "frame", "x", "y", "w", "h")]
    wanted = [tuple(row[k] for k in at) for row in rows]
    places = {
        name: (path, camera, start_ns)
        for name, path, camera, start_ns in case.rows(
            "SELECT recording, path, camera, start_ns FROM recordings"
        )
    }
    times = _times(case, {(w[0], w[1]) for w in wanted})
    found: dict[int, Crop | str] = {}
    for name in dict.fromkeys(w[0] for w in wanted):
        path, camera, start_ns = places[name]
        mine = {
            k: (start_ns + round(times[w[0], w[1]] * 1e9), w[2:])
            for k, w in enumerate(wanted)
            if w[0] == name
        }
        try:
            found.update(_cut(Path(path), camera, mine, case.log_limits))
        except (SceneTraceError, OSError) as error:
            found.update(dict.fromkeys(mine, f"{name}: {error}"))
    for k, w in enumerate(wanted):
        yield found.get(k, f"{w[0]}: no picture of frame {w[1]}")


def _times(case: Case, wanted: set[tuple[str, int]]) -> dict[tuple[str, int], float]:
    out = {}
    for name in sorted({name for name, _ in wanted}):
        frames = sorted(frame for of, frame in wanted if of == name)
        for frame, t in case.rows(
            "SELECT frame, t FROM frames WHERE recording = ? AND list_contains(?, frame)",
            [name, frames],
        ):
            out[name, frame] = t
    return out


def _cut(
    path: Path,
    camera: str,
    wanted: Mapping[int, tuple[int, Sequence[float]]],
    limits: Limits,
) -> dict[int, Crop]:
    at: dict[int, list[int]] = {}
    for k, (time_ns, _) in wanted.items():
        at.setdefault(time_ns, []).append(k)
    out: dict[int, Crop] = {}
    with SceneLog(path, camera, limits) as scene:
        for frame in scene.frames(min(at), again=True):
            for k in at.get(frame.time_ns, ()):
                if frame.image is not None:
                    out[k] = Crop(_around(frame.image, wanted[k][1]))
            if frame.time_ns >= max(at):
                break
    return out


def _around(image: Image, box: Sequence[float]) -> Image:
    """The box and a little around it, enlarged to `_TALL` where it is smaller."""
    x, y, w, h = box
    margin = _MARGIN * h
    height, width = image.shape[:2]
    left, top = max(0, round(x - margin)), max(0, round(y - margin))
    right, foot = min(width, round(x + w + margin)), min(height, round(y + h + margin))
    cut: Image = image[top : max(foot, top + 2), left : max(right, left + 2)]
    scale = max(1, round(_TALL / max(cut.shape[0], 1)))
    if scale == 1:
        return np.ascontiguousarray(cut)
    size = (cut.shape[1] * scale, cut.shape[0] * scale)
    return np.asarray(cv2.resize(cut, size, interpolation=cv2.INTER_LINEAR), np.uint8)


_STYLE = """
body{font:15px/1.4 system-ui,sans-serif;margin:1.5rem;color:#16181d;background:#fff}
ol{list-style:none;padding:0;display:flex;flex-wrap:wrap;gap:1rem}li{width:11rem;break-inside:avoid}
img{height:13rem;max-width:100%;object-fit:contain;background:#eceff3;display:block}
p{margin:.3rem 0;overflow-wrap:anywhere}code{font-size:.85em}
@media(prefers-color-scheme:dark){body{color:#e3e6eb;background:#16181d}img{background:#2c313a}}
"""


def write_sheet(
    case: Case,
    columns: Sequence[str],
    rows: Sequence[tuple[Any, ...]],
    folder: Path,
    *,
    force: bool = False,
) -> list[str]:
    """Write a thumbnail of each row and `INDEX`; answers with why rows have none.

    Raises:
        OutputExistsError: the folder holds something, and ``force`` is not set.
    """
    left_out: list[str] = []
    old = [p.name for p in folder.glob("*_*_*.jpg")] if folder.is_dir() else []
    items = []
    with whole_folder(folder, INDEX, force=force, stale=old) as part:
        for number, (row, crop) in enumerate(
            zip(rows, crops(case, columns, rows), strict=True), 1
        ):
            told = dict(zip(columns, row, strict=True))
            shown = ""
            if isinstance(crop, Crop):
                name = f"{number:03d}_{_plain(told['recording'])}_{told['track']}.jpg"
                (part / name).write_bytes(encode_jpeg(crop.image))
                alt = f"target {told['track']} of {told['recording']}"
                shown = f'<img src="{escape(name)}" alt="{escape(alt)}">'
            else:
                left_out.append(crop)
            items.append(f"<li>{shown}{_words(told)}</li>")
        (part / INDEX).write_text(
            "<!doctype html><html lang=en><head><meta charset=utf-8><title>Found</title>"
            f"<style>{_STYLE}</style></head><body><h1>Found: {len(rows)}</h1>"
            f"<ol>{''.join(items)}</ol></body></html>\n",
            encoding="utf-8",
        )
    return left_out


def _words(told: dict[str, Any]) -> str:
    colours = " over ".join(str(told[c] or "?") for c in ("upper_colour", "lower_colour"))
    return (
        f"<p><b>{escape(str(told['recording']))}: {told['track']}</b>, likeness"
        f" {told['likeness']:.2f}</p><p>{escape(colours)}; {told['first_t']:.1f} to"
        f" {told['last_t']:.1f} s</p><p><code>{escape(told['explain'])}</code></p>"
    )


def _plain(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-." else "-" for c in name)[:60]
