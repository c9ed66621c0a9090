"""Many recordings: what `batch` costs beside the bare commands, engines beside one another, a
catalogue of thousands, and what comes at 10^3, 10^5, 10^7 recordings.

`bench_fleet.py overhead`, `bench_fleet.py engines`, `bench_fleet.py catalogue`, `bench_fleet.py
simulate`; without a word all of them. `bench_fleet.py show` demonstrates what a fleet must bear.
Processor time is that of all processes that take part.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, redirect_stderr, redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from statistics import median
from typing import Any

import fleet_shows
from fleet_catalogue import measure
from fleet_simulator import Rates, catalogue_rates, status_rate, told
from fleet_sources import ROOT, SIZE, boxes_alone, mixed, real_video

from reasoning.questions import Case, catalogue
from reasoning.questions.schema import TABLES
from replay.cli import main as run

WHAT = ("overhead", "engines", "catalogue", "simulate")
_PICTURES = 40


def timed(act: Callable[[], Any]) -> tuple[float, float]:
    """Seconds by the clock and by the processors, of this process and its children that ended."""
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


def overhead(count: int, frames: int, rounds: int) -> None:
    """`batch` with one and two workers beside the bare commands."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = boxes_alone(folder / "in", count, frames)
        boxes_alone(folder / "one", 1, frames)
        ways: dict[str, Callable[[Path], None]] = {
            "bare": lambda out: bare(paths, out),
            "batch of one": lambda out: batch(folder / "one", out, "--workers", "1"),
            "batch, 1 worker": lambda out: batch(folder / "in", out, "--workers", "1"),
            "batch, 2 workers": lambda out: batch(folder / "in", out, "--workers", "2"),
        }
        with redirect_stderr(StringIO()), redirect_stdout(StringIO()):
            bare(paths[:1], folder / "warm")  # what is imported once is not counted
        found: dict[str, list[tuple[float, float]]] = {way: [] for way in ways}
        for turn in range(rounds):
            for way, act in ways.items():
                out = folder / f"out{turn}{way}"
                found[way].append(timed(partial(act, out)))
                shutil.rmtree(out)
    print(f"{count} recordings of {frames} frames, boxes alone; medians of {rounds}")
    print(f"{'':18}{'clock s':>9}{'cpu s':>9}")
    for way, times in found.items():
        clock, used = (median(column) for column in zip(*times, strict=True))
        print(f"{way:18}{clock:9.2f}{used:9.2f}")
    cpu = {way: median(used for _, used in times) for way, times in found.items()}
    clocks = {way: median(clock for clock, _ in times) for way, times in found.items()}
    _compared(cpu, clocks, count)


def _compared(cpu: dict[str, float], clocks: dict[str, float], count: int) -> None:
    """What the times of `overhead` come to."""
    one, all_of_them = cpu["batch of one"], cpu["batch, 1 worker"]
    print(
        f"batch over the bare commands, processor time: {all_of_them / cpu['bare'] - 1:+.1%}"
    )
    if count > 1:
        each = (all_of_them - one) / (count - 1)
        more = each / (cpu["bare"] / count) - 1
        print(
            f"  start-up aside: {more:+.1%}; start-up: {one - each:.2f} s for each worker, once"
        )
    gain = clocks["batch, 1 worker"] / clocks["batch, 2 workers"]
    most = 2 * cpu["batch, 1 worker"] / cpu["batch, 2 workers"]
    print(f"two workers over one: {gain:.2f} x by the clock,")
    print(f"  {most:.2f} x by processor time (what two idle processors would give)")


def engines(count: int, frames: int) -> None:
    """A Ray cluster of two nodes beside two local workers: processor time, and the same files."""
    try:
        import ray  # noqa: F401
    except ImportError:
        print("Ray is not installed: skipped")
        return
    print(f"{count} recordings of {frames} frames, boxes alone; the first line: two")
    used = []
    for some in (2, count):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            made = boxes_alone(folder / "in", some, frames)
            lines = [f"{path.relative_to(folder / 'in')} {' '.join(SIZE)}" for path in made]
            stage = fleet_shows.Stage(folder, lines, 2)
            print(f"Ray cluster: {fleet_shows.engines(stage)}")
            used.append((stage.used_s, stage.ray_s))
    (local_two, ray_two), (local, fleet) = used
    if count > 2:
        more = (fleet - ray_two) / (local - local_two) - 1
        print(f"start-up aside: {more:+.1%}; Ray's: {ray_two - local_two:.1f} s more, once")


