"""``scenetrace record``."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TYPE_CHECKING

from recorders.errors import UsageError
from replay.cli import common
from replay.cli.exit_codes import Exit

if TYPE_CHECKING:
    from recorders.detectors import ModelOptions
    from recorders.recording import RecordOptions, RecordSummary
    from recorders.sources import Source


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "record",
        "a video, pictures or detections into a scene log",
        "Record a source into a scene log (MCAP): pictures, foreground masks, detections,"
        " regions.\n\nSOURCE is a video file, a folder of JPEG or PNG pictures (in the"
        " order of their numbers, bytes kept as they\nare), a MOTChallenge text file (.txt)"
        " or a CAVIAR XML file (.xml; its labelled identities are left out), or a log of others\n"
        "(MCAP, a ROS 1 or 2 bag): its pictures and detections, everything else passed on.\n"
        "Live cameras are recorded until Ctrl-C, and connected again where the connection is lost.\nExit code 3:"
        " recorded, but something had to be left out; stderr says what.",
        "scenetrace record video.avi --fps 7 -o scene.mcap\n"
        "scenetrace record img1 --fps 7 --detections det.txt -o scene.mcap\n"
        "scenetrace record video.avi --detect onnx --model yolo11n.onnx --labels person,car"
        " -o scene.mcap\n"
        "scenetrace record det.txt --fps 25 --size 640x480 -o scene.mcap\n"
        "scenetrace record Walk1.xml -o walk.mcap\n"
        "scenetrace record bag.mcap --image-topic /front/image -o scene.mcap\n"
        "scenetrace record rtsp://camera/stream --segment 10min -o door.mcap",
    )
    parser.add_argument(
        "source",
        type=_source,
        nargs="+",
        metavar="SOURCE",
        help="video | folder of pictures | MOTChallenge .txt | CAVIAR .xml | MCAP log or ROS bag"
        " (a file, a folder, or several files of one recording) | rtsp://..., udp://..., http://... | /dev/video0"
        " | - (a video in a pipe) | NAME:WHERE of an installed plug-in",
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE", help="the scene log"
    )
    add_options(parser)
    common.add_configuration(parser)
    common.add_limits(parser)
    parser.add_argument("--force", action="store_true", help="overwrite an existing output")
    parser.set_defaults(run=run)


def add_options(parser: argparse.ArgumentParser) -> None:
    """What says how a source is recorded, wherever it is: `record`, and `batch` for many."""
    parser.add_argument(
        "--detections", type=Path, metavar="DET.TXT",
        help="detections beside the pictures, their first frame with the first picture: MOTChallenge, KITTI, CSV,"
        " JSON lines, Parquet, COCO, YOLO or LabelMe or VOC folders, CVAT, Label Studio, Frigate",
    )  # fmt: skip
    parser.add_argument(
        "--stream", type=int, metavar="N",
        help="which of a video's streams of pictures, from 0; default the first",
    )  # fmt: skip
    parser.add_argument(
        "--segment", type=common.duration_ns, metavar="TIME",
        help="begin a new log every so often, as 10min: NAME-0001.mcap, NAME-0002.mcap ..., each of which stands alone",
    )  # fmt: skip
    parser.add_argument(
        "--columns", metavar="NAMES",
        help="what the columns of a table of detections are, where it does not name them: frame,id,x1,y1,x2,y2,score",
    )  # fmt: skip
    parser.add_argument(
        "--first-frame", type=int, choices=(0, 1), metavar="N",
        help="what a file of detections calls the first frame, 0 or 1; default 0 where some frame is 0, else 1",
    )  # fmt: skip
    parser.add_argument(
        "--detect", metavar="METHOD", action="append",
        help="motion, density, threshold, onnx, module:Class or none: how to find what is in the pictures; default "
        "motion, with --detections none. Masks and a detector go together (--detect motion,onnx), as masks and "
        "--detections do. threshold is for animals on an even ground, darker or lighter than it: it finds those that "
        "sit still, too. density is the SHELLS paper's own: kernel densities of background and foreground, at about "
        "twice the time. onnx is a network of yours (--model), module:Class a detector of yours in Python, with one "
        "method: detect(image) -> ((x, y, w, h), score, label) for each thing",
    )  # fmt: skip
    parser.add_argument(
        "--model", type=Path, metavar="FILE.onnx",
        help="the network of --detect onnx: YOLO of any version, YOLOX, RT-DETR, D-FINE, RF-DETR, SSD, torchvision, "
        "FastestDet or NanoDet",
    )  # fmt: skip
    parser.add_argument(
        "--model-format", metavar="FORMAT",
        help="the network's family, where its outputs do not tell: yolov5, yolov8, end2end, yolox, detr, rfdetr, ssd, "
        "fastestdet or nanodet",
    )  # fmt: skip
    parser.add_argument(
        "--labels",
        metavar="A,B",
        help="keep these classes of the network, by name; default all",
    )
    parser.add_argument(
        "--min-score",
        metavar="S",
        help="smallest score that the network's detections are recorded from (detector.min_score)",
    )
    parser.add_argument(
        "--fps", metavar="F",
        help="frames per second: 7, 29.97 or 30000/1001; default a video's own times, CAVIAR 25, else 25 is assumed",
    )  # fmt: skip
    parser.add_argument(
        "--start",
        metavar="RFC3339",
        help="when the first frame was taken; default: times start at 0",
    )
    parser.add_argument(
        "--camera", action="append", default=None, metavar="NAME[=TOPIC]",
        help="the camera's name in the topics; default camera. Of a log NAME=TOPIC, repeated, records several"
        " cameras into one log",
    )  # fmt: skip
    parser.add_argument(
        "--regions",
        type=Path,
        metavar="FILE",
        help='JSON: {"roi": [[x, y], ...], "border": ..., "zones": {name: ...}}',
    )
    parser.add_argument(
        "--size", type=common.picture_size, metavar="WxH",
        help="the picture size that the detections were made for: beside pictures boxes are scaled from it",
    )  # fmt: skip
    parser.add_argument(
        "--codec", metavar="CODEC",
        help="jpeg, png, h264 or none: how pictures are stored; default: pictures as they are, video as jpeg",
    )  # fmt: skip
    _add_log_options(parser)


def _add_log_options(argument_parser: argparse.ArgumentParser) -> None:
    logs = argument_parser.add_argument_group("of logs (MCAP, ROS 1 and 2 bags)")
    logs.add_argument(
        "--image-topic", metavar="T",
        help="the topic of the pictures, or none; default: the only one, else they are listed",
    )  # fmt: skip
    logs.add_argument(
        "--detections-topic", action="append", metavar="[NAME=]T",
        help="the topic of the detections, or none; default: the only one, else they are listed. Of"
        " several cameras NAME=TOPIC, repeated; default: the one in the namespace of the pictures",
    )  # fmt: skip
    logs.add_argument(
        "--time", default="log", metavar="CLOCK",
        help="log: when a message was recorded; publish; header: the picture's own stamp; file: the file's order,"
        " where the recorder's clock was set back; default log",
    )  # fmt: skip
    logs.add_argument(
        "--tolerance", metavar="S",
        help="how far apart in seconds a picture and its detections may be; default half a frame",
    )  # fmt: skip
    logs.add_argument(
        "--topics", action="append", metavar="PATTERN",
        help="other topics that are passed on, as /tf*; may be repeated; default all",
    )  # fmt: skip
    logs.add_argument(
        "--exclude", action="append", default=[], metavar="PATTERN",
        help="other topics that are not passed on; may be repeated",
    )  # fmt: skip


def parse_tolerance(text: str) -> int:
    """A tolerance in seconds as ns.

    Raises:
        UsageError: it is no number of 0 or more.
    """
    try:
        value = Decimal(text)
    except InvalidOperation:
        value = Decimal(-1)
    if not value.is_finite() or not 0 <= value <= 10**6:
        raise UsageError(f"--tolerance {text}: must be a number of seconds, as 0.02")
    return int(value * common.NANOS)


def parse_cameras(words: Sequence[str] | None) -> tuple[str, dict[str, str]]:
    """The camera's name, and the topics of cameras by name where some are given.

    Raises:
        UsageError: several names without topics, or one twice.
    """
    if not words:
        return "camera", {}
    topics = dict(word.split("=", 1) for word in words if "=" in word)
    if len(topics) != len(words) and len(words) > 1:
        if all("=" in word for word in words):
            raise UsageError("--camera: one name stands for two topics")
        raise UsageError(
            "--camera: several cameras need a topic each, as --camera left=/left/image"
        )
    return ("camera", topics) if topics else (words[0], {})


def parse_detections(
    words: Sequence[str] | None, cameras: Collection[str]
) -> dict[str, str]:
    """The topic of detections of each camera; that of all by the empty name.

    Raises:
        UsageError: a camera that is none, or one twice.
    """
    found: dict[str, str] = {}
    for word in words or ():
        name, _, topic = word.partition("=")
        name, topic = (name, topic) if topic and not name.startswith("/") else ("", word)
        if name and name not in cameras:
            raise UsageError(
                f"--detections-topic {word}: no --camera {name}=TOPIC is named"
            )
        if name in found:
            raise UsageError(
                "--detections-topic: one topic for each camera, as left=/left/found"
            )
        found[name] = topic
    return found


def _offer_clock(sources: Sequence[Path | str]) -> None:
    """Say what a source's own clock says, where the recording has none."""
    from recorders.sources.own_clock import own_clock

    for source in sources:
        for when, where in own_clock(Path(source)):
            common.say(
                f"{source}: has a clock of its own: {when} ({where}); --start {when} takes it"
            )


