"""Whether what a question names is there at all: an unknown target, zone, group, event or recording is an error that
says what there is, so that an empty answer always means that nothing happened.
"""

from __future__ import annotations

from collections.abc import Sequence

from reasoning.questions.case import Case
from reasoning.questions.ready import Options, Question
from reasoning.questions.values import Recordings, identity, literal
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
    "zone": "nobody was in a named zone (`record --regions FILE` names zones); `scene` is the whole picture",
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
    if not case.rows(f"SELECT 1 FROM recordings WHERE recording = {literal(name)}"):  # noqa: S608
        names = [r[0] for r in case.rows("SELECT recording FROM recordings ORDER BY recording")]
        raise UsageError(f"--recording {name}: there is none of that name; there are: {_few(names)}")


def check_words(case: Case, question: Question, words: Sequence[str], options: Options) -> None:
    """That each target, zone, group or event that a question names is in one of the recordings that it is asked of.

    Raises:
        UsageError: it is in none; says which there are.
    """
    for kind, word in zip(question.kinds(), words, strict=False):
        if kind == "zone" and word == _EVERYWHERE:
            continue
        _check(case, kind, word, options.recordings)


def _check(case: Case, kind: str, word: str, recordings: Recordings | None) -> None:
    noun, column, table = _SUBJECTS[kind]
    value = word if kind == "zone" else identity(word.removeprefix(f"{kind}:"))
    only = "true" if recordings is None else recordings.sql()
    if case.rows(f"SELECT 1 FROM {table} WHERE {column} = {literal(value)} AND {only} LIMIT 1"):  # noqa: S608
        return
    found = case.rows(f"SELECT DISTINCT {column} FROM {table} WHERE {only} ORDER BY 1 LIMIT 1000")  # noqa: S608
    there = f"there are {_few([r[0] for r in found])}" if found else _NONE[kind]
    where = "" if recordings is None else f" in {recordings.first}"
    raise UsageError(f"{noun} {word!r}: there is none{where}; {there}")


def _few(names: Sequence[object]) -> str:
    """The first few; runs of numbers as ``1-4``."""
    parts: list[str] = []
    k = 0
    while k < len(names):
        end = k
        while end + 1 < len(names) and _follows(names[end], names[end + 1]):
            end += 1
        parts.append(
            str(names[k]) if end == k else f"{names[k]}-{names[end]}" if end > k + 1 else f"{names[k]}, {names[end]}"
        )
        k = end + 1
    return ", ".join(parts[:_SHOWN]) + (", ..." if len(parts) > _SHOWN else "")


def _follows(one: object, two: object) -> bool:
    return isinstance(one, int) and isinstance(two, int) and two == one + 1
