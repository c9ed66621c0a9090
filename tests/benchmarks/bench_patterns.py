"""The shipped patterns meeting, moving, fighting and leaving_object against CAVIAR's labels,
beside RTEC's figures.

    python tests/benchmarks/bench_patterns.py [FOLDER]

Input: the labelled boxes, written as tracks of an annotated log and asked like any other; nothing
else of the labels. Truth per pair and frame: the group's situation `interacting` (meeting),
`moving`, `fighting`, the context `leaving`. RTEC's figures are for all thirty files with labelled
activities (walking, active, inactive, abrupt) as input, so the two columns are not the same task:
ours has less to go by, and fewer files. The thresholds of a contact were set on the two fights
that are scored here.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import caviar
import numpy as np

from reasoning.questions import Case
from reasoning.questions.patterns import plan
from recorders import channels
from recorders.log import LogWriter
from recorders.messages import Box, Groups, Relations, Track, Tracks

FRAME_NS = 40_000_000
RTEC = {"meeting": 0.71, "moving": 0.64, "fighting": 0.82, "leaving_object": 0.22}
LABELS = {"meeting": ("interacting",), "moving": ("moving",), "fighting": ("fighting",)}


def write_log(sequence: caviar.Sequence, path: Path) -> Path:
    """The labelled boxes as an annotated log's tracks."""
    by_frame: dict[int, list[tuple[int, Any]]] = {n: [] for n in range(sequence.frames)}
    for i, h in sorted(sequence.histories.items()):
        for n, box in zip(h.frames.tolist(), h.boxes.tolist(), strict=True):
            by_frame[n].append((i, tuple(box)))
    with LogWriter(path) as log:
        ids = {
            n: log.channel(
                channels.topic("camera", n),
                channels.schema(n),
                channels.message_encoding(n),
            )
            for n in ("tracks", "relations", "groups", "events")
        }
        for n, boxes in by_frame.items():
            tracks = Tracks(n, [_track(i, box) for i, box in boxes])
            for name, message in (
                ("tracks", tracks),
                ("relations", Relations(n)),
                ("groups", Groups(n)),
            ):
                log.write(ids[name], channels.encode(name, message), n * FRAME_NS)
    return path


def _track(i: int, box: Box) -> Track:
    return Track(
        id=i, box=box, ellipse=None, velocity=(0.0, 0.0), shell_radius=box[3], mode="motion", confidence=1.0,
        present=True, observed=True, blob=-1, grouping=False, grouped=False, splitting=False, grouping_partners=[],
        grouped_partners=[], splitting_partners=[], group=None, scene="inside",
    )  # fmt: skip


def truth(sequence: caviar.Sequence, activity: str) -> set[tuple[int, int, int]]:
    """(a, b, frame) of an activity."""
    if activity == "leaving_object":
        return {(x.a, x.b, n) for x in sequence.leaving for n in range(x.start, x.end + 1)}
    return {
        (x.a, x.b, n)
        for x in sequence.together
        for start, end, _, situation in x.situations
        if situation in LABELS[activity]
        for n in range(start, end + 1)
    }


def found(case: Case, activity: str) -> set[tuple[int, int, int]]:
    """(a, b, frame) that the pattern finds: the frames of its last item."""
    out = set()
    answer = case.sql(plan(activity))
    for row in answer.rows:
        values = dict(zip(answer.columns, row, strict=True))
        a, b = sorted(values[v] for v in answer.columns[1:3])
        start, end = values["step_frames"][-1]
        out |= {(a, b, n) for n in range(start, end + 1)}
    return out


def score(folder: Path) -> dict[str, np.ndarray]:
    """Counts per activity and file: (files, 3) true, false, missed frames."""
    rows: dict[str, list[tuple[int, int, int]]] = {activity: [] for activity in RTEC}
    with tempfile.TemporaryDirectory() as temporary:
        for path in sorted(folder.glob("*.xml")):
            sequence = caviar.read(path)
            with Case(
                [write_log(sequence, Path(temporary) / f"{sequence.name}.mcap")]
            ) as case:
                for activity in RTEC:
                    f, t = found(case, activity), truth(sequence, activity)
                    rows[activity].append((len(f & t), len(f - t), len(t - f)))
    return {activity: np.array(r, np.int64) for activity, r in rows.items()}


def main() -> int:
    folder = (
        Path(sys.argv[1])
        if len(sys.argv) > 1
        else Path(__file__).parents[3] / "shared" / "data" / "caviar"
    )
    print(
        f"{'pattern':16s} {'F1':>5s} {'precision':>9s} {'recall':>6s}   RTEC (30 files,"
        " labelled activities)"
    )
    for activity, counts in score(folder).items():
        tp, fp, fn = (int(v) for v in counts.sum(axis=0))
        f1, precision, recall = (
            2 * tp / max(1, 2 * tp + fp + fn),
            tp / max(1, tp + fp),
            tp / max(1, tp + fn),
        )
        print(
            f"{activity:16s} {f1:5.2f} {precision:9.2f} {recall:6.2f}  "
            f" {RTEC[activity]:.2f}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