def _model(args: argparse.Namespace) -> ModelOptions | None:
    """The network that was named."""
    from recorders.detectors import ModelOptions

    if args.model is not None:
        labels = [name.strip() for name in (args.labels or "").split(",")]
        return ModelOptions(args.model, args.model_format, tuple(filter(None, labels)))
    for option in ("model_format", "labels", "min_score"):
        if getattr(args, option) is not None:
            word = option.replace("_", "-")
            raise UsageError(f"--{word} goes with --detect onnx --model FILE.onnx")
    return None


def _source(text: str) -> str | Path:
    """A source's word: what is live is no path."""
    from recorders.sources.live import is_live

    return text if is_live(text) else Path(text)


def run(args: argparse.Namespace) -> int:
    """Record."""
    from recorders.errors import OutputExistsError
    from recorders.formats.columns import parse_columns
    from recorders.formats.opening import BoxOptions
    from recorders.parameters import configure
    from recorders.recording import SECTIONS, RecordOptions
    from recorders.sources import LogOptions, open_cameras, open_source
    from replay.asking_configuration import sections_beside

    start_ns = None if args.start is None else common.parse_rfc3339(args.start)
    if start_ns is not None and start_ns < 0:
        raise UsageError(f"--start {args.start}: times before 1970 cannot be recorded")
    camera, topics = parse_cameras(args.camera)
    detections = parse_detections(args.detections_topic, topics)
    limits = common.parse_limits(args.limit)
    assignments = [*args.assignments]
    if args.min_score is not None:
        assignments.append(f"detector.min_score={args.min_score}")
    config = configure(
        SECTIONS, args.config, assignments, others=sections_beside(args.config)
    )
    if args.output.exists() and not args.force:
        raise OutputExistsError(args.output)
    log = LogOptions(
        args.image_topic,
        detections.get(""),
        args.time,
        None if args.tolerance is None else parse_tolerance(args.tolerance),
        None if args.topics is None else tuple(args.topics),
        tuple(args.exclude),
    )
    boxes = BoxOptions(
        None if args.columns is None else parse_columns(args.columns), args.first_frame
    )
    if topics:
        sources = open_cameras(
            args.source,
            topics,
            detections=detections,
            fps=args.fps,
            size=args.size,
            log=log,
            limits=limits,
        )
    else:
        sources = {
            camera: open_source(
                args.source,
                detections=args.detections,
                fps=args.fps,
                size=args.size,
                log=log,
                boxes=boxes,
                stream=args.stream,
                limits=limits,
            )
        }
    options = RecordOptions(
        camera=camera,
        start_ns=start_ns,
        codec=args.codec,
        detect=None if args.detect is None else ",".join(args.detect),
        model=_model(args),
        regions=args.regions,
        config=config,
        force=args.force,
        limits=limits,
        segment_ns=args.segment,
    )
    done = _recorded(sources, args.output, options)
    if start_ns is None and not any(hasattr(s, "start_ns") for s in sources.values()):
        _offer_clock(args.source if isinstance(args.source, list) else [args.source])
    for (name, source), one in zip(sources.items(), done, strict=True):
        seconds = one.duration_ns / common.NANOS
        given = args.detections or source.name
        named = f" of {name}" if topics else ""
        written = (
            one.path
            if len(one.logs) < 2
            else f"{len(one.logs)} logs, {one.logs[0]} to {one.logs[-1].name}"
        )
        common.say(
            f"{written}: {one.frames} frames{named} of {one.width}x{one.height} over"
            f" {seconds:.1f} s, {one.detections} detections"
            f" ({given if source.has_detections else one.detect}),"
            f" pictures {one.codec}"
        )
    return Exit.LEFT_OUT if any(one.losses for one in done) else Exit.DONE


