"""Events of every generated scene, of the labelled CAVIAR people and of the corridor: right,
missing, spurious.

    python tests/benchmarks/bench_events.py                          all tables
    python tests/benchmarks/bench_events.py scenes --names demo --seeds 0 1 --list
    python tests/benchmarks/bench_events.py caviar
    python tests/benchmarks/bench_events.py damping
    python tests/benchmarks/bench_events.py corridor
    python tests/benchmarks/bench_events.py pictures -o DIR
    python tests/benchmarks/bench_events.py drawn -o docs/pictures

``scenes``: a scene's events from the truth's boxes, from a whole replay of a log with perfect
detections, and from a whole replay of its pixels. ``caviar``: whether the pairs that the labels
call a group interact in our graph, states visited, transitions exercised, forbidden ones.
``damping``: how often partners flicker, by ``leave_margin``. ``corridor``: the indoor sequence of
EVENTS, Figure 5. ``pictures``: a picture per kind of event from the real recordings; ``drawn``:
those of the documentation, from generated scenes.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import caviar
import cv2
import event_pictures
import numpy as np
import sequences

from fixtures.logs import record_scene, write_scene_log
from fixtures.scenes import SCRIPTS, GeneratedScene, generate
from fixtures.targets import truth_targets
from reasoning.interactions import InteractionParameters
from reasoning.reasoner import Reasoner
from recorders.annotated.reader import AnnotatedLog
from recorders.messages import Target, Targets
from recorders.recording import RecordOptions, record
from recorders.sources import open_source
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.run import ReplayOptions

TOLERANCE_S = 1.0
DATA = Path(
    os.environ.get("SCENETRACE_DATA", Path(__file__).parents[3] / "shared" / "data")
)


def options(settings: list[str] | None = None) -> ReplayOptions:
    """A replay with the EVENTS tracker."""
    return ReplayOptions(
        config=replay_config("events", assignments=settings or ()), force=True
    )


def scenes(names: list[str], seeds: list[int], show: bool, settings: list[str]) -> int:
    """The table scene x {perfect detections, pixels}."""
    print(
        f"events of {', '.join(f'seed {s}' for s in seeds)}; right within {TOLERANCE_S} s;"
        " sw = identity switches"
    )
    head = "  ".join(
        f"{w:>5}{'right':>6}{'miss':>6}{'spur':>6}{'edits':>6}{'sw':>4}"
        for w in ("boxes", "pixel")
    )
    print(f"{'scene':28}{'truth':>6}  {head}")
    total = np.zeros((2, 6), np.int64)
    for name in names:
        for seed in seeds:
            row, details = one_scene(name, seed, settings)
            total += row
            cells = "  ".join(
                f"{c[0]:>5}{c[1]:>6}{c[2]:>6}{c[3]:>6}{c[4]:>6}{c[5]:>4}"
                for c in row.tolist()
            )
            print(
                f"{name + ' ' + str(seed):28}{row[0, 1] + row[0, 2]:>6}  {cells}",
                flush=True,
            )
            if show:
                print(details)
    cells = "  ".join(
        f"{c[0]:>5}{c[1]:>6}{c[2]:>6}{c[3]:>6}{c[4]:>6}{c[5]:>4}" for c in total.tolist()
    )
    print(f"{'together':28}{total[0, 1] + total[0, 2]:>6}  {cells}")
    return 0


def one_scene(name: str, seed: int, settings: list[str]) -> tuple[np.ndarray, str]:
    """(perfect detections, pixels) x (events, right, missing, spurious, edits, switches), and
    what is wrong.
    """
    scene = generate(name, seed)
    truth, _ = sequences.of_truth(scene)
    rows, details = [], []
    with TemporaryDirectory() as folder:
        boxes, pixels = Path(folder) / "boxes.mcap", Path(folder) / "pixels.mcap"
        write_scene_log(scene, boxes, pictures="none")
        record_scene(scene, pixels)
        for what, path in (("perfect detections", boxes), ("pixels", pixels)):
            out = path.with_suffix(".annotated.mcap")
            replay(path, out, options(settings))
            found = sequences.of_replay(scene, out)
            c = sequences.compare(truth, found.events, round(TOLERANCE_S * scene.fps))
            rows.append(
                [
                    len(found.events),
                    c.right,
                    len(c.missing),
                    len(c.spurious),
                    c.edits,
                    found.switches,
                ]
            )
            details.append(f"  from {what}, tracks {found.owner}:")
            details += [f"    missing  {line}" for line in sequences.lines(c.missing)]
            details += [f"    spurious {line}" for line in sequences.lines(c.spurious)]
    return np.array(rows, np.int64), "\n".join(details)


def labelled(sequence: caviar.Sequence) -> list[Targets]:
    """A CAVIAR file's people as a tracker without a fault would give them; boxes that nearly
    touch are one blob.
    """
    frames: list[dict[int, Any]] = [{} for _ in range(sequence.frames)]
    speeds: list[dict[int, tuple[float, float]]] = [{} for _ in range(sequence.frames)]
    for i, h in sequence.people().items():
        middle = h.boxes[:, :2] + h.boxes[:, 2:] / 2
        for k, f in enumerate(h.frames.tolist()):
            back = int(np.searchsorted(h.frames, f - 12))
            dt = (f - int(h.frames[back])) / caviar.FPS
            vx, vy = ((middle[k] - middle[back]) / dt).tolist() if dt else (0.0, 0.0)
            frames[f][i], speeds[f][i] = tuple(h.boxes[k].tolist()), (vx, vy)
    answer = []
    for f, boxes in enumerate(frames):
        blob = shared(boxes)
        answer.append(
            Targets(
                f, [Target(i, boxes[i], speeds[f][i], blob=blob[i]) for i in sorted(boxes)]
            )
        )
    return answer


def shared(boxes: dict[int, tuple[float, ...]], gap: float = 4.0) -> dict[int, int]:
    """Boxes that overlap or are at most ``gap`` px apart stand for one blob, numbered by its
    lowest member.
    """
    root = {i: i for i in boxes}
    for i, a in boxes.items():
        for j, b in boxes.items():
            wide = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0]) > -gap
            if i < j and wide and min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1]) > -gap:
                low, high = sorted((root[i], root[j]))
                root = {k: low if v == high else v for k, v in root.items()}
    return root


def caviar_table(folder: Path) -> int:
    """Per file: labelled pairs, the share of their labelled frames in which they interact,
    states, transitions.
    """
    print(
        f"{'file':24}{'pairs':>6}{'interact':>9}{'share':>7}{'as partners':>12}  states"
        " visited; transitions; forbidden"
    )
    everything: Counter[str] = Counter()
    for path in sorted(folder.glob("*.xml")):
        s = caviar.read(path)
        reasoner = Reasoner({}, 384, 288)
        related: list[set[tuple[int, int]]] = []
        partners: list[set[tuple[int, int]]] = []
        for t in labelled(s):
            a = reasoner.step(t.frame, round(t.frame * 1e9 / caviar.FPS), t, None)
            related.append({(r.a, r.b) for r in a.relations.relations})
            partners.append(
                {
                    (r.a, r.b)
                    for r in a.relations.relations
                    if r.grouping or r.grouped or r.splitting
                }
            )
        rows = [((x.a, x.b), f) for x in s.together for f in range(x.start, x.end + 1)]
        met = {p for p, f in rows if p in related[f]}
        pairs = {p for p, _ in rows}
        share = np.mean([p in related[f] for p, f in rows]) if rows else 1.0
        close = np.mean([p in partners[f] for p, f in rows]) if rows else 1.0
        summary = reasoner.counter.summary()
        everything.update(summary["exercised"])
        words = (
            f"{' '.join(summary['visited'])}; {len(summary['exercised'])};"
            f" {summary['forbidden']}"
        )
        print(
            f"{s.name:24}{len(pairs):>6}{len(met):>9}{share:>7.3f}{close:>12.3f}  {words}"
        )
    print(
        f"transitions exercised ({len(everything)} of 56): {', '.join(sorted(everything))}"
    )
    return 0


def damping(folder: Path) -> int:
    """Pairs that part and are partners again within a second, by leave_margin."""
    people = [
        (p.stem, labelled(caviar.read(p)), 40_000_000, (384, 288))
        for p in sorted(folder.glob("*.xml"))
    ]
    generated: list[tuple[str, list[Targets], int, tuple[int, int]]] = []
    for name in SCRIPTS:
        s = generate(name)
        generated.append((name, list(truth_targets(s)), s.frame_ns, (s.width, s.height)))
    print(
        "partners' intervals (flickers: partners again within a second), and their frames,"
        " by leave_margin"
    )
    print(
        f"{'leave_margin':>12}  {'CAVIAR, 12 files':>28} "
        f" {f'generated, {len(generated)} scenes':>28}"
    )
    for margin in (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5):
        cells = []
        for recordings in (people, generated):
            sums = np.array([intervals(r[1], r[2], r[3], margin) for r in recordings]).sum(
                axis=0
            )
            cells.append(f"{sums[0]:>8} ({sums[1]:>4}) {sums[2]:>12}")
        print(f"{margin:>12}  {cells[0]:>28}  {cells[1]:>28}", flush=True)
    return 0


def intervals(
    frames: list[Targets], frame_ns: int, size: tuple[int, int], margin: float
) -> tuple[int, int, int]:
    """Of all pairs: intervals as partners, those that begin within a second of the last one's
    end, frames.
    """
    reasoner = Reasoner({"interactions": InteractionParameters(leave_margin=margin)}, *size)
    last: dict[tuple[int, int], int] = {}
    begun = again = held = 0
    for t in frames:
        a = reasoner.step(t.frame, t.frame * frame_ns, t, None)
        pairs = {
            (min(k.id, p), max(k.id, p)) for k in a.tracks.tracks for p in partners_of(k)
        }
        held += len(pairs)
        for pair in sorted(pairs):
            gap = t.frame - last[pair] if pair in last else None
            begun += gap != 1
            again += gap is not None and 1 < gap <= 1e9 / frame_ns
            last[pair] = t.frame
    return begun, again, held


def partners_of(track: object) -> list[int]:
    """Everyone a track is grouping, grouped or splitting with."""
    return [*track.grouping_partners, *track.grouped_partners, *track.splitting_partners]  # type: ignore[attr-defined]


CORRIDOR = ("OneLeaveShopReenter1cor", "EnterExitCrossingPaths1cor")
MOMENTS = (
    "track_confirmed",
    "interaction_started",
    "grouping",
    "grouped",
    "splitting",
    "single",
)
"""What Figure 5 of EVENTS shows of the indoor sequence, by the last event of each kind, and the
deepest occlusion.
"""


def corridor(
    folder: Path, settings: list[str], name: str = CORRIDOR[0], out: Path | None = None
) -> int:
    """The events of the indoor sequence from its pixels; with ``out``, the row of pictures, too."""
    with TemporaryDirectory() as temporary:
        path = real(folder / "caviar-corridor" / f"{name}.mpg", Path(temporary), settings)
        with AnnotatedLog(path) as log:
            frames = list(log.frames())
        events = [e for f in frames for e in f.events]
        print(
            f"{name}: {len(frames)} frames, targets"
            f" {sorted({t.id for f in frames for t in f.tracks})}"
        )
        for e in events:
            print(f"{e.frame:>5} {e.kind:20} {e.text}")
        if out is not None:
            last = {e.kind: e.frame for e in events}
            middle = (last["grouped"] + last["splitting"]) // 2
            wanted = sorted(
                {middle, *(last[k] for k in MOMENTS if k in last)}
                - {last["track_confirmed"]}
            )
            out.mkdir(parents=True, exist_ok=True)
            rows = event_pictures.moments(path, wanted, (30, 50, 200, 200))
            event_pictures.save(out / "one_leaves_shop.jpg", rows)
    return 0


def real(source: Path, folder: Path, settings: list[str], **wanted: Any) -> Path:
    """Record and replay a recording from its pixels."""
    log, out = folder / f"{source.stem}.mcap", folder / f"{source.stem}.annotated.mcap"
    record(
        open_source(source, fps=wanted.pop("fps", None)),
        log,
        RecordOptions(force=True, **wanted),
    )
    replay(log, out, options(settings))
    return out


class TruthTracker:
    """Says what is true of a generated scene."""

    def __init__(self, scene: GeneratedScene) -> None:
        self._answers: Iterator[Targets] = truth_targets(scene)

    def step(self, frame: object) -> Targets:
        """The next frame's truth."""
        return next(self._answers)

    def state(self) -> dict[str, object]:
        """It cannot be continued."""
        return {}

    def restore(self, state: object) -> None:
        """It cannot be continued."""


