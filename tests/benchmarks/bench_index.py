"""A synthetic index: how long ready questions take, and how an index grows.

    python tests/benchmarks/bench_index.py [--recordings 500] [--relations 10000] [--folder DIR]
    [--log ANNOTATED.mcap]

Deterministic: every row is a function of its number. Per recording (an hour long):
``--relations`` rows of relations among forty targets, a tenth as many encounters and bits, a
twentieth as many groups, stays in zones and events. The tables `frames` and `tracks` stay empty:
no ready question reads tracks, and they grow with the frames, not the case (``--log`` measures
the growth of all tables on a real annotated log). The case of 10^8 relation rows:

    python tests/benchmarks/bench_index.py --recordings 10000

Each question is asked of one recording and of all of them at once, as `query` does. "Processor"
is the time of all threads together: half of it is what two idle cores need at best.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import duckdb

from reasoning.questions import Case, QueryError, QueryLimits
from reasoning.questions.index import build_index
from reasoning.questions.literals import Moment, Recordings, only
from reasoning.questions.patterns import plan
from reasoning.questions.ready_questions import Options, question
from reasoning.questions.schema import create_statements

HOUR = 3600.0
FPS = 25
TARGETS = 40


def _name(expression: str) -> str:
    return f"printf('garage-%05d', CAST({expression} AS INTEGER))"


def _span(n: int, length: int) -> str:
    """start and end, frames and seconds, of the k-th of n intervals spread over an hour, up to
    ``length`` frames.
    """
    start = f"CAST(k * {int(HOUR * FPS) // n} + hash(i, 1) % 7 AS INTEGER)"
    end = f"{start} + CAST(hash(i, 2) % {length} AS INTEGER)"
    return f"{start} AS s, {end} AS e, ({start}) / {FPS}.0 AS st, ({end}) / {FPS}.0 AS et"


SURE = "1, 1, 1, CAST([] AS INTEGER[])"
"""How sure every row is: seen, existing, who he is, no joins."""


def generate(path: Path, recordings: int, relations: int) -> None:
    """Write the index."""
    with duckdb.connect(str(path), config={"threads": "2", "memory_limit": "8GB"}) as con:
        con.execute("SET enable_progress_bar = false")
        for statement in create_statements():
            con.execute(statement)
        con.execute(
            f"INSERT INTO recordings SELECT {_name('i')}, printf('%064d', i), '', 'camera',"
            f" 'events', 640, 480, {int(HOUR * FPS)}, i * 3600 * 1000000000, {HOUR}, '', 0"
            f" FROM range({recordings}) t(i)"
        )
        con.execute(
            f"INSERT INTO presence SELECT {_name('i // 40')}, CAST(i % 40 AS INTEGER),"
            " CAST((i % 40) * 100 AS INTEGER), CAST((i % 40) * 100 + 80000 AS INTEGER), (i"
            f" % 40) * 4.0, (i % 40) * 4.0 + 3200.0, 1, 1, 1, [] FROM range({recordings * TARGETS}) t(i)"
        )
        few, fewer = max(1, relations // 10), max(1, relations // 20)
        pair = "CAST(least(p, q) AS INTEGER) AS a, CAST(greatest(p, q) AS INTEGER) AS b"
        # fmt: off
        _fill(con, "relations", recordings, relations, 120,
              f"{pair}, if(hash(i, 5) % 3 = 0, 'JOINT', 'INTERACTION') AS state, s, e, st, et",
              " ORDER BY recording, a, b, s")  # as an index stores them
        # fmt: on
        _fill(
            con, "encounters", recordings, few, 900, f"{pair}, 'meeting', s, e, st, et, 0.9"
        )
        bit = "if(hash(i, 5) % 2 = 0, 'grouping', 'splitting')"
        _fill(
            con,
            "bits",
            recordings,
            few,
            900,
            f"CAST(p AS INTEGER), {bit}, [CAST(q AS INTEGER)], s, e, st, et",
        )
        formed = (
            "CASE WHEN k > 0 AND hash(i, 6) % 4 = 0 THEN [CAST(k - 1 AS INTEGER)] ELSE"
            " [] END"
        )
        members = "[CAST(p AS INTEGER), CAST(q AS INTEGER)]"
        group = f"CAST(k AS INTEGER), {members}, s, e, st, et, {formed}, 'group_ended'"
        _fill(con, "groups", recordings, fewer, 400, group)
        _fill(
            con,
            "zones",
            recordings,
            fewer,
            2000,
            "CAST(p AS INTEGER), 'bench', s, e, st, et",
        )
        kind = (
            "CASE hash(i, 7) % 4 WHEN 0 THEN 'entered' WHEN 1 THEN 'exited' ELSE"
            " 'joined' END"
        )
        event = (
            f"CAST(k AS INTEGER), {kind}, s, st, [CAST(p AS INTEGER)], 'SHELLS 2.3',"
            " '{}', ''"
        )
        _fill(con, "events", recordings, fewer, 1, event)
        con.execute("CHECKPOINT")


def _fill(
    con: duckdb.DuckDBPyConnection,
    table: str,
    recordings: int,
    n: int,
    length: int,
    columns: str,
    order: str = "",
) -> None:
    batch = max(1, 20_000_000 // n)
    sure = f"{SURE}, 1" if table in ("relations", "bits") else SURE
    for first in range(0, recordings, batch):
        count = min(batch, recordings - first) * n
        numbers = (
            f"SELECT i + {first * n} AS i, (i + {first * n}) // {n} AS r, i % {n} AS k FROM"
            f" range({count}) t(i)"
        )
        con.execute(
            f"INSERT INTO {table} SELECT {_name('r')} AS recording, {columns}, {sure} FROM (SELECT"
            f" *, hash(i, 3) % {TARGETS} AS p, (hash(i, 3) % {TARGETS} + 1 + hash(i, 4) %"
            f" {TARGETS - 1}) % {TARGETS} AS q, {_span(n, length)} FROM ({numbers})){order}"
        )


Make = Callable[[Recordings | None], str]
PATTERN = "interaction(a,b)[>2s] ; joint(a,b)[>3s, gap<10s] ; exited(a)[<30s]"


def questions() -> dict[str, tuple[Make, bool]]:
    """Each question: its SQL from the recordings that it is asked of, and whether it keeps few
    rows.
    """
    at = Moment(seconds=1800.0)
    asked: tuple[tuple[str, list[str], dict[str, Any]], ...] = (
        ("met", ["7"], {}), ("met", ["7", "12"], {}), ("together", ["7", "12"], {}), ("left-with", ["7"], {}),
        ("who-was-in", ["bench"], {"at": at}), ("loitered", ["bench"], {"least_s": 60.0}),
        ("entered-never-left", [], {}),
        ("grouping-and-splitting", [], {}), ("group-history", ["100"], {}), ("before", ["100"], {}),
        ("contacts", ["7"], {"depth": 3}), ("timeline", ["7"], {}),
    )  # fmt: skip
    out: dict[str, tuple[Make, bool]] = {}
    for name, words, options in asked:

        def make(
            some: Any,
            name: str = name,
            words: list[str] = words,
            options: dict[str, Any] = options,
        ) -> Any:
            return question(name).sql(words, Options(recordings=some, **options))

        out[" ".join([name, *words])] = make, question(name).keeps_few(words)
    out["pattern"] = (lambda some: plan(PATTERN, some)), False
    return out


@dataclass
class Taken:
    """Seconds to the first row, to the last row, and of the processor, of each round; rows."""

    first: list[float] = field(default_factory=list)
    last: list[float] = field(default_factory=list)
    processor: list[float] = field(default_factory=list)
    rows: int = 0


def timed(
    case: Case, make: Make, recordings: Recordings | None, keeps_few: bool, rounds: int
) -> Taken:
    """Ask some times, reading all rows."""
    taken = Taken()
    for _ in range(rounds):
        start, busy = time.perf_counter(), time.process_time()
        answer = case.by_recording(make, recordings, keeps_few=keeps_few)
        taken.rows = sum(1 for _ in islice(answer.rows, 1))
        taken.first.append(time.perf_counter() - start)
        taken.rows += sum(1 for _ in answer.rows)
        taken.last.append(time.perf_counter() - start)
        taken.processor.append(time.process_time() - busy)
    return taken


def percentile(values: list[float], share: float) -> float:
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def ask(path: Path, recordings: int, rounds: int, scope: str, memory_mib: int) -> None:
    """Print each question's times, and median and p95 over the questions."""
    with Case([path], QueryLimits(seconds=3600, memory_mib=memory_mib)) as case:
        for kind in ("one", "all") if scope == "both" else (scope,):
            some = only(f"garage-{recordings * 2 // 3:05d}") if kind == "one" else None
            print(
                f"of {'one recording' if some else 'all at once':36s} rows   first row   "
                " all rows  processor s"
            )
            every: list[Taken] = []
            for label, (make, keeps_few) in questions().items():
                try:
                    t = timed(case, make, some, keeps_few, rounds)
                except QueryError as e:
                    print(f"  {label:26s} {e}", flush=True)
                    continue
                every.append(t)
                times = "".join(
                    f"{statistics.median(v):12.3f}" for v in (t.first, t.last, t.processor)
                )
                print(f"  {label:26s} {t.rows:12d}{times}", flush=True)
            for name in ("first", "last", "processor"):
                values = [v for t in every for v in getattr(t, name)]
                middle = statistics.median(
                    statistics.median(getattr(t, name)) for t in every
                )
                print(
                    f"  {name:10s} median {middle:.3f} s, p95"
                    f" {percentile(values, 0.95):.3f} s"
                )


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--recordings", type=int, default=500)
    p.add_argument(
        "--relations", type=int, default=10_000, help="rows of relations per recording"
    )
    p.add_argument(
        "--scope",
        choices=("one", "all", "both"),
        default="both",
        help="questions of one recording, of all",
    )
    p.add_argument("--rounds", type=int, default=3)
    p.add_argument(
        "--memory",
        type=int,
        default=2048,
        help="memory of a query in MiB, the default of `query`",
    )
    p.add_argument(
        "--folder", type=Path, help="where the index goes; kept there and used again"
    )
    p.add_argument(
        "--log",
        type=Path,
        help="an annotated log, to measure the growth per hour of a real recording",
    )
    args = p.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"bench-{args.recordings}-{args.relations}.duckdb"
        if not path.exists():
            start = time.perf_counter()
            generate(path, args.recordings, args.relations)
            print(f"generated in {time.perf_counter() - start:.0f} s")
        size = path.stat().st_size / 1e6
        total = args.recordings * args.relations
        print(f"{args.recordings} recordings of an hour, {total} relation rows: {size:.0f} MB, "
              f"{size / args.recordings:.2f} MB per hour without tracks")  # fmt: skip
        ask(path, args.recordings, args.rounds, args.scope, args.memory)
        if args.log is not None:
            start = time.perf_counter()
            (facts,) = build_index([args.log], Path(temporary) / "real.duckdb").added
            taken = time.perf_counter() - start
            grown = (Path(temporary) / "real.duckdb").stat().st_size / 1e6
            print(
                f"{args.log.name}: {facts.seconds:.0f} s of recording indexed in {taken:.1f} s, {grown:.2f} MB: "
                f"{grown * HOUR / max(facts.seconds, 1e-9):.1f} MB per hour with tracks"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
