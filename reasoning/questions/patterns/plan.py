"""A pattern as one SELECT: its items' intervals, joined on recording and shared variables,
ordered in time.

Every item that is wanted becomes a common table; negated items become NOT EXISTS. No product of
tracks is made: a join is on the recording and on the variables that two items share, and DuckDB
orders the joins. Items of one pair that follow one another closely are joined before it matters
which of the two is which (`pairs`): one table ``p0`` of them, both ways round, with a column for
each item.
"""

from __future__ import annotations

from reasoning.questions.literals import Recordings
from reasoning.questions.patterns.atoms import ATOMS
from reasoning.questions.patterns.grammar import Bound, Item, Pattern, Term, parse
from reasoning.questions.patterns.pairs import one_way_groups
from reasoning.questions.patterns.symmetry import symmetries


def plan(text: str, recordings: Recordings | None = None) -> str:
    """The SQL of a pattern, or of the shipped pattern of that name.

    Rows: recording, one column per variable, first and last frame and time, ``step_frames``
    (first and last frame of each wanted item in order), and ``explain``.

    Raises:
        PatternError: it is no pattern.
    """
    return compile_pattern(parse(shipped_or_given(text)), recordings)


def shipped_or_given(text: str) -> str:
    """The shipped pattern of that name, or the text itself."""
    from reasoning.questions.patterns.shipped import SHIPPED

    name = text.strip().replace("-", "_")
    return SHIPPED[name].text if name in SHIPPED else text


def compile_pattern(pattern: Pattern, recordings: Recordings | None = None) -> str:
    """The SQL of a parsed pattern."""
    return _Plan(pattern, recordings).sql()