def drawn_from_truth(out: Path) -> int:
    """The pictures of the documentation: generated scenes, tracked without a fault."""
    with TemporaryDirectory() as temporary:
        logs = []
        for name in (
            "three_way_group",
            "stand_on_edge",
            "enter_as_group_and_split",
            "demo",
        ):
            scene = generate(name, size=(480, 360))
            path = write_scene_log(scene, Path(temporary) / f"{name}.mcap", style="none")
            logs.append(path.with_suffix(".annotated.mcap"))
            chosen = options(FORWARD)
            replay(
                path, logs[-1], replace(chosen, tracker=lambda *_, s=scene: TruthTracker(s))
            )
        missing = event_pictures.per_kind(logs, out, ".jpg")
        print(f"{out}: no picture of {', '.join(missing) or 'no kind'}")
        rows = event_pictures.moments(logs[0], THREE_WAY, (80, 120, 300, 180))
        half = np.asarray(
            cv2.resize(rows, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA), np.uint8
        )
        event_pictures.save(out / "three_way.jpg", half)
    return 0


THREE_WAY = (44, 60, 131, 151, 158, 222)
"""Two group, are grouped; a third groups with them, all three are grouped; one splits off; the
others split.
"""
FORWARD = ["events.hindsight=false"]


def pictures(folder: Path, settings: list[str], out: Path) -> int:
    """A picture per kind of event from the real recordings; for kinds that do not occur there,
    from a generated one.
    """
    with TemporaryDirectory() as temporary:
        here = Path(temporary)
        zones = here / "regions.json"
        zones.write_text(ZONES, encoding="ascii")
        logs = [
            real(folder / "caviar-corridor" / f"{n}.mpg", here, settings) for n in CORRIDOR
        ]
        logs.append(
            real(
                folder / "pets09-s2l1" / "video.avi", here, settings, fps=7.0, regions=zones
            )
        )
        missing = event_pictures.per_kind(logs, out, ".jpg")
        print(f"{out}: no picture of {', '.join(missing) or 'no kind'}")
    return corridor(folder, settings, out=out)


