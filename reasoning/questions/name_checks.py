"""Whether what a question names is there at all: an unknown target, zone, group, event or
recording is an error that says what there is, so that an empty answer always means that nothing
happened.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from reasoning.questions.case import Case
from reasoning.questions.literals import Moment, Recordings, identity, literal, moment
from reasoning.questions.patterns import Pattern, PatternError
from reasoning.questions.ready_questions import Options, Question
from recorders.errors import UsageError

_SHOWN = 12
_EVERYWHERE = "scene"
_SUBJECTS = {
    "track": ("target", "track", "presence"),
    "zone": ("zone", "zone", "zones"),
    "group": ("group", "group_id", "groups"),
    "event": ("event", "event", "events"),
}
_NONE = {
    "track": "there are no targets at all",
    "zone": (
        "nobody was in a named zone (--zone NAME=x,y,x,y,... draws one, `record --regions"
        " FILE` records some); `scene` is the whole picture"
    ),
    "group": "no group was formed",
    "event": "there are no events",
}


def check_recording(case: Case, name: str | None) -> None:
    """That there is a recording of that name.

    Raises:
        UsageError: there is none; names those that there are.
    """
    if name is None:
        return
    if not case.rows(f"SELECT 1 FROM recordings WHERE recording = {literal(name)}"):
        names = [
            row[0]
            for row in case.rows("SELECT recording FROM recordings ORDER BY recording")
        ]
        raise UsageError(
            f"--recording {name}: there is none of that name; there are: {_few(names)}"
        )


def check_thresholds(case: Case, chosen: Mapping[str, float]) -> None:
    """That the encounters of every recording were found with the thresholds that the call asks for.

    Logs are read with them; an index keeps those that it was made with.

    Raises:
        UsageError: a recording has others; names it, and what to do.
    """
    for name, value in chosen.items():
        wanted = f"name = {literal(name)} AND value <> {float(value)!r}"
        others = case.rows(
            f"SELECT recording, value FROM encounter_parameters WHERE {wanted} ORDER BY recording LIMIT 1"
        )
        for recording, was in others:
            raise UsageError(
                f"encounters.{name} = {value:g}: the encounters of {recording!r} in the"
                f" index were found with {was:g}, and it keeps them; make another index"
                " with this value, or ask the annotated logs"
            )


def check_words(
    case: Case, question: Question, words: Sequence[str], options: Options
) -> None:
    """That each target, zone, group, event and moment that a question names is in a recording
    that it is asked of.

    Raises:
        UsageError: it is in none; says which there are.
    """
    for kind, word in zip(question.kinds(), words, strict=False):
        if not kind or (kind in ("zone", "place") and word == _EVERYWHERE):
            continue
        if kind == "moment":
            check_moment(
                case, moment(word, options.timezone), options.recordings, word="", ends=True
            )
        elif kind == "line" or (kind == "place" and case.drawn.line(word) is not None):
            _check_line(case, word, options)
        else:
            _check(case, "zone" if kind == "place" else kind, word, options.recordings)
    check_moment(case, options.at, options.recordings)


def _check_line(case: Case, name: str, options: Options) -> None:
    line = case.drawn.line(name)
    if line is None:
        there = _few([x.name for x in case.drawn.lines])
        known = f"there are {there}" if there else "draw it: --line NAME=x1,y1,x2,y2"
        raise UsageError(f"line {name!r}: there is none; {known}")
    if options.direction not in (None, *line.directions):
        raise UsageError(
            f"--direction {options.direction}: line {name!r} is crossed to the"
            f" {' or '.join(line.directions)}"
        )


def check_moment(
    case: Case,
    at: Moment | None,
    recordings: Recordings | None,
    word: str = "--at ",
    *,
    ends: bool = False,
) -> None:
    """That a moment lies within one of the recordings that are asked; ``ends`` says that the end
    of a span may lie behind it.

    Raises:
        UsageError: it lies in none; says from when to when they go.
    """
    if at is None:
        return
    only = "true" if recordings is None else recordings.sql()
    if at.frame is not None:
        within = f"SELECT 1 FROM frames r WHERE frame = {at.frame} AND {only} LIMIT 1"
    else:
        # To the millisecond, as times are shown.
        seconds = at.sql("r")
        within = (
            f"SELECT 1 FROM recordings r WHERE {only} AND {seconds} <= r.seconds + 0.0005 AND EXISTS "
            f"(SELECT 1 FROM frames f WHERE f.recording = r.recording AND f.t <= {seconds}"
            " + 0.0005) LIMIT 1"
        )
    if case.rows(within) or (ends and at.frame is None and not _before(case, at, only)):
        return
    spans = case.rows(
        "SELECT recording, first_frame, (SELECT min(f.t) FROM frames f WHERE f.recording = r.recording), "
        "(SELECT max(f.frame) FROM frames f WHERE f.recording = r.recording), seconds, "
        "CAST(wall_time(recording, 0.0) AS VARCHAR), CAST(wall_time(recording, seconds) AS"
        " VARCHAR) "
        f"FROM recordings r WHERE {only} ORDER BY recording LIMIT 4"
    )
    told = []
    for name, first, since, last, until, wall_since, wall_until in spans[:3]:
        if at.frame is not None:
            told.append(f"{name} has frames {first} to {last}")
        elif at.seconds is not None or wall_since < "1971":
            told.append(f"{name} goes from {since or 0:.3f} to {until:.3f} s")
        else:
            told.append(f"{name} goes from {wall_since} to {wall_until} UTC")
    raise UsageError(
        f"{word}{at.text()}: outside of the recording;"
        f" {'; '.join(told)}{' ...' if len(spans) > 3 else ''}"
    )


def _before(case: Case, at: Moment, only: str) -> bool:
    """Whether a moment lies before all that is asked."""
    return not case.rows(
        f"SELECT 1 FROM recordings r WHERE {only} AND {at.sql('r')} >= 0 LIMIT 1"
    )


def check_pattern(case: Case, pattern: Pattern, recordings: Recordings | None) -> None:
    """That each target and zone that a pattern names is in one of the recordings that it is asked
    of.

    Raises:
        PatternError: it is in none; says which there are, and points at it.
    """
    for item in (item for step in pattern.steps for item in step):
        for term in item.terms:
            kind, word = (
                ("track", str(term.number))
                if term.number is not None
                else ("zone", term.text)
            )
            wrong = None if word is None else _missing(case, kind, word, recordings)
            if wrong is not None:
                raise PatternError(wrong, pattern.text, term.position)


def _check(case: Case, kind: str, word: str, recordings: Recordings | None) -> None:
    wrong = _missing(case, kind, word, recordings)
    if wrong is not None:
        raise UsageError(wrong)


def _missing(case: Case, kind: str, word: str, recordings: Recordings | None) -> str | None:
    """That there is none of that name, and what there is; None if there is one."""
    noun, column, table = _SUBJECTS[kind]
    if kind == "zone" and any(word == zone.name for zone in case.drawn.zones):
        return None
    value = word if kind == "zone" else identity(word.removeprefix(f"{kind}:"))
    only = "true" if recordings is None else recordings.sql()
    if case.rows(
        f"SELECT 1 FROM {table} WHERE {column} = {literal(value)} AND {only} LIMIT 1"
    ):
        return None
    found = case.rows(
        f"SELECT DISTINCT {column} FROM {table} WHERE {only} ORDER BY 1 LIMIT 1000"
    )
    there = f"there are {_few([r[0] for r in found])}" if found else _NONE[kind]
    where = "" if recordings is None else f" in {recordings.first}"
    return f"{noun} {word!r}: there is none{where}; {there}"


def _few(names: Sequence[object]) -> str:
    """The first few; runs of numbers as ``1-4``."""
    parts: list[str] = []
    k = 0
    while k < len(names):
        end = k
        while end + 1 < len(names) and _follows(names[end], names[end + 1]):
            end += 1
        parts.append(
            str(names[k])
            if end == k
            else f"{names[k]}-{names[end]}"
            if end > k + 1
            else f"{names[k]}, {names[end]}"
        )
        k = end + 1
    return ", ".join(parts[:_SHOWN]) + (", ..." if len(parts) > _SHOWN else "")


def _follows(one: object, two: object) -> bool:
    return isinstance(one, int) and isinstance(two, int) and two == one + 1