class _Plan:
    def __init__(self, pattern: Pattern, recordings: Recordings | None) -> None:
        self._pattern = pattern
        self._recordings = recordings
        self._tables: list[str] = []
        self._conditions: list[str] = []
        self._groups = {
            id(item): index
            for index, group in enumerate(one_way_groups(pattern))
            for item in group
        }
        self._joined: dict[int, list[str]] = {group: [] for group in self._groups.values()}
        self._from: list[str] = []
        self._names: dict[int, str] = {}
        self._references: list[str] = []
        self._bound: dict[str, str] = {}
        for step in pattern.steps:
            for item in step:
                if not item.negated:
                    self._add(item)

    def _add(self, item: Item) -> None:
        own = f"i{len(self._names)}"
        group = self._groups.get(id(item))
        table = own if group is None else f"p{group}"
        name = own if group is None else f"{table}.{own}"
        self._names[id(item)] = name
        self._tables.append(f"{own} AS (\n  {self._source(item)})")
        self._references.append(
            f"{name}.ref"
            if item.repeated
            else ATOMS[item.name].reference.replace("$n", name)
        )
        if table in self._from:
            return  # joined with the others of its pair
        self._from.append(table)
        if table != self._from[0]:
            self._conditions.append(f"{table}.recording = {self._from[0]}.recording")
        for index, term in enumerate(item.terms):
            if term.variable is None:
                continue
            column = f"{table}.x{index}"
            if term.variable in self._bound:
                self._conditions.append(f"{column} = {self._bound[term.variable]}")
            else:
                self._conditions += [
                    f"{column} <> {other}" for other in self._bound.values()
                ]
                self._conditions += [f"{column} <> {number}" for number in self._numbers()]
                self._bound[term.variable] = column

    def _require(self, condition: str, *items: Item) -> None:
        """A condition on the times of some items: if they are all of one pair's, it is met where
        those are joined.
        """
        groups = {self._groups.get(id(item)) for item in items}
        group = groups.pop()
        if groups or group is None:
            self._conditions.append(condition)
        else:
            self._joined[group].append(condition.replace(f"p{group}.", ""))

    def _pair(self, group: int) -> str:
        """The table of a pair's items: both ways round, a column for each item."""
        first, *others = names = [
            name.partition(".")[2]
            for name in self._names.values()
            if name.startswith(f"p{group}.")
        ]
        same = [
            f"{other}.{c} = {first}.{c}"
            for other in others
            for c in ("recording", "x0", "x1")
        ]
        return (
            f"p{group} AS (\n  SELECT {first}.recording, unnest([{first}.x0, {first}.x1]) AS x0, "
            f"unnest([{first}.x1, {first}.x0]) AS x1, {', '.join(names)}\n  FROM"
            f" {', '.join(names)}\n  "
            f"WHERE {' AND '.join([*same, *self._joined[group]])})"
        )

    def _numbers(self) -> list[int]:
        """Ids that the pattern names: no variable stands for them."""
        return sorted(
            {
                term.number
                for step in self._pattern.steps
                for i in step
                for term in i.terms
                if term.number is not None
            }
        )

    def _source(self, item: Item) -> str:
        targets = [
            term
            for term in item.terms
            if term.text is None and not self._is_zone(item, term)
        ]
        zone = next((term.text for term in item.terms if term.text is not None), None)
        wanted = [
            f"x{index} = {target.number}"
            for index, target in enumerate(targets)
            if target.number is not None
        ]
        wanted += [
            _compared("et - st", bound) for bound in item.bounds if bound.what == "lasts"
        ]
        if self._recordings is not None:
            wanted.append(self._recordings.sql())
        atom = ATOMS[item.name]
        one_way = atom.one_way if id(item) in self._groups else None
        rows = f"SELECT * FROM ({one_way or atom.source(len(targets), zone)})"
        if wanted:
            rows += f" WHERE {' AND '.join(wanted)}"
        if not item.repeated:
            return rows
        rows = f"SELECT *, {atom.reference.replace('$n', 'r')} AS ref FROM ({rows}) r"
        return _in_a_row(rows, [f"x{index}" for index in range(len(targets))], item)

    @staticmethod
    def _is_zone(item: Item, term: Term) -> bool:
        return ATOMS[item.name].zone and term is item.terms[-1]

    def sql(self) -> str:
        spans = self._steps()
        self._symmetry()
        wanted = list(self._names.values())
        first, last = (
            _least([f"{n}.s" for n in wanted]),
            _greatest([f"{n}.e" for n in wanted]),
        )
        first_t, last_t = (
            _least([f"{n}.st" for n in wanted]),
            _greatest([f"{n}.et" for n in wanted]),
        )
        if self._pattern.within_s is not None:
            self._conditions.append(
                _compared(
                    f"{last_t} - {first_t}", Bound("lasts", "<=", self._pattern.within_s)
                )
            )
        self._absences(spans)
        columns = [f"{column} AS {_quoted(name)}" for name, column in self._bound.items()]
        columns += [
            f"{first} AS start_frame",
            f"{last} AS end_frame",
            f"{first_t} AS start_t",
            f"{last_t} AS end_t",
        ]
        columns.append(
            "[" + ", ".join(f"[{n}.s, {n}.e]" for n in wanted) + "] AS step_frames"
        )
        columns.append("concat_ws(' ', " + ", ".join(self._references) + ") AS explain")
        conditions = "\n  AND ".join(self._conditions) or "true"
        order = ", ".join(
            [
                "1",
                *(_quoted(variable) for variable in self._bound),
                "step_frames",
                "explain",
            ]
        )
        return (
            "WITH " + ",\n".join(self._tables + [self._pair(k) for k in self._joined])
            + f"\nSELECT DISTINCT {self._from[0]}.recording, " + ",\n  ".join(columns)
            + "\nFROM " + ", ".join(self._from) + "\nWHERE " + conditions + f"\nORDER BY {order}"
        )  # fmt: skip

    def _steps(self) -> list[tuple[str, str, str, str] | None]:
        """Each step's span (s, e, st, et) as SQL, None for a negated one; adds what orders items
        and steps.
        """
        spans: list[tuple[str, str, str, str] | None] = []
        previous: tuple[str, str, str, str] | None = None
        before: list[Item] = []
        for step in self._pattern.steps:
            items = [i for i in step if not i.negated]
            if not items:
                spans.append(None)
                continue
            self._within_step(items)
            names = [self._names[id(item)] for item in items]
            span = (
                _least([f"{name}.s" for name in names]), _greatest([f"{name}.e" for name in names]),
                _least([f"{name}.st" for name in names]), _greatest([f"{name}.et" for name in names]),
            )  # fmt: skip
            if previous is not None:
                self._require(f"{span[0]} > {previous[1]}", *before, *items)
                for i in (item for item in items if not item.repeated):
                    for b in (bound for bound in i.bounds if bound.what == "gap"):
                        self._require(
                            _compared(f"{self._names[id(i)]}.st - {previous[3]}", b),
                            *before,
                            i,
                        )
            spans.append(span)
            previous, before = span, items
        return spans

    def _within_step(self, items: list[Item]) -> None:
        for index, item in enumerate(items[1:], 1):
            name = self._names[id(item)]
            if item.link == ("&",):
                for other in items[:index]:
                    n = self._names[id(other)]
                    self._require(f"{n}.s <= {name}.e AND {name}.s <= {n}.e", other, item)
            else:
                n = self._names[id(items[index - 1])]
                either = " OR ".join(
                    f"allen_{r}({n}.s, {n}.e, {name}.s, {name}.e)" for r in item.link
                )
                self._require(f"({either})", items[index - 1], item)

    def _absences(self, spans: list[tuple[str, str, str, str] | None]) -> None:
        for index, step in enumerate(self._pattern.steps):
            span = spans[index]
            for item in (i for i in step if i.negated):
                if span is not None:
                    window = [f"n.s <= {span[1]}", f"n.e >= {span[0]}"]
                else:
                    window = self._between(spans, index, item)
                self._conditions.append(self._none(item, window))

    @staticmethod
    def _between(
        spans: list[tuple[str, str, str, str] | None], k: int, item: Item
    ) -> list[str]:
        """What makes an interval ``n`` touch the time between the steps beside a negated one."""
        before = spans[k - 1] if k > 0 else None
        after = spans[k + 1] if k + 1 < len(spans) else None
        gaps = [bound for bound in item.bounds if bound.what == "gap"]
        window = []
        if before is not None:
            window.append(f"n.e > {before[1]}")
            window += [_compared(f"n.st - {before[3]}", gap) for gap in gaps]
        if after is not None:
            window.append(f"n.s < {after[0]}")
            if before is None:
                window += [_compared(f"{after[2]} - n.et", gap) for gap in gaps]
        return window

    def _none(self, item: Item, window: list[str]) -> str:
        conditions = [f"n.recording = {self._from[0]}.recording", *window]
        free: dict[str, str] = {}
        for index, term in enumerate(item.terms):
            if term.variable is None:
                continue
            if term.variable in self._bound:
                conditions.append(f"n.x{index} = {self._bound[term.variable]}")
            else:
                others = [*self._bound.values(), *free.values(), *map(str, self._numbers())]
                conditions += [f"n.x{index} <> {other}" for other in others]
                free[term.variable] = f"n.x{index}"
        return f"NOT EXISTS (SELECT 1 FROM ({self._source(item)}) n WHERE {' AND '.join(conditions)})"

    def _symmetry(self) -> None:
        """Where renaming variables does not change the pattern, a match is told once: the least
        ids first.
        """
        conditions: dict[str, None] = {}
        for renamed in symmetries(self._pattern):
            # Two variables are never the same target: the first one that moves decides which
            # telling is the least.
            first = next(
                variable for variable in self._bound if renamed[variable] != variable
            )
            conditions[f"{self._bound[first]} < {self._bound[renamed[first]]}"] = None
        self._conditions += conditions


