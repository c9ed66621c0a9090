"""`scenetrace export`: tracks, tables, the graph or an overlaid video out of an annotated log."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recorders.errors import UsageError
from recorders.names import whole
from replay.cli import common
from replay.cli.drawing import add_ground, ground_of
from replay.cli.exit_codes import Exit
from replay.plurals import count_of

if TYPE_CHECKING:
    from recorders.annotated.reader import AnnotatedLog

FORMATS = (
    "mot", "csv", "parquet", "json", "graphml", "coco", "cvat", "srt", "video", "clips",
    "layout", "ros2", "rrd", "3d",
)  # fmt: skip
EXAMPLE = """\
scenetrace export annotated.mcap --to mot -o result.txt
scenetrace export annotated.mcap --to parquet -o tables/
scenetrace export annotated.mcap --to layout -o layout.json
scenetrace export annotated.mcap --to video -o overlay.mp4 --from 10 --until 20 --only 3,7
"""
DESCRIPTION = """\
Write what an annotated log holds in other formats.

mot      MOTChallenge text, frame,id,x,y,w,h,conf,-1,-1,-1: frames from 1, tracks that are present
csv      one table (--table, default tracks) where OUT has a suffix, else a folder with all tables
parquet  the same as Parquet
json     all tables in one document, and the same graph as node-link data (`graph`)
graphml  the log's interaction graph over time: targets, groups, one edge per interval
coco     COCO JSON, `track_id` and `score` beside each box; comes back by `record --detections`
cvat     CVAT's XML for videos, to correct there; comes back by `record --detections`
srt      the events as subtitles beside a video
video    the pictures with boxes, shells, relations, groups, regions and events drawn in, as MP4
clips    a folder with such an MP4 for each stretch with events, and clips.csv
layout   a layout for Lichtblick and Foxglove: pictures with the drawings, events, plots
ros2     a bag folder: pictures, vision_msgs/Detection2DArray with ids, markers, events (rosbags)
rrd      a Rerun recording: pictures, boxes, trails, edges, regions, events (rerun-sdk)
3d       a log for 3D panels: where targets stood on the ground (--homography or --height)
"""


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "export",
        "tracks, tables, graph, video, or a file for other viewers",
        DESCRIPTION,
        EXAMPLE,
    )
    parser.add_argument("annotated", type=Path, metavar="ANNOTATED", help="annotated log")
    parser.add_argument(
        "--to", choices=FORMATS, required=True, metavar="FORMAT", help=", ".join(FORMATS)
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="OUT",
        help="file; a folder for clips, ros2, and tables without a suffix",
    )
    common.add_camera(parser)
    parser.add_argument("--force", action="store_true", help="overwrite an existing output")
    parser.add_argument(
        "--table",
        default="tracks",
        metavar="NAME",
        help="csv, parquet: the table of a single file",
    )
    parser.add_argument(
        "--from",
        dest="start",
        metavar="T",
        help="video: first time, seconds, frame:N or RFC 3339",
    )
    parser.add_argument("--until", dest="end", metavar="T", help="video: end, excluded")
    parser.add_argument(
        "--scale",
        type=float,
        default=0.0,
        help="video: enlargement (default: to about 960 pixels wide)",
    )
    parser.add_argument(
        "--only", type=ids, metavar="IDS", help="video: draw only these tracks, such as 3,7"
    )
    parser.add_argument(
        "--size",
        type=common.picture_size,
        metavar="WxH",
        help="video: the picture's size where the log does not say",
    )
    for what in ("shells", "edges", "groups", "regions", "labels", "gates", "membership"):
        parser.add_argument(
            f"--no-{what}", action="store_true", help=f"video: draw no {what}"
        )
    add_ground(parser)
    common.add_limits(parser)
    parser.set_defaults(run=run)


def ids(text: str) -> frozenset[int]:
    """Track ids of ``3,7``."""
    numbers = [whole(part.strip()) for part in text.split(",")]
    if None in numbers:
        raise argparse.ArgumentTypeError(f"{text[:60]!r}: must be track ids, like 3,7")
    return frozenset(number for number in numbers if number is not None)


def run(args: argparse.Namespace) -> int:
    """Export."""
    from recorders.annotated.reader import AnnotatedLog
    from replay.export import write_mot

    # Opened first, so that every format gives the same answer to what is no annotated log.
    limits = common.parse_limits(args.limit)
    with AnnotatedLog(args.annotated, args.camera, limits) as log:
        left_out = 0
        if args.to == "mot":
            done = f"{write_mot(log, args.output, force=args.force)} rows"
        elif args.to in ("video", "clips"):
            done = _video(args, log)
        elif args.to in ("ros2", "rrd"):
            done, left_out = _recording(args, log)
        elif args.to in _OTHERS:
            done = _other(args, log)
        else:
            done = _tables(args, log.camera)
    common.say(f"{args.output}: {done}")
    if left_out:
        common.say(
            f"scenetrace: left out: {count_of(left_out, 'picture')}, stored in a way that"
            f" --to {args.to} has no message for"
        )
    return Exit.LEFT_OUT if left_out else Exit.DONE


_OTHERS = ("coco", "cvat", "srt", "layout", "3d")


def _other(args: argparse.Namespace, log: AnnotatedLog) -> str:
    from replay.export import write_coco, write_cvat, write_layout, write_srt

    out, force = args.output, args.force
    if args.to == "3d":
        from replay.export.scene3d import write_scene3d

        ground = ground_of(args)
        if ground is None:
            raise UsageError(
                "--to 3d needs metres: --homography points.csv, or --height 1.75 for a rough scale"
            )
        return count_of(write_scene3d(log, out, ground, force=force), "frame")
    if args.to == "srt":
        return count_of(write_srt(log, out, force=force), "event")
    if args.to == "layout":
        return count_of(write_layout(log, out, force=force), "panel")
    write = write_coco if args.to == "coco" else write_cvat
    return count_of(write(log, out, size=args.size, force=force), "row")


def _recording(args: argparse.Namespace, log: AnnotatedLog) -> tuple[str, int]:
    from replay.export import write_ros2, write_rrd

    write, what = (write_ros2, "message") if args.to == "ros2" else (write_rrd, "frame")
    count, left_out = write(log, args.output, force=args.force)
    return count_of(count, what), left_out


def log_time(text: str | None, log: AnnotatedLog) -> int | None:
    """A time as log time in ns: seconds from the recording's start, ``frame:N`` or RFC 3339.

    Raises:
        UsageError: it is none of them, or the frame is not there.
    """
    if text is None:
        return None
    if match := re.fullmatch(r"frame:(\d{1,18})", text):
        return log.time_of(int(match[1]))
    if re.fullmatch(r"\d{1,12}(\.\d*)?", text):
        return log.start_ns + round(Decimal(text) * common.NANOS)
    return common.parse_clock(text, lambda: log.start_ns)


def _tables(args: argparse.Namespace, camera: str) -> str:
    from replay.export import write_csv, write_graphml, write_json, write_parquet

    limits = common.parse_limits(args.limit)
    if args.to == "graphml":
        nodes, edges = write_graphml(
            args.annotated, args.output, camera=camera, force=args.force, limits=limits
        )
        return f"{nodes} nodes, {edges} edges"
    chosen: dict[str, Any] = {
        "camera": args.camera,
        "force": args.force,
        "limits": limits,
    }
    if args.to == "json":
        return _rows(write_json(args.annotated, args.output, **chosen))
    write = write_csv if args.to == "csv" else write_parquet
    return _rows(write(args.annotated, args.output, table=args.table, **chosen))


def _rows(rows: Mapping[str, int]) -> str:
    return (
        ", ".join(f"{count} {table}" for table, count in rows.items() if count) or "no rows"
    )


def _video(args: argparse.Namespace, log: AnnotatedLog) -> str:
    from replay.draw import DrawOptions
    from replay.export import VideoOptions, write_clips, write_video

    if args.scale and not 0.1 <= args.scale <= 8:
        raise UsageError(f"--scale {args.scale:g}: must be 0.1 to 8")
    draw = DrawOptions(
        scale=args.scale,
        shells=not args.no_shells,
        edges=not args.no_edges,
        groups=not args.no_groups,
        regions=not args.no_regions,
        labels=not args.no_labels,
        only=args.only,
        model=log.tracker == "parts",
        gates=not args.no_gates,
        membership=not args.no_membership,
    )
    options = VideoOptions(
        draw, log_time(args.start, log), log_time(args.end, log), size=args.size
    )
    if not log.has_pictures:
        common.say("the log holds no pictures; drawing on a plain ground")
    chosen: dict[str, Any] = {"force": args.force}
    if args.to == "clips":
        clips, events = write_clips(log, args.output, options, **chosen)
        return f"{count_of(clips, 'clip')}, {count_of(events, 'event')}"
    with common.progress(log.frame_count) as progress:
        frames = write_video(log, args.output, options, force=args.force, progress=progress)
    return f"{frames} frames"
