"""What the report shows, as plain data: figures, paths, intervals, the graph at sampled frames,
events, thumbnails.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from reasoning.questions import Case
from reasoning.questions.literals import literal
from recorders.annotated.provenance import CORRECTIONS
from recorders.annotated.reader import AnnotatedLog
from recorders.corrections import parse_corrections
from recorders.messages import EVENT_LEVELS
from recorders.quality import QualityMeasure
from recorders.segmentation.quality import worst
from replay.palette import track_css
from replay.report.small_pictures import SmallPictures

_INTERVALS = {  # table: its columns, its order; the interval's ends are start_t and end_t
    "relations": (
        "a, b, state, start_frame, end_frame, start_t, end_t",
        "start_frame, a, b",
    ),
    "groups": (
        "group_id, members, start_frame, end_frame, start_t, end_t, ended_by",
        "start_frame, group_id",
    ),
    "encounters": (
        "a, b, kind, start_frame, end_frame, start_t, end_t, confidence",
        "start_frame, a, b",
    ),
    "presence": ("track, start_frame, end_frame, start_t, end_t", "track, start_frame"),
}
_CORRECTION = "correction, kind, tracks, frame, t, text, made_by, why, date, undone"
_NODE = (
    "track, round(x, 1), round(y, 1), round(w, 1), round(h, 1),"
    " CAST(present AND mode <> 'predicted' AS INTEGER)"
)
_YEAR_NS = 365 * 86_400 * 10**9
_AT_ONCE = """SELECT coalesce(max(n), 0) FROM (
    SELECT count(*) AS n FROM tracks WHERE recording = $name GROUP BY frame)"""


@dataclass(frozen=True)
class ReportOptions:
    """How much goes into one page.

    Attributes:
        thumbnails: most frames shown as pictures; 0: none.
        thumbnail_width: their width in pixels.
        picture_bytes: what all of them together may take, as they are in the page.
        steps: most further frames whose boxes and edges are in the page.
        points: most points of one trajectory.
        all_points: most points of all trajectories together.
        tracks: most trajectories; those of the longest lives.
        intervals: most intervals of each sort on the timeline, the longest; the page says so if
            there were more.
        events: most events in the table; the page says so if there were more.
        quality: JPEG quality of the pictures.
        ground_frames: frames whose median is the ground that paths are drawn on.
    """

    thumbnails: int = 900
    thumbnail_width: int = 400
    picture_bytes: int = 10_000_000
    steps: int = 300
    points: int = 300
    all_points: int = 60_000
    tracks: int = 2_000
    intervals: int = 4_000
    events: int = 5_000
    quality: int = 45
    ground_frames: int = 15


def collect(case: Case, log: AnnotatedLog, options: ReportOptions) -> dict[str, Any]:
    """Everything that the page draws, as JSON-ready data."""
    facts = _only(case, f"SELECT * FROM recordings WHERE camera = {literal(log.camera)}")  # noqa: S608
    name = literal(facts["recording"])
    quality = _quality(case, name)
    found = worst(quality)
    size = log.size() or (facts["width"], facts["height"])
    frames = case.rows(
        f"SELECT frame, t FROM frames WHERE recording = {name} ORDER BY frame"  # noqa: S608
    )
    # Of a span the page tells the span alone, by the recording's own times.
    facts["begins"] = frames[0][1] if frames else 0.0
    events = case.rows(
        f"SELECT event, kind, frame, t, subjects, text, rule FROM events WHERE recording = {name} ORDER BY event"  # noqa: S608
    )
    data: dict[str, Any] = {
        "recording": facts["recording"],
        "facts": [*_facts(facts, log), *_told(quality)],
        "warning": "" if found is None else found.verdict,
        "figures": _figures(case, name, facts),
        "size": list(size),
        "begins": facts["begins"],
        "seconds": facts["seconds"],
        "tracks": _tracks(case, name, options),
        **{table: _intervals(case, name, table, options) for table in _INTERVALS},
        "events": [list(event) for event in events[: options.events]],
        "events_left_out": max(0, len(events) - options.events),
        "in_all": {
            t: case.rows(f"SELECT count(*) FROM {t} WHERE recording = {name}")[0][0]  # noqa: S608
            for t in _INTERVALS
        },
        "times": [[f, round(t, 3)] for f, t in _sampled(frames, options.steps)],
        "quiet": sorted(kind for kind, level in EVENT_LEVELS.items() if level == "DEBUG"),
        "corrections": _corrections(case, name),
        "labels": [
            list(row)
            for row in case.rows(
                f"SELECT track, label FROM targets WHERE recording = {name} AND label IS NOT"  # noqa: S608
                " NULL ORDER BY track"
            )
        ],
        "begin_frame": frames[0][0] if frames else 0,
        "end_frame": frames[-1][0] if frames else 0,
        "start_ms": facts["start_ns"] // 10**6 if facts["start_ns"] > _YEAR_NS else None,
        "zone_minutes": 0,
        "case": {},
        "notes": [],
        "server": {},
        "thumbnails": [],
    }
    numbers = [f for f, _ in frames]
    small = SmallPictures(log, numbers, options.thumbnail_width, options.quality)
    sample = small.sample(options.ground_frames)
    data["ground"] = small.median(sample)
    happened = [e[2] for e in events if e[1] not in data["quiet"]]
    if sample and options.thumbnails:
        # As many as there is room for, by what a few of them take.
        each = sum(len(small.encoded(image)) for image in sample) / len(sample)
        most = max(2, min(options.thumbnails, int(options.picture_bytes / each)))
        data["thumbnails"] = small.of(_thumbnail_frames(numbers, happened, data, most))
    shown = sorted(
        {*_spread(numbers, options.steps), *(frame for frame, _ in data["thumbnails"])}
    )
    data["steps"] = steps(case, name, shown, dict(frames))
    return data


def _corrections(case: Case, name: str) -> list[list[Any]]:
    """What people corrected, by whom and why."""
    rows = case.rows(
        f"SELECT {_CORRECTION} FROM corrections WHERE recording = {name} ORDER BY correction"  # noqa: S608
    )
    return [list(row) for row in rows]


def _only(case: Case, query: str) -> dict[str, Any]:
    answer = case.sql(query)
    return dict(zip(answer.columns, next(answer.rows), strict=True))


def _intervals(
    case: Case, name: str, table: str, options: ReportOptions
) -> list[list[Any]]:
    """The longest intervals of a table, in order."""
    columns, order = _INTERVALS[table]
    rows = case.rows(
        f"SELECT {columns} FROM (SELECT * FROM {table} WHERE recording = {name} "  # noqa: S608
        f"ORDER BY end_frame - start_frame DESC, {order} LIMIT {options.intervals}) ORDER"
        f" BY {order}"
    )
    return [list(row) for row in rows]


def _sampled(frames: Sequence[tuple[int, float]], most: int) -> list[tuple[int, float]]:
    return [frames[k] for k in _spread(range(len(frames)), most)]


def _facts(facts: dict[str, Any], log: AnnotatedLog) -> list[list[str]]:
    said = log.facts
    began = ""
    if facts["start_ns"] > _YEAR_NS:  # a recording without a clock begins at 0
        first_ns = facts["start_ns"] + round(facts["begins"] * 1e9)
        began = datetime.fromtimestamp(first_ns // 10**9, UTC).strftime(
            "%Y-%m-%d %H:%M:%S UTC"
        )
    rows = [
        ["Began", began], ["File", log.path.name], ["Camera", log.camera], ["Tracker", log.tracker or "not said"],
        ["SHA-256 of the file", facts["digest"]], ["Output digest", said.get("output_digest", "")],
        ["Input digest", said.get("input_digest", "")],
    ]  # fmt: skip
    text = said.get(CORRECTIONS)
    if text is not None:
        rows.append(["Corrections", parse_corrections(text, log.path).summary()])
    return [row for row in rows if row[1]]


def _quality(case: Case, name: str) -> list[QualityMeasure]:
    query = (
        f"SELECT name, value, verdict FROM quality WHERE recording = {name} ORDER BY name"  # noqa: S608
    )
    return [QualityMeasure(*row) for row in case.rows(query)]


def _told(quality: Sequence[QualityMeasure]) -> list[list[str]]:
    return [
        [f"Quality: {measure.name}", f"{measure.value:g}: {measure.verdict}"]
        for measure in quality
    ]


def _figures(case: Case, name: str, facts: dict[str, Any]) -> list[list[Any]]:
    def count(query: str) -> Any:
        return case.rows(query.replace("$name", name))[0][0]

    return [
        ["length", _clock(facts["seconds"] - facts["begins"])],
        ["frames", facts["frames"]],
        ["targets", count("SELECT count(DISTINCT track) FROM presence WHERE recording = $name")],
        ["at once, at most", count(_AT_ONCE)],
        ["pairs that met", count("SELECT count(DISTINCT (a, b)) FROM relations WHERE recording = $name")],
        ["groups", count("SELECT count(DISTINCT group_id) FROM groups WHERE recording = $name")],
        ["encounters", count("SELECT count(*) FROM encounters WHERE recording = $name")],
        ["events", count("SELECT count(*) FROM events WHERE recording = $name")],
    ]  # fmt: skip


def _clock(seconds: float) -> str:
    """A length of time for people.

    >>> _clock(113.4), _clock(7384.2)
    ('1 min 53 s', '2 h 03 min')
    """
    whole = round(seconds)
    if whole < 60:
        return f"{seconds:.1f} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def _tracks(case: Case, name: str, options: ReportOptions) -> list[dict[str, Any]]:
    """Each track's path of standing points, thinned so that all together stay few."""
    chosen = case.rows(
        f"SELECT track FROM tracks WHERE recording = {name} GROUP BY track "  # noqa: S608
        f"ORDER BY count(*) DESC, track LIMIT {options.tracks}"
    )
    points = min(options.points, max(4, options.all_points // max(1, len(chosen))))
    listed = ", ".join(str(track) for (track,) in chosen) or "-1"
    rows = case.rows(
        f"""SELECT track, list([round(x + w / 2, 1), round(y + h, 1), frame] ORDER BY frame) FROM (
        SELECT *, row_number() OVER (PARTITION BY track ORDER BY frame) - 1 AS k,
          count(*) OVER (PARTITION BY track) AS n FROM tracks
          WHERE recording = {name} AND track IN ({listed}))
        WHERE k % greatest(1, CAST(ceil(n / {points}) AS BIGINT)) = 0 OR k = n - 1 GROUP BY track ORDER BY track"""  # noqa: S608
    )
    return [{"id": track, "colour": track_css(track), "path": path} for track, path in rows]


def steps(
    case: Case, name: str, chosen: Sequence[int], times: Mapping[int, float]
) -> list[dict[str, Any]]:
    """Boxes (track, x, y, w, h, present and seen) and edges of frames: what the page moves through.

    Args:
        case: asked.
        name: the recording's name, as a literal of SQL.
        chosen: the frames' numbers, in order.
        times: every frame's time in seconds.
    """
    listed = ", ".join(map(str, chosen)) or "-1"
    nodes: dict[int, list[list[float]]] = {f: [] for f in chosen}
    for f, *node in case.rows(
        f"SELECT frame, {_NODE} FROM tracks "  # noqa: S608
        f"WHERE recording = {name} AND frame IN ({listed}) ORDER BY frame, track"
    ):
        nodes[f].append(node)
    edges: dict[int, list[list[Any]]] = {f: [] for f in chosen}
    for f, a, b, state in case.rows(
        f"SELECT f.frame, r.a, r.b, r.state FROM relations r JOIN frames f ON f.recording = r.recording "  # noqa: S608
        f"AND f.frame BETWEEN r.start_frame AND r.end_frame WHERE r.recording = {name} AND"
        f" f.frame IN ({listed}) "
        "ORDER BY f.frame, r.a, r.b"
    ):
        edges[f].append([a, b, state])
    return [
        {"frame": f, "t": round(times[f], 3), "nodes": nodes[f], "edges": edges[f]}
        for f in chosen
    ]


def _spread(values: Sequence[int] | range, most: int) -> list[int]:
    """At most so many of the values, evenly spaced, first and last among them."""
    if len(values) <= most:
        return list(values)
    last = len(values) - 1
    return [
        values[k]
        for k in sorted({round(index * last / (most - 1)) for index in range(most)})
    ]


def _thumbnail_frames(
    frames: Sequence[int], events: Sequence[int], data: dict[str, Any], most: int
) -> list[int]:
    """A quarter at what happened, the rest evenly over the recording, so that they play."""
    present = set(frames)
    starts = (
        [row[3] for row in data["relations"]]
        + [row[2] for row in data["groups"]]
        + [row[3] for row in data["encounters"]]
    )
    happened = sorted(present.intersection([*events, *starts]))
    few = max(2, most // 4)
    return sorted({*_spread(happened, few), *_spread(list(frames), max(2, most - few))})
