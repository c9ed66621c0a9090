"""Many recordings: what `batch` costs beside the bare commands, engines beside one another, a
catalogue of thousands, and what comes at 10^3, 10^5, 10^7 recordings.

`bench_fleet.py overhead`, `bench_fleet.py engines`, `bench_fleet.py catalogue`, `bench_fleet.py
simulate`; without a word all of them. Processor time is that of the process and its children.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from statistics import median
from typing import Any

import duckdb
import msgspec
import numpy as np

from reasoning.questions import Case, QueryLimits, catalogue
from reasoning.questions.catalogue import Choice, Piece
from reasoning.questions.schema import TABLES, create_statements
from recorders.stores import FolderStore
from replay.cli import main as run

SIZE = ["--fps", "25", "--size", "640x480"]


def sources(folder: Path, count: int, frames: int) -> list[Path]:
    """Recordings of boxes alone: four people who walk about."""
    made = []
    for number in range(count):
        rng = np.random.default_rng(number)
        start = rng.uniform(0, 400, (4, 2))
        speed = rng.uniform(-3, 3, (4, 2))
        lines = []
        for frame in range(frames):
            where = (start + speed * frame) % 440
            lines += [
                f"{frame + 1},-1,{x:.1f},{y:.1f},40,100,1,-1,-1,-1"
                for x, y in where.tolist()
            ]
        path = folder / f"cam{number % 20}" / f"{number:06d}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(lines) + "\n")
        made.append(path)
    return made


def timed(act: Callable[[], Any]) -> tuple[float, float]:
    """Seconds by the clock and by the processors, children included."""
    clock, before = time.perf_counter(), os.times()
    with redirect_stderr(StringIO()), redirect_stdout(StringIO()):
        act()
    after = os.times()
    used = sum(after[k] - before[k] for k in range(4))
    return time.perf_counter() - clock, used


def bare(paths: list[Path], out: Path) -> None:
    """The commands one after the other, in one process."""
    out.mkdir()
    for path in paths:
        scene, annotated = out / f"{path.stem}.s.mcap", out / f"{path.stem}.mcap"
        assert run(["record", str(path), "-o", str(scene), *SIZE]) == 0
        assert run(["replay", str(scene), "-o", str(annotated)]) == 0
        catalogue.write_tables(
            annotated, out, name=path.stem, digest=path.stem, shown_path=str(annotated)
        )


def batch(folder: Path, case: Path, *words: str) -> None:
    """`scenetrace batch` over all of a folder."""
    pattern = str(folder / "*" / "*.txt")
    assert run(["batch", pattern, "-o", str(case), *SIZE, *words]) == 0


def overhead(count: int, frames: int) -> None:
    """`batch` with one and two workers beside the bare commands."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = sources(folder / "in", count, frames)
        ways: dict[str, Callable[[Path], None]] = {
            "bare": lambda out: bare(paths, out),
            "batch, 1 worker": lambda out: batch(folder / "in", out, "--workers", "1"),
            "batch, 2 workers": lambda out: batch(folder / "in", out, "--workers", "2"),
        }
        found: dict[str, list[tuple[float, float]]] = {way: [] for way in ways}
        for turn in range(3):
            for way, act in ways.items():
                out = folder / f"out{turn}{way}"
                found[way].append(timed(partial(act, out)))
                shutil.rmtree(out)
    print(f"{count} recordings of {frames} frames, boxes alone; medians of 3")
    print(f"{'':18}{'clock s':>9}{'cpu s':>9}{'frames/s':>10}")
    for way, times in found.items():
        clock, used = (median(column) for column in zip(*times, strict=True))
        print(f"{way:18}{clock:9.2f}{used:9.2f}{count * frames / clock:10.0f}")
    cpu = {way: median(used for _, used in times) for way, times in found.items()}
    clocks = {way: median(clock for clock, _ in times) for way, times in found.items()}
    more = cpu["batch, 1 worker"] / cpu["bare"] - 1
    print(f"batch over the bare commands, processor time: {more:+.1%}")
    gain = clocks["batch, 1 worker"] / clocks["batch, 2 workers"]
    print(f"two workers over one, clock: {gain:.2f} x")


