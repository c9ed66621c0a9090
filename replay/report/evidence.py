"""Evidence: a folder that stands alone: clip, frames, facts, configuration, digests, a page to
read and print.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from reasoning.encounters import EncounterParameters
from reasoning.questions import Case
from reasoning.questions.explain import Explanation, explain
from reasoning.questions.ingest import file_digest
from reasoning.questions.joins import joins_of
from reasoning.questions.thresholds import measure_line
from recorders.annotated.reader import AnnotatedLog
from recorders.errors import SceneTraceError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.pictures import encode_png
from recorders.pieces import Span, cut
from replay.draw import DrawOptions
from replay.export.output import check_folder, whole_folder
from replay.export.video import VideoOptions, write_video
from replay.report.joins import join_picture
from replay.report.pictures import around, check_log, chosen_frames, drawn
from replay.sealing.manifest import read_manifest, seal, write_manifest

BEFORE_S = 1.0
CLIP_S = 3.0
MANIFEST = "manifest.json"
_LONGEST_NAME = 80
_MOST_JOINS = 8
"""So many joins of one explanation are shown, the latest."""
_JOIN_NAME = re.compile(r"_join_(\d+)_frame_\d+\.png$")
EXPLANATION = "explanation.json"


def write_explanations(
    path: str | Path,
    found: Sequence[Explanation],
    folder: Path,
    *,
    camera: str | None = None,
    force: bool = False,
) -> int:
    """Write explanation.txt, explanation.json and the frames of each explanation; returns the
    number of pictures.

    Raises:
        OutputExistsError: the folder holds an older one and ``force`` is not set.
        UsageError: it is a folder of somebody else's.
    """
    text = "\n\n".join("\n".join(event.lines()) for event in found) + "\n"
    with whole_folder(folder, EXPLANATION, force=force) as part:
        (part / "explanation.txt").write_text(text, encoding="utf-8")
        (part / EXPLANATION).write_text(
            _json([event.as_json() for event in found]), encoding="utf-8"
        )
        with AnnotatedLog(path, camera) as log, Case([path]) as case:
            return sum(
                len(_frames(log, event, part)) + len(_join_pictures(case, log, event, part))
                for event in found
            )


def write_evidence(
    path: str | Path,
    references: Sequence[str],
    folder: Path,
    *,
    camera: str | None = None,
    force: bool = False,
    encounters: EncounterParameters | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> list[Explanation]:
    """Write the evidence of events and answer rows into a folder that appears whole.

    An older evidence folder (``force``) loses the files that its manifest lists; strangers' files
    stay.

    Raises:
        OutputExistsError: it holds something and ``force`` is not set.
        UsageError: a reference names nothing, or the folder is somebody else's.
        RecordingError: the log is damaged.
    """
    check_folder(folder, MANIFEST, force=force)
    check_log(path)
    with (
        Case([path], log_limits=limits, encounters=encounters) as case,
        AnnotatedLog(path, camera, limits) as log,
    ):
        names = case.rows("SELECT recording, camera FROM recordings")
        recording = next((n for n, c in names if c == log.camera), None)
        # Two frames of one interval name the same thing: it is told once.
        found = list(
            {
                event.reference: event
                for event in (
                    explain(case, reference, recording) for reference in references
                )
            }.values()
        )
        facts = _facts(case, log, found)
        with whole_folder(folder, MANIFEST, force=force, stale=_sealed(folder)) as part:
            pages = []
            for e in found:
                place = part / _safe(e.reference)
                place.mkdir()
                pictures = _frames(log, e, place, bare=True)
                joins = _join_pictures(case, log, e, place)
                clip = _clip(log, e, place / "clip.mp4")
                cut(path, place / "log.mcap", Span(*_span(log, e)), limits=log.limits)
                pages.append(
                    (
                        e,
                        [p.relative_to(part).as_posix() for p in (*pictures, *joins)],
                        clip.relative_to(part).as_posix(),
                    )
                )
            (part / "facts.json").write_text(_json(facts), encoding="utf-8")
            (part / "configuration.json").write_text(
                _json(facts["configuration"]), encoding="utf-8"
            )
            (part / "index.html").write_text(_page(facts, pages), encoding="utf-8")
            _sums(part)
            # The folder alone: the log's own digest stands in the facts, and the folder may
            # travel without it.
            manifest = part / MANIFEST
            write_manifest(
                seal([part], manifest, note=f"evidence from {log.path.name}"), manifest
            )
    return found


def _sealed(folder: Path) -> list[str]:
    """What an older manifest in the folder lists: its files go when their successors come."""
    try:
        return [entry.name for entry in read_manifest(folder / MANIFEST).files]
    except SceneTraceError:
        return []


def _frames(
    log: AnnotatedLog, explanation: Explanation, folder: Path, *, bare: bool = False
) -> list[Path]:
    """Frames before, at the start, in the middle, at the end and after, with overlays; ``bare``:
    also as recorded.
    """
    steps = max(1, round(BEFORE_S * _rate(log)))
    wanted = around(explanation.start_frame, explanation.end_frame, steps, _last(log))
    frames = chosen_frames(log, wanted)
    out = []
    for frame, image in drawn(log, frames):
        out.append(folder / f"{_safe(explanation.reference)}_frame_{frame.index:06d}.png")
        out[-1].write_bytes(encode_png(image))
    for frame, image in drawn(log, frames, bare=True) if bare and log.has_pictures else ():
        (
            folder / f"{_safe(explanation.reference)}_frame_{frame.index:06d}_recorded.png"
        ).write_bytes(encode_png(image))
    return out


def _join_pictures(
    case: Case, log: AnnotatedLog, explanation: Explanation, folder: Path
) -> list[Path]:
    """The joins that its identities rest on, each as two sights side by side."""
    out = []
    for join in joins_of(
        case, explanation.recording, explanation.subjects, explanation.end_frame
    )[-_MOST_JOINS:]:
        image = join_picture(log, join)
        if image is not None:
            name = f"{_safe(explanation.reference)}_join_{join.track}_frame_{join.frame:06d}.png"
            out.append(folder / name)
            out[-1].write_bytes(encode_png(image))
    return out


def _rate(log: AnnotatedLog) -> float:
    """Frames per second, over the first frames."""
    times: list[int] = []
    for frame in log.frames(("tracks",)):
        times.append(frame.time_ns)
        if len(times) > 50:
            break
    return (
        (len(times) - 1) * 1e9 / (times[-1] - times[0])
        if len(times) > 1 and times[-1] > times[0]
        else 25.0
    )


def _last(log: AnnotatedLog) -> int:
    last = 0
    for frame in log.frames(("tracks",)):
        last = frame.index
    return last


def _clip(log: AnnotatedLog, explanation: Explanation, out: Path) -> Path:
    """An H.264 clip from some seconds before to some seconds after."""
    start, end = _span(log, explanation)
    options = VideoOptions(DrawOptions(), start, end)
    write_video(log, out, options)
    return out


def _span(log: AnnotatedLog, explanation: Explanation) -> tuple[int, int]:
    """First log time and end of an event's clip."""
    start, end = (
        log.start_ns + round(track * 1e9)
        for track in (explanation.start_t - CLIP_S, explanation.end_t + CLIP_S)
    )
    return max(0, start), end


