"""The pattern language: its tree, and the parser whose errors point at the character.

    pattern  = step { ";" step } [ "within" time ]
    step     = item { ( "&" | allen ) item }
    item     = [ "!" ] atom [ "{" count [ "," ] "}" ] [ "[" bound { "," bound } "]" ]
    atom     = name "(" [ term { "," term } ] ")"
    term     = variable | number | "_" | name | text in quotes
    bound    = [ "gap" | "lasts" ] ( "<" | "<=" | ">" | ">=" ) time
    allen    = relation { "|" relation }       one of Allen's thirteen
    time     = number [ "ms" | "s" | "sec" | "m" | "min" | "h" ]

A ``name`` or a text is a zone's.

``A ; B``: B starts after A has ended. ``A & B``: there is a frame that both (and all before them
in the step) share. ``A during B``: one of Allen's thirteen relations of A to B. ``!A``: no A
between the steps beside it, or, after ``&``, none that touches the step. ``A{3}``: three of A for
the same targets, one after the other. A variable is one target throughout, different variables
are different targets, ``_`` is anybody.
"""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Never

from reasoning.questions.literals import duration
from reasoning.questions.macros import ALLEN
from reasoning.questions.patterns.atoms import ATOMS, NAMES, ArgumentKind
from recorders.errors import UsageError
from recorders.names import whole

MAX_LENGTH = 2_000
MAX_ITEMS = 24
MAX_REPEAT = 1_000
_TOKEN = re.compile(
    r"""\s*(?:([A-Za-z_][A-Za-z0-9_-]*)|(\d+(?:\.\d+)?)|('[^']*'|"[^"]*")|(<=|>=|[;&|!(),{}\[\]<>]))"""
)
_UNITS = ("ms", "s", "sec", "m", "min", "h")


class PatternError(UsageError):
    """A pattern cannot be read.

    Attributes:
        reason: what is wrong.
        position: the character at which it is, from 0.
    """

    def __init__(self, reason: str, text: str, position: int) -> None:
        shown = "".join(c if c.isprintable() else " " for c in text)
        before = "".join(
            "  " if unicodedata.east_asian_width(c) in "WF" else " "
            for c in shown[:position]
        )
        super().__init__(
            f"pattern, character {position + 1}: {reason}", f"  {shown}", f"  {before}^"
        )
        self.reason = reason
        self.position = position


@dataclass(frozen=True)
class Term:
    """An argument: a variable, a target's id, anybody (both None), or a text (a zone's name)."""

    variable: str | None = None
    number: int | None = None
    text: str | None = None
    position: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Bound:
    """``lasts > 2``: how long an item lasts; ``gap < 30``: seconds since what came before it."""

    what: str
    compare: str
    seconds: float
    position: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Item:
    """One atom with what is asked of it.

    Attributes:
        name: the atom's name, as in `ATOMS`, or an event's kind.
        terms: its arguments.
        negated: none of it is wanted.
        count: that many in a row, 1 without repetition.
        open_ended: ... or more.
        bounds: of duration and gap.
        link: how it follows the item before it in its step: ``("&",)``, or names of Allen's
            relations.
        position: where it stands in the text.
    """

    name: str
    terms: tuple[Term, ...]
    negated: bool = False
    count: int = 1
    open_ended: bool = False
    bounds: tuple[Bound, ...] = ()
    link: tuple[str, ...] = ("&",)
    position: int = field(default=0, compare=False)

    @property
    def repeated(self) -> bool:
        """Whether several in a row are asked for."""
        return self.count > 1 or self.open_ended


@dataclass(frozen=True)
class Pattern:
    """Steps in order, each a tuple of items; ``within_s`` bounds the whole."""

    steps: tuple[tuple[Item, ...], ...]
    within_s: float | None = None
    text: str = field(default="", compare=False)

    def variables(self) -> list[str]:
        """Variables of items that are wanted, in the order of their first place."""
        seen: dict[str, None] = {}
        for step in self.steps:
            for item in step:
                if not item.negated:
                    seen.update(
                        {
                            term.variable: None
                            for term in item.terms
                            if term.variable is not None
                        }
                    )
        return list(seen)


def parse(text: str) -> Pattern:
    """Read a pattern.

    Raises:
        PatternError: it is none; points at the character.
    """
    if len(text) > MAX_LENGTH:
        raise PatternError(f"longer than {MAX_LENGTH} characters", text[:60], 59)
    return _Parser(text).pattern()


@dataclass(frozen=True)
class _Token:
    kind: str
    value: str
    position: int