def engines(count: int, frames: int) -> None:
    """A Ray cluster of this machine beside local processes."""
    try:
        import ray  # noqa: F401
    except ImportError:
        print("Ray is not installed: skipped")
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sources(folder / "in", count, frames)
        local = timed(lambda: batch(folder / "in", folder / "a", "--workers", "2"))
        fleet = timed(lambda: batch(folder / "in", folder / "b", "--engine", "ray"))
        same = all(
            (folder / "b" / p.relative_to(folder / "a")).read_bytes() == p.read_bytes()
            for p in (folder / "a").rglob("*")
            if p.is_file() and p.name != ".lock"
        )
    print(
        f"{count} recordings of {frames} frames: local {local[0]:.1f} s, Ray {fleet[0]:.1f} s"
    )
    print(f"every file the same: {same}")
    assert same


def fill(case: Path, recordings: int, rows: int) -> None:
    """A case with generated relations: 100 cameras, days as needed, compacted."""
    con = duckdb.connect(":memory:", config={"threads": "2"})
    for statement in create_statements():
        con.execute(statement)
    store = FolderStore(case)
    catalogue.check_schema(store, write=True)
    cameras, each = 100, rows // recordings
    days = max(1, math.ceil(recordings / cameras / 10))
    whole: dict[str, list[str]] = {}
    number = 0
    for camera in range(cameras):
        for day in range(days):
            names = [f"r{number + k:07d}" for k in range(10) if number + k < recordings]
            number += len(names)
            if not names:
                continue
            piece = Piece(
                f"cam{camera:03d}", f"2026-01-{day + 1:02d}", f"whole-{camera}-{day}"
            )
            _write(con, case, piece, names, each)
            whole[piece.place] = [f"{name}" for name in names]
    snap = catalogue.Snapshot(1, whole, [])
    store.write(f"{catalogue.SNAPSHOTS_FOLDER}/00000001.json", msgspec.json.encode(snap))


def _write(
    con: duckdb.DuckDBPyConnection, case: Path, piece: Piece, names: list[str], each: int
) -> None:
    listed = ", ".join(f"('{name}')" for name in names)
    filled = {
        "recordings": f"SELECT name AS recording, name AS digest, '' AS path, '{piece.camera}'"
        " AS camera, 'events' AS tracker, 640 AS width, 480 AS height, 90000 AS frames,"
        " 1767225600000000000 AS start_ns, 3600.0 AS seconds, '' AS output_digest, 0 AS"
        f" first_frame FROM (VALUES {listed}) v(name)",
        "relations": "SELECT name AS recording, (k % 60)::INTEGER AS a, (k % 60 + 1 + k % 7)"
        "::INTEGER AS b, CASE WHEN k % 9 = 0 THEN 'JOINT' ELSE 'INTERACTION' END AS state,"
        " (k % 90000)::INTEGER AS start_frame, (k % 90000 + 50)::INTEGER AS end_frame,"
        " (k % 90000) / 25.0 AS start_t, (k % 90000 + 50) / 25.0 AS end_t, 0.9 AS seen_share,"
        " 0.95 AS existence, 0.97 AS identity, []::INTEGER[] AS joins FROM (VALUES"
        f" {listed}) v(name), range({each}) r(k)",
        "presence": "SELECT name AS recording, k::INTEGER AS track, 0 AS start_frame, 89999 AS"
        " end_frame, 0.0 AS start_t, 3600.0 AS end_t, 0.9 AS seen_share, 0.95 AS existence,"
        f" 0.97 AS identity, []::INTEGER[] AS joins FROM (VALUES {listed}) v(name),"
        " range(67) r(k)",
    }
    for table in TABLES:
        out = case / piece.key(table)
        out.parent.mkdir(parents=True, exist_ok=True)
        text = filled.get(table, f"SELECT * FROM {table}")
        con.execute(f"COPY ({text}) TO '{out}' (FORMAT parquet, COMPRESSION zstd)")


