"""Evidence: a folder that stands alone: clip, frames, facts, configuration, digests, a page to
read and print.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from reasoning.encounters import EncounterParameters
from reasoning.questions import Case
from reasoning.questions.drawn import Drawn
from reasoning.questions.explain import Explanation, explain
from reasoning.questions.joins import joins_of
from reasoning.questions.recording_facts import file_digest
from recorders.annotated.reader import AnnotatedLog
from recorders.errors import SceneTraceError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.pictures import encode_png
from recorders.pieces import Span, cut
from replay.export.answer_clips import source_of
from replay.export.output import check_folder, whole_folder
from replay.export.shots import Camera, Shot, ShotFile
from replay.report.evidence_page import Shown, page
from replay.report.evidence_pdf import write_pdf
from replay.report.joins import join_picture
from replay.report.pictures import around, check_log, chosen_frames, drawn
from replay.sealing.manifest import read_manifest, seal, write_manifest

BEFORE_S = 1.0
CLIP_S = 2.0
MANIFEST = "manifest.json"
_LONGEST_NAME = 80
_MOST_JOINS = 8
"""So many joins of one explanation are shown, the latest."""
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


@dataclass(frozen=True)
class EvidenceOptions:
    """How evidence is collected.

    Attributes:
        camera: which, where the log has several.
        force: write into an older evidence folder.
        encounters: thresholds of encounters.
        drawn: zones and lines that references may name.
        start_ns: when the recording began, where it was made without a clock.
        zone: time zone of the clock.
        hide: everybody but the subjects is hidden, and no piece of the log is given.
        limits: what the log may ask for.
    """

    camera: str | None = None
    force: bool = False
    encounters: EncounterParameters | None = None
    drawn: Drawn | None = None
    start_ns: int | None = None
    zone: str = "UTC"
    hide: bool = False
    limits: Limits = DEFAULT_LIMITS


def write_evidence(
    path: str | Path,
    references: Sequence[str],
    folder: Path,
    options: EvidenceOptions | None = None,
) -> list[Explanation]:
    """Write the evidence of events and answer rows into a folder that appears whole.

    An older evidence folder (``force``) loses the files that its manifest lists; strangers' files
    stay.

    Raises:
        OutputExistsError: it holds something and ``force`` is not set.
        UsageError: a reference names nothing, or the folder is somebody else's.
        RecordingError: the log is damaged.
    """
    o = options or EvidenceOptions()
    check_folder(folder, MANIFEST, force=o.force)
    check_log(path)
    with (
        Case(
            [path],
            log_limits=o.limits,
            encounters=o.encounters,
            drawn=o.drawn,
            start_ns=o.start_ns,
        ) as case,
        AnnotatedLog(path, o.camera, o.limits) as log,
    ):
        names = case.rows("SELECT recording, camera FROM recordings")
        recording = next((n for n, c in names if c == log.camera), None)
        # Two frames of one interval name the same thing: it is told once.
        told = (explain(case, reference, recording, o.zone) for reference in references)
        found = list({event.reference: event for event in told}.values())
        facts = _facts(case, log, found, o)
        with whole_folder(folder, MANIFEST, force=o.force, stale=_sealed(folder)) as part:
            shown = _film(case, log, found, part, o)
            (part / "facts.json").write_text(_json(facts), encoding="utf-8")
            (part / "configuration.json").write_text(
                _json(facts["configuration"]), encoding="utf-8"
            )
            (part / "index.html").write_text(page(facts, shown), encoding="utf-8")
            write_pdf(part / "evidence.pdf", facts, shown, part)
            _sums(part)
            # The folder alone: the log's own digest stands in the facts, and the folder may
            # travel without it.
            manifest = part / MANIFEST
            write_manifest(
                seal([part], manifest, note=f"evidence from {log.path.name}"), manifest
            )
    return found


def _film(
    case: Case,
    log: AnnotatedLog,
    found: Sequence[Explanation],
    part: Path,
    o: EvidenceOptions,
) -> list[Shown]:
    """Clips, frames and pieces of all explanations, each picture decoded once."""
    times = {frame.index: frame.time_ns for frame in log.frames(("tracks",))}
    shots, stills = [], []
    wanted: dict[str, list[Path]] = {}
    for e in found:
        name = _safe(e.reference)
        place = part / name
        place.mkdir()
        subjects = frozenset(e.subjects)
        start, end = _span(log, e)
        shots += [
            Shot(place / "clip.mp4", start, end, subjects, True),
            Shot(place / "plain.mp4", start, end, subjects, False),
        ]
        wanted[e.reference] = []
        for index in _telling(e, times):
            still = place / f"{name}_frame_{index:06d}"
            wanted[e.reference].append(still)
            stills.append(ShotFile(still, times[index], subjects, True))
            if log.has_pictures:
                recorded = still.with_name(f"{still.name}_recorded")
                stills.append(ShotFile(recorded, times[index], subjects, False))
    placed = Camera(log, hide=o.hide, zone=o.zone).write(shots, stills)
    pieces = {} if o.hide else _pieces(log, found, part)
    shown = []
    for e in found:
        place = part / _safe(e.reference)
        joins = [] if o.hide else _join_pictures(case, log, e, place)
        pictures = [*(placed[still] for still in wanted[e.reference]), *joins]
        shown.append(
            Shown(
                e,
                [picture.relative_to(part).as_posix() for picture in pictures],
                f"{place.name}/clip.mp4",
                f"{place.name}/plain.mp4",
                pieces.get(e.reference, ""),
            )
        )
    return shown


def _telling(e: Explanation, times: Mapping[int, int]) -> list[int]:
    """Frames before, at the start, in the middle, at the end and after."""
    numbers = sorted(times)
    steps = max(1, round(BEFORE_S * _rate(list(times.values()))))
    return [n for n in around(e.start_frame, e.end_frame, steps, numbers[-1]) if n in times]


def _rate(times: Sequence[int]) -> float:
    """Frames per second, over the first frames."""
    some = times[:50]
    return (len(some) - 1) * 1e9 / (some[-1] - some[0]) if len(some) > 1 else 25.0


def _pieces(log: AnnotatedLog, found: Sequence[Explanation], part: Path) -> dict[str, str]:
    """Pieces of the log that stand alone, one for all explanations whose clips meet; by reference."""
    spans: list[tuple[int, int]] = []
    for start, end in sorted(_span(log, e) for e in found):
        if spans and start <= spans[-1][1]:
            spans[-1] = spans[-1][0], max(spans[-1][1], end)
        else:
            spans.append((start, end))
    out: dict[str, str] = {}
    for number, (start, end) in enumerate(spans, 1):
        name = f"log_{number:04d}.mcap"
        cut(log.path, part / name, Span(start, end), limits=log.limits)
        inside = (e for e in found if start <= _span(log, e)[0] < end)
        out.update((e.reference, name) for e in inside)
    return out


def _sealed(folder: Path) -> list[str]:
    """What an older manifest in the folder lists: its files go when their successors come."""
    try:
        return [entry.name for entry in read_manifest(folder / MANIFEST).files]
    except SceneTraceError:
        return []


def _frames(log: AnnotatedLog, explanation: Explanation, folder: Path) -> list[Path]:
    """Frames before, at the start, in the middle, at the end and after, with overlays."""
    times = {frame.index: frame.time_ns for frame in log.frames(("tracks",))}
    out = []
    for frame, image in drawn(log, chosen_frames(log, _telling(explanation, times))):
        out.append(folder / f"{_safe(explanation.reference)}_frame_{frame.index:06d}.png")
        out[-1].write_bytes(encode_png(image))
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


def _span(log: AnnotatedLog, explanation: Explanation) -> tuple[int, int]:
    """First log time and end of an event's clip."""
    start, end = (
        log.start_ns + round(track * 1e9)
        for track in (explanation.start_t - CLIP_S, explanation.end_t + CLIP_S)
    )
    return max(0, start), end


def _facts(
    case: Case, log: AnnotatedLog, found: Sequence[Explanation], o: EvidenceOptions
) -> dict[str, Any]:
    stated = dict(log.facts)
    configuration = json.loads(stated.pop("configuration", "{}") or "{}")
    row = case.sql("SELECT * FROM recordings")
    recordings = [dict(zip(row.columns, r, strict=True)) for r in row.rows]
    source, digest = source_of(log)
    return {
        "log": log.path.name,
        "log_sha256": file_digest(log.path),
        "recordings": recordings,
        "log_says": stated,
        "configuration": configuration,
        "source": {"name": source, "digest": digest},
        "others_hidden": o.hide,
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
