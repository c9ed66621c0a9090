"""A comparison as one HTML file that opens offline: the first differences as pictures side by
side, then all.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path

import numpy as np

from recorders.annotated.provenance import provenance_of
from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.pictures import Image, encode_jpeg
from recorders.scene import SceneLog
from recorders.vision import cv2
from replay.compare.difference import Comparison, Difference
from replay.compare.weight import weightiest
from replay.draw import DrawOptions, draw_frame
from replay.export.output import whole_file
from replay.export.video import frame_overlay
from replay.plurals import count_of

FRAMES = 12
_WIDTH = 960
_QUALITY = 72
_GROUND = 96
# What a picture shows; bytes and recordings are only listed.
_MOST = 10
_SEEN = ("frames", "track", "identity", "event", "relation", "group", "encounter")


@dataclass
class _Moment:
    """A frame with differences and its picture in both logs."""

    frame: int
    differences: list[Difference]
    pictures: list[str]


def write_page(
    found: Comparison,
    out: str | Path,
    *,
    scene: str | Path | None = None,
    force: bool = False,
    frames: int = FRAMES,
) -> None:
    """Write the page.

    Args:
        found: what `compare` gave; its files are read again.
        out: the HTML file.
        scene: a log with the pictures, where neither of the two has them; without any, the boxes
            stand on plain grey.
        force: overwrite.
        frames: how many frames are shown as pictures.

    Raises:
        OutputExistsError: ``out`` exists and ``force`` is not set.
        RecordingError: a log is damaged.
    """
    with whole_file(out, force=force) as file:
        moments = list(_moments(found, scene, frames))
        file.write(_page(found, moments).encode("utf-8"))


def _chosen(found: Comparison, frames: int) -> dict[int, list[Difference]]:
    """The first frames in which something is to be seen; what appears, vanishes or is someone
    else before values.
    """
    seen = [difference for difference in found.differences if difference.what in _SEEN]
    weighty = [d for d in seen if d.change != "changed" or d.what == "identity"] or seen
    first = sorted({d.frame for d in weighty})[:frames]
    return {frame: [d for d in seen if d.frame == frame] for frame in first}


def _moments(found: Comparison, scene: str | Path | None, frames: int) -> Iterator[_Moment]:
    chosen = _chosen(found, frames)
    with _log(found.a) as a, _log(found.b) as b:
        sides = [{frame.index: frame for frame in _frames(log, chosen)} for log in (a, b)]
        times = {k: side[k].time_ns for side in sides for k in side}
        backgrounds = _Backgrounds([a, b], None if scene is None else Path(scene))
        for k in sorted(chosen):
            if k not in times:
                continue
            image = backgrounds.at(times[k], k)
            pictures = [
                _picture(log, side.get(k), image)
                for log, side in zip((a, b), sides, strict=True)
            ]
            yield _Moment(k, chosen[k], pictures)


def _log(path: str) -> AnnotatedLog:
    from recorders.log import LogReader

    with LogReader(path) as log:
        camera = provenance_of(log).camera
    return AnnotatedLog(path, camera, as_it_is=True)


def _frames(
    log: AnnotatedLog, chosen: dict[int, list[Difference]]
) -> Iterator[AnnotatedFrame]:
    for frame in log.frames():
        if frame.index in chosen:
            yield frame
        if frame.index >= max(chosen, default=-1):
            return


class _Backgrounds:
    """The recorded pictures, from whichever log has them."""

    def __init__(self, logs: Sequence[AnnotatedLog], scene: Path | None) -> None:
        self._size = next(
            (size for size in (log.size() for log in logs) if size is not None), (640, 480)
        )
        camera = logs[0].camera
        with_pictures = next((log for log in logs if log.has_pictures), None)
        self._source = (scene, camera) if scene is not None else None
        if self._source is None and with_pictures is not None:
            self._source = (with_pictures.path, with_pictures.camera)

    def at(self, time_ns: int, index: int) -> Image:
        """The picture of a time; plain grey where there is none."""
        if self._source is not None:
            with SceneLog(*self._source) as scene:
                frame = next(scene.frames(time_ns, index), None)
                if (
                    frame is not None
                    and frame.time_ns == time_ns
                    and frame.image is not None
                ):
                    return frame.image
        return np.full((self._size[1], self._size[0], 3), _GROUND, np.uint8)


def _picture(log: AnnotatedLog, frame: AnnotatedFrame | None, image: Image) -> str:
    """A frame's drawing as a data URI; empty where the log has no such frame."""
    if frame is None:
        return ""
    # The events stand beside the picture as text.
    drawing = draw_frame(
        image, frame_overlay(log, replace(frame, events=[])), DrawOptions()
    )
    height, width = drawing.shape[:2]
    if width > _WIDTH:
        size = (_WIDTH, max(1, round(height * _WIDTH / width)))
        drawing = np.asarray(
            cv2.resize(drawing, size, interpolation=cv2.INTER_AREA), np.uint8
        )
    return "data:image/jpeg;base64," + b64encode(encode_jpeg(drawing, _QUALITY)).decode()


# -- the page
# ------------------------------------------------------------------------------------------------------

