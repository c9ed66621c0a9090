"""A catalogue of thousands of recordings, generated, and how long ready questions take.

The rows of a camera's day are those that `bench_index.py` makes of ten recordings of an hour; a
file of each table holds them, as a compaction leaves it. Each question opens the catalogue anew, as
`scenetrace query CASE` does.
"""

from __future__ import annotations

import math
import os
import tempfile
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from statistics import median

import duckdb
import msgspec
from bench_index import generate, questions

from reasoning.questions import Case, QueryError, QueryLimits, catalogue
from reasoning.questions.catalogue import Choice, Piece
from reasoning.questions.schema import TABLES
from recorders.stores import FolderStore

_CAMERAS, _A_DAY = 100, 10
_DAY_NS = 86_400 * 10**9
_FIRST_DAY_NS = 1_767_225_600 * 10**9  # 2026-01-01


def fill(case: Path, recordings: int, rows: int) -> None:
    """A case of so many recordings with so many rows of relations: 100 cameras, ten recordings of
    each on a day.
    """
    store = FolderStore(case)
    catalogue.check_schema(store, write=True)
    whole: dict[str, list[str]] = {}
    with tempfile.TemporaryDirectory() as name:
        base = Path(name) / "day.duckdb"
        generate(base, _A_DAY, rows // recordings)
        con = duckdb.connect(str(base), read_only=True, config={"threads": "1"})
        held = {table: _count(con, table) for table in TABLES}
        for number in range(math.ceil(recordings / _A_DAY)):
            day, camera = divmod(number, _CAMERAS)
            piece = Piece(
                f"cam{camera:03d}",
                catalogue.date_of(_FIRST_DAY_NS + day * _DAY_NS),
                f"{catalogue.WHOLE}{number:024d}",
            )
            for table in TABLES:
                if held[table] or not number:
                    _copy(con, case, piece, table, day)
                else:
                    _link(case, piece, table)
            names = [f"{number}-{k}" for k in range(_A_DAY)]
            whole[piece.place] = names
        con.close()
    made = catalogue.Snapshot(1, whole, [])
    store.write(f"{catalogue.SNAPSHOTS_FOLDER}/00000001.json", msgspec.json.encode(made))


def _count(con: duckdb.DuckDBPyConnection, table: str) -> int:
    row = con.execute(f"SELECT count(*) FROM {table}").fetchone()
    return 0 if row is None else int(row[0])


_first: dict[str, Path] = {}


def _copy(
    con: duckdb.DuckDBPyConnection, case: Path, piece: Piece, table: str, day: int
) -> None:
    out = case / piece.key(table)
    out.parent.mkdir(parents=True, exist_ok=True)
    name = f"'{piece.camera}-{piece.date}-' || recording AS recording"
    if table == "recordings":
        start = _FIRST_DAY_NS + day * _DAY_NS
        name += f", '{piece.camera}-{piece.date}-' || digest AS digest"
        name += f", '{piece.camera}' AS camera, {start} AS start_ns"
    con.execute(
        f"COPY (SELECT * REPLACE ({name}) FROM {table}) TO '{out}' (FORMAT parquet,"
        " COMPRESSION zstd)"
    )
    _first.setdefault(f"{case} {table}", out)


def _link(case: Path, piece: Piece, table: str) -> None:
    """An empty table is the same everywhere."""
    out = case / piece.key(table)
    out.parent.mkdir(parents=True, exist_ok=True)
    os.link(_first[f"{case} {table}"], out)


def _asked(case: Path, choice: Choice, rounds: int, limits: QueryLimits) -> Iterator[str]:
    clocks, used = [], []
    for label, (make, keeps_few) in questions().items():
        taken, opened, rows = [], [], ""
        for _ in range(rounds):
            clock, busy = time.perf_counter(), time.process_time()
            with Case([case], limits, choice=choice) as asked:
                opened.append(time.process_time() - busy)
                try:
                    answer = asked.by_recording(make, None, keeps_few=keeps_few)
                    rows = str(sum(1 for _ in islice(answer.rows, None)))
                except QueryError as error:
                    rows = str(error)[:60]
            taken.append((time.perf_counter() - clock, time.process_time() - busy))
        clocks.append(median(c for c, _ in taken))
        used.append(median(b for _, b in taken))
        yield (
            f"  {label:26}{used[-1]:10.2f} (opening {median(opened):.2f}){clocks[-1]:10.2f}"
            f"  {rows} rows"
        )
    yield f"  median over the questions{used and median(used):11.2f}{'':15}{median(clocks):10.2f}"


def measure(case: Path, recordings: int, rows: int, rounds: int, seconds: float) -> None:
    """Fill a catalogue, and ask it of one camera's day and of everything."""
    if not case.exists():
        begun = time.process_time()
        fill(case, recordings, rows)
        print(f"made in {time.process_time() - begun:.0f} s of processor")
    files = [p for p in case.rglob("*") if p.is_file()]
    size = sum({p.stat().st_ino: p.stat().st_size for p in files}.values())
    print(
        f"{recordings} recordings, {rows} relations: {len(files)} files, {size / 1e6:.0f} MB"
    )
    limits = QueryLimits(seconds, 2048, 2)
    day = Choice("cam007", ("2026-01-01", "2026-01-01"))
    asked: tuple[tuple[str, Choice, int], ...] = (
        ("one camera and day", day, rounds),
        ("all", Choice(), 1),
    )
    for what, choice, times in asked:
        print(f"of {what}: seconds of processor, and by the clock", flush=True)
        for line in _asked(case, choice, times, limits):
            print(line, flush=True)