def catalogue_times(args: argparse.Namespace) -> None:
    """Ready questions of one camera and day, and of all."""
    with tempfile.TemporaryDirectory() as name:
        case = (args.folder or Path(name)) / "case"
        measure(case, args.recordings, args.rows, args.rounds, args.time_limit)


def simulate(count: int, frames: int) -> None:
    """What comes at more recordings than one machine can try, from measured rates."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        boxes_alone(folder / "in", count, frames)
        case = folder / "case"
        batch(folder / "in", folder / "warm", "--workers", "1")
        _, used = timed(lambda: batch(folder / "in", case, "--workers", "1"))
        size = sum(p.stat().st_size for p in case.rglob("*") if p.is_file())
        with Case([case]) as asked:
            rows = sum(asked.rows(f"SELECT count(*) FROM sure_{t}")[0][0] for t in TABLES)
        total = count * frames
        rates = Rates(
            boxes_fps=total / used,
            pictures_fps=_pictures_rate(folder),
            frame_bytes=size / total,
            hour_rows=rows / total * 3600 * 25,
            status_s=status_rate(case),
            **catalogue_rates(),
        )
    for line in told(rates):
        print(line)


def _pictures_rate(folder: Path) -> float:
    """Frames a second of a processor, of the first real video, as it is."""
    source = folder / "piece.avi"
    if not real_video(source, _PICTURES):
        return 0.0
    scene, out = str(folder / "p.mcap"), str(folder / "q.mcap")
    _, used = timed(lambda: run(["record", str(source), "-o", scene, "--fps", "7"]))
    _, more = timed(lambda: run(["replay", scene, "-o", out]))
    return _PICTURES / (used + more)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog=fleet_shows.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "what",
        nargs="*",
        metavar="WHAT",
        help=f"{', '.join(WHAT)}; or show, and then {', '.join(fleet_shows.SHOWS)} (default:"
        " all of them)",
    )
    parser.add_argument("--count", type=int, help="recordings: 40, of show 200")
    parser.add_argument(
        "--frames", type=int, help="frames of one that is generated: 250, of show 15"
    )
    parser.add_argument(
        "--rounds", type=int, default=3, help="of overhead and catalogue (3)"
    )
    parser.add_argument(
        "--time-limit", type=float, default=600.0, metavar="S", help="of a question (600)"
    )
    parser.add_argument("--workers", type=int, default=2, help="of show (2)")
    parser.add_argument(
        "--cut", type=float, default=20.0, metavar="S", help="of show store (20)"
    )
    parser.add_argument("--recordings", type=int, default=10_000, help="of catalogue")
    parser.add_argument("--rows", type=int, default=100_000_000, help="of catalogue")
    parser.add_argument("--simulate", action="store_true", help="the same as simulate")
    parser.add_argument(
        "--folder",
        type=Path,
        help="a new folder for what show or catalogue makes, which then stays",
    )
    return parser


def main() -> int:
    """Run what was asked for."""
    sys.path.insert(0, str(ROOT))  # the demonstrations share the S3 server of the tests
    parser = _parser()
    args = parser.parse_args()
    wanted = args.what or (["simulate"] if args.simulate else list(WHAT))
    if wanted[0] == "show":
        unknown = [name for name in wanted[1:] if name not in fleet_shows.SHOWS]
        if unknown:
            parser.error(f"show {unknown[0]}: there are {', '.join(fleet_shows.SHOWS)}")
        return _show(wanted[1:], args)
    unknown = [name for name in wanted if name not in WHAT]
    if unknown:
        parser.error(f"{unknown[0]}: there are {', '.join(WHAT)}, and show")
    if "overhead" in wanted:
        overhead(args.count or 40, args.frames or 250, args.rounds)
    if "engines" in wanted:
        engines(args.count or 40, args.frames or 250)
    if "catalogue" in wanted:
        catalogue_times(args)
    if "simulate" in wanted:
        simulate(min(args.count or 10, 10), args.frames or 250)
    return 0


def _show(names: list[str], args: argparse.Namespace) -> int:
    with ExitStack() as stack:
        folder = args.folder
        if folder is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=args.folder is None)
        count, frames = args.count or 200, args.frames or 15
        lines = mixed(folder / "in", count, frames)
        stage = fleet_shows.Stage(folder, lines, args.workers, args.cut)
        return fleet_shows.show(names, stage)


if __name__ == "__main__":
    sys.exit(main())
