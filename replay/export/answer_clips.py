"""A clip of each row of an answer: its subjects marked, some seconds around, and the same plain."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from reasoning.questions import Case
from reasoning.questions.explain import explain
from reasoning.questions.recording_facts import file_digest
from recorders.annotated.reader import AnnotatedLog
from recorders.channels import NANOS
from recorders.errors import SceneTraceError, UsageError
from recorders.told_times import clock_text
from replay.export.output import check_folder, whole_folder
from replay.export.shots import Camera, Shot

AROUND_S = 2.0
LONGEST_S = 600.0
INDEX = "clips.csv"
SPANS = (
    ("start_t", "end_t"), ("from_t", "until_t"), ("since_t", "until_t"), ("entered_t", "last_seen_t"),
    ("track_left_t", "other_left_t"), ("t", "t"), ("reached_t", "reached_t"),
)  # fmt: skip
"""Columns that say when a row was: the first pair that an answer has."""
SUBJECTS = (
    "track", "other", "a", "b", "follower", "object", "who", "subject", "targets", "subjects", "members",
)  # fmt: skip
"""Columns that name targets: numbers or lists of them."""
_COLUMNS = ("clip", "plain", "recording", "start_t", "end_t", "start_clock", "end_clock", "subjects",
            "explain", "source", "source_sha256", "log", "log_sha256")  # fmt: skip


@dataclass(frozen=True)
class ClipScene:
    """What a clip is to show.

    Attributes:
        recording: of which recording.
        start_t, end_t: seconds from its start.
        subjects: who is marked.
        explain: the row's reference.
    """

    recording: str
    start_t: float
    end_t: float
    subjects: tuple[int, ...]
    explain: str


def scenes_of(
    case: Case, columns: Sequence[str], rows: Sequence[Sequence[Any]]
) -> list[ClipScene]:
    """What the rows of an answer show, each scene once, in their order.

    A row that names no target itself, as one of `count`, shows what its references name.

    Raises:
        UsageError: the answer does not say when its rows were, or in which recording.
    """
    names = list(columns)
    span = next(((a, b) for a, b in SPANS if a in names and b in names), None)
    known = [c for c in SUBJECTS if c in names]
    if "recording" not in names or (span is None and "explain" not in names):
        raise UsageError(
            "--clips: these rows do not say when they were; they need the columns recording"
            " and start_t, end_t (or t, or explain)"
        )
    found: list[ClipScene] = []
    for row in rows:
        told = dict(zip(names, row, strict=True))
        if span is not None and known:
            times = [told[c] for c in span if told[c] is not None]
            if times:
                found.append(_scene(told, times, known))
        else:
            found += _explained(case, told)
    return list(dict.fromkeys(found))


def _scene(
    told: Mapping[str, Any], times: Sequence[float], known: Sequence[str]
) -> ClipScene:
    subjects: list[int] = []
    for column in known:
        value = told[column]
        some = value if isinstance(value, list) else [value]
        subjects += [v for v in some if isinstance(v, int) and v not in subjects]
    return ClipScene(
        told["recording"],
        min(times),
        max(times),
        tuple(subjects),
        str(told.get("explain") or ""),
    )


def _explained(case: Case, told: Mapping[str, Any]) -> list[ClipScene]:
    out = []
    for reference in str(told.get("explain") or "").split():
        e = explain(case, reference, told["recording"])
        out.append(ClipScene(e.recording, e.start_t, e.end_t, tuple(e.subjects), reference))
    return out


def write_answer_clips(
    case: Case,
    scenes: Sequence[ClipScene],
    out: Path,
    *,
    hide: bool = False,
    zone: str = "UTC",
    force: bool = False,
    progress: Callable[[str, int], None] | None = None,
) -> list[str]:
    """Write ``0001_marked.mp4``, ``0001_plain.mp4`` and so on, and `INDEX`, which says what each
    shows and of which file; answers with what was left out, and why.

    Args:
        case: where the answer is from.
        scenes: as `scenes_of` gives them.
        out: the folder.
        hide: everybody but the subjects is hidden in both.
        zone: time zone of the clock.
        force: write into an older folder of its own.
        progress: called with a stage and the number of frames done.

    Raises:
        OutputExistsError: the folder holds something, and ``force`` is not set.
        SceneTraceError: no log of the recordings is to be found.
    """
    check_folder(out, INDEX, force=force)
    old = [p.name for p in out.glob("*_marked.mp4")] + [
        p.name for p in out.glob("*_plain.mp4")
    ]
    places = {
        name: (Path(path), camera, start_ns)
        for name, path, camera, start_ns in case.rows(
            "SELECT recording, path, camera, start_ns FROM recordings"
        )
    }
    left_out: list[str] = []
    rows: dict[int, list[Any]] = {}
    with whole_folder(out, INDEX, force=force, stale=old) as folder:
        for recording in dict.fromkeys(s.recording for s in scenes):
            mine = [(n, s) for n, s in enumerate(scenes, 1) if s.recording == recording]
            path, camera, start_ns = places[recording]
            try:
                with AnnotatedLog(path, camera) as log:
                    found = _write(log, mine, folder, left_out, (hide, zone), progress)
            except (SceneTraceError, OSError) as error:
                if len(places) == 1:
                    raise
                left_out.append(f"{recording}: {error}")
                continue
            clock = start_ns if start_ns else 0
            for n, row in found.items():
                rows[n] = _with_clock(row, clock, zone)
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerows([_COLUMNS, *(rows[n] for n in sorted(rows))])
        (folder / INDEX).write_text(text.getvalue(), encoding="utf-8")
    return left_out


def _write(
    log: AnnotatedLog,
    scenes: Sequence[tuple[int, ClipScene]],
    folder: Path,
    left_out: list[str],
    how: tuple[bool, str],
    progress: Callable[[str, int], None] | None,
) -> dict[int, list[Any]]:
    hide, zone = how
    shots = []
    rows = {}
    log_facts = (log.path.name, file_digest(log.path))
    source, digest = source_of(log)
    for n, s in scenes:
        end_t = min(s.end_t, s.start_t + LONGEST_S)
        if end_t < s.end_t:
            left_out.append(f"clip {n}: what comes after {LONGEST_S:g} s ({s.explain})")
        start, end = (
            log.start_ns + round(t * NANOS)
            for t in (s.start_t - AROUND_S, end_t + AROUND_S)
        )
        names = f"{n:04d}_marked.mp4", f"{n:04d}_plain.mp4"
        shots += [
            Shot(folder / name, max(0, start), end + 1, frozenset(s.subjects), marked)
            for name, marked in zip(names, (True, False), strict=True)
        ]
        rows[n] = [
            *names, s.recording, round(s.start_t, 3), round(end_t, 3),
            " ".join(map(str, s.subjects)), s.explain, source, digest, *log_facts,
        ]  # fmt: skip
    Camera(log, hide=hide, zone=zone).write(shots, progress=progress)
    return rows


def _with_clock(row: list[Any], start_ns: int, zone: str) -> list[Any]:
    clocks = [
        clock_text(start_ns + round(t * NANOS), zone) if start_ns else "" for t in row[3:5]
    ]
    return [*row[:5], *clocks, *row[5:]]


def source_of(log: AnnotatedLog) -> tuple[str, str]:
    """Name and digest of the file that was recorded, as the log says; empty where it does not."""
    for facts in log.recorded_facts():
        if facts.get("camera", log.camera) == log.camera and facts.get("source_digest"):
            return facts.get("source", ""), facts["source_digest"]
    return "", ""
