"""What patterns are made of: each atom's arguments, and the SELECT that gives its intervals.

A source has the columns ``recording, x0, x1, ..., s, e, st, et`` (targets, first and last frame,
their times) and, of groups and events, ``id``. The reference that explains a row is made of these
last, of the rows of the answer alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from reasoning.questions.literals import literal
from recorders.messages import EVENT_KINDS

_SPAN = "start_frame AS s, end_frame AS e, start_t AS st, end_t AS et"


class ArgumentKind(Enum):
    """What an argument is."""

    TARGET = "target"
    TEXT = "text"


@dataclass(frozen=True)
class Atom:
    """A relation, state or event.

    Attributes:
        about: one line for people.
        least, most: number of targets.
        zone: it has a zone's name as its last argument.
        symmetric: the order of its targets does not matter.
        instant: it is a moment, not an interval.
        source: SQL from the number of targets and the zone's name (None: any).
        one_way: of two targets whose order does not matter: SQL as ``source`` gives it, but with
            x0 < x1 alone.
        reference: SQL of the id that explains a row, with ``$n`` for the row's name.
    """

    about: str
    source: Callable[[int, str | None], str]
    reference: str
    least_targets: int = 2
    most_targets: int = 2
    zone: bool = False
    symmetric: bool = True
    instant: bool = False
    one_way: str | None = None

    @property
    def least(self) -> int:
        """Number of arguments that must be there."""
        return self.least_targets + self.zone

    def place(self, k: int) -> ArgumentKind | None:
        """What argument k is; None if there is none."""
        if k < self.most_targets:
            return ArgumentKind.TARGET
        return ArgumentKind.TEXT if self.zone and k == self.most_targets else None

    def arity(self) -> str:
        """For messages."""
        targets = (
            f"{self.least_targets}" if self.least_targets == self.most_targets
            else f"{self.least_targets} to {self.most_targets}"
        )  # fmt: skip
        return (
            f"{targets}"
            f" target{'s' if targets != '1' else ''}{' and a zone' if self.zone else ''}"
        )


def _pairs(about: str, table: str, condition: str, what: str) -> Atom:
    one_way, other_way = (
        f"SELECT recording, {x} AS x0, {y} AS x1, {_SPAN} FROM {table} WHERE {condition}"
        for x, y in (("a", "b"), ("b", "a"))
    )
    reference = (
        f"format('{what}:{{}}-{{}}@{{}}', least($n.x0, $n.x1), greatest($n.x0, $n.x1),"
        " $n.s)"
    )
    return Atom(
        about, lambda _, __: f"{one_way} UNION ALL {other_way}", reference, one_way=one_way
    )


def _state(table: str, zone: bool = False) -> Callable[[int, str | None], str]:
    def source(_: int, name: str | None) -> str:
        where = f" WHERE zone = {literal(name)}" if zone and name is not None else ""
        which = ", zone" if zone else ""
        return f"SELECT recording, track AS x0, {_SPAN}{which} FROM {table}{where}"

    return source


def _spread(rows: str, column: str, count: int) -> str:
    """Spread a list's different members over x0, x1, ... of rows; an UNNEST in a SELECT needs no
    join.
    """
    for index in range(count):
        rows = f"SELECT *, unnest({column}) AS x{index} FROM ({rows})"
        if index:
            different = " AND ".join(f"x{j} <> x{index}" for j in range(index))
            rows = f"SELECT * FROM ({rows}) WHERE {different}"
    return rows


def _targets(count: int) -> str:
    return "".join(f", x{index}" for index in range(count))


def _event(kind: str) -> Callable[[int, str | None], str]:
    def source(count: int, _: str | None) -> str:
        rows = _spread(
            f"SELECT * FROM events WHERE kind = {literal(kind)}", "subjects", count
        )
        return (
            f"SELECT recording{_targets(count)}, frame AS s, frame AS e, t AS st, t AS et, event AS id "
            f"FROM ({rows})"
        )

    return source


def _group(count: int, _: str | None) -> str:
    rows = _spread("SELECT * FROM groups", "members", count)
    return f"SELECT recording{_targets(count)}, {_SPAN}, group_id AS id FROM ({rows})"


def _bit(bit: str) -> Callable[[int, str | None], str]:
    def source(count: int, _: str | None) -> str:
        partner = ", unnest(partners) AS x1" if count > 1 else ""
        return f"SELECT recording, track AS x0{partner}, {_SPAN} FROM bits WHERE bit = {literal(bit)}"

    return source


def _one(what: str) -> str:
    return f"format('{what}:{{}}@{{}}', $n.x0, $n.s)"


_ZONE = "format('zone:{}@{}:{}', $n.x0, $n.s, url_encode($n.zone))"

_STATES: Mapping[str, Atom] = {
    "interaction": _pairs(
        "INTERACTION of two (SHELLS)", "relations", "state = 'INTERACTION'", "relation"
    ),
    "joint": _pairs("JOINT of two (SHELLS)", "relations", "state = 'JOINT'", "relation"),
    "related": _pairs("INTERACTION or JOINT", "relations", "true", "relation"),
    "together": _pairs(
        "an encounter of two, in hindsight", "encounters", "true", "encounter"
    ),
    "meeting": _pairs("two stand together", "phases", "kind = 'meeting'", "phase"),
    "moving": _pairs("two walk together", "phases", "kind = 'moving'", "phase"),
    "contact": _pairs(
        "two touch, abruptly or JOINT", "phases", "kind = 'contact'", "phase"
    ),
    "separation": _pairs(
        "two who were together walk apart", "phases", "kind = 'separation'", "phase"
    ),
    "abrupt": _pairs(
        "two touch, abrupt against one another, and do not go through",
        "abrupt",
        "true",
        "abrupt",
    ),
    "near": _pairs("two within touching distance", "near", "true", "near"),
    "group": Atom("members of one group", _group, "format('group:{}', $n.id)", 1, 4),
    "present": Atom("a target is in the picture", _state("presence"), _one("track"), 1, 1),
    "still": Atom("a target stands still", _state("still"), _one("still"), 1, 1),
    "in": Atom("a target is in a zone", _state("zones", zone=True), _ZONE, 1, 1, zone=True),
    "is_grouping": Atom(
        "grouping (with a partner)", _bit("grouping"), _one("track"), 1, 2, symmetric=False
    ),
    "is_grouped": Atom(
        "grouped (with a partner)", _bit("grouped"), _one("track"), 1, 2, symmetric=False
    ),
    "is_splitting": Atom(
        "splitting (from a partner)",
        _bit("splitting"),
        _one("track"),
        1,
        2,
        symmetric=False,
    ),
}
ATOMS: Mapping[str, Atom] = {
    **{
        kind: Atom(
            f"the event {kind}",
            _event(kind),
            "format('event:{}', $n.id)",
            0,
            4,
            instant=True,
        )
        for kind in EVENT_KINDS
        if kind not in _STATES
    },
    **_STATES,
}
NAMES: Sequence[str] = tuple(ATOMS)
