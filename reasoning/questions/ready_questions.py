"""The ready questions: a name, its arguments, and the SQL that answers it.

Every answer row has a column ``explain``: what to give to ``scenetrace explain`` to see frames,
rule and values behind the row (``event:12``, ``relation:1-2@40``: the interval of 1 and 2 that
starts in frame 40, ``group:3``, ``encounter:1-2@65``, ``zone:4@160:bench``, ``track:7@31``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from string import Template

from reasoning.questions import statements as sql
from reasoning.questions.desk_questions import DESK, SETTLED_S, stays_of
from reasoning.questions.literals import identity
from reasoning.questions.question import FLAGS, Options, Question, only_of, track_of
from recorders import plugins
from recorders.errors import SceneTraceError, UsageError

__all__ = [
    "DEFAULT_CERTAINTY",
    "FLAGS",
    "QUESTIONS",
    "Options",
    "Question",
    "all_questions",
    "question",
    "unsure_contacts_sql",
]

SOURCES: Mapping[str, str] = {
    "relations": sql.BY_RELATIONS,
    "joint": sql.BY_JOINT,
    "encounters": sql.BY_ENCOUNTERS,
    "groups": sql.BY_GROUPS,
}


DEFAULT_CERTAINTY = 0.5
"""What the command leaves out unless told otherwise; see docs/questions.md for why."""


def _met(words: Sequence[str], _: Options) -> Mapping[str, str]:
    a = track_of(words[0])
    if len(words) == 1:
        return {"a": str(a), "b": "", "a_too": ""}
    b = track_of(words[1])
    if a == b:
        raise UsageError(f"--ask met {a} {b}: two different targets are wanted")
    # A row has a < b: of the two ways round one is empty, and need not be looked for.
    first, second = (
        (f" AND b = {b}", " AND false") if a < b else (" AND false", f" AND a = {b}")
    )
    return {"a": str(a), "b": first, "a_too": second}


def _together(words: Sequence[str], options: Options) -> Mapping[str, str]:
    sure = {"sure": repr(options.certainty or 0.0)}
    a = track_of(words[0])
    if len(words) == 1:
        return {"who": f"{a} IN (a, b)", **sure}
    b = track_of(words[1])
    if a == b:
        raise UsageError(f"--ask together {a} {b}: two different targets are wanted")
    return {"who": f"a = {min(a, b)} AND b = {max(a, b)}", **sure}


def _one(words: Sequence[str], options: Options) -> Mapping[str, str]:
    within = 5.0 if options.within_s is None else options.within_s
    gap = 1.0 if options.gap_s is None else options.gap_s
    return {"a": str(track_of(words[0])), "within": repr(within), "gap": repr(gap)}


def _zone_at(words: Sequence[str], options: Options) -> Mapping[str, str]:
    if options.at is None:
        raise UsageError(
            "--ask who-was-in ZONE --at T: give --at (seconds, frame:N, or RFC 3339)"
        )
    return {**stays_of(words), "at": options.at.sql("s")}


def _loitered(words: Sequence[str], options: Options) -> Mapping[str, str]:
    least = 30.0 if options.least_s is None else options.least_s
    return {
        **stays_of(words),
        "least": repr(least),
        "gap": repr(2.0 if options.gap_s is None else options.gap_s),
    }


def _nothing(_: Sequence[str], __: Options) -> Mapping[str, str]:
    return {"settled": repr(SETTLED_S)}


def _anybody(words: Sequence[str], _: Options) -> Mapping[str, str]:
    return {"whose": f"track = {track_of(words[0])}" if words else "true"}


def _label(words: Sequence[str], _: Options) -> Mapping[str, str]:
    return {"label": str(identity(words[0].removeprefix("group:")))}


def _before(words: Sequence[str], options: Options) -> Mapping[str, str]:
    within = 60.0 if options.within_s is None else options.within_s
    return {"event": str(identity(words[0].removeprefix("event:"))), "within": repr(within)}


def _contacts_of(by: str, options: Options, sure: float) -> str:
    """The contacts of a sort that are sure enough."""
    template = Template(SOURCES[by])
    return template.substitute(only=only_of(options), sure=repr(sure)).strip()


def unsure_contacts_sql(options: Options) -> str:
    """Counts the contacts that chains of `contacts` do not run over, because they are not sure."""
    by, sure = options.by or "relations", options.certainty or 0.0
    every, kept = (_contacts_of(by, options, least) for least in (-1.0, sure))
    return f"SELECT (SELECT count(*) FROM ({every})) - (SELECT count(*) FROM ({kept}))"


def _contacts(words: Sequence[str], options: Options) -> Mapping[str, str]:
    depth, by = 3 if options.depth is None else options.depth, options.by or "relations"
    if not 1 <= depth <= 100:
        raise UsageError(f"--depth {depth}: must be 1 to 100")
    if by not in SOURCES:
        raise UsageError(f"--by {by}: must be one of {', '.join(SOURCES)}")
    since = "-1e18" if options.at is None else options.at.sql("r")
    what = "encounter" if by == "encounters" else "relation"
    return {
        "a": str(track_of(words[0])),
        "contacts": _contacts_of(by, options, options.certainty or 0.0),
        "since": since,
        "why": (
            sql.GROUP_WHY
            if by == "groups"
            else Template(sql.PAIR_WHY).substitute(what=what)
        ),
        "depth": str(depth),
    }


QUESTIONS: Mapping[str, Question] = {
    x.name: x
    for x in (
        Question("met", "A [B]", "whom A met or passed (whose shells touched A's), when, and how long", sql.MET, _met,
                 "target A's shell never touched such a shell; `timeline A` shows all there is of it", few_from=2),
        Question("together", "A [B]", "with whom A was socially together, and when, in hindsight", sql.TOGETHER,
                 _together,
                 "target A was never near and slow against another for long; `met A` shows whom it passed",
                 few_from=1),
        Question("left-with", "A --within 5s",
                 "who left with A: the same way, in contact until the first of them left (--gap 1s)",
                 sql.LEFT_WITH, _one,
                 "nobody left with target A: it left by itself, or (see `timeline A`) it was not seen to leave at all;"
                 " widen --within and --gap",
                 ("within_s", "gap_s"), few_from=1),
        Question("who-was-in", "ZONE --at T", "who was in a zone at a moment (zone `scene`: anywhere)",
                 sql.WHO_WAS_IN, _zone_at,
                 "nobody was there then; `loitered ZONE --min 0s` lists all stays", ("at",), few_from=1),
        Question("loitered", "ZONE --min 30s", "who stayed in a zone at least so long (gaps up to --gap 2s closed)",
                 sql.LOITERED, _loitered, "nobody stayed so long; lower --min, or raise --gap", ("least_s", "gap_s")),
        Question("entered-never-left", "", "who came in and was never seen to leave", sql.ENTERED_NEVER_LEFT, _nothing,
                 "everybody who came in was seen to leave; who was there from the first frame did not come in",
                 few_from=0),
        Question("grouping-and-splitting", "", "who joined some while leaving others, with both partner lists",
                 sql.GROUPING_AND_SPLITTING, _nothing, "nobody was grouping and splitting in one frame", few_from=0),
        Question("group-history", "LABEL", "the groups that a group came from and went into", sql.GROUP_HISTORY, _label,
                 few_from=1),
        Question("before", "EVENT --within 60s", "who was near the event's subjects before it", sql.BEFORE, _before,
                 "nobody was near the subjects of event EVENT in that time; widen --within", ("within_s",), few_from=1),
        Question("contacts", "A --depth 3", "chains of contacts from A that respect time", sql.CONTACTS, _contacts,
                 "target A had no contact of that sort (--by relations, joint, encounters, groups)",
                 ("depth", "by", "at")),
        Question("hidden", "[A]", "which parts of A, or of anybody, were hidden when (tracker parts)", sql.HIDDEN,
                 _anybody,
                 "no part of anybody asked about was hidden, or the tracker knows no parts (replay --tracker parts)"),
        Question("timeline", "A", "everything about A in order", sql.TIMELINE, _one),
        *DESK,
    )
}  # fmt: skip


def question(name: str) -> Question:
    """The ready question of that name, or that of an installed plug-in (entry points of
    ``scenetrace.questions``), or of ``module:name``.

    Raises:
        UsageError: there is none; names those that there are.
        SceneTraceError: a plug-in cannot be imported.
    """
    if name in QUESTIONS:
        return QUESTIONS[name]
    installed = plugins.names(plugins.QUESTIONS)
    if ":" not in name and name not in installed:
        raise UsageError(
            f"no ready question {name!r}; there are: {', '.join([*QUESTIONS, *installed])}"
            " (--ask list)"
        )
    found = plugins.load(plugins.QUESTIONS, name, QUESTIONS).value
    if not isinstance(found, Question):
        raise UsageError(
            f"the question {name} is {type(found).__name__}, must be a scenetrace.Question"
        )
    return found


def all_questions() -> list[Question]:
    """The ready questions, then those of installed plug-ins by name; of one that cannot be used,
    the line says why.
    """
    found = list(QUESTIONS.values())
    for name in plugins.names(plugins.QUESTIONS):
        if name not in QUESTIONS:
            try:
                found.append(replace(question(name), name=name))
            except SceneTraceError as error:
                found.append(Question(name, "", f"cannot be used: {error}", "", _nothing))
    return found
