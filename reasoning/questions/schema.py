"""The tables that questions are asked of: names, columns, types, and what a column means.

Times ``t`` are seconds from the recording's start, frames count from 0, intervals include both
ends. Every table has a ``recording`` column. The first nine are the contract; those after them hold
what the others cannot say. How sure a row is stands in it; rows of relations, groups, events and
encounters show it in the views ``sure_relations`` and so on.
"""

from __future__ import annotations

from collections.abc import Mapping

SPAN = (
    ("start_frame", "INTEGER"),
    ("end_frame", "INTEGER"),
    ("start_t", "DOUBLE"),
    ("end_t", "DOUBLE"),
)
BELIEF = (
    ("seen_share", "DOUBLE"),
    ("existence", "DOUBLE"),
    ("identity", "DOUBLE"),
    ("joins", "INTEGER[]"),
)
"""What a row rests on: the share of its frames in which all whom it names were seen, the least
probability that they exist and are who they are said to be, and the events that joined tracks.
"""
Columns = tuple[tuple[str, str], ...]

TABLES: Mapping[str, Columns] = {
    "frames": (("recording", "VARCHAR"), ("frame", "INTEGER"), ("t", "DOUBLE")),
    "tracks": (
        ("recording", "VARCHAR"),
        ("frame", "INTEGER"),
        ("t", "DOUBLE"),
        ("track", "INTEGER"),
        ("x", "DOUBLE"),
        ("y", "DOUBLE"),
        ("w", "DOUBLE"),
        ("h", "DOUBLE"),
        ("vx", "DOUBLE"),
        ("vy", "DOUBLE"),
        ("mode", "VARCHAR"),
        ("confidence", "DOUBLE"),
        ("grouping", "BOOLEAN"),
        ("grouped", "BOOLEAN"),
        ("splitting", "BOOLEAN"),
        ("group_id", "INTEGER"),
        ("scene", "VARCHAR"),
        ("label", "VARCHAR"),
        ("present", "BOOLEAN"),
        ("seen", "BOOLEAN"),
        ("identity", "DOUBLE"),
    ),
    "relations": (
        ("recording", "VARCHAR"),
        ("a", "INTEGER"),
        ("b", "INTEGER"),
        ("state", "VARCHAR"),
        *SPAN,
        *BELIEF,
        ("nearest", "DOUBLE"),
    ),
    "groups": (
        ("recording", "VARCHAR"),
        ("group_id", "INTEGER"),
        ("members", "INTEGER[]"),
        *SPAN,
        ("formed_from", "INTEGER[]"),
        ("ended_by", "VARCHAR"),
        *BELIEF,
    ),
    "encounters": (
        ("recording", "VARCHAR"),
        ("a", "INTEGER"),
        ("b", "INTEGER"),
        ("kind", "VARCHAR"),
        *SPAN,
        ("confidence", "DOUBLE"),
        ("seen_share", "DOUBLE"),
        ("identity", "DOUBLE"),
        ("existence", "DOUBLE"),
        ("joins", "INTEGER[]"),
    ),
    "events": (
        ("recording", "VARCHAR"),
        ("event", "INTEGER"),
        ("kind", "VARCHAR"),
        ("frame", "INTEGER"),
        ("t", "DOUBLE"),
        ("subjects", "INTEGER[]"),
        ("rule", "VARCHAR"),
        ("evidence", "JSON"),
        ("text", "VARCHAR"),
        *BELIEF,
    ),
    "targets": (
        ("recording", "VARCHAR"),
        ("track", "INTEGER"),
        ("label", "VARCHAR"),
        ("first_t", "DOUBLE"),
        ("last_t", "DOUBLE"),
        ("seen_share", "DOUBLE"),
        ("identity", "DOUBLE"),
        ("upper_colour", "VARCHAR"),
        ("lower_colour", "VARCHAR"),
        ("height", "DOUBLE"),
        ("existence", "DOUBLE"),
        ("last_x", "DOUBLE"),
        ("last_y", "DOUBLE"),
        ("first_way", "DOUBLE"),
    ),
    "looks": (
        ("recording", "VARCHAR"),
        ("track", "INTEGER"),
        ("samples", "INTEGER"),
        ("upper", "INTEGER[]"),
        ("lower", "INTEGER[]"),
        ("frame", "INTEGER"),
        ("x", "DOUBLE"),
        ("y", "DOUBLE"),
        ("w", "DOUBLE"),
        ("h", "DOUBLE"),
    ),
    "held_back": (
        ("recording", "VARCHAR"),
        ("t", "DOUBLE"),
        ("x", "DOUBLE"),
        ("y", "DOUBLE"),
        ("w", "DOUBLE"),
        ("h", "DOUBLE"),
        ("reason", "VARCHAR"),
    ),
    "quality": (
        ("recording", "VARCHAR"),
        ("name", "VARCHAR"),
        ("value", "DOUBLE"),
        ("verdict", "VARCHAR"),
    ),
    "recordings": (
        ("recording", "VARCHAR"),
        ("digest", "VARCHAR"),
        ("path", "VARCHAR"),
        ("camera", "VARCHAR"),
        ("tracker", "VARCHAR"),
        ("width", "INTEGER"),
        ("height", "INTEGER"),
        ("frames", "INTEGER"),
        ("start_ns", "BIGINT"),
        ("seconds", "DOUBLE"),
        ("output_digest", "VARCHAR"),
        ("first_frame", "INTEGER"),
    ),
    "presence": (("recording", "VARCHAR"), ("track", "INTEGER"), *SPAN, *BELIEF),
    "bits": (
        ("recording", "VARCHAR"),
        ("track", "INTEGER"),
        ("bit", "VARCHAR"),
        ("partners", "INTEGER[]"),
        *SPAN,
        *BELIEF,
        ("nearest", "DOUBLE"),
        ("drift", "DOUBLE"),
    ),
    "zones": (
        ("recording", "VARCHAR"),
        ("track", "INTEGER"),
        ("zone", "VARCHAR"),
        *SPAN,
        *BELIEF,
    ),
    "hidden": (
        ("recording", "VARCHAR"),
        ("track", "INTEGER"),
        ("part", "VARCHAR"),
        *SPAN,
        *BELIEF,
    ),
    "phases": (
        ("recording", "VARCHAR"),
        ("a", "INTEGER"),
        ("b", "INTEGER"),
        ("kind", "VARCHAR"),
        *SPAN,
        ("distance", "DOUBLE"),
        ("relative_speed", "DOUBLE"),
        ("agitation", "DOUBLE"),
        ("slower", "DOUBLE"),
        ("heading", "DOUBLE"),
        ("end_distance", "DOUBLE"),
        ("abrupt_s", "DOUBLE"),
        ("phase", "VARCHAR"),
    ),
    "abrupt": (
        ("recording", "VARCHAR"),
        ("a", "INTEGER"),
        ("b", "INTEGER"),
        *SPAN,
        ("abrupt_s", "DOUBLE"),
        ("distance", "DOUBLE"),
        ("agitation", "DOUBLE"),
        ("through", "DOUBLE"),
    ),
    "still": (
        ("recording", "VARCHAR"),
        ("track", "INTEGER"),
        *SPAN,
        ("speed", "DOUBLE"),
        ("fastest", "DOUBLE"),
    ),
    "near": (
        ("recording", "VARCHAR"),
        ("a", "INTEGER"),
        ("b", "INTEGER"),
        *SPAN,
        ("distance", "DOUBLE"),
        ("farthest", "DOUBLE"),
    ),
    "encounter_evidence": (
        ("recording", "VARCHAR"),
        ("a", "INTEGER"),
        ("b", "INTEGER"),
        ("start_frame", "INTEGER"),
        ("near_s", "DOUBLE"),
        ("distance", "DOUBLE"),
        ("relative_speed", "DOUBLE"),
        ("sure_frame", "INTEGER"),
        ("drift", "DOUBLE"),
        ("all_distance", "DOUBLE"),
        ("all_relative_speed", "DOUBLE"),
    ),
    "encounter_parameters": (
        ("recording", "VARCHAR"),
        ("name", "VARCHAR"),
        ("value", "DOUBLE"),
    ),
    "event_groups": (
        ("recording", "VARCHAR"),
        ("event", "INTEGER"),
        ("group_id", "INTEGER"),
    ),
    "corrections": (
        ("recording", "VARCHAR"),
        ("correction", "INTEGER"),
        ("kind", "VARCHAR"),
        ("tracks", "INTEGER[]"),
        ("frame", "INTEGER"),
        ("t", "DOUBLE"),
        ("text", "VARCHAR"),
        ("made_by", "VARCHAR"),
        ("why", "VARCHAR"),
        ("date", "VARCHAR"),
        ("other", "VARCHAR"),
        ("undone", "BOOLEAN"),
    ),
}
DRAWN: Mapping[str, Columns] = {
    "crossings": (
        ("recording", "VARCHAR"),
        ("track", "INTEGER"),
        ("line", "VARCHAR"),
        ("frame", "INTEGER"),
        ("t", "DOUBLE"),
        ("direction", "VARCHAR"),
        ("x", "DOUBLE"),
        ("y", "DOUBLE"),
        *BELIEF,
    ),
    "lines": (
        ("line", "VARCHAR"),
        ("direction", "VARCHAR"),
        ("x1", "DOUBLE"),
        ("y1", "DOUBLE"),
        ("x2", "DOUBLE"),
        ("y2", "DOUBLE"),
    ),
}
"""Tables of what is drawn after the fact, which no index holds."""

