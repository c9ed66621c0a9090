"""Patterns against a matcher that tries everything, on a thousand small histories; errors that
point at the place.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from reasoning.questions import Case
from reasoning.questions.duckdb_tables import insert
from reasoning.questions.literals import only
from reasoning.questions.macros import ALLEN, macro_statements
from reasoning.questions.patterns import (
    ATOMS,
    SHIPPED,
    PatternError,
    compile_pattern,
    parse,
    plan,
)
from reasoning.questions.patterns.grammar import Bound, Item, Pattern
from reasoning.questions.schema import create_statements
from tests.examples import examples

FPS = 10.0
# (targets, first frame, last frame)
Found = tuple[tuple[int, ...], int, int]
History = dict[str, list[Found]]

# Each pattern, and which orders of its variables say the same (by hand; all but the one that they
# are read in): a match is told in one of them.
SAME: dict[str, tuple[str, ...]] = {
    "joint(a,b)": ("ba",),
    "interaction(a,b) ; joint(a,b)": ("ba",),
    "interaction(a,b) ; joint(a,b)[>0.3s] ; exited(a)[<2s]": (),
    "interaction(a,b) ; joint(a,b)[>=0.2s] ; exited(a)[<30s] ; !together(b,c)": (),
    "joint(a,b) & in(a,door)": (),
    "joint(a,b) during together(a,b)": ("ba",),
    "joint(a,b) overlaps|meets|starts together(a,c)": (),
    "in(a,door) ; !joint(a,_) ; exited(a)": (),
    "!joint(a,b)[gap<1s] ; exited(a) & in(b,door)": (),
    "joint(a,b) & !in(a,door)": (),
    "related(a,b){2}": ("ba",),
    "related(a,b){2,}[gap<1s]": ("ba",),
    "interaction(a,b){3} ; exited(_)": ("ba",),
    "joint(a,1) ; joint(a,b)": (),
    "joint(a,b) ; joint(b,c) ; joint(c,a)": (),
    "joint(a,b) ; joint(b,c) within 2s": (),
    "exited(a) ; in(b,'door')[gap<=0.5s, lasts>0.1s]": (),
    "in(a,_) & in(b,_) & in(c,_)": ("acb", "bac", "bca", "cab", "cba"),
    "interaction(a,b) meets joint(a,b) ; !exited(c)[<1s]": ("ba",),
    "joint(_,_)": (),
    "in(a,door) & in(b,door)": ("ba",),
    "related(a,b) & related(b,c)": ("cba",),
    "in(b,door) & related(a,b) & in(a,door)": ("ab",),
    "in(a,door) & in(b,door)[>0.3s]": (),
    "related(a,b) & related(c,d)": ("abdc", "bacd", "badc", "cdab", "cdba", "dcab", "dcba"),
    "in(a,door) equals|overlaps|overlapped_by in(b,door)": ("ba",),
    "in(a,door) overlaps in(b,door)": (),
    "in(a,door) & in(b,door) ; exited(c)[<1s] & !related(a,b)": ("bac",),
    "joint(a,b) ; exited(a)[<1s] & in(c,door)[gap<3s]": (),
    "in(a,door) ; exited(b)[gap>0.5s] ; !joint(a,b)": (),
    # of one pair, soon after one another
    "interaction(a,b) ; joint(a,b)[gap<1s] ; exited(a)[<2s]": (),
    "interaction(a,b) ; joint(b,a)[gap<=0.5s] ; !together(b,c)": (),
    "interaction(a,b) ; joint(a,b)[gap<1s] within 2s": ("ba",),
    "related(a,b) & together(b,a) & in(b,door)": (),
    "related(a,b){2} ; related(a,b)[gap<1s]": ("ba",),
    "in(a,door) & !present(b) ; joint(a,b) & together(a,b)": (),
    "related(1,b) ; joint(1,b)[gap<1s] & !in(b,door)": (),
    "together(a,b) & joint(a,b) ; related(a,c) & !joint(b,c)": (),
}
PATTERNS = tuple(SAME)


def histories(count: int, seed: int) -> dict[str, History]:
    rng = np.random.default_rng(seed)
    out: dict[str, History] = {}
    for h in range(count):
        history: History = defaultdict(list)
        for name, most in (("interaction", 4), ("joint", 4), ("together", 2)):
            for _ in range(int(rng.integers(0, most + 1))):
                a, b = sorted(int(v) for v in rng.choice(4, 2, replace=False))
                s = int(rng.integers(0, 24))
                row = ((a, b), s, s + int(rng.integers(0, 9)))
                # One pair is in one state at a time, and one encounter does not begin within
                # another.
                others = (
                    history["interaction"] + history["joint"]
                    if name != "together"
                    else history[name]
                )
                if not any(
                    p == row[0] and s1 <= row[2] and row[1] <= e1 for p, s1, e1 in others
                ):
                    history[name].append(row)
        for _ in range(int(rng.integers(0, 4))):
            a, s = int(rng.integers(0, 4)), int(rng.integers(0, 24))
            stay = ((a,), s, s + int(rng.integers(0, 9)))
            if not any(
                p == (a,) and s1 <= stay[2] and stay[1] <= e1 for p, s1, e1 in history["in"]
            ):
                history["in"].append(stay)
        for a in rng.permutation(4)[: int(rng.integers(0, 3))].tolist():
            n = int(rng.integers(5, 34))
            history["exited"].append(((int(a),), n, n))
        out[f"h{h}"] = history
    return out


EITHER_WAY = ("interaction", "joint", "related", "together")


def occurrences(history: History, item: Item) -> list[Found]:
    """All that one item can be, in every order of its targets."""
    names = {"related": ("interaction", "joint")}.get(item.name, (item.name,))
    rows = [r for name in names for r in history.get(name, [])]
    if item.name in EITHER_WAY:
        rows = [(p, s, e) for (a, b), s, e in rows for p in ((a, b), (b, a))]
    rows = [
        r
        for r in rows
        if all(_holds(b, (r[2] - r[1]) / FPS) for b in item.bounds if b.what == "lasts")
    ]
    numbers = [(k, t.number) for k, t in enumerate(item.terms) if t.number is not None]
    rows = [r for r in rows if all(r[0][k] == n for k, n in numbers)]
    return _in_a_row(rows, item) if item.repeated else rows


def _in_a_row(rows: list[Found], item: Item) -> list[Found]:
    by_targets: dict[tuple[int, ...], list[Found]] = defaultdict(list)
    for row in rows:
        by_targets[row[0]].append(row)
    out = []
    gaps = [b for b in item.bounds if b.what == "gap"]
    for targets, mine in by_targets.items():
        mine.sort(key=lambda r: (r[1], r[2]))
        runs: list[list[Found]] = []
        for row in mine:
            last = runs[-1][-1] if runs else None
            if (
                last is not None
                and row[1] > last[2]
                and all(_holds(b, (row[1] - last[2]) / FPS) for b in gaps)
            ):
                runs[-1].append(row)
            else:
                runs.append([row])
        for run in runs:
            if item.open_ended:
                if len(run) >= item.count:
                    out.append((targets, run[0][1], max(r[2] for r in run)))
            else:
                out += [
                    (targets, run[k][1], run[k + item.count - 1][2])
                    for k in range(len(run) - item.count + 1)
                ]
    return out


def _holds(bound: Bound, value: float) -> bool:
    value = round(value, 3)
    return {
        "<": value < bound.seconds, "<=": value <= bound.seconds,
        ">": value > bound.seconds, ">=": value >= bound.seconds,
    }[bound.compare]  # fmt: skip


def allen(s1: int, e1: int, s2: int, e2: int) -> str:
    """Allen's relation of closed frame intervals, by the ends of the half-open ones."""
    a, b, c, d = s1, e1 + 1, s2, e2 + 1
    if b < c:
        return "before"
    if b == c:
        return "meets"
    if d < a:
        return "after"
    if d == a:
        return "met_by"
    if a == c:
        return "equals" if b == d else "starts" if b < d else "started_by"
    if b == d:
        return "finishes" if a > c else "finished_by"
    if a < c:
        return "overlaps" if b < d else "includes"
    return "during" if b < d else "overlapped_by"


