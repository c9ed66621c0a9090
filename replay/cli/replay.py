"""``scenetrace replay``."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from recorders.errors import OutputExistsError, UsageError
from recorders.parameters import Config
from replay.cli import common, diff, follow
from replay.cli.exit_codes import Exit
from replay.cli.starts import check_starts, missed
from replay.plurals import count_of

if TYPE_CHECKING:
    from recorders.corrections import Corrections
    from recorders.scene import SceneLog
    from replay.trackers.choice import TrackerChoice


_LEAST_FRAME_NS = 10_000
"""No camera takes pictures faster: times are of another unit."""


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "replay",
        "a scene log through a tracker into an annotated log",
        "Replay a scene log through a tracker, reason over what its targets do to one"
        " another, and write everything\nback beside the recorded messages. Same recording,"
        " same configuration: the same annotations, bit for bit.",
        "scenetrace replay scene.mcap -o annotated.mcap --tracker events\nscenetrace replay"
        " scene.mcap -o minute.mcap --from 60 --to 120 --annotations-only\nscenetrace"
        " replay scene.mcap --against annotated.mcap --set interactions.safety_margin=0.5\nscenetrace"
        " replay scene.mcap --follow -o live.mcap",
    )
    parser.add_argument(
        "scene", type=Path, help="a scene log, or an annotated log to be replayed anew"
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="the annotated log"
    )
    common.add_tracker(parser, "default events")
    common.add_configuration(parser)
    parser.add_argument(
        "--init", action="append", default=[], metavar="frame:N:x,y,w,h",
        help="parts: start a target by hand, and none by itself; may be repeated (same as --set parts.init=...)",
    )  # fmt: skip
    parser.add_argument(
        "--from",
        dest="start",
        metavar="T",
        help="first time to write: seconds, frame:N or RFC 3339",
    )
    parser.add_argument(
        "--to", dest="end", metavar="T", help="end of what is written, excluded"
    )
    parser.add_argument(
        "--regions", type=Path, metavar="FILE",
        help="region of interest, border and zones as JSON, in place of the recorded ones",
    )  # fmt: skip
    parser.add_argument(
        "--corrections", type=Path, metavar="FILE",
        help="what people corrected (see `scenetrace correct`), applied before anything is reasoned out",
    )  # fmt: skip
    parser.add_argument(
        "--annotations-only", action="store_true", help="leave the recorded messages out"
    )
    parser.add_argument(
        "--follow", action="store_true",
        help="the scene log is still written: annotate what comes as it comes, without hindsight, until it ends or"
        " Ctrl-C",
    )  # fmt: skip
    parser.add_argument(
        "--checkpoint",
        type=float,
        metavar="SECONDS",
        help="store the whole state every so often",
    )
    parser.add_argument(
        "--checkpoints",
        type=Path,
        metavar="LOG",
        help="an annotated log whose checkpoints make --from faster",
    )
    common.add_camera(parser)
    common.add_limits(parser)
    parser.add_argument("--force", action="store_true", help="overwrite an existing output")
    parser.add_argument(
        "--against", type=Path, metavar="LOG",
        help="print what happens otherwise than in this annotated log, whose tracker and parameters are taken where "
        "none are given; exit code 4 where it differs; -o may be left out",
    )  # fmt: skip
    diff.add_options(parser)
    parser.add_argument(
        "--json", action="store_true", help="with --against: the differences as JSON"
    )
    parser.add_argument(
        "--html",
        type=Path,
        metavar="OUT",
        help="with --against: a page with pictures of the first ones",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Replay."""
    if args.follow and args.output is None:
        raise UsageError("--follow: give -o FILE for the annotated log")
    if args.output is None and args.against is None:
        raise UsageError("no output: give -o FILE, or --against LOG to compare alone")
    if args.against is None and (args.json or args.html is not None):
        raise UsageError(
            f"{'--json' if args.json else '--html'} shows what differs: give --against LOG"
        )
    if args.html is not None and args.html.exists() and not args.force:
        raise OutputExistsError(args.html)
    if args.follow:
        from replay.trackers.choice import DEFAULT_TRACKER, choose

        tracker = choose(args.tracker or DEFAULT_TRACKER)
        return follow.run(args, _assignments(args, tracker))
    if args.against is None:
        return _replay(args, args.output)
    with TemporaryDirectory(prefix="scenetrace-") as folder:
        out = args.output or Path(folder) / "replayed.mcap"
        left_out = _replay(args, out)
        return _compare(args, out) or left_out


def _configured(args: argparse.Namespace) -> tuple[TrackerChoice, Config]:
    """Tracker and configuration: of the log to compare with, then of the file, then of the words."""
    from recorders.annotated.provenance import provenance_of
    from recorders.log import LogReader
    from recorders.parameters import as_plain
    from replay.configuration import recorded_config, replay_config, sections
    from replay.trackers.choice import DEFAULT_TRACKER, choose
    from replay.verification import choice_of

    if args.against is None:
        tracker = choose(args.tracker or DEFAULT_TRACKER)
        return tracker, replay_config(tracker, args.config, _assignments(args, tracker))
    with LogReader(args.against, common.parse_limits(args.limit)) as log:
        facts = provenance_of(log)
    tracker = choose(args.tracker) if args.tracker else choice_of(facts)
    known = sections(tracker)
    recorded, notes = recorded_config(
        tracker, {s: v for s, v in facts.configuration.items() if s in known}
    )
    for note in notes if tracker.name == facts.tracker else ():
        common.say(f"{args.against}: {note}")
    return tracker, replay_config(
        tracker, args.config, _assignments(args, tracker), as_plain(recorded)
    )