def _tokens(text: str) -> list[_Token]:
    out, at = [], 0
    stop = len(text.rstrip())
    while at < stop:
        match = _TOKEN.match(text, at)
        if match is None:
            bad = at + len(text[at:]) - len(text[at:].lstrip())
            raise PatternError(f"{text[bad]!r} means nothing here", text, bad)
        kind = ("name", "number", "text", "sign")[(match.lastindex or 1) - 1]
        out.append(
            _Token(
                kind, match.group(match.lastindex or 1), match.start(match.lastindex or 1)
            )
        )
        at = match.end()
    out.append(_Token("end", "the end", stop))
    return out


class _Parser:
    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens = _tokens(text)
        self._k = 0

    @property
    def _now(self) -> _Token:
        return self._tokens[self._k]

    def _fail(self, reason: str, at: int | None = None) -> Never:
        raise PatternError(reason, self._text, self._now.position if at is None else at)

    def _found(self) -> str:
        return (
            "the pattern ends here"
            if self._now.kind == "end"
            else f"found {self._now.value!r}"
        )

    def _is(self, *signs: str) -> bool:
        return self._now.kind == "sign" and self._now.value in signs

    def _take(self) -> _Token:
        token = self._now
        self._k += 1
        return token

    def _want(self, sign: str) -> None:
        if not self._is(sign):
            self._fail(f"{sign!r} is wanted, {self._found()}")
        self._take()

    def pattern(self) -> Pattern:
        steps = [self._step()]
        while self._is(";"):
            self._take()
            steps.append(self._step())
        within = None
        if self._now.kind == "name" and self._now.value.lower() == "within":
            self._take()
            within = self._time()
        if self._now.kind != "end":
            self._fail(
                f"';', '&', one of Allen's relations or the end is wanted, {self._found()}"
            )
        found = Pattern(tuple(steps), within, self._text)
        self._check(found)
        return found

    def _step(self) -> tuple[Item, ...]:
        items = [self._item(("&",))]
        while True:
            if self._is("&"):
                self._take()
                items.append(self._item(("&",)))
            elif self._now.kind == "name" and self._now.value.lower() in ALLEN:
                items.append(self._allen(items[-1]))
            else:
                return tuple(items)

    def _allen(self, before: Item) -> Item:
        at = self._now.position
        names = [self._take().value.lower()]
        while self._is("|"):
            self._take()
            if self._now.value.lower() not in ALLEN:
                self._fail(f"one of {', '.join(ALLEN)} is wanted, {self._found()}")
            names.append(self._take().value.lower())
        item = self._item(tuple(dict.fromkeys(names)))
        if item.negated or before.negated:
            self._fail(
                f"{names[0]!r} relates two items that happen; use '& !' for what must not",
                at,
            )
        return item

    def _item(self, link: tuple[str, ...]) -> Item:
        at = self._now.position
        negated = self._is("!")
        if negated:
            self._take()
        if self._now.kind != "name":
            self._fail(f"a relation, state or event is wanted, {self._found()}")
        name = self._name(self._take())
        terms = self._terms(name)
        count, open_ended = self._repeat() if self._is("{") else (1, False)
        bounds = self._bounds(name) if self._is("[") else ()
        if negated and (count > 1 or open_ended):
            self._fail("a negated item cannot be repeated", at)
        return Item(
            name,
            terms=terms,
            negated=negated,
            count=count,
            open_ended=open_ended,
            bounds=bounds,
            link=link,
            position=at,
        )

    def _name(self, token: _Token) -> str:
        lower = token.value.lower().replace("-", "_")
        if lower not in NAMES:
            close = difflib.get_close_matches(lower, NAMES, 1)
            hint = (
                f"; did you mean {close[0]!r}?"
                if close
                else "; `query --pattern list` shows what there is"
            )
            self._fail(
                f"no relation, state or event is called {token.value!r}{hint}",
                token.position,
            )
        return lower

    def _terms(self, name: str) -> tuple[Term, ...]:
        start = self._now.position
        self._want("(")
        places: list[Term] = []
        atom = ATOMS[name]
        while not self._is(")"):
            if places:
                self._want(",")
            place = atom.place(len(places))
            if place is None:
                self._fail(f"{name} takes {atom.arity()}")
            places.append(self._term(place))
        if len(places) < atom.least:
            self._fail(f"{name} takes {atom.arity()}", start)
        self._take()
        return tuple(places)

    def _term(self, place: ArgumentKind) -> Term:
        token = self._take()
        if place is ArgumentKind.TEXT:
            if token.kind == "text":
                return Term(text=token.value[1:-1], position=token.position)
            if token.kind == "name":
                return (
                    Term()
                    if token.value == "_"
                    else Term(text=token.value, position=token.position)
                )
            self._fail(
                "a zone's name is wanted, like bench or 'north door'", token.position
            )
        if token.kind == "number" and re.fullmatch(r"\d{1,9}", token.value):
            return Term(number=int(token.value), position=token.position)
        if token.kind == "name" and re.fullmatch(r"_|[a-z][a-z0-9_]*", token.value):
            return (
                Term()
                if token.value == "_"
                else Term(variable=token.value, position=token.position)
            )
        return self._fail(
            "a variable (like a), a target's id or '_' is wanted", token.position
        )

    def _repeat(self) -> tuple[int, bool]:
        self._take()
        at = self._now.position
        token = self._take()
        if token.kind != "number" or not 1 <= (whole(token.value) or 0) <= MAX_REPEAT:
            self._fail(f"how many in a row, 1 to {MAX_REPEAT}, is wanted", at)
        open_ended = self._is(",")
        if open_ended:
            self._take()
        self._want("}")
        return int(token.value), open_ended

    def _bounds(self, name: str) -> tuple[Bound, ...]:
        self._take()
        out = [self._bound(name)]
        while self._is(","):
            self._take()
            out.append(self._bound(name))
        self._want("]")
        return tuple(out)

    def _bound(self, name: str) -> Bound:
        at, what = self._now.position, "gap" if ATOMS[name].instant else "lasts"
        if self._now.kind == "name":
            if self._now.value.lower() not in ("gap", "lasts"):
                self._fail(f"'gap', 'lasts' or a comparison is wanted, {self._found()}")
            if self._now.value.lower() == "lasts" and ATOMS[name].instant:
                self._fail(f"{name} is a moment, it does not last")
            what = self._take().value.lower()
        if not self._is("<", "<=", ">", ">="):
            self._fail(f"'<', '<=', '>' or '>=' is wanted, {self._found()}")
        return Bound(what, self._take().value, self._time(), at)

    def _time(self) -> float:
        if self._now.kind != "number":
            self._fail(f"a time, like 30s, is wanted, {self._found()}")
        token = self._take()
        unit = "s"
        if self._now.kind == "name" and self._now.value.lower() in _UNITS:
            unit = self._take().value.lower()
        try:
            return duration(f"{token.value}{unit}")
        except UsageError as error:
            self._fail(str(error), token.position)

    def _check(self, pattern: Pattern) -> None:
        items = [item for step in pattern.steps for item in step]
        if len(items) > MAX_ITEMS:
            self._fail(f"more than {MAX_ITEMS} items", items[MAX_ITEMS].position)
        if all(item.negated for item in items):
            self._fail("something must happen: every item is negated", items[0].position)
        for step in pattern.steps:
            if step[0].negated and len(step) > 1:
                self._fail("put what happens first in a step: A & !B", step[0].position)
        for item in items:
            named = [
                term.variable or term.number
                for term in item.terms
                if term.variable is not None or term.number is not None
            ]
            if len(set(named)) < len(named):
                self._fail("the same target stands twice in one item", item.position)
        self._check_gaps(pattern)
        for one, two in zip(pattern.steps, pattern.steps[1:], strict=False):
            if one[0].negated and two[0].negated:
                self._fail(
                    "two negated steps beside one another; write them in two patterns",
                    two[0].position,
                )

    def _check_gaps(self, pattern: Pattern) -> None:
        """That every gap is one between two things."""
        for index, step in enumerate(pattern.steps):
            for item in step:
                gap = next((bound for bound in item.bounds if bound.what == "gap"), None)
                if gap is None or item.repeated:
                    continue
                if item.negated and len(step) > 1:
                    self._fail(
                        "what must not happen during a step has no gap to it", gap.position
                    )
                if not item.negated and index == 0:
                    self._fail(
                        f"nothing comes before {item.name}, so there is no gap to bound",
                        gap.position,
                    )
                if not item.negated and index == 1 and pattern.steps[0][0].negated:
                    self._fail(
                        f"nothing that happens comes before {item.name}: there is no gap to bound",
                        gap.position,
                    )


def variables_of(items: Sequence[Item]) -> list[str]:
    """Variables in these items, in order, without repeats."""
    return list(
        dict.fromkeys(
            term.variable
            for item in items
            for term in item.terms
            if term.variable is not None
        )
    )