def bind(
    bound: dict[str, int], item: Item, targets: tuple[int, ...], numbers: set[int]
) -> dict[str, int] | None:
    """The bindings with this occurrence's targets, None where they clash."""
    out = dict(bound)
    for term, target in zip(item.terms, targets, strict=False):
        if term.variable is None:
            continue
        if term.variable in out:
            if out[term.variable] != target:
                return None
        elif target in out.values() or target in numbers:
            return None
        else:
            out[term.variable] = target
    return out


def variables(pattern: Pattern) -> list[str]:
    """Variables that stand in something that happens, as they are first read."""
    read = [
        t.variable
        for s in pattern.steps
        for i in s
        if not i.negated
        for t in i.terms
        if t.variable is not None
    ]
    return list(dict.fromkeys(read))


def told_once(matches: set[tuple], pattern: Pattern, orders: Sequence[str]) -> set[tuple]:
    """Of the tellings of one match the one with the least ids."""
    names = variables(pattern)
    out = set()
    for ids, spans in matches:
        value = dict(zip(names, ids, strict=True))
        # Read in another order: the variable that stands at a place there takes the id of this
        # place here.
        others = [tuple(value[v] for v in order) for order in orders]
        if all(ids <= other for other in others):
            out.add((ids, spans))
    return out