SURE = "sure_"
"""What the views of contract tables with all their columns begin with."""

KEPT_APART: Mapping[str, tuple[str, ...]] = {
    **{t: tuple(name for name, _ in BELIEF) for t in ("groups", "events")},
    "relations": (*(name for name, _ in BELIEF), "nearest"),
    "tracks": ("seen", "identity"),
    "encounters": ("existence", "joins"),
    "targets": ("existence", "last_x", "last_y", "first_way"),
}
"""Columns that a contract table shows under its name with `SURE` alone."""

CONTRACT = (
    "frames",
    "tracks",
    "relations",
    "groups",
    "encounters",
    "events",
    "targets",
    "held_back",
    "quality",
)

MEANING: Mapping[str, str] = {
    "frames": "one row per frame",
    "tracks": (
        "one row per track and frame; x, y, w, h in pixels, vx, vy in pixels per second;"
        " label is the class that its detections voted for, NULL where they told none;"
        " present says whether the track is held to be in the picture (what MOT exports hold)"
    ),
    "relations": (
        "one row per interval in which a and b (a < b) were in INTERACTION or JOINT; nearest:"
        " least distance on the ground, in body sizes; NULL where the two were never seen apart,"
        " and may be one"
    ),
    "groups": (
        "one row per group's life; ended_by is the kind of the event that ended it, NULL at"
        " the recording's end"
    ),
    "encounters": (
        "who was socially together, in hindsight, without approach and parting: meeting,"
        " moving or contact; confidence is how sure that is, existence that both are real"
    ),
    "events": "what happened, by which rule, with the measured values",
    "targets": (
        "one row per target: from when to when, which share of its frames it was seen in,"
        " how sure it is that it exists and is one and the same; last_x, last_y:"
        " where its feet were last, pixels; first_way: how far it went in its first two seconds,"
        " in its own sizes, NULL where it was not there for long enough to tell"
    ),
    "looks": (
        "what each target looks like, from as many pictures as samples says: shares of shades"
        " of upper and lower body in thousandths, and where it is seen best"
    ),
    "held_back": "what was seen and held to be no body, with the reason",
    "quality": "what was measured of the recording itself, with a verdict",
    "recordings": (
        "one row per recording: where it came from; start_ns is the log time of frame 0,"
        " seconds its end"
    ),
    "presence": "one row per unbroken time in which a track was present",
    "bits": (
        "one row per time in which a track was grouping, grouped or splitting with the same"
        " partners; nearest: least distance on the ground to the farthest of them, in body sizes;"
        " drift: by how many body sizes a second they draw away from one another (less than"
        " nothing: close in) in the second before it groups, or after it splits"
    ),
    "zones": "one row per stay of a track in a named zone",
    "hidden": (
        "one row per time in which a part of a track's body was held to be hidden (tracker"
        " parts)"
    ),
    "phases": (
        "the parts of each encounter, in order (phase: approach, together, parting), with"
        " medians over their own frames, in body sizes and seconds"
    ),
    "abrupt": (
        "one row per time in which a and b, touching, were abrupt against one another and"
        " did not go through"
    ),
    "still": (
        "one row per time in which a track stood still; speeds in own sizes per second"
    ),
    "near": (
        "one row per time in which a and b stood within touching distance, in sizes of the"
        " larger one"
    ),
    "encounter_evidence": (
        "the measured values behind each encounter, in body sizes and seconds; distance and"
        " relative_speed are medians of the moments together for sure, all_... those of all"
        " its frames"
    ),
    "encounter_parameters": "the thresholds that a recording's encounters were found with",
    "event_groups": "the groups that an event names",
    "corrections": (
        "what people corrected before the recording was replayed, by whom and why; frame and t"
        " are NULL where it holds in all frames; other is the target of another recording;"
        " undone says that it was taken back"
    ),
}


def shown(table: str) -> list[str]:
    """The columns of a table under its own name."""
    apart = KEPT_APART.get(table, ())
    return [name for name, _ in TABLES[table] if name not in apart]


def create_statements(temporary: bool = False) -> list[str]:
    """One CREATE TABLE per table."""
    word = "CREATE TEMP TABLE" if temporary else "CREATE TABLE"
    return [
        f"{word} {name} ({', '.join(f'{c} {t}' for c, t in columns)})"
        for name, columns in TABLES.items()
    ]