def _recorded(
    sources: Mapping[str, Source], output: Path, options: RecordOptions
) -> list[RecordSummary]:
    """Record with a progress bar, and say what was assumed and what was left out."""
    from recorders.recording import record_scenes
    from recorders.sources import LiveSource

    said = set()
    for source in sources.values():
        for note in source.notes:
            if note not in said:
                common.say(f"scenetrace: {note}")
            said.add(note)
    counts = [source.frame_count for source in sources.values()]
    total = None if None in counts else sum(count or 0 for count in counts)
    with common.progress(total) as bar:

        def progress(stage: str, done: int, expected: int | None) -> None:
            share = done if not expected or not total else done * total // expected
            bar(stage, share - 1)

        live = [source for source in sources.values() if isinstance(source, LiveSource)]
        with ExitStack() as stack:
            if live:
                live[0].listen(common.say)
                stack.enter_context(common.ends_at_interrupt(live[0].stop))
                report = progress
            else:
                report = stack.enter_context(common.interrupts_at(progress))
            done = record_scenes(sources, output, options, report)
    for one in done:
        for note in one.notes:
            if note not in said:
                common.say(f"scenetrace: {note}")
            said.add(note)
        for loss in one.losses:
            common.say(f"scenetrace: left out: {loss}")
    return done