def by_brute_force(pattern: Pattern, history: History) -> set[tuple]:
    """Every way in which targets fit, each telling of it."""
    numbers = {
        t.number for s in pattern.steps for i in s for t in i.terms if t.number is not None
    }
    wanted = [i for s in pattern.steps for i in s if not i.negated]
    found = set()
    for chosen in itertools.product(*(occurrences(history, i) for i in wanted)):
        bound: dict[str, int] | None = {}
        for item, row in zip(wanted, chosen, strict=True):
            bound = bind(bound or {}, item, row[0], numbers)
            if bound is None:
                break
        if bound is None or not fits(
            pattern,
            history,
            dict(zip(map(id, wanted), chosen, strict=True)),
            bound,
            numbers,
        ):
            continue
        found.add(
            (
                tuple(bound[v] for v in variables(pattern)),
                tuple((r[1], r[2]) for r in chosen),
            )
        )
    return found


def fits(
    pattern: Pattern,
    history: History,
    chosen: dict[int, Any],
    bound: dict[str, int],
    numbers: set[int],
) -> bool:
    spans: list[tuple[int, int] | None] = []
    previous = None
    for step in pattern.steps:
        items = [i for i in step if not i.negated]
        if not items:
            spans.append(None)
            continue
        rows = [chosen[id(i)] for i in items]
        for k in range(1, len(items)):
            if items[k].link == ("&",):
                if any(r[1] > rows[k][2] or rows[k][1] > r[2] for r in rows[:k]):
                    return False
            elif (
                allen(rows[k - 1][1], rows[k - 1][2], rows[k][1], rows[k][2])
                not in items[k].link
            ):
                return False
        span = (min(r[1] for r in rows), max(r[2] for r in rows))
        if previous is not None:
            if span[0] <= previous[1]:
                return False
            for i in items:
                gaps = [] if i.repeated else [b for b in i.bounds if b.what == "gap"]
                if not all(
                    _holds(b, chosen[id(i)][1] / FPS - previous[1] / FPS) for b in gaps
                ):
                    return False
        spans.append(span)
        previous = span
    whole = [s for s in spans if s is not None]
    if (
        pattern.within_s is not None
        and round((whole[-1][1] - whole[0][0]) / FPS, 3) > pattern.within_s
    ):
        return False
    return not any(
        happens(history, i, k, spans, bound, numbers)
        for k, step in enumerate(pattern.steps) for i in step if i.negated
    )  # fmt: skip


