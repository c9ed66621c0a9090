"""How far a replay can be trusted: determinism, planted differences, what the digests and checkpoints cost.

    python tests/benchmarks/bench_trust.py [determinism] [travel] [plants] [cost] [--full] [--runs N] [--tracker NAME]

determinism  equal digests over runs, hash seeds, threads, BLAS and OpenCV kernels, IPP, other interpreters
             (--python PATH, may be repeated), speeds; for each tracker, on scripted scenes and on PETS09-S2L1
travel       from a state at every frame, and --from at every frame, with and without checkpoints
plants       planted differences: found by verify and by diff, at the right frame; false alarms on unchanged pairs
cost         the share of a replay's time that digests and checkpoints take, and a checkpoint's size

Without a name, all of them. --full: whole scenes and the whole of PETS; else their first frames.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace as changed
from pathlib import Path
from typing import Any

from fixtures.logs import write_scene_log
from fixtures.plants import ANNOTATION_PLANTS, RECORDED, RECORDING_PLANTS, Planted
from fixtures.scenes import SCRIPTS, GeneratedScene, generate
from recorders.errors import RecordingError
from recorders.log import LogReader
from recorders.recording import RecordOptions, record
from recorders.scene import SceneLog
from recorders.sources import open_source
from recorders.vision import cv2
from replay import checkpoint, digest, replaying, writing
from replay.compare import Comparison, compare
from replay.configuration import python_version, replay_config
from replay.engine import Engine
from replay.replaying import ReplayOptions
from replay.trackers.catalogue import TRACKERS
from replay.verifying import verify, verify_chain

DATA = Path(os.environ.get("SCENETRACE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
# From the newest kernels down to SSE3, this build's baseline: whatever else there is has been disabled then. The
# baseline itself cannot be: OpenCV warns that "code optimizations for this feature are executed unconditionally".
CPU_LEVELS = (
    "AVX512-SKX", "AVX512-SKX,AVX2,FP16", "AVX512-SKX,AVX2,FP16,AVX", "AVX512-SKX,AVX2,FP16,AVX,SSE4.2,SSE4.1"
)  # fmt: skip
NUMPY_KERNELS = ("X86_V4 AVX512_ICL AVX512_SPR", "X86_V3 X86_V4 AVX512_ICL AVX512_SPR")
PLACES = (
    {"TZ": "Asia/Kathmandu", "LC_ALL": "C"},
    {"TZ": "America/St_Johns", "LC_ALL": "C.UTF-8", "LANG": "tr_TR.UTF-8"},
)
KERNELS = ("Haswell", "Nehalem", "Prescott")
FRAMES, PETS_FRAMES = 120, 60
SECOND = 1_000_000_000


def options(tracker: str, *assignments: str, **more: Any) -> ReplayOptions:
    config = replay_config(tracker, assignments=assignments)
    return ReplayOptions(tracker=tracker, config=config, annotations_only=True, force=True, **more)


def scenes(folder: Path, full: bool) -> dict[str, Path]:
    """Scripted scenes, and PETS where it is at hand, as scene logs."""
    found = {}
    for name in ("three_way_group", "six_fish"):
        size, frames = (None, None) if full else ((160, 120), FRAMES)
        found[name] = write_scene_log(
            generate(name, seed=1, size=size, frames=frames), folder / f"{name}.mcap", style="merged"
        )
    video = DATA / "pets09-s2l1" / "video.avi"
    if video.exists():
        print(f"recording {video.name} ...", file=sys.stderr, flush=True)
        record(open_source(video, fps=7), folder / "whole.mcap", RecordOptions(detect="motion"))
        found["PETS09-S2L1"] = folder / "whole.mcap"
        if not full:
            found["PETS09-S2L1"] = cut(folder / "whole.mcap", folder / "pets.mcap", PETS_FRAMES)
    else:
        print(f"no {video}: scripted scenes alone", file=sys.stderr)
    return found


def cut(source: Path, out: Path, frames: int) -> Path:
    """The first frames of a scene log."""
    from fixtures.plants import copy_log

    with SceneLog(source) as scene:
        times = [t for _, t in zip(range(frames), scene.frame_times(), strict=False)]
    copy_log(source, out, lambda m: m.data if m.log_time_ns <= times[-1] else None)
    return out


# -- determinism ---------------------------------------------------------------------------------------------------


def worker(order: dict[str, Any]) -> None:
    """Replay every scene with every tracker once, print the digests."""
    cv2.setNumThreads(order.get("threads", cv2.getNumThreads()))

    def slow(*_: object) -> None:
        time.sleep(0.002)

    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, path in order["scenes"].items():
            for tracker in order["trackers"]:
                progress = slow if order.get("slow") else None
                done = writing.replay(Path(path), Path(folder) / "a.mcap", options(tracker), progress)
                found[f"{name} {tracker}"] = done.output_digest
    print(json.dumps({"digests": found, "python": python_version(), "kernels": cv2.getCPUFeaturesLine()}))


def elsewhere(order: dict[str, Any], env: dict[str, str], python: str = sys.executable) -> dict[str, Any]:
    """What a worker found; no digests where it failed, which then counts as unequal."""
    done = subprocess.run(
        [python, __file__, "--worker", json.dumps(order)],
        env={**os.environ, **env},
        capture_output=True,
        text=True,
        check=False,
    )
    # A kernel that OpenCV does not know by that name, or that is its baseline, would have stayed on.
    if done.returncode or "unknown CPU feature" in done.stderr or "baseline CPU feature" in done.stderr:
        print(f"{python} with {env} failed:\n{done.stderr[-1500:]}", file=sys.stderr)
        return {"digests": {}, "python": python, "kernels": ""}
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def variants(runs: int, pythons: Sequence[str]) -> Iterator[tuple[str, dict[str, Any], dict[str, str], str]]:
    """Family, order, environment, interpreter."""
    me = sys.executable
    for _ in range(runs):
        yield "run again", {}, {}, me
    for seed in range(10):
        yield "PYTHONHASHSEED 0 to 9", {}, {"PYTHONHASHSEED": str(seed)}, me
    for n in (1, 2, 4):
        yield "threads 1, 2, 4", {"threads": n}, {"OPENBLAS_NUM_THREADS": str(n), "OMP_NUM_THREADS": str(n)}, me
    for kernel in KERNELS:
        yield f"OPENBLAS_CORETYPE {', '.join(KERNELS)}", {}, {"OPENBLAS_CORETYPE": kernel}, me
    for level in CPU_LEVELS:
        yield "OPENCV_CPU_DISABLE down to SSE3", {}, {"OPENCV_CPU_DISABLE": level}, me
    for kernels in NUMPY_KERNELS:
        yield "NPY_DISABLE_CPU_FEATURES down to X86_V2", {}, {"NPY_DISABLE_CPU_FEATURES": kernels}, me
    for place in PLACES:
        yield "time zone and locale", {}, place, me
    yield "IPP on", {}, {"SCENETRACE_EXPERIMENT": "ipp"}, me
    yield "slow (2 ms a frame more)", {"slow": True}, {}, me
    for python in pythons:
        yield "", {}, {}, python


def determinism(logs: dict[str, Path], trackers: Sequence[str], runs: int, pythons: Sequence[str]) -> bool:
    order = {"scenes": {n: str(p) for n, p in logs.items()}, "trackers": list(trackers)}
    first = elsewhere(order, {})["digests"]
    columns = [f"{name} {tracker}" for name in logs for tracker in trackers]
    if sorted(first) != sorted(columns):
        print("the first replay failed: there is nothing to compare with")
        return False
    equal: dict[str, dict[str, int]] = {}
    count: dict[str, int] = {}
    for family, more, env, python in variants(runs, pythons):
        answer = elsewhere({**order, **more}, env, python)
        row_name = family or f"interpreter {answer['python']}"
        count[row_name] = count.get(row_name, 0) + 1
        row = equal.setdefault(row_name, dict.fromkeys(columns, 0))
        for column in columns:
            row[column] += answer["digests"].get(column) == first[column]
        kernels = f" ({answer['kernels']})" if "OPENCV_CPU_DISABLE" in env else ""
        print(f"  {row_name}: {count[row_name]}{kernels}", file=sys.stderr, flush=True)
    print("\nEqual output digests")
    table(["", *columns], [[f, *(f"{row[c]}/{count[f]}" for c in columns)] for f, row in equal.items()])
    for column in columns:
        print(f"  {column}: {first[column][:16]}")
    return all(n == count[f] for f, row in equal.items() for n in row.values())


# -- time travel ---------------------------------------------------------------------------------------------------


def travel(folder: Path, trackers: Sequence[str], full: bool) -> bool:
    """States at every frame of every script; --from every frame of one."""
    rows, good = [], True
    for name, script in SCRIPTS.items():
        scene = generate(name, 3) if full else GeneratedScene(name, changed(script, fps=3), 3, (96, 72), 40)
        log = write_scene_log(scene, folder / f"travel-{name}.mcap", style="merged")
        row: list[str] = [f"state at every frame of {name}"]
        for tracker in trackers:
            n, failed = restored(log, tracker)
            good = good and not failed
            row.append(f"{n - failed}/{n}")
        rows.append(row)
    log = folder / "travel-three_way_group.mcap"
    for with_checkpoints in (True, False):
        row = ["--from every frame, " + ("from checkpoints" if with_checkpoints else "from 0")]
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
            found = engine.step()
            same = found is not None and (found.targets, found.annotation) == results[k + 1]
            failed += not (same and checkpoint.encode_state(engine.state()) == states[k + 1])
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
        writing.replay(log, folder / "span.mcap", options(tracker, from_ns=now, to_ns=end, **more))
        failed += annotated(folder / "span.mcap") != annotated(whole, now, end)
    return len(times), failed


def annotated(path: Path, first_ns: int = 0, end_ns: int = 1 << 62) -> list[tuple[Any, ...]]:
    with LogReader(path) as log:
        return [(m.topic, m.log_time_ns, m.sequence, m.data) for m in log.messages(None, first_ns, end_ns)]


# -- plants --------------------------------------------------------------------------------------------------------


def plants(folder: Path, trackers: Sequence[str]) -> bool:
    scene = write_scene_log(
        generate("three_way_group", seed=1, size=(160, 120), frames=110), folder / "p.mcap", style="merged",
        pictures="png",
    )  # fmt: skip
    good, found = True, 0
    for tracker in trackers:
        rows = planted(scene, folder, tracker)
        print(f"\nPlanted differences, {tracker}: found at their frame")
        table(["plant", "frame", "verify", "diff"], rows)
        good = good and all("NO" not in row for row in rows)
        found += sum("NO" not in row for row in rows)
    print(f"\n{found} plants found")
    for tracker in trackers:
        pairs, alarms = unchanged(folder, tracker)
        print(f"False alarms on unchanged pairs, {tracker}: {alarms} of {pairs}")
        good = good and not alarms
    return good


def planted(scene: Path, folder: Path, tracker: str) -> list[list[str]]:
    """A row for each plant."""
    rows = []
    config = replay_config(tracker)
    whole = ReplayOptions(tracker=tracker, config=config, checkpoint_ns=SECOND, force=True)
    original, altered = folder / "pa.mcap", folder / "pb.mcap"
    writing.replay(scene, original, whole)
    for name, plant in ANNOTATION_PLANTS.items():
        what = plant(original, altered)
        seen = compare(original, altered)
        rows.append([f"altered afterwards: {name}", *outcome(what, (verify_chain(altered), verify(altered)), seen)])
    for name, plant in RECORDING_PLANTS.items():
        what = plant(original, altered)
        seen = compare(original, altered)
        rows.append([f"recording in the log: {name}", *outcome(what, (verify_chain(altered), verify(altered)), seen)])
        what = plant(scene, altered)
        verdict = verify(original, altered)
        try:
            writing.replay(altered, folder / "pc.mcap", whole)
            again = compare(original, folder / "pc.mcap")
        except RecordingError as e:
            again = e
        rows.append([f"another recording: {name}", *outcome(what, (verdict,), again)])
    config = replay_config(tracker, assignments=[f"shell_model.k_s={0.2 + 1e-9!r}"])
    writing.replay(scene, folder / "pc.mcap", changed(whole, config=config))
    other = compare(original, folder / "pc.mcap")
    named = other.made == ["parameter: shell_model.k_s = 0.200000001, not 0.2"]
    first = bool(other.differences) and "shell_radius" in str(other.differences[0].details)
    rows.append(["another parameter: k_s by 1e-9", "0", "-", "yes" if named and first else "NO"])
    return rows


# What `diff` calls a difference in each channel.
SHOWN = {
    "tracks": {"track", "identity"},
    "relations": {"relation"},
    "groups": {"group"},
    "events": {"event"},
    "graph": {"message"},
    "annotations": {"message"},
    "digest": {"message"},
    RECORDED: {"recording", "frames"},
}


def outcome(planted: Planted, verdicts: Sequence[Any], diff: Comparison | RecordingError) -> list[str]:
    """Frame, and whether verify and diff name it: the first difference, in the channel that was altered."""
    place = "-" if planted.frame < 0 else str(planted.frame)
    right = all(v.difference is not None and v.difference.frame == planted.frame for v in verdicts)
    if isinstance(diff, RecordingError):
        seen = f"no replay of it: {diff.reason}"
    elif planted.frame >= 0:
        kinds = SHOWN[planted.channel]
        first = min((d.frame for d in diff.differences if d.what in kinds), default=-1)
        seen = "yes" if first == planted.frame else "NO"
    elif planted.channel == "metadata":
        seen = "yes" if diff.made else "NO"
    else:
        seen = "not in what happens" if diff.equal else "NO"
    return [place, "yes" if right else "NO", seen]


def unchanged(folder: Path, tracker: str) -> tuple[int, int]:
    """Replays of one scene twice, over all scripts until there are 50 pairs."""
    pairs = alarms = 0
    while pairs < 50:
        for name in SCRIPTS:
            scene = generate(name, seed=pairs, size=(96, 72), frames=25)
            log = write_scene_log(scene, folder / "u.mcap", style="merged", force=True)
            for out in ("ua.mcap", "ub.mcap"):
                writing.replay(log, folder / out, options(tracker))
            quiet = compare(folder / "ua.mcap", folder / "ub.mcap").identical
            alarms += not (quiet and verify(folder / "ub.mcap", log).identical)
            pairs += 1
            if pairs == 50:
                break
    return pairs, alarms


# -- cost ----------------------------------------------------------------------------------------------------------


@contextmanager
def timed(places: Sequence[tuple[Any, str]], spent: dict[str, float], name: str) -> Iterator[None]:
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
            writing.replay(path, folder / "c.mcap", changed(options(tracker), annotations_only=False))
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
                whole = changed(options(tracker), annotations_only=False, checkpoint_ns=2 * SECOND)
                done = writing.replay(path, folder / "c.mcap", whole)
                whole_s = time.process_time() - start
            with LogReader(folder / "c.mcap") as log:
                sizes = [a.data_size for a in log.index.attachment_indexes if a.name.startswith("checkpoint/")]
            total = spent["digest"] + spent.get("states", 0.0)
            good = good and total < 0.05 * whole_s
            shares = [f"{spent.get(what, 0.0) / whole_s:.1%}" for what in ("digest", "states")]
            largest = f"{max(sizes, default=0) / 1000:.1f} kB"
            each = f"{1000 * whole_s / done.frames:.1f}"
            rows.append([name, tracker, str(done.frames), each, *shares, str(len(sizes)), largest])
    print("\nCost of digests and of a checkpoint every 2 s, in a replay with pictures")
    table(["scene", "tracker", "frames", "ms/frame", "digests", "states", "checkpoints", "largest"], rows)
    return good


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    widths = [max(len(str(row[k])) for row in [head, *rows]) for k in range(len(head))]
    for row in [head, *rows]:
        print("  " + "  ".join(str(cell).ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


PARTS = ("determinism", "travel", "plants", "cost")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(PARTS)}; default: all")
    parser.add_argument("--full", action="store_true", help="whole scenes")
    parser.add_argument("--runs", type=int, default=20, help="runs that change nothing; default 20")
    parser.add_argument("--tracker", action="append", choices=list(TRACKERS), help="default: all")
    parser.add_argument("--python", action="append", default=[], help="another interpreter with scenetrace")
    parser.add_argument("--worker", type=json.loads, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.worker:
        worker(args.worker)
        return 0
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
