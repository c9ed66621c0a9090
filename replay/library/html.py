"""What a notebook shows of logs, frames and answers: HTML without scripts, all text of files
escaped.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from recorders.pictures import encode_jpeg
from replay.draw import Overlay, draw_frame

if TYPE_CHECKING:
    from replay.library.opened import OpenLog, SceneFrame

MOST_ROWS = 20
_MOST_TRACKS = 30
_WIDTH, _BAR, _SIDE = 640, 14, 60
_QUALITY = 85
_TABLE = 'style="border-collapse:collapse;font-size:90%"'
_CELL = 'style="padding:1px 8px;text-align:left;vertical-align:top"'


def table(columns: Sequence[str], rows: Sequence[Sequence[Any]], total: int) -> str:
    """Rows as a table; what is not shown is counted."""
    head = "".join(f"<th {_CELL}>{escape(name)}</th>" for name in columns)
    lines = "".join(
        "<tr>"
        + "".join(f"<td {_CELL}>{escape(_text(value))}</td>" for value in row)
        + "</tr>"
        for row in rows
    )
    more = f"<p>{len(rows)} of {total} rows</p>" if total > len(rows) else ""
    return f"<table {_TABLE}><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>{more}"


def _text(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def frame_html(shown: SceneFrame) -> str:
    """A frame: its picture with what was found drawn in, and its events."""
    title = f"<p>{escape(shown.path.name)}, frame {shown.index}, {shown.t:.2f} s</p>"
    picture = shown.picture
    if picture is None:
        return title + ("" if not shown.annotated else _boxes(shown))
    if shown.annotated:
        overlay = Overlay(
            shown.tracks, shown.relations, shown.groups, (), shown.regions, shown.membership
        )
        picture = draw_frame(picture, overlay)
    data = base64.b64encode(encode_jpeg(picture, _QUALITY)).decode()
    events = shown.events if shown.annotated else []
    happened = "".join(f"<li>{escape(event.text)}</li>" for event in events)
    return (
        f'{title}<img alt="frame {shown.index}" style="max-width:100%"'
        f' src="data:image/jpeg;base64,{data}"/>'
        + (f"<ul>{happened}</ul>" if happened else "")
    )


def _boxes(shown: SceneFrame) -> str:
    rows = [(t.id, *(round(v, 1) for v in t.box), t.label or "") for t in shown.present]
    return table(["track", "x", "y", "w", "h", "label"], rows, len(rows))


def log_html(opened: OpenLog) -> str:
    """A log: what it is, and of an annotated one who was there when."""
    size = opened.size
    seconds = opened[-1].t if len(opened) else 0.0
    said = [
        f"<b>{escape(opened.path.name)}</b>",
        f"{len(opened)} frames",
        f"{seconds:.1f} s",
        f"{size[0]}x{size[1]}" if size else "",
        f"annotated by {escape(opened.tracker)}" if opened.annotated else "a scene log",
    ]
    head = f"<p>{', '.join(filter(None, said))}</p>"
    if not opened.annotated:
        return head
    stays = opened.sql("SELECT track, start_t, end_t FROM presence ORDER BY track, start_t")
    return head + _timeline([(int(r[0]), float(r[1]), float(r[2])) for r in stays], seconds)


def _timeline(stays: Sequence[tuple[int, float, float]], seconds: float) -> str:
    """A bar for each stay, a row for each track."""
    tracks = list(dict.fromkeys(track for track, _, _ in stays))
    shown = {track: k for k, track in enumerate(tracks[:_MOST_TRACKS])}
    scale = (_WIDTH - _SIDE) / max(seconds, 1e-9)
    parts = [
        f'<text x="0" y="{_BAR * k + _BAR - 3}" font-size="11" fill="currentColor">{track}</text>'
        for track, k in shown.items()
    ]
    parts += [
        f'<rect x="{_SIDE + start * scale:.1f}" y="{_BAR * shown[track] + 2}"'
        f' width="{max(1.0, (end - start) * scale):.1f}" height="{_BAR - 4}" fill="#4878a8">'
        f"<title>{track}: {start:.2f} to {end:.2f} s</title></rect>"
        for track, start, end in stays
        if track in shown
    ]
    more = len(tracks) - len(shown)
    rest = f"<p>and {more} tracks more</p>" if more > 0 else ""
    height = _BAR * max(1, len(shown))
    return (
        f'<svg width="{_WIDTH}" height="{height}" role="img" aria-label="who was there when">'
        f"{''.join(parts)}</svg>{rest}"
    )
