"""``scenetrace record``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from recorders.errors import UsageError
from replay.cli import common
from replay.cli.exit_codes import Exit

if TYPE_CHECKING:
    from recorders.detectors import ModelOptions


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "record",
        "a video, pictures or detections into a scene log",
        "Record a source into a scene log (MCAP): pictures, foreground masks, detections,"
        " regions.\n\nSOURCE is a video file, a folder of JPEG or PNG pictures (in the"
        " order of their numbers, bytes kept as they\nare), a MOTChallenge text file (.txt)"
        " or a CAVIAR XML file (.xml; its labelled identities are left out).\nExit code 3:"
        " recorded, but something had to be left out; stderr says what.",
        "scenetrace record video.avi --fps 7 -o scene.mcap\n"
        "scenetrace record img1 --fps 7 --detections det.txt -o scene.mcap\n"
        "scenetrace record video.avi --detect onnx --model yolo11n.onnx --labels person,car"
        " -o scene.mcap\n"
        "scenetrace record det.txt --fps 25 --size 640x480 -o scene.mcap\n"
        "scenetrace record Walk1.xml -o walk.mcap",
    )
    parser.add_argument(
        "source",
        type=Path,
        metavar="SOURCE",
        help="video | folder of pictures | MOTChallenge .txt | CAVIAR .xml",
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE", help="the scene log"
    )
    parser.add_argument(
        "--detections", type=Path, metavar="DET.TXT",
        help="MOTChallenge detections beside the pictures, its frame 1 with the first picture",
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
        "--camera",
        default="camera",
        metavar="NAME",
        help="the camera's name in the topics; default camera",
    )
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
    common.add_configuration(parser)
    parser.add_argument("--force", action="store_true", help="overwrite an existing output")
    parser.set_defaults(run=run)


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


def run(args: argparse.Namespace) -> int:
    """Record."""
    from recorders.errors import OutputExistsError
    from recorders.parameters import configure
    from recorders.recording import SECTIONS, RecordOptions, record
    from recorders.sources import open_source
    from replay.configuration import all_sections

    start_ns = 0 if args.start is None else common.parse_rfc3339(args.start)
    if start_ns < 0:
        raise UsageError(f"--start {args.start}: times before 1970 cannot be recorded")
    assignments = [*args.assignments]
    if args.min_score is not None:
        assignments.append(f"detector.min_score={args.min_score}")
    config = configure(SECTIONS, args.config, assignments, others=all_sections())
    if args.output.exists() and not args.force:
        raise OutputExistsError(args.output)
    source = open_source(
        args.source, detections=args.detections, fps=args.fps, size=args.size
    )
    for note in source.notes:
        common.say(f"scenetrace: {note}")
    said = set(source.notes)
    options = RecordOptions(
        camera=args.camera,
        start_ns=start_ns,
        codec=args.codec,
        detect=None if args.detect is None else ",".join(args.detect),
        model=_model(args),
        regions=args.regions,
        config=config,
        force=args.force,
    )
    with common.progress(source.frame_count) as bar:

        def progress(stage: str, done: int, total: int | None) -> None:
            share = (
                done
                if not total or not source.frame_count
                else done * source.frame_count // total
            )
            bar(stage, share - 1)

        with common.interrupts_at(progress) as report:
            done = record(source, args.output, options, report)
    for note in done.notes:
        if note not in said:
            common.say(f"scenetrace: {note}")
    for loss in done.losses:
        common.say(f"scenetrace: left out: {loss}")
    seconds = done.duration_ns / common.NANOS
    common.say(
        f"{args.output}: {done.frames} frames of {done.width}x{done.height} over"
        f" {seconds:.1f} s, {done.detections} detections"
        f" ({args.detections or source.name if source.has_detections else done.detect}),"
        f" pictures {done.codec}"
    )
    return Exit.LEFT_OUT if done.losses else Exit.DONE