_STYLE = """
:root { --ground: #fbfbf9; --card: #fff; --ink: #1d2126; --soft: #626b75; --line: #dfe3e6;
  --appeared: #17734a; --vanished: #b3261e; --moved: #8a5a00; --changed: #2b59c3; color-scheme: light dark; }
@media (prefers-color-scheme: dark) { :root { --ground: #14171a; --card: #1d2125; --ink: #e8eaed; --soft: #9aa4ae;
  --line: #343a40; --appeared: #58c892; --vanished: #ff8a80; --moved: #f0b957; --changed: #8ab0ff; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1.5rem 1rem 4rem; max-width: 75rem; background: var(--ground); color: var(--ink);
  font: 16px/1.5 system-ui, sans-serif; overflow-wrap: anywhere; }
h1 { font-size: 1.5rem; line-height: 1.25; margin: 0 0 .5rem; }
h2 { font-size: 1.1rem; margin: 2rem 0 .75rem; }
h3 { font-size: 1rem; margin: 0 0 .5rem; }
p, ul { margin: .25rem 0 .75rem; }
ul { padding-left: 1.1rem; }
code { font: .85em ui-monospace, monospace; }
.soft { color: var(--soft); }
.counts { display: flex; flex-wrap: wrap; gap: .5rem; padding: 0; list-style: none; }
.counts li { background: var(--card); border: 1px solid var(--line); border-radius: 999px; padding: .1rem .7rem; }
.moment { background: var(--card); border: 1px solid var(--line); border-radius: .5rem; padding: 1rem;
  margin: 0 0 1rem; }
.sides { display: grid; grid-template-columns: 1fr 1fr; gap: .75rem; }
figure { margin: 0; min-width: 0; }
figure img { display: block; width: 100%; height: auto; border-radius: .25rem; }
figcaption { font-size: .85rem; color: var(--soft); margin-bottom: .25rem; }
.empty { border: 1px dashed var(--line); border-radius: .25rem; padding: 2rem 1rem; text-align: center; }
.appeared { color: var(--appeared); } .vanished { color: var(--vanished); }
.moved { color: var(--moved); } .changed { color: var(--changed); }
table { border-collapse: collapse; width: 100%; font-size: .9rem; }
th, td { text-align: left; vertical-align: top; padding: .3rem .6rem .3rem 0; border-bottom: 1px solid var(--line); }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
@media (max-width: 40rem) { .sides { grid-template-columns: 1fr; } .narrow { display: none; } }
"""


def _page(found: Comparison, moments: Sequence[_Moment]) -> str:
    a, b = Path(found.a).name, Path(found.b).name
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        (
            f"<title>{escape(a)} against"
            f" {escape(b)}</title><style>{_STYLE}</style></head><body>"
        ),
        "<h1>What differs in what happened</h1>",
        (
            f'<p class="soft">A: <code>{escape(found.a)}</code><br>B:'
            f" <code>{escape(found.b)}</code></p>"
        ),
        f"<p>{escape(_verdict(found))}</p>",
        '<ul class="counts">',
        *(
            f'<li class="{what.rsplit(" ", 1)[1]}">{count} {escape(what)}</li>'
            for what, count in found.counts().items()
        ),
        "</ul>",
    ]
    if found.made:
        parts += ["<h2>How B was made otherwise than A</h2><ul>"]
        parts += [*(f"<li>{escape(line)}</li>" for line in found.made), "</ul>"]
    most = weightiest(found.differences, _MOST)
    if len(found.differences) > len(most):
        parts.append(_table(f"The {len(most)} that matter most", most))
    if moments:
        first = "frame" if len(moments) == 1 else f"{len(moments)} frames"
        parts.append(f"<h2>The first {first} in which they differ</h2>")
        parts += [_moment(moment, a, b) for moment in moments]
    if found.differences:
        parts.append(_table("All differences", found.differences))
    return "\n".join([*parts, "</body></html>", ""])


def _verdict(found: Comparison) -> str:
    frames = count_of(found.frames, "frame")
    if found.identical:
        return f"Identical: {frames}."
    if found.equal:
        return (
            f"Equal in meaning over {frames}; track numbers or values within the tolerance"
            " differ."
        )
    return f"{count_of(len(found.differences), 'difference')} over {frames}."


def _moment(moment: _Moment, a: str, b: str) -> str:
    texts = "".join(
        f'<li><span class="{difference.change}">{difference.what} {difference.change}</span>'
        f": {escape(difference.text)}</li>"
        for difference in moment.differences
    )
    sides = "".join(
        f"<figure><figcaption>{side}: {escape(name)}</figcaption>"
        + (
            f'<img src="{picture}" alt="frame {moment.frame} of {side}" loading="lazy">'
            if picture
            else '<div class="empty soft">no such frame</div>'
        )
        + "</figure>"
        for side, name, picture in zip("AB", (a, b), moment.pictures, strict=True)
    )
    head = f"{moment.differences[0].t:.2f} s, frame {moment.frame}"
    return (
        f'<section class="moment"><h3>{head}</h3><ul>{texts}</ul><div'
        f' class="sides">{sides}</div></section>'
    )


def _table(title: str, differences: Sequence[Difference]) -> str:
    rows = "".join(
        f'<tr><td class="number">{difference.t:.2f}</td><td class="number narrow">{difference.frame}</td>'
        f'<td class="{difference.change}">{difference.what} {difference.change}</td>'
        f"<td>{escape(difference.text)}</td></tr>"
        for difference in differences
    )
    head = '<tr><th>s</th><th class="narrow">frame</th><th>what</th><th></th></tr>'
    return f"<h2>{title}</h2><table><thead>{head}</thead><tbody>{rows}</tbody></table>"
