"""How far a replay can be trusted: determinism, planted differences, what the digests and
checkpoints cost.

    python tests/benchmarks/bench_trust.py [determinism] [travel] [plants] [cost] [--full] [--runs
    N] [--tracker NAME]

determinism  equal digests over runs, hash seeds, threads, BLAS and OpenCV kernels, IPP, other
             interpreters (--python PATH, may be repeated), speeds; for each tracker, on scripted
             scenes and on PETS09-S2L1
travel       from a state at every frame, and --from at every frame, with and without checkpoints
plants       planted differences: found by verify and by diff, at the right frame; false alarms on
unchanged pairs cost         the share of a replay's time that digests and checkpoints take, and a
checkpoint's size

Without a name, all of them. --full: whole scenes and the whole of PETS; else their first frames.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace as changed
from pathlib import Path
from typing import Any

from trust_common import SECOND, options, table
from trust_determinism import determinism
from trust_plants import plants

from fixtures.logs import write_scene_log
from fixtures.planted_differences import copy_log
from fixtures.scenes import SCRIPTS, GeneratedScene, generate
from recorders.annotated import checkpoint, digest
from recorders.log import LogReader
from recorders.recording import RecordOptions, record
from recorders.scene import SceneLog
from recorders.sources import open_source
from recorders.vision import cv2
from replay import annotated_writer as writing
from replay import run as replaying
from replay.engine import Engine
from replay.trackers.catalogue import TRACKERS
from replay.verification import verify_chain

DATA = Path(
    os.environ.get(
        "SCENETRACE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"
    )
)
FRAMES, PETS_FRAMES = 120, 60


def scenes(folder: Path, full: bool) -> dict[str, Path]:
    """Scripted scenes, and PETS where it is at hand, as scene logs."""
    found = {}
    for name in ("three_way_group", "six_fish"):
        size, frames = (None, None) if full else ((160, 120), FRAMES)
        found[name] = write_scene_log(
            generate(name, seed=1, size=size, frames=frames),
            folder / f"{name}.mcap",
            style="merged",
        )
    video = DATA / "pets09-s2l1" / "video.avi"
    if video.exists():
        print(f"recording {video.name} ...", file=sys.stderr, flush=True)
        record(
            open_source(video, fps=7), folder / "whole.mcap", RecordOptions(detect="motion")
        )
        found["PETS09-S2L1"] = folder / "whole.mcap"
        if not full:
            found["PETS09-S2L1"] = cut(
                folder / "whole.mcap", folder / "pets.mcap", PETS_FRAMES
            )
    else:
        print(f"no {video}: scripted scenes alone", file=sys.stderr)
    return found


def cut(source: Path, out: Path, frames: int) -> Path:
    """The first frames of a scene log."""
    with SceneLog(source) as scene:
        times = [t for _, t in zip(range(frames), scene.frame_times(), strict=False)]
    copy_log(source, out, lambda m: m.data if m.log_time_ns <= times[-1] else None)
    return out


# -- time travel
# ---------------------------------------------------------------------------------------------------


def travel(folder: Path, trackers: Sequence[str], full: bool) -> bool:
    """States at every frame of every script; --from every frame of one."""
    rows, good = [], True
    for name, script in SCRIPTS.items():
        scene = (
            generate(name, 3)
            if full
            else GeneratedScene(name, changed(script, fps=3), 3, (96, 72), 40)
        )
        log = write_scene_log(scene, folder / f"travel-{name}.mcap", style="merged")
        row: list[str] = [f"state at every frame of {name}"]
        for tracker in trackers:
            n, failed = restored(log, tracker)
            good = good and not failed
            row.append(f"{n - failed}/{n}")
        rows.append(row)
    log = folder / "travel-three_way_group.mcap"
    for with_checkpoints in (True, False):
        row = [
            "--from every frame, " + ("from checkpoints" if with_checkpoints else "from 0")
        ]
        for tracker in trackers:
            n, failed = spans(log, tracker, folder, with_checkpoints)
            good = good and not failed
            row.append(f"{n - failed}/{n}")
        rows.append(row)
    print("\nTime travel: starts that went on as the straight run did")
    table(["", *trackers], rows)
    return good


def restored(log: Path, tracker: str) -> tuple[int, int]:
    with SceneLog(log) as scene:
        engine = Engine(scene, tracker)
        states, results = [], []
        for found in engine.run():
            states.append(checkpoint.encode_state(engine.state()))
            results.append((found.targets, found.annotation))
        failed = 0
        for k, state in enumerate(states[:-1]):
            engine.restore(checkpoint.decode_state(state))
            again = engine.step()
            same = again is not None and (again.targets, again.annotation) == results[k + 1]
            failed += not (
                same and checkpoint.encode_state(engine.state()) == states[k + 1]
            )
    return len(states) - 1, failed


def spans(log: Path, tracker: str, folder: Path, with_checkpoints: bool) -> tuple[int, int]:
    whole = folder / "whole-travel.mcap"
    writing.replay(log, whole, options(tracker, checkpoint_ns=1))
    with SceneLog(log) as scene:
        times = list(scene.frame_times())
    failed = 0
    for k, now in enumerate(times):
        end = times[k + 1] if k + 1 < len(times) else now + 1
        more = {"checkpoints": whole} if with_checkpoints else {}
        writing.replay(
            log, folder / "span.mcap", options(tracker, from_ns=now, to_ns=end, **more)
        )
        same = annotated(folder / "span.mcap") == annotated(whole, now, end)
        failed += not (same and verify_chain(folder / "span.mcap").identical)
    return len(times), failed


def annotated(
    path: Path, first_ns: int = 0, end_ns: int = 1 << 62
) -> list[tuple[Any, ...]]:
    with LogReader(path) as log:
        return [
            (m.topic, m.log_time_ns, m.sequence, m.data)
            for m in log.messages(None, first_ns, end_ns)
        ]


# -- cost
# ----------------------------------------------------------------------------------------------------------


@contextmanager
def timed(
    places: Sequence[tuple[Any, str]], spent: dict[str, float], name: str
) -> Iterator[None]:
    """Add up the time within functions while the block runs."""
    before = [(owner, attribute, getattr(owner, attribute)) for owner, attribute in places]

    def wrapped(function: Callable[..., Any]) -> Callable[..., Any]:
        def run(*args: Any, **more: Any) -> Any:
            start = time.thread_time()
            try:
                return function(*args, **more)
            finally:
                spent[name] = spent.get(name, 0.0) + time.thread_time() - start

        return run

    for owner, attribute, function in before:
        setattr(owner, attribute, wrapped(function))
    try:
        yield
    finally:
        for owner, attribute, function in before:
            setattr(owner, attribute, function)


def cost(logs: dict[str, Path], trackers: Sequence[str], folder: Path) -> bool:
    rows, good = [], True
    cv2.setNumThreads(1)
    for name, path in logs.items():
        for tracker in trackers:
            writing.replay(
                path, folder / "c.mcap", changed(options(tracker), annotations_only=False)
            )
            spent: dict[str, float] = {}
            digests = [(digest, "recorded_digest"), (digest, "digest"), (digest, "chained")]
            states = [
                (replaying.Run, "_checkpoint"),
                (writing.AnnotatedWriter, "keep"),
                (sys.modules["replay.engine"], "encode_state"),
            ]
            with timed(digests, spent, "digest"), timed(states, spent, "states"):
                # Processor time: shares hold on a busy machine, too.
                start = time.process_time()
                whole = changed(
                    options(tracker), annotations_only=False, checkpoint_ns=2 * SECOND
                )
                done = writing.replay(path, folder / "c.mcap", whole)
                whole_s = time.process_time() - start
            with LogReader(folder / "c.mcap") as log:
                sizes = [
                    a.data_size
                    for a in log.index.attachment_indexes
                    if a.name.startswith("checkpoint/")
                ]
            total = spent["digest"] + spent.get("states", 0.0)
            good = good and total < 0.05 * whole_s
            shares = [
                f"{spent.get(what, 0.0) / whole_s:.1%}" for what in ("digest", "states")
            ]
            largest = f"{max(sizes, default=0) / 1000:.1f} kB"
            each = f"{1000 * whole_s / done.frames:.1f}"
            rows.append(
                [name, tracker, str(done.frames), each, *shares, str(len(sizes)), largest]
            )
    print("\nCost of digests and of a checkpoint every 2 s, in a replay with pictures")
    table(
        [
            "scene",
            "tracker",
            "frames",
            "ms/frame",
            "digests",
            "states",
            "checkpoints",
            "largest",
        ],
        rows,
    )
    return good


PARTS = ("determinism", "travel", "plants", "cost")


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"{', '.join(PARTS)}; default: all"
    )
    parser.add_argument("--full", action="store_true", help="whole scenes")
    parser.add_argument(
        "--runs", type=int, default=20, help="runs that change nothing; default 20"
    )
    parser.add_argument(
        "--tracker", action="append", choices=list(TRACKERS), help="default: all"
    )
    parser.add_argument(
        "--python", action="append", default=[], help="another interpreter with scenetrace"
    )
    args = parser.parse_args()
    for part in args.parts:
        if part not in PARTS:
            parser.error(f"no part {part!r}; there are: {', '.join(PARTS)}")
    parts, trackers, good = args.parts or PARTS, args.tracker or list(TRACKERS), True
    with tempfile.TemporaryDirectory(prefix="trust-") as place:
        folder = Path(place)
        logs = scenes(folder, args.full) if {"determinism", "cost"} & set(parts) else {}
        if "determinism" in parts:
            good = determinism(logs, trackers, args.runs, args.python) and good
        if "travel" in parts:
            good = travel(folder, trackers, args.full) and good
        if "plants" in parts:
            good = plants(folder, trackers) and good
        if "cost" in parts:
            good = cost(logs, trackers, folder) and good
    print(f"\n{'all as it should be' if good else 'NOT all as it should be'}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