def happens(
    history: History,
    item: Any,
    k: int,
    spans: Sequence[Any],
    bound: dict[str, int],
    numbers: set[int],
) -> bool:
    for targets, s, e in occurrences(history, item):
        if bind(bound, item, targets, numbers) is None:
            continue
        if spans[k] is not None:
            if s <= spans[k][1] and e >= spans[k][0]:
                return True
            continue
        before = spans[k - 1] if k > 0 else None
        after = spans[k + 1] if k + 1 < len(spans) else None
        gaps = [b for b in item.bounds if b.what == "gap"]
        inside = (before is None or e > before[1]) and (after is None or s < after[0])
        if before is not None:
            inside = inside and all(_holds(b, s / FPS - before[1] / FPS) for b in gaps)
        elif after is not None:
            inside = inside and all(_holds(b, after[0] / FPS - e / FPS) for b in gaps)
        if inside:
            return True
    return False


SURE: tuple[float, float, float, list[int]] = (1.0, 1.0, 1.0, [])


def load(made: dict[str, History]) -> duckdb.DuckDBPyConnection:
    con = duckdb.connect(":memory:", config={"threads": "1"})
    for statement in [*create_statements(), *macro_statements()]:
        con.execute(statement)
    for name, history in made.items():
        for state in ("interaction", "joint"):
            insert(
                con,
                "relations",
                [
                    (name, *p, state.upper(), s, e, s / FPS, e / FPS, *SURE, 0.0)
                    for p, s, e in history[state]
                ],
            )
        insert(
            con,
            "encounters",
            [
                (name, *p, "meeting", s, e, s / FPS, e / FPS, 0.5, 1.0, 1.0, 1.0, [])
                for p, s, e in history["together"]
            ],
        )
        insert(
            con,
            "zones",
            [
                (name, *p, "door", s, e, s / FPS, e / FPS, *SURE)
                for p, s, e in history["in"]
            ],
        )
        insert(con, "events", [(name, k, "exited", s, s / FPS, list(p), "", "{}", "", *SURE)
                               for k, (p, s, _) in enumerate(history["exited"])])  # fmt: skip
    return con


def test_a_thousand_histories_match_as_brute_force_says() -> None:
    matched = dict.fromkeys(PATTERNS, 0)
    for part in range(4):
        made = histories(250, seed=part)
        con = load(made)
        for text in PATTERNS[part::4] if part else PATTERNS:
            pattern = parse(text)
            got: dict[str, list] = {name: [] for name in made}
            count = len(variables(pattern))
            for row in con.execute(compile_pattern(pattern)).fetchall():
                steps = tuple(tuple(span) for span in row[-2])
                got[row[0]].append((tuple(row[1 : 1 + count]), steps))
            for name, history in made.items():
                every = by_brute_force(pattern, history)
                assert all(
                    same_match_is_there(ids, spans, every, pattern, SAME[text])
                    for ids, spans in every
                ), text
                wanted = told_once(every, pattern, SAME[text])
                assert set(got[name]) == wanted, (text, name, dict(history))
                if "_" not in text:  # of anybody there may be several over the same spans
                    assert len(got[name]) == len(wanted), (text, name)
                matched[text] += len(wanted)
        con.close()
    assert min(matched.values()) > 0, matched