ZONES = """{"roi": [[[16, 16], [464, 16], [464, 344], [16, 344]]], "border": [[[5, 5], [475, 5], [475, 355], [5, 355]]],
"zones": {"junction": [[150, 130], [330, 130], [330, 230], [150, 230]]}}"""


def main() -> int:
    """Choose a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    tables = ("all", "scenes", "caviar", "damping", "corridor", "pictures", "drawn")
    parser.add_argument("what", nargs="?", choices=tables, default="all")
    parser.add_argument(
        "--names", nargs="*", choices=tuple(SCRIPTS), default=list(SCRIPTS), metavar="SCENE"
    )
    parser.add_argument("--seeds", nargs="*", type=int, default=[0])
    parser.add_argument(
        "--list", action="store_true", help="every missing and spurious event"
    )
    parser.add_argument(
        "--set", nargs="*", default=[], metavar="KEY=VALUE", help="the replay's parameters"
    )
    parser.add_argument("-o", "--out", type=Path, help="folder of the pictures")
    args = parser.parse_args()
    folder = DATA / "caviar"
    answer = 0
    if args.what in ("all", "scenes"):
        answer |= scenes(args.names, args.seeds, args.list, args.set)
    if not folder.exists():
        print(f"no CAVIAR labels at {folder}; set SCENETRACE_DATA", file=sys.stderr)
        return answer
    if args.what in ("pictures", "drawn") and args.out is None:
        parser.error("pictures need a folder: -o DIR")
    if args.what in ("all", "corridor"):
        answer |= corridor(DATA, args.set, out=args.out) | corridor(
            DATA, args.set, CORRIDOR[1]
        )
    if args.what == "drawn":
        answer |= drawn_from_truth(args.out)
    if args.what == "pictures":
        answer |= pictures(DATA, args.set, args.out)
    if args.what in ("all", "caviar"):
        answer |= caviar_table(folder)
    if args.what in ("all", "damping"):
        answer |= damping(folder)
    return answer


if __name__ == "__main__":
    sys.exit(main())
