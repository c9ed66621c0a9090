"""SQL macros: Allen's thirteen relations, overlaps and gaps in seconds, wall time in a time zone.

The thirteen take the closed frame intervals of two rows, ``(a.start_frame, a.end_frame,
b.start_frame, b.end_frame)``. A closed interval of frames lasts to the start of the frame after
it, so *meets* is "ends in the frame before the other starts". Exactly one of the thirteen holds
for any two intervals (J. F. Allen, Maintaining Knowledge about Temporal Intervals, 1983);
``allen`` names it.
"""

from __future__ import annotations

# a = [p, q), b = [r, s) half open: p = a_start, q = a_end + 1, r = b_start, s = b_end + 1.
_CONDITIONS: tuple[tuple[str, str], ...] = (
    ("before", "a_end + 1 < b_start"),
    ("meets", "a_end + 1 = b_start"),
    ("overlaps", "a_start < b_start AND a_end >= b_start AND a_end < b_end"),
    ("starts", "a_start = b_start AND a_end < b_end"),
    ("during", "a_start > b_start AND a_end < b_end"),
    ("finishes", "a_start > b_start AND a_end = b_end"),
    ("equals", "a_start = b_start AND a_end = b_end"),
    ("finished_by", "a_start < b_start AND a_end = b_end"),
    ("includes", "a_start < b_start AND a_end > b_end"),
    ("started_by", "a_start = b_start AND a_end > b_end"),
    ("overlapped_by", "a_start > b_start AND a_start <= b_end AND a_end > b_end"),
    ("met_by", "b_end + 1 = a_start"),
    ("after", "b_end + 1 < a_start"),
)
ALLEN = tuple(name for name, _ in _CONDITIONS)
# The thirteen stand in an order that their inverses reverse.
INVERSE = dict(zip(ALLEN, reversed(ALLEN), strict=True))
_ARGUMENTS = "(a_start, a_end, b_start, b_end)"


def macro_statements() -> list[str]:
    """CREATE MACRO statements; they need the table ``recordings``."""
    made = [
        f"CREATE MACRO allen_{name}{_ARGUMENTS} AS ({condition})"
        for name, condition in _CONDITIONS
    ]
    cases = " ".join(f"WHEN {condition} THEN '{name}'" for name, condition in _CONDITIONS)
    return [
        *made,
        f"CREATE MACRO allen{_ARGUMENTS} AS (CASE {cases} END)",
        (
            "CREATE MACRO overlap_s(a_start_t, a_end_t, b_start_t, b_end_t) AS "
            "greatest(0.0, least(a_end_t, b_end_t) - greatest(a_start_t, b_start_t))"
        ),
        (
            "CREATE MACRO gap_s(a_start_t, a_end_t, b_start_t, b_end_t) AS "
            "greatest(0.0, greatest(a_start_t, b_start_t) - least(a_end_t, b_end_t))"
        ),
        (
            "CREATE MACRO wall_instant(name, t) AS make_timestamptz((SELECT"
            " any_value(r.start_ns) // 1000 FROM recordings r WHERE r.recording = name) +"
            " CAST(round(t * 1000000) AS BIGINT))"
        ),
        (
            "CREATE MACRO wall_time(name, t, zone := 'UTC') AS timezone(zone,"
            " wall_instant(name, t))"
        ),
    ]
