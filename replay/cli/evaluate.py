"""`scenetrace eval`: score an annotated log, or a MOTChallenge text, against a labelled truth."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recorders.errors import OutputExistsError, SceneTraceError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.names import whole
from replay.cli.common import (
    Commands,
    add_camera,
    add_limits,
    parse_limits,
    picture_size,
    printable,
)
from replay.cli.exit_codes import Exit

if TYPE_CHECKING:
    from rich.table import Table

    from replay.evaluate import Errors, MotTable, Scores

MCAP_MAGIC = b"\x89MCAP0\r\n"
EPILOG = """\
examples:
  scenetrace eval annotated.mcap --truth gt.txt --truth-size 768x576
  scenetrace eval annotated.mcap --truth sequence.xml --json
  scenetrace eval result.txt --truth gt.txt --plot errors.png
  scenetrace eval result.txt --truth gt.txt --plot both.png --also other.txt

The truth is MOTChallenge text (rows with confidence 0 do not count) or CAVIAR XML. HOTA, CLEAR and identity
figures are those of TrackEval; shares are in percent. Where the truth was labelled in a picture of another size than
the recording's, say so with --truth-size; its boxes are then scaled. Truth in frames that the recording
does not have is left out, and said.
"""


@dataclass(frozen=True)
class Result:
    """What is scored: boxes, picture size if known, frames and seconds between them if known.

    ``fitted_on`` says what the tracker's features were fitted on, if they were fitted: its truth
    is no fair judge.
    """

    table: MotTable
    size: tuple[int, int] | None = None
    frames: Any = None
    frame_s: float = 0.0
    fitted_on: str = ""


def add(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "eval",
        help="score tracks against truth: HOTA, MOTA, IDF1",
        description=(
            "Score tracks against a labelled truth: HOTA, CLEAR, identity, trajectories,"
            " place and size."
        ),
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "annotated",
        type=Path,
        metavar="ANNOTATED",
        help="annotated log, or MOTChallenge text",
    )
    parser.add_argument(
        "--truth",
        type=Path,
        required=True,
        metavar="FILE",
        help="gt.txt, CAVIAR or CVAT .xml, or another format of boxes with identities",
    )
    parser.add_argument(
        "--truth-size",
        type=picture_size,
        metavar="WxH",
        help="picture that the truth was labelled in",
    )
    parser.add_argument(
        "--size",
        type=picture_size,
        metavar="WxH",
        help="picture of the tracks, where the log does not say",
    )
    parser.add_argument(
        "--frames",
        type=span,
        metavar="A:B",
        help="score only frames A to B (from 0, B excluded)",
    )
    parser.add_argument(
        "--iou",
        type=float,
        default=0.5,
        help="overlap from which boxes match (default 0.5)",
    )
    add_camera(parser)
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="FILE",
        help="plot distances, MOTA and paths over time (.png .pdf .svg)",
    )
    parser.add_argument(
        "--also", type=Path, action="append", default=[], metavar="ANNOTATED",
        help="another tracker's result to draw beside it; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--raw", action="store_true",
        help="without MOTChallenge's preprocessing: every row of the truth counts but those of confidence 0",
    )  # fmt: skip
    parser.add_argument(
        "--labelled-frames-only", action="store_true",
        help="score the frames that the truth labels alone, where it labels one in some",
    )  # fmt: skip
    parser.add_argument("--force", action="store_true", help="overwrite an existing plot")
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_limits(parser)
    parser.set_defaults(run=run)


def span(text: str) -> tuple[int, int | None]:
    """First and last frame (excluded) of ``100:200``, ``100:`` or ``:200``."""
    first, colon, last = text.partition(":")
    if not colon or not all(end == "" or whole(end) is not None for end in (first, last)):
        raise argparse.ArgumentTypeError(f"{text[:60]!r}: must be FIRST:LAST, like 0:300")
    return int(first or 0), int(last) if last else None


def run(args: argparse.Namespace) -> int:
    """Score and print."""
    from replay.evaluate import evaluate, fit_truth, read_truth
    from replay.export.output import check_figure

    if not 0 < args.iou <= 1:
        raise UsageError(f"--iou {args.iou}: must be over 0 and at most 1")
    if args.plot is not None:
        check_figure(args.plot)
    if args.plot is not None and args.plot.exists() and not args.force:
        raise OutputExistsError(args.plot)
    if args.also and args.plot is None:
        raise UsageError("--also draws another result into the plot: say where with --plot")
    result = read_result(args.annotated, args.camera, parse_limits(args.limit))
    picture = args.size or result.size
    truth = read_truth(args.truth) if args.raw else _whole_truth(args.truth)
    done = _told_left_out({args.truth: truth, args.annotated: result.table})
    if picture is not None:
        truth = fit_truth(truth, picture, args.truth_size)
    elif args.truth_size is not None:
        raise UsageError(
            f"--truth-size needs the size of the tracks' picture, which {args.annotated}"
            " does not say: --size"
        )
    all_true = len(truth)
    truth, table = _common(args, truth, result)
    left_out = all_true - len(truth)
    if left_out:
        sys.stderr.write(
            f"scenetrace: {left_out} of {all_true} true boxes are in frames that are not"
            " scored\n"
        )
    if not args.raw:
        truth, table = _prepared(truth, table)
    others = [
        read_result(path, args.camera, parse_limits(args.limit)) for path in args.also
    ]
    for fitted_on in dict.fromkeys(r.fitted_on for r in (result, *others) if r.fitted_on):
        sys.stderr.write(
            f"scenetrace: the features of parts were fitted on {fitted_on}; "
            "figures for those recordings are not of data unseen\n"
        )
    scores = evaluate(truth, table, args.iou)
    if args.plot is not None:
        from replay.evaluate.plots import plot

        names = _told_apart([args.annotated, *args.also])
        tables = [_common(args, truth, other)[1] for other in others]
        also = list(zip(names[1:], tables, strict=True))
        name = names[0] if also else ""
        plot(
            truth,
            table,
            args.plot,
            iou=args.iou,
            frame_s=result.frame_s,
            name=name,
            also=also,
        )
    if args.json:
        facts = {
            "annotated": str(args.annotated),
            "truth": str(args.truth),
            "iou": args.iou,
            "size": picture,
        }
        facts |= {
            "features_fitted_on": result.fitted_on,
            "truth_size": args.truth_size or picture,
            "true_boxes_left_out": left_out,
        }
        print(json.dumps(facts | scores.as_plain(), indent=2))
    else:
        show(scores, str(args.annotated))
    return done


def _told_left_out(tables: dict[Path, MotTable]) -> Exit:
    """Say what in the files is no box; how the command ends therefore."""
    lines = [
        f"{path}: left out: {line}" for path, one in tables.items() for line in one.left_out
    ]
    sys.stderr.writelines(f"scenetrace: {line}\n" for line in lines)
    return Exit.LEFT_OUT if lines else Exit.DONE


def _whole_truth(path: Path) -> MotTable:
    """A truth with the rows that do not count, which tell what a result may follow."""
    from replay.evaluate import read_truth
    from replay.evaluate.truth import read_table

    table = read_table(path)
    judged_otherwise = table.classes is not None or table.regions is not None
    return table if judged_otherwise else read_truth(path)


def _prepared(truth: MotTable, table: MotTable) -> tuple[MotTable, MotTable]:
    """Truth and result without what MOTChallenge does not judge; says so."""
    from replay.evaluate.preprocessing import prepared

    done = prepared(truth, table)
    if truth.classes is not None and (done.ignored or done.dropped):
        sys.stderr.write(
            f"scenetrace: as MOTChallenge judges: {done.ignored} rows of the truth do not"
            " count (other classes, or marked so), and"
            f" {done.dropped} boxes of the result lay on distractors; --raw judges all\n"
        )
    if truth.regions is not None and done.dropped:
        sys.stderr.write(
            f"scenetrace: {done.dropped} boxes of the result lay where the truth says that"
            " nobody was labelled (crowds, DontCare); --raw judges all\n"
        )
    if not len(done.truth):
        raise SceneTraceError("no row of the truth counts: --raw judges all")
    return done.truth, done.result


def _told_apart(paths: list[Path]) -> list[str]:
    """Names of results for a legend: the files' names without suffix, or whole paths where those
    are alike.
    """
    stems = [path.stem for path in paths]
    return stems if len(set(stems)) == len(stems) else [str(path) for path in paths]


def _common(
    args: argparse.Namespace, truth: MotTable, result: Result
) -> tuple[MotTable, MotTable]:
    """Truth and result in the frames that are scored."""
    import numpy as np

    table = result.table
    kept = (
        truth
        if result.frames is None
        else truth.select(np.isin(truth.frames, result.frames))
    )
    if args.labelled_frames_only:
        table = table.select(np.isin(table.frames, kept.frames))
    if args.frames is not None:
        first, last = args.frames
        end = int(np.iinfo(np.int64).max) if last is None else last
        kept, table = kept.between(first, end), table.between(first, end)
    if not len(kept):
        first, last = int(truth.frames[0]), int(truth.frames[-1])
        raise SceneTraceError(
            f"{args.truth}: no truth in the frames to score; it has frames {first} to"
            f" {last} (from 0)"
        )
    return kept, table


def read_result(path: Path, camera: str | None, limits: Limits = DEFAULT_LIMITS) -> Result:
    """Read an annotated log or, if it is no MCAP, a MOTChallenge text."""
    import numpy as np

    from recorders.annotated.reader import AnnotatedLog
    from replay.evaluate.track_table import read_tracks
    from replay.evaluate.truth import read_table

    try:
        with path.open("rb") as file:
            is_log = (
                file.read(len(MCAP_MAGIC)) == MCAP_MAGIC or path.suffix.lower() == ".mcap"
            )
    except OSError as error:
        raise SceneTraceError(f"{path}: cannot be read: {error.strerror}") from error
    if not is_log:
        return Result(read_table(path))
    with AnnotatedLog(path, camera, limits) as log:
        found = read_tracks(log)
        fitted_on = _fitted_on(log.tracker, log.facts.get("configuration", ""))
    step = float(np.median(np.diff(found.times_ns))) / 1e9 if len(found.frames) > 1 else 0.0
    return Result(found.table, found.size, found.frames, step, fitted_on)


def _fitted_on(tracker: str, configuration: str) -> str:
    """What the recorded configuration of a tracker with fitted features says that they were
    fitted on.
    """
    try:
        section = json.loads(configuration)["part_features"] if tracker == "parts" else {}
        return printable(str(section.get("fitted_on", "")))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return ""


def show(scores: Scores, name: str) -> None:
    """Print the scores as tables."""
    from rich.console import Console

    console = Console(file=sys.stdout)
    if not console.is_terminal:
        console = Console(file=sys.stdout, width=100)
    for table in (
        _headline(scores, name),
        _criteria(scores),
        _errors(scores),
        _each(scores),
    ):
        console.print(table)


def _table(title: str, columns: Sequence[str]) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right")
    return table


def _headline(scores: Scores, name: str) -> Table:
    h, c, i = scores.hota, scores.clear, scores.identity
    table = _table(
        f"{name} (percent)",
        [
            "HOTA",
            "DetA",
            "AssA",
            "LocA",
            "MOTA",
            "MOTP",
            "IDF1",
            "IDP",
            "IDR",
            "Prec",
            "Rec",
        ],
    )
    shares = (
        h.hota,
        h.det_a,
        h.ass_a,
        h.loc_a,
        c.mota,
        c.motp,
        i.idf1,
        i.idp,
        i.idr,
        c.precision,
        c.recall,
    )
    table.add_row(*(f"{share:.1f}" for share in shares))
    table.caption = (
        f"switches {c.switches}, fragments {c.fragments}, false positives"
        f" {c.false_positives}, misses {c.false_negatives}, mostly tracked"
        f" {c.mostly_tracked}, partly {c.partly_tracked}, mostly lost {c.mostly_lost};"
        f" {scores.true_ids} true and {scores.result_ids} result identities"
    )
    table.caption_justify = "left"
    return table


def _criteria(scores: Scores) -> Table:
    trajectories = scores.trajectories
    table = _table("Trajectories (PARTS 5.2)", ["criterion", ""])
    for what, value in (
        ("trajectories", f"{trajectories.count}"),
        ("mostly tracked (over 80 % of frames)", f"{trajectories.mostly_tracked}"),
        ("mostly tracked under a single id", f"{trajectories.mostly_tracked_single_id}"),
        ("mostly lost (under 40 %)", f"{trajectories.mostly_lost}"),
        ("missed", f"{trajectories.missed}"),
        ("under-segmented (taken for another)", f"{trajectories.under_segmented}"),
        ("over-segmented (several ids)", f"{trajectories.over_segmented}"),
        ("ids swapped, per trajectory", f"{trajectories.swaps_per_trajectory:.2f}"),
        ("ids per trajectory", f"{trajectories.ids_per_trajectory:.2f}"),
        ("ids per frame", f"{trajectories.ids_per_frame:.2f}"),
    ):
        table.add_row(what, value)
    return table


def _errors(scores: Scores) -> Table:
    trajectories = scores.trajectories
    table = _table(
        "Errors of place and size (PARTS 5.3)",
        [
            "over",
            "as",
            "x",
            "y",
            "width",
            "height",
            "of the truth",
        ],
    )
    for what, e in (
        ("matched frames", trajectories.matched),
        ("all frames of the identity", trajectories.followed),
    ):
        for index, (how, values, unit) in enumerate(_normalisations(e)):
            table.add_row(
                "" if index else what,
                how,
                *(f"{value:.1f}{unit}" for value in values),
                f"{e.share:.1f} %",
            )
    return table


def _normalisations(errors: Errors) -> list[tuple[str, tuple[float, ...], str]]:
    return [
        ("centre by coordinate, size by size", errors.headline, " %"),
        ("all by true coordinate", errors.coordinate, " %"),
        ("all by true size", errors.size, " %"),
        ("pixels", errors.pixels, " px"),
    ]


def _each(scores: Scores) -> Table:
    table = _table(
        "Each trajectory",
        [
            "truth",
            "frames",
            "tracked",
            "ids",
            "switches",
            "swaps",
            "fragments",
            "centre off",
        ],
    )
    for t in scores.trajectories.each:
        ids = " ".join(map(str, t.ids[:6])) + (
            f" +{len(t.ids) - 6}" if len(t.ids) > 6 else ""
        )
        tracked, off = f"{t.share:.0f} %", f"{t.error_px:.1f} px"
        where = f"{t.first_frame}-{t.last_frame}"
        counts = map(str, (t.switches, t.swaps, t.fragments))
        table.add_row(str(t.truth), where, tracked, ids, *counts, off)
    return table