def _facts(case: Case, log: AnnotatedLog, found: Sequence[Explanation]) -> dict[str, Any]:
    stated = dict(log.facts)
    configuration = json.loads(stated.pop("configuration", "{}") or "{}")
    row = case.sql("SELECT * FROM recordings")
    recordings = [dict(zip(row.columns, r, strict=True)) for r in row.rows]
    wall = {event.reference: [str(row) for row in case.rows(
        "SELECT wall_time(?, ?), wall_time(?, ?)", [event.recording, event.start_t, event.recording, event.end_t])[0]]
        for event in found}  # fmt: skip
    return {
        "log": log.path.name,
        "log_sha256": file_digest(log.path),
        "recordings": recordings,
        "log_says": stated,
        "configuration": configuration,
        "wall_time_utc": wall,
        "explanations": [event.as_json() for event in found],
    }


def _sums(folder: Path) -> None:
    """SHA256SUMS over every file, as `sha256sum -c` reads it."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    lines = [
        f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.relative_to(folder).as_posix()}"
        for file in files
    ]
    (folder / "SHA256SUMS").write_text("\n".join(lines) + "\n", encoding="ascii")


def _safe(reference: str) -> str:
    """A file's name for a reference; a zone's name may hold what a file's or a link cannot."""
    plain = reference.replace(":", "_").replace("@", "_at_")
    if "%" not in plain and len(plain) <= _LONGEST_NAME:
        return plain
    digest = hashlib.sha256(reference.encode()).hexdigest()[:8]
    return f"{plain.replace('%', '_')[:_LONGEST_NAME]}_{digest}"


def _json(value: Any) -> str:
    return json.dumps(value, indent=1, ensure_ascii=False, default=str) + "\n"