def same_match_is_there(
    ids: Sequence[int],
    spans: Sequence[Any],
    every: set[tuple],
    pattern: Pattern,
    orders: Sequence[str],
) -> bool:
    """That the table of orders above is right: each other telling is a match over the same spans."""
    value = dict(zip(variables(pattern), ids, strict=True))
    others = [tuple(value[v] for v in order) for order in orders]
    return all(
        any(i == other and sorted(s) == sorted(spans) for i, s in every) for other in others
    )


@pytest.mark.parametrize("text", PATTERNS)
def test_no_other_order_of_variables_says_the_same(text: str) -> None:
    """That the table of orders above is whole, shown by histories: in one of them the other
    telling is no match.
    """
    pattern = parse(text)
    names = variables(pattern)
    orders = {"".join(o) for o in itertools.permutations(names)} - {
        "".join(names),
        *SAME[text],
    }
    for history in histories(2000, seed=9).values() if orders else ():
        every = by_brute_force(pattern, history)
        orders -= {
            o
            for o in orders
            if not all(same_match_is_there(i, s, every, pattern, [o]) for i, s in every)
        }
        if not orders:
            break
    assert not orders


def test_matches_that_say_the_same_are_told_once(meeting_log: Path) -> None:
    with Case([meeting_log]) as case:
        for text in ("present(a) & present(b)", "related(a,b) & related(b,c)"):
            rows = [(frozenset(r[1:-6]), *r[-6:-2]) for r in case.rows(plan(text))]
            assert rows
            assert len(rows) == len(set(rows)), text
        together = [tuple(r[1:3]) for r in case.rows(plan("present(a) & present(b)"))]
        assert together == [(1, 2), (1, 3), (1, 4), (2, 3), (2, 4), (3, 4)]


def test_the_issues_own_example(meeting_log: Path) -> None:
    text = "INTERACTION(a,b) ; JOINT(a,b)[>2s] ; exited(a)[<30s] ; !together(b,c)"
    with Case([meeting_log]) as case:
        answer = case.sql(plan(text))
        assert answer.columns == ["recording", "a", "b", "start_frame", "end_frame", "start_t", "end_t", "step_frames",
                                  "explain"]  # fmt: skip
        assert list(answer.rows) == [
            ("meeting", 3, 4, 150, 280, 6.0, 11.2, [[150, 169], [170, 240], [280, 280]],
             "relation:3-4@150 relation:3-4@170 event:13"),
        ]  # fmt: skip
        assert case.rows(plan(text, only("other"))) == []


def test_shipped_patterns_run(meeting_log: Path) -> None:
    assert {"meeting", "moving", "fighting", "leaving_object"} <= set(SHIPPED)
    with Case([meeting_log]) as case:
        for name in SHIPPED:
            case.rows(plan(name))
        assert case.rows(plan("changed-company")) == case.rows(plan("changed_company"))
        assert [r[1:4] for r in case.rows(plan("changed_company"))] == [(2, 1, 3)]


def test_every_atom_plans(meeting_log: Path) -> None:
    with Case([meeting_log]) as case:
        for name, atom in ATOMS.items():
            for count in range(atom.least_targets, atom.most_targets + 1):
                terms = [*"abcd"[:count], *(["door"] if atom.zone else [])]
                case.rows(plan(f"{name}({','.join(terms)})"))