def _check_corrections(
    path: Path, corrections: Corrections, tracker: str, camera: str
) -> None:
    """That corrections are of this tracker's numbers and this camera's tracks.

    Raises:
        UsageError: they are not.
    """
    theirs = corrections.head
    if (theirs.tracker, theirs.camera) != (tracker, camera):
        raise UsageError(
            f"--corrections {path}: is of camera {theirs.camera} and tracker {theirs.tracker},"
            f" this is a replay of {camera} with {tracker}, which numbers its targets otherwise"
        )


def _assignments(args: argparse.Namespace, tracker: TrackerChoice) -> list[str]:
    """What was set, and the targets started by hand."""
    if args.init and "parts" not in tracker.sections:
        raise UsageError(
            f"--init: the tracker {tracker.name} starts its targets by itself; use --tracker"
            " parts"
        )
    return [
        *args.assignments,
        *([f"parts.init={'; '.join(args.init)}"] if args.init else []),
    ]


def _compare(args: argparse.Namespace, out: Path) -> int:
    from replay.compare import compare

    options = replace(
        diff.options_of(args), only_shared=args.start is not None or args.end is not None
    )
    found = compare(args.against, out, options, common.parse_limits(args.limit))
    if args.html is not None:
        diff.write_html(found, args.html, scene=args.scene, force=args.force)
    return diff.show(replace(found, b=str(args.output or "this replay")), args.json)


def _replay(args: argparse.Namespace, out: Path) -> int:
    from recorders.corrections import read_corrections
    from recorders.scene import SceneLog
    from recorders.sources.regions import read_regions
    from replay.annotated_writer import replay
    from replay.run import ReplayOptions

    tracker, config = _configured(args)
    corrections = None if args.corrections is None else read_corrections(args.corrections)
    if args.checkpoint is not None and not 1e-9 <= args.checkpoint <= 1e9:
        raise UsageError(
            f"--checkpoint {args.checkpoint}: must be over 0 and at most 1e9 seconds"
        )
    limits = common.parse_limits(args.limit)
    with SceneLog(args.scene, args.camera, limits) as scene:
        first = None if args.start is None else common.parse_time(args.start, scene)
        end = None if args.end is None else common.parse_time(args.end, scene)
        check_span(args, first, end, scene)
        counts = [
            c.message_count for c in scene.recorded if c.topic.endswith("/detections")
        ]
        starts = check_starts(config, scene, counts[0] if counts else None)
        if corrections is not None:
            _check_corrections(args.corrections, corrections, tracker.name, scene.camera)
        has_masks, frame_ns = scene.info.has_masks, scene.info.frame_ns
        regions = (
            None
            if args.regions is None
            else read_regions(
                args.regions,
                scene.info.width,
                scene.info.height,
                next((frame.regions for frame in scene.frames()), None),
            )
        )
    del scene  # its index of a day's chunks would stay beside that of the replay
    options = ReplayOptions(
        tracker=tracker,
        config=config,
        from_ns=first,
        to_ns=end,
        # What is thrown away after the comparison needs no copy of the recording.
        annotations_only=args.annotations_only or args.output is None,
        checkpoint_ns=(
            None if args.checkpoint is None else int(args.checkpoint * common.NANOS)
        ),
        checkpoints=args.checkpoints,
        force=args.force,
        camera=args.camera,
        limits=limits,
        regions=regions,
        corrections=corrections,
    )
    with (
        common.progress(counts[0] if counts else None) as bar,
        common.interrupts_at(bar) as progress,
    ):
        done = replay(args.scene, out, options, progress)
    if args.checkpoints is not None and done.resumed is None:
        why = (
            "without --from there is nothing to skip"
            if first is None
            else "it holds no checkpoint before --from"
        )
        common.say(f"--checkpoints {args.checkpoints}: {why}; replayed from the start")
    made = ((done.frames, "frame"), (done.tracks, "track"), (done.events, "event"))
    said = ", ".join(count_of(n, name) for n, name in made)
    common.say(
        f"{args.output or args.scene}: {said}, output digest {done.output_digest[:16]}"
    )
    if not done.tracks and not starts and not has_masks:
        why = (
            f"frames are {frame_ns} ns apart, as no camera takes them: record it again with"
            " --fps"
            if frame_ns < _LEAST_FRAME_NS
            else "no foreground was recorded, and no detections that were sure enough, often"
            " enough"
        )
        common.say(f"{args.scene}: nothing was tracked: {why}")
    left_out = missed(starts, done)
    if left_out:
        common.say(f"{args.scene}: {left_out}")
    for line in done.gaps:
        common.say(f"scenetrace: {line}")
    return Exit.LEFT_OUT if left_out or done.unreadable else Exit.DONE


def check_span(
    args: argparse.Namespace, first: int | None, end: int | None, scene: SceneLog
) -> None:
    """Refuse a span that holds nothing.

    Raises:
        UsageError: it ends before it begins, or lies outside the recording.
    """
    if first is not None and end is not None and end <= first:
        raise UsageError(f"--from {args.start} --to {args.end}: an empty span")
    start_ns, end_ns = scene.log.start_ns or 0, scene.log.end_ns or 0
    length = f"the recording is {(end_ns - start_ns) / common.NANOS:.3f} s long"
    if first is not None and first > end_ns:
        raise UsageError(f"--from {args.start}: after the last frame; {length}")
    if end is not None and end <= start_ns:
        raise UsageError(f"--to {args.end}: before the first frame; {length}")