_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#16181d;background:#fff}
h2{margin-top:2.5rem;border-top:1px solid #c9ced6;padding-top:1rem}table{border-collapse:collapse;width:100%}
td,th{text-align:left;padding:.25rem .6rem;border-bottom:1px solid #dfe3e8;vertical-align:top}
table{table-layout:fixed}th{width:min(14rem,35%);font-weight:600}
td,th,h1,h2,li{overflow-wrap:anywhere}li{margin:.15rem 0}
img{max-width:100%;display:block;margin:.6rem 0 0}figure{margin:0 0 1rem;break-inside:avoid}video{max-width:100%}
figcaption,.small{color:#4b5563;font-size:.85rem}code{overflow-wrap:anywhere}
@media(prefers-color-scheme:dark){body{color:#e3e6eb;background:#16181d}h2{border-color:#3a404a}td,th{border-color:#2c313a}
figcaption,.small{color:#a3abb8}a{color:#8ab4f8}}
@media print{body{color:#000;background:#fff}video{display:none}body{margin:0;max-width:none}h2{break-before:page}}
"""


_FIRST = ("tracker", "scene", "input_digest", "output_digest")
_FOR_MACHINES = ("checkpoints", "extras", "fact_digests")
"""Lists of digests, which nobody reads: they stand in facts.json."""
_YEAR_NS = 365 * 86_400 * 10**9


def _page(
    facts: Mapping[str, Any], pages: Sequence[tuple[Explanation, list[str], str]]
) -> str:
    """The page: every value escaped, no script, nothing from elsewhere."""
    said = facts["log_says"]
    known = [(name.replace("_", " "), said[name]) for name in _FIRST if said.get(name)]
    out = [
        "<!doctype html><html lang=en><head><meta charset=utf-8>",
        '<meta name=viewport content="width=device-width,initial-scale=1">',
        (
            "<title>Evidence from"
            f" {escape(str(facts['log']))}</title><style>{_STYLE}</style></head><body>"
        ),
        f"<h1>Evidence from {escape(str(facts['log']))}</h1>",
        _table([("SHA-256 of the log", facts["log_sha256"]), *known]),
    ]
    for e, pictures, clip in pages:
        out += _section(facts, e, pictures, clip)
    rest = [
        (name.replace("_", " "), value)
        for name, value in said.items()
        if name not in _FIRST + _FOR_MACHINES
    ]
    out.append(f"<h2>What the log says of how it was made</h2>{_table(rest)}")
    out.append(
        "<p class=small>All of it for machines: facts.json, configuration.json. To see that"
        " nothing was changed: <code>scenetrace verify --manifest manifest.json</code>, or"
        " <code>sha256sum -c SHA256SUMS</code></p>"
    )
    return "\n".join([*out, "</body></html>\n"])


def _section(
    facts: Mapping[str, Any], explanation: Explanation, pictures: Sequence[str], clip: str
) -> Iterator[str]:
    """One event or row: when, by which rule, what was measured, what led there, clip and frames."""
    moment = explanation.start_frame == explanation.end_frame
    when = (
        f"{explanation.start_t:.3f} s"
        if moment
        else f"{explanation.start_t:.3f} s to {explanation.end_t:.3f} s"
    )
    frames = (
        f"frame {explanation.start_frame}"
        if moment
        else f"frames {explanation.start_frame} to {explanation.end_frame}"
    )
    rows: list[tuple[str, Any]] = [
        ("When", f"{when} from the start, {frames}"), ("Wall time", _wall(facts, explanation)),
        ("Rule", explanation.rule),
        ("Targets", ", ".join(map(str, explanation.subjects))),
    ]  # fmt: skip
    yield (
        f"<h2>{escape(explanation.reference)}:"
        f" {escape(explanation.kind)}</h2><p>{escape(explanation.text)}</p>{_table(rows)}"
    )
    if explanation.measures:
        yield "<h3>Measured</h3>" + _table(
            [_measured(measure_line(measure)) for measure in explanation.measures]
        )
    if explanation.chain:
        yield (
            "<h3>What led there</h3><ul>"
            + "".join(f"<li>{escape(line)}</li>" for line in explanation.chain)
            + "</ul>"
        )
    for title, lines in (
        ("Rests on joins", explanation.joins),
        ("Corrected by hand", explanation.corrected),
    ):
        if lines:
            listed = "".join(f"<li>{escape(line)}</li>" for line in lines)
            yield f"<h3>{title}</h3><ul>{listed}</ul>"
    yield (
        "<h3>Clip and frames</h3><video controls preload=metadata"
        f' src="{escape(clip)}"></video>'
    )
    for picture in pictures:
        alt, caption = _caption(picture)
        yield (
            f'<figure><img src="{escape(picture)}" alt="{escape(alt)}"><figcaption>'
            f"{escape(caption)}</figcaption></figure>"
        )


def _caption(picture: str) -> tuple[str, str]:
    """What a picture shows, by its file's name."""
    number = int(picture.rsplit("_", 1)[1].removesuffix(".png"))
    join = _JOIN_NAME.search(picture)
    if join is not None:
        said = f"target {join[1]} before the join at frame {number} and after it"
        return said, f"{said}: is it one and the same?"
    return (
        f"frame {number} with overlays",
        f"frame {number}, drawn by scenetrace over the recorded picture",
    )


def _wall(facts: Mapping[str, Any], explanation: Explanation) -> str:
    start = next(
        (
            fact["start_ns"]
            for fact in facts["recordings"]
            if fact["recording"] == explanation.recording
        ),
        0,
    )
    if start < _YEAR_NS:
        return (
            "unknown: the recording was made without a clock (record --start gives it one)"
        )
    return (
        " to ".join(dict.fromkeys(facts["wall_time_utc"][explanation.reference])) + " UTC"
    )


def _measured(line: str) -> tuple[str, str]:
    name, _, rest = line.partition(" = ")
    return name, rest


def _table(rows: Sequence[tuple[str, Any]]) -> str:
    cells = "".join(
        f"<tr><th>{escape(str(k))}</th><td>{escape(str(v))}</td></tr>" for k, v in rows
    )
    return f"<table>{cells}</table>"