@pytest.mark.parametrize(
    ("text", "position", "said"),
    [
        ("", 0, "wanted"),
        ("joint(a,b", 9, "',' is wanted"),
        ("joint a,b)", 6, "'(' is wanted"),
        ("join(a,b)", 0, "did you mean 'joint'"),
        ("joint(a,b)[>2q]", 13, "']' is wanted"),
        ("joint(a,b)[>]", 12, "a time"),
        ("joint(a,b)[2s]", 11, "'<'"),
        ("joint(a,b) ; ;", 13, "a relation"),
        ("joint(a,b) joint(b,c)", 11, "';', '&'"),
        ("!joint(a,b)", 0, "something must happen"),
        ("!joint(a,b) & exited(a)", 0, "first in a step"),
        ("joint(a,b) ; !exited(a) ; !exited(b) ; joint(a,b)", 26, "two negated"),
        ("joint(a,b) during !exited(a)", 11, "relates two items"),
        ("joint(a,a)", 0, "twice"),
        ("joint(3,3)", 0, "twice"),
        ("in(a)", 2, "1 target and a zone"),
        ("in(a,3)", 5, "zone's name"),
        ("joint(a,b,c)", 10, "2 targets"),
        ("joint(A,b)", 6, "a variable"),
        ("joint(a,b){0}", 11, "how many"),
        ("joint(a,b){x}", 11, "how many"),
        ("!joint(a,b){2} ; exited(a)", 0, "cannot be repeated"),
        ("exited(a)[lasts>2s]", 10, "does not last"),
        ("joint(a,b) # c", 11, "means nothing"),
        ("joint(a,b) starts| joint(a,b)", 19, "one of before"),
        ("joint(a,b) within", 17, "a time"),
        ("joint(a,b)[<99999999999s]", 12, "at most 1e9"),
        ("exited(a)[>1000s]", 10, "nothing comes before exited"),
        ("joint(a,b)[>1s, gap<3s] ; exited(a)", 16, "nothing comes before joint"),
        ("!joint(a,b) ; exited(a)[<3s]", 24, "nothing that happens comes before exited"),
        ("joint(a,b) & !present(c)[gap<1s]", 25, "no gap"),
    ],
)
def test_errors_point_at_the_character(text: str, position: int, said: str) -> None:
    with pytest.raises(PatternError) as caught:
        parse(text)
    assert said in str(caught.value)
    assert caught.value.position == position
    lines = str(caught.value).splitlines()
    assert lines[-1].index("^") == 2 + position


def read_or_refused(text: str) -> Pattern | PatternError:
    try:
        return parse(text)
    except PatternError as e:
        return e


WORDS = st.sampled_from(
    [*";&!(),{}[]<>|", "joint", "interaction", "exited", "in", "together", "a", "b", "_", "3", "2s", "0.5", "gap",
     "lasts", "within", "during", "starts", "'door'", "door", "{2,}", "[<3s]", "(a,b)", " ", "\n", "é", "\x00", '"'],
)  # fmt: skip


@given(st.one_of(st.lists(WORDS, max_size=14).map("".join), st.text(max_size=40)))
@settings(max_examples=examples(600), deadline=None)
def test_fuzzed_patterns_are_read_or_refused_at_a_place(text: str) -> None:
    answer = read_or_refused(text)
    if isinstance(answer, PatternError):
        assert 0 <= answer.position <= len(text)
    else:
        assert compile_pattern(answer).startswith("WITH i0 AS")


@given(st.data())
@settings(max_examples=examples(150), deadline=None)
def test_mutilated_patterns_are_read_or_refused(data: st.DataObject) -> None:
    text = data.draw(st.sampled_from(PATTERNS))
    at = data.draw(st.integers(0, len(text)))
    cut = data.draw(st.integers(0, 4))
    added = data.draw(
        st.sampled_from(["", ";", "(", ")", "&", "!", "[", "{", "|", "a", "9", "'"])
    )
    mutilated = text[:at] + added + text[at + cut :]
    answer = read_or_refused(mutilated)
    assert isinstance(answer, Pattern) or answer.position <= len(mutilated)


def test_limits() -> None:
    with pytest.raises(PatternError, match="longer than"):
        parse("joint(a,b) ; " * 200 + "joint(a,b)")
    with pytest.raises(PatternError, match="more than 24 items"):
        parse(" ; ".join(["joint(a,b)"] * 30))


def test_allen_names_agree() -> None:
    assert {allen(*spans) for spans in itertools.product(range(4), repeat=4) if spans[0] <= spans[1]
            and spans[2] <= spans[3]} == set(ALLEN)  # fmt: skip