def _in_a_row(rows: str, keys: list[str], item: Item) -> str:
    """``count`` (or more) of one item for the same targets: each starts after the one before has
    ended.
    """
    gaps = [bound for bound in item.bounds if bound.what == "gap"]
    part = f"PARTITION BY {', '.join(['recording', *keys])} ORDER BY s, e, ref"
    follows = " AND ".join(
        ["s > lag(e) OVER w", *(_compared("st - lag(et) OVER w", gap) for gap in gaps)]
    )
    targets = "".join(f", {key}" for key in keys)
    marked = f"SELECT *, coalesce({follows}, false) AS follows FROM ({rows}) WINDOW w AS ({part})"
    if item.open_ended:
        runs = f"SELECT *, sum((NOT follows)::INTEGER) OVER ({part}) AS run FROM ({marked})"
        return (
            f"SELECT recording{targets}, min(s) AS s, max(e) AS e, min(st) AS st, max(et) AS et, "
            f"string_agg(ref, ' ' ORDER BY s, e, ref) AS ref FROM ({runs}) GROUP BY"
            f" recording{targets}, run "
            f"HAVING count(*) >= {item.count}"
        )
    more = item.count - 1
    return (
        f"SELECT recording{targets}, s, e2 AS e, st, et2 AS et, ref2 AS ref FROM (SELECT *, "
        f"lead(e, {more}) OVER w AS e2, lead(et, {more}) OVER w AS et2, "
        f"sum(follows::INTEGER) OVER (w ROWS BETWEEN 1 FOLLOWING AND {more} FOLLOWING) AS"
        " linked, "
        f"string_agg(ref, ' ') OVER (w ROWS BETWEEN CURRENT ROW AND {more} FOLLOWING) AS"
        " ref2 "
        f"FROM ({marked}) WINDOW w AS ({part})) WHERE linked = {more}"
    )


def _compared(value: str, bound: Bound) -> str:
    # To the millisecond, as times are shown.
    return f"round({value}, 3) {bound.compare} {bound.seconds!r}"


def _least(values: list[str]) -> str:
    return values[0] if len(values) == 1 else f"least({', '.join(values)})"


def _greatest(values: list[str]) -> str:
    return values[0] if len(values) == 1 else f"greatest({', '.join(values)})"


def _quoted(name: str) -> str:
    return f'"{name}"'
