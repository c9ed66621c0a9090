"""The page of an evidence folder: to read in a browser and to print."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from reasoning.questions.explain import Explanation
from reasoning.questions.thresholds import measure_line

_JOIN_NAME = re.compile(r"_join_(\d+)_frame_\d+\.png$")


@dataclass(frozen=True)
class Shown:
    """What the folder holds of one explanation; names are relative to the folder.

    Attributes:
        explanation: why.
        pictures: of frames and joins, marked.
        clip, plain: the clip with its subjects marked, and the same as recorded.
        piece: the piece of the log, empty without.
    """

    explanation: Explanation
    pictures: list[str]
    clip: str
    plain: str
    piece: str


_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#16181d;background:#fff}
h2{margin-top:2.5rem;border-top:1px solid #c9ced6;padding-top:1rem}table{border-collapse:collapse;width:100%}
td,th{text-align:left;padding:.25rem .6rem;border-bottom:1px solid #dfe3e8;vertical-align:top}
table{table-layout:fixed}th{width:min(14rem,35%);font-weight:600}
td,th,h1,h2,li{overflow-wrap:anywhere}li{margin:.15rem 0}
img{max-width:100%;display:block;margin:.6rem 0 0}figure{margin:0 0 1rem;break-inside:avoid}video{max-width:100%}
.frames{display:grid;grid-template-columns:repeat(auto-fill,minmax(18rem,1fr));gap:0 1rem}
figcaption,.small{color:#4b5563;font-size:.85rem}code{overflow-wrap:anywhere}
@media(prefers-color-scheme:dark){body{color:#e3e6eb;background:#16181d}h2{border-color:#3a404a}td,th{border-color:#2c313a}
figcaption,.small{color:#a3abb8}a{color:#8ab4f8}}
@media print{body{color:#000;background:#fff}video{display:none}body{margin:0;max-width:none}h2,h3{break-after:avoid}
tr,li{break-inside:avoid}.frames{grid-template-columns:1fr 1fr}}
"""


_FIRST = ("tracker", "scene", "input_digest", "output_digest")
_FOR_MACHINES = ("checkpoints", "extras", "fact_digests", "corrections")
"""Lists of digests, which nobody reads: they stand in facts.json."""


def page(facts: Mapping[str, Any], shown: Sequence[Shown]) -> str:
    """The page: every value escaped, no script, nothing from elsewhere."""
    out = [
        "<!doctype html><html lang=en><head><meta charset=utf-8>",
        '<meta name=viewport content="width=device-width,initial-scale=1">',
        (
            "<title>Evidence from"
            f" {escape(str(facts['log']))}</title><style>{_STYLE}</style></head><body>"
        ),
        f"<h1>Evidence from {escape(str(facts['log']))}</h1>",
        _table(origin_rows(facts)),
    ]
    for one in shown:
        out += _section(one)
    out.append(f"<h2>What the log says of how it was made</h2>{_table(made_rows(facts))}")
    out.append(
        "<p class=small>The same on paper: evidence.pdf. All of it for machines: facts.json,"
        " configuration.json. To see that nothing was changed: <code>scenetrace verify"
        " --manifest manifest.json</code>, or <code>sha256sum -c SHA256SUMS</code></p>"
    )
    return "\n".join([*out, "</body></html>\n"])


def origin_rows(facts: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """What the evidence is of: digests of the log and of the file that was recorded."""
    said, source = facts["log_says"], facts["source"]
    rows = [("SHA-256 of the log", facts["log_sha256"])]
    if source["name"]:
        rows += [("recorded from", source["name"]), ("its digest", source["digest"])]
    if facts["others_hidden"]:
        rows.append(
            (
                "others",
                "everybody but the targets is hidden in clips and pictures; the log is not",
            )
        )
    return rows + [
        (name.replace("_", " "), said[name]) for name in _FIRST if said.get(name)
    ]


def made_rows(facts: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """What the log says of how it was made, without what `origin_rows` has."""
    return [
        (name.replace("_", " "), value)
        for name, value in facts["log_says"].items()
        if name not in _FIRST + _FOR_MACHINES
    ]


def told_rows(e: Explanation) -> list[tuple[str, Any]]:
    """When, by which rule, of whom."""
    moment = e.start_frame == e.end_frame
    when = f"{e.start_t:.3f} s" if moment else f"{e.start_t:.3f} s to {e.end_t:.3f} s"
    frames = (
        f"frame {e.start_frame}" if moment else f"frames {e.start_frame} to {e.end_frame}"
    )
    unknown = (
        "unknown: the recording was made without a clock (record --start gives it one)"
    )
    return [
        ("When", f"{when} from the start, {frames}"),
        ("Wall time", " to ".join(dict.fromkeys(e.clock)) or unknown),
        ("Rule", e.rule),
        ("Targets", ", ".join(map(str, e.subjects))),
    ]


def listed(e: Explanation) -> list[tuple[str, list[str]]]:
    """What led there and what it rests on, each with a title; nothing that is empty."""
    found = (
        ("What led there", e.chain),
        ("Rests on joins", e.joins),
        ("Corrected by hand", e.corrected),
    )
    return [(title, list(lines)) for title, lines in found if lines]


def measured_rows(e: Explanation) -> list[tuple[str, str]]:
    """The measured values beside their limits."""
    lines = (measure_line(measure).partition(" = ") for measure in e.measures)
    return [(name, rest) for name, _, rest in lines]


def _section(shown: Shown) -> Iterator[str]:
    """One event or row: when, by which rule, what was measured, what led there, clip and frames."""
    e = shown.explanation
    yield (
        f"<h2>{escape(e.reference)}: {escape(e.kind)}</h2><p>{escape(e.text)}</p>"
        f"{_table(told_rows(e))}"
    )
    if e.measures:
        yield "<h3>Measured</h3>" + _table(measured_rows(e))
    for title, lines in listed(e):
        items = "".join(f"<li>{escape(line)}</li>" for line in lines)
        yield f"<h3>{title}</h3><ul>{items}</ul>"
    files = [
        (shown.clip, "clip, targets marked"),
        (shown.plain, "plain"),
        (shown.piece, "piece of the log"),
    ]
    links = ", ".join(f'<a href="{escape(f)}">{what}</a>' for f, what in files if f)
    yield (
        f"<h3>Clip and frames</h3><p>{links}</p><video controls preload=metadata"
        f' src="{escape(shown.clip)}"></video><div class=frames>'
    )
    for picture in shown.pictures:
        alt, caption = caption_of(picture)
        yield (
            f'<figure><img src="{escape(picture)}" alt="{escape(alt)}"><figcaption>'
            f"{escape(caption)}</figcaption></figure>"
        )
    yield "</div>"


def caption_of(picture: str) -> tuple[str, str]:
    """What a picture shows, by its file's name."""
    number = int(Path(picture).stem.rsplit("_", 1)[1])
    join = _JOIN_NAME.search(picture)
    if join is not None:
        said = f"target {join[1]} before the join at frame {number} and after it"
        return said, f"{said}: is it one and the same?"
    return (
        f"frame {number}, targets marked",
        f"frame {number}, marked by scenetrace in the recorded picture",
    )


def _table(rows: Sequence[tuple[str, Any]]) -> str:
    cells = "".join(
        f"<tr><th>{escape(str(k))}</th><td>{escape(str(v))}</td></tr>" for k, v in rows
    )
    return f"<table>{cells}</table>"
