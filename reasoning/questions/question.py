"""What a ready question is: its name, its arguments, the options that it takes, and its SQL."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from string import Template

from reasoning.questions.literals import Moment, Recordings, identity
from recorders.errors import UsageError


@dataclass(frozen=True)
class Options:
    """Options that ready questions take.

    Attributes:
        recordings: only these recordings.
        at: the moment of who-was-in, the start of contacts.
        least_s: shortest stay of loitered.
        within_s: how far back (before), or how close together (left-with).
        gap_s: stays with a gap up to this are one (loitered); contact until so long before
            leaving (left-with).
        depth: longest chain of contacts (3).
        by: what counts as a contact (relations).
        certainty: rows less sure than this are left out (none; of contacts, chains do not run
            over them).
        direction: only crossings that way.
        every_s: how long the spans are that are counted by.
        timezone: where times of day are told.
    """

    recordings: Recordings | None = None
    at: Moment | None = None
    least_s: float | None = None
    within_s: float | None = None
    gap_s: float | None = None
    depth: int | None = None
    by: str | None = None
    certainty: float | None = None
    direction: str | None = None
    every_s: float | None = None
    timezone: str = "UTC"


FLAGS: Mapping[str, str] = {
    "at": "--at",
    "least_s": "--min",
    "within_s": "--within",
    "gap_s": "--gap",
    "depth": "--depth",
    "by": "--by",
    "direction": "--direction",
    "every_s": "--every",
    "certainty": "--certainty",
    "recordings": "--recording",
}
EVERY = ("recordings", "certainty")
"""Options that every question takes."""
_KINDS = {"A": "track", "B": "track", "OBJECT": "track", "ZONE": "zone", "LINE": "line",
          "ZONE|LINE": "place", "LABEL": "group", "EVENT": "event", "T1": "moment", "T2": "moment"}  # fmt: skip

Build = Callable[[Sequence[str], Options], Mapping[str, str]]


@dataclass(frozen=True)
class Question:
    """A ready question.

    Attributes:
        name: what it is called on the command line.
        arguments: its arguments as shown to people; brackets mark what may be left out.
        about: one line on what it answers.
        template: its SQL, with ``$name`` where values go.
        build: the values.
        nothing: what an empty answer means, and what to ask then.
        takes: names of the `Options` that it takes besides ``recordings``.
        certain: whether rows that are not sure are left out unless asked for.
        few_from: with so many arguments or more it keeps few of the rows that it looks through
            (None: never).
    """

    name: str
    arguments: str
    about: str
    template: str
    build: Build
    nothing: str = ""
    takes: tuple[str, ...] = ()
    few_from: int | None = None
    certain: bool = True

    def _words(self) -> list[str]:
        wanted = self.arguments.split()
        return [
            w
            for index, w in enumerate(wanted)
            if not _is_option(w) and not (index and _is_option(wanted[index - 1]))
        ]

    def why_empty(self, words: Sequence[str]) -> str:
        """What an empty answer to these arguments means, and what to ask then."""
        text = self.nothing
        for name, word in zip(self._words(), words, strict=False):
            name = name.strip("[]")  # noqa: PLW2901
            shown = word if _KINDS.get(name) == "moment" else word.rpartition(":")[2]
            text = re.sub(rf"\b{re.escape(name)}\b", shown.replace("\\", ""), text)
        return text

    def kinds(self) -> list[str]:
        """What each argument is: track, zone, line, place (zone or line), group, event or moment;
        empty for anything else.
        """
        return [_KINDS.get(w.strip("[]"), "") for w in self._words()]

    def keeps_few(self, words: Sequence[str]) -> bool:
        """Whether the question to all recordings is best asked of all at once
        (`Case.by_recording`).
        """
        return self.few_from is not None and len(words) >= self.few_from

    def sql(self, words: Sequence[str], options: Options) -> str:
        """The SQL for these arguments.

        Raises:
            UsageError: too few, too many or wrong arguments; says which are wanted.
        """
        names = self._words()
        least = sum(not name.startswith("[") for name in names)
        if not least <= len(words) <= len(names):
            raise UsageError(
                f"--ask {self.name} {self.arguments}: {len(words)} arguments given;"
                f" {self.about}"
            )
        for field, flag in FLAGS.items():
            if getattr(options, field) is not None and field not in (*self.takes, *EVERY):
                taken = ", ".join(FLAGS[take] for take in (*self.takes, *EVERY))
                raise UsageError(f"--ask {self.name} takes no {flag}; it takes: {taken}")
        try:
            values = {"only": only_of(options), **self.build(words, options)}
            return Template(self.template).substitute(values).strip()
        except (ValueError, KeyError) as error:
            # A question of the user's own need not know our errors.
            raise UsageError(
                f"--ask {self.name} {self.arguments}: {type(error).__name__}: {error}"
            ) from error

    def sure_sql(self, words: Sequence[str], options: Options) -> str:
        """The SQL whose rows are all at least as sure as the options ask for.

        Raises:
            UsageError: as `sql`.
        """
        sql = self.sql(words, options)
        if options.certainty is None or "certainty" not in self.template:
            return sql
        return f"SELECT * FROM (\n{sql}\n) WHERE certainty >= {options.certainty!r}"


def _is_option(word: str) -> bool:
    return word.lstrip("[").startswith("-")


def only_of(options: Options) -> str:
    """What narrows a condition to the recordings that are asked."""
    return "" if options.recordings is None else f" AND {options.recordings.sql()}"


def track_of(word: str) -> int:
    """A track's id, with or without ``track:`` before it."""
    return identity(word.removeprefix("track:"))
