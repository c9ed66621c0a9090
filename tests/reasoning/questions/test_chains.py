"""Contact chains against a search of every path, on a thousand random temporal graphs."""

from __future__ import annotations

from typing import Any

import duckdb
import numpy as np
import pytest

from reasoning.questions.duckdb_tables import insert
from reasoning.questions.literals import Moment
from reasoning.questions.ready_questions import Options, question
from reasoning.questions.schema import create_statements

Contact = tuple[int, int, int, int]


def earliest_by_brute_force(
    contacts: list[Contact], source: int, depth: int, since: float
) -> dict[int, tuple[int, int]]:
    """Earliest arrival over at most ``depth`` contacts, by walking every path; with the fewest
    contacts for it.
    """
    best: dict[int, tuple[float, int]] = {}

    def walk(track: int, t: float, hops: int) -> None:
        if hops == depth:
            return
        for a, b, start, end in contacts:
            for giver, taker in ((a, b), (b, a)):
                if giver == track and end >= t and taker != source:
                    arrival = max(t, start)
                    if taker not in best or (arrival, hops + 1) < best[taker]:
                        best[taker] = (arrival, hops + 1)
                    walk(taker, arrival, hops + 1)

    walk(source, since, 0)
    return {k: (int(t), hops) for k, (t, hops) in best.items()}


def graphs(count: int, seed: int) -> dict[str, list[Contact]]:
    rng = np.random.default_rng(seed)
    out = {}
    for g in range(count):
        people = int(rng.integers(2, 6))
        contacts = set()
        for _ in range(int(rng.integers(0, 7))):
            a, b = sorted(int(v) for v in rng.choice(people, 2, replace=False))
            start = int(rng.integers(0, 20))
            contacts.add((a, b, start, start + int(rng.integers(0, 8))))
        out[f"g{g}"] = sorted(contacts)
    return out


@pytest.mark.parametrize(("depth", "since"), [(1, None), (2, None), (3, 6.0), (5, None)])
def test_chains_equal_a_search_of_every_path(depth: int, since: float | None) -> None:
    made = graphs(250, seed=depth)
    with duckdb.connect(":memory:", config={"threads": "1"}) as con:
        for statement in create_statements():
            con.execute(statement)
        rows: list[tuple[Any, ...]] = [
            (g, a, b, "JOINT", s, e, float(s), float(e), 1.0, 0.9, 0.8, [], 0.1)
            for g, cs in made.items()
            for a, b, s, e in cs
        ]
        insert(con, "relations", rows)
        con.execute("CREATE VIEW sure_relations AS FROM relations")
        insert(
            con,
            "recordings",
            [(g, g, "", "camera", "", 1, 1, 1, 0, 30.0, "", 0) for g in made],
        )
        at = None if since is None else Moment(seconds=since)
        query = question("contacts").sql(["0"], Options(depth=depth, at=at))
        found: dict[str, dict[int, tuple[int, int]]] = {g: {} for g in made}
        for g, track, hops, t, via, *sure, joins, why in con.execute(query).fetchall():
            assert (sure, joins) == ([1.0, 0.9, 0.8, 0.8], [])
            found[g][track] = (int(t), hops)
            assert len(via) == hops == len(why.split())
            assert via[0] == 0
    for g, contacts in made.items():
        wanted = earliest_by_brute_force(
            contacts, 0, depth, -1e18 if since is None else since
        )
        assert {k: t for k, (t, _) in found[g].items()} == {
            k: t for k, (t, _) in wanted.items()
        }, (g, contacts)
        assert found[g] == wanted, (g, contacts)
