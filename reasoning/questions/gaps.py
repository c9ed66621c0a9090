"""Times in which nothing was recorded: what happened then nobody knows, which is not the same as
that nothing happened.
"""

from __future__ import annotations

from reasoning.questions.case import Case
from reasoning.questions.literals import Moment, Recordings
from recorders.clock import seconds

LEAST_S, STEPS = 2.0, 10.0
"""A gap is longer than both: so many seconds, so many of the usual steps between frames."""
_SHOWN = 3


def gaps_sql(recordings: Recordings | None, at: Moment | None = None) -> str:
    """Recording, last frame's time before and first one's after each gap (of those around the
    moment), in s.
    """
    only = "true" if recordings is None else recordings.sql()
    around = "true" if at is None else f"since < {at.sql('g')} AND {at.sql('g')} < until"
    return (
        "WITH steps AS (SELECT recording, lag(t) OVER (PARTITION BY recording ORDER BY frame)"
        f" AS since, t AS until FROM frames r WHERE {only}), usual AS (SELECT recording,"
        " median(until - since) AS step FROM steps GROUP BY recording), g AS (SELECT"
        " s.recording, since, until FROM steps s JOIN usual USING (recording) WHERE until -"
        f" since > greatest({LEAST_S}, {STEPS} * step)) SELECT recording, since, until FROM g"
        f" WHERE {around} ORDER BY recording, since"
    )


def unrecorded(
    case: Case, at: Moment | None, recordings: Recordings | None, nothing: str
) -> str:
    """What an empty answer means where there are gaps: ``nothing``, if there are none.

    At a moment in a gap it means that nothing was recorded then; else that what was recorded
    holds nothing of the kind.
    """
    found = case.rows(gaps_sql(recordings, at))
    if not found:
        return nothing
    told = [
        f"from {since:.2f} s to {until:.2f} s, {seconds(round((until - since) * 1e9))}"
        + (f" in {name}" if recordings is None and len({r[0] for r in found}) > 1 else "")
        for name, since, until in found[:_SHOWN]
    ]
    more = f", and {len(found) - _SHOWN} times more" if len(found) > _SHOWN else ""
    if at is not None:
        return f"nothing was recorded then: {', '.join(told)}{more}"
    return f"{nothing}. Nothing was recorded {', '.join(told)}{more}"