def catalogue_times(recordings: int, rows: int) -> None:
    """A ready question on one camera and day, and over all."""
    with tempfile.TemporaryDirectory() as name:
        case = Path(name) / "case"
        clock, _ = timed(lambda: fill(case, recordings, rows))
        size = sum(p.stat().st_size for p in case.rglob("*") if p.is_file())
        print(
            f"{recordings} recordings, {rows} relations: {size / 1e6:.0f} MB, {clock:.0f} s"
        )
        limits = QueryLimits(600.0, 2048, 2)
        one = "SELECT count(*) FROM relations WHERE state = 'JOINT' AND (a = 3 OR b = 3)"

        def asked(choice: Choice) -> None:
            with Case([case], limits, choice=choice) as opened:
                opened.rows(one)

        day = Choice("cam042", ("2026-01-01", "2026-01-01"))
        for what, choice in (("one camera and day", day), ("all", Choice())):
            times = [timed(partial(asked, choice)) for _ in range(5)]
            clock, used = (median(column) for column in zip(*times, strict=True))
            print(f"{what:20} median {clock:.2f} s by the clock, {used:.2f} s of processor")


def simulate(frames_a_second: float, bytes_a_frame: float, rows_an_hour: float) -> None:
    """What comes at more recordings than one machine can try, from measured rates."""
    hour = 3600 * 25
    print(
        f"{'':>12}{'core days':>11}{'TB':>8}{'files':>12}{'Gfiles*':>9}{'rows':>10}  first to break"
    )
    for count in (10**3, 10**5, 10**7):
        days = count * hour / frames_a_second / 86400
        size = count * hour * bytes_a_frame / 1e12
        small = count * (len(TABLES) + 3)
        compacted = min(count, 400 * 30) * len(TABLES) + 3 * count
        rows = count * rows_an_hour
        breaks = (
            "nothing"
            if count < 10**4
            else "listing small files: compact each day"
            if count < 10**6
            else "one folder listing and one planner: a table format (Iceberg, Delta) with"
            " manifests"
        )
        print(
            f"{count:12d}{days:11.1f}{size:8.2f}{small:12d}{compacted / 1e9:9.4f}{rows:10.1e}  {breaks}"
        )
    print("recordings of an hour at 25 frames/s; * compacted by camera and day")


def rates(count: int, frames: int) -> dict[str, float]:
    """Frames a second of a core, bytes a frame, rows an hour, of boxes alone."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sources(folder / "in", count, frames)
        _, used = timed(lambda: batch(folder / "in", folder / "case", "--workers", "1"))
        size = sum(p.stat().st_size for p in (folder / "case").rglob("*") if p.is_file())
        with Case([folder / "case"]) as case:
            rows = sum(case.rows(f"SELECT count(*) FROM sure_{t}")[0][0] for t in TABLES)
    total = count * frames
    return {
        "frames_a_second": total / used,
        "bytes_a_frame": size / total,
        "rows_an_hour": rows / total * 3600 * 25,
    }


def main() -> int:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="*", help="overhead, engines, catalogue, simulate")
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--frames", type=int, default=250)
    parser.add_argument("--recordings", type=int, default=10_000)
    parser.add_argument("--rows", type=int, default=100_000_000)
    parser.add_argument("--simulate", action="store_true", help="the same as simulate")
    args = parser.parse_args()
    wanted = args.what or (
        ["simulate"] if args.simulate else ["overhead", "engines", "catalogue", "simulate"]
    )
    if "overhead" in wanted:
        overhead(args.count, args.frames)
    if "engines" in wanted:
        engines(args.count, args.frames)
    if "catalogue" in wanted:
        catalogue_times(args.recordings, args.rows)
    if "simulate" in wanted:
        found = rates(min(args.count, 10), args.frames)
        print(json.dumps({name: round(value, 1) for name, value in found.items()}))
        simulate(**found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
