"""Finding targets by what they look like: by colours, or like somebody, over any recordings.

A likeness to colours is the share of the body that they cover. A likeness to somebody is what the
shares of shades of the two have in common (histogram intersection: M. J. Swain, D. H. Ballard,
Color indexing, IJCV 1991), the mean of upper and lower body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from string import Template

from reasoning.questions.asking import Answer
from reasoning.questions.case import Case
from reasoning.questions.literals import Recordings, identity, literal
from recorders.errors import UsageError
from recorders.looks import COLOURS, SHADES, shades_of

LEAST = 0.2
"""What is less like what is wanted is no answer."""
_THOUSAND = 1000.0


@dataclass(frozen=True)
class Wanted:
    """What is looked for.

    Attributes:
        anywhere: colours of which the upper or the lower body shall be.
        upper, lower: colours of that half.
        like: shares of shades in thousandths of upper and lower body.
        not_this: the recording and track that the likeness is to, which is no answer.
    """

    anywhere: tuple[str, ...] = ()
    upper: tuple[str, ...] = ()
    lower: tuple[str, ...] = ()
    like: tuple[Sequence[int], Sequence[int]] | None = None
    not_this: tuple[str, int] | None = None


_FIND = """
WITH likened AS (
  SELECT *, round(CAST($likeness AS DOUBLE), 4) AS likeness FROM looks WHERE true$only),
best AS (
  SELECT * FROM likened WHERE likeness >= $least$other ORDER BY likeness DESC, recording, track LIMIT $most)
SELECT recording, track, likeness, t.upper_colour, t.lower_colour, t.height, samples, t.first_t, t.last_t,
  t.seen_share, t.existence, t.identity, frame, x, y, w, h, concat('track:', track, '@', frame) AS explain
FROM best JOIN sure_targets t USING (recording, track) ORDER BY likeness DESC, recording, track
"""


def find(
    case: Case,
    wanted: Wanted,
    *,
    recordings: Recordings | None = None,
    most: int = 20,
    least: float = LEAST,
) -> Answer:
    """The targets that are most like what is wanted, best first.

    Raises:
        UsageError: nothing is wanted, or a colour has no name here.
    """
    other = ""
    if wanted.not_this is not None:
        recording, track = wanted.not_this
        other = f" AND NOT (recording = {literal(recording)} AND track = {track})"
    return case.sql(
        Template(_FIND).substitute(
            likeness=_likeness(wanted),
            only="" if recordings is None else f" AND {recordings.sql()}",
            other=other,
            most=most,
            least=repr(least),
        )
    )


def _likeness(wanted: Wanted) -> str:
    parts = []
    if wanted.anywhere:
        halves = (_share(half, wanted.anywhere) for half in ("upper", "lower"))
        parts.append(f"greatest({', '.join(halves)})")
    parts += [
        _share(half, colours)
        for half, colours in (("upper", wanted.upper), ("lower", wanted.lower))
        if colours
    ]
    if wanted.like is not None:
        both = (
            _common(half, shares)
            for half, shares in zip(("upper", "lower"), wanted.like, strict=True)
        )
        parts.append(f"({' + '.join(both)}) / 2")
    if not parts:
        raise UsageError(
            "nothing to find: give --colour NAME, --upper NAME, --lower NAME, or --like ID"
        )
    # All that is wanted must be so: as like as the least of it.
    return parts[0] if len(parts) == 1 else f"least({', '.join(parts)})"


def _share(half: str, colours: Sequence[str]) -> str:
    for name in colours:
        if not shades_of([name]):
            raise UsageError(
                f"colour {name!r}: has no name here; there are: {', '.join(COLOURS)}"
                f" (and shades: {', '.join(shade for shade, _ in SHADES if shade not in COLOURS)})"
            )
    terms = (f"{half}[{k + 1}]" for k in shades_of(colours))
    return f"({' + '.join(terms)}) / {_THOUSAND}"


def _common(half: str, shares: Sequence[int]) -> str:
    terms = (f"least({half}[{k + 1}], {int(v)})" for k, v in enumerate(shares) if v)
    return f"({' + '.join(terms) or '0'}) / {_THOUSAND}"


def likeness_to(case: Case, word: str, recordings: Recordings | None) -> Wanted:
    """What looks like ``7`` or ``RECORDING:7``.

    Raises:
        UsageError: there is no such target, or in several recordings, or it was not seen well
            enough.
    """
    name, colon, number = word.rpartition(":")
    track = identity(number.removeprefix("track:"))
    only = f" AND recording = {literal(name)}" if colon and name != "track" else ""
    only += "" if recordings is None or only else f" AND {recordings.sql()}"
    there = case.rows(
        f"SELECT recording FROM targets WHERE track = {track}{only} ORDER BY 1"
    )
    if not there:
        raise UsageError(f"--like {word}: there is no such target")
    if len(there) > 1:
        shown = ", ".join(f"{r}:{track}" for (r,) in there[:4])
        raise UsageError(f"--like {word}: in several recordings; give one of {shown}")
    rows = case.rows(
        f"SELECT upper, lower FROM looks WHERE track = {track}"
        f" AND recording = {literal(there[0][0])}"
    )
    if not rows:
        raise UsageError(
            f"--like {word}: no picture of it is good enough, or the log holds no pictures"
        )
    return Wanted(like=rows[0], not_this=(there[0][0], track))
