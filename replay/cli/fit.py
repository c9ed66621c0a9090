"""``scenetrace fit``: the part features' models and weights from annotated recordings."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from recorders.errors import OutputExistsError, SceneTraceError, UsageError
from replay.cli import common
from replay.cli.exit_codes import Exit

if TYPE_CHECKING:
    from replay.fitting import Fitted

FEW = 50
"""Pairs of frames below which a fit says little."""


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "fit",
        "fit the part features' models to annotated recordings",
        "Fit how much the features of a person's parts differ from frame to frame (PARTS"
        " 2.2), and the weights of\nfeatures and parts, to recordings whose true boxes are"
        " known. The result is a configuration for\n`replay --tracker parts`, with what it"
        " was fitted on in it: never report accuracy on those recordings\nwithout"
        " saying so.",
        "scenetrace fit scene.mcap --truth gt.txt -o features.toml\nscenetrace fit a.mcap"
        " b.mcap --truth a.txt --truth b.txt -o features.toml --plot"
        " features.png\nscenetrace replay other.mcap -o annotated.mcap --tracker parts"
        " --config features.toml",
    )
    parser.add_argument(
        "scenes",
        type=Path,
        nargs="+",
        metavar="SCENE",
        help="scene logs with pictures and masks",
    )
    parser.add_argument(
        "--truth", type=Path, action="append", required=True, metavar="FILE",
        help="gt.txt or CAVIAR .xml, one for each scene, in their order",
    )  # fmt: skip
    parser.add_argument(
        "--truth-size", type=_size, action="append", metavar="WxH",
        help="picture that the truth was labelled in; of several scenes one for each, in their order, `same` for the "
        "scene's own",
    )  # fmt: skip
    parser.add_argument(
        "--camera", metavar="NAME", help="which camera, where the scenes have several"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="FILE",
        help="the configuration, TOML",
    )
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="FILE",
        help="histograms with the models (.png .pdf .svg)",
    )
    parser.add_argument("--force", action="store_true", help="overwrite existing outputs")
    common.add_limits(parser)
    parser.set_defaults(run=run)


def _size(text: str) -> tuple[int, int] | None:
    """Width and height of ``768x576``, None of ``same``."""
    return None if text == "same" else common.picture_size(text)


def run(args: argparse.Namespace) -> int:
    """Fit and write."""
    from recorders.parameters import to_toml
    from replay.export.output import check_figure, whole_file
    from replay.fitting import collect, fit

    if len(args.truth) != len(args.scenes):
        raise UsageError(
            f"{len(args.scenes)} scenes but {len(args.truth)} --truth; give one for each"
            " scene"
        )
    if args.plot is not None:
        check_figure(args.plot)
    for path in (args.output, args.plot):
        if path is not None and path.exists() and not args.force:
            raise OutputExistsError(path)
    sizes = args.truth_size or [None] * len(args.truth)
    if len(sizes) != len(args.truth):
        raise UsageError(
            f"{len(args.truth)} --truth but {len(sizes)} --truth-size; give one for each,"
            " `same` for a scene's own size"
        )
    pairs = list(zip(args.scenes, args.truth, strict=True))
    limits = common.parse_limits(args.limit)
    samples = collect(pairs, sizes, args.camera, limits)
    fitted = fit(samples)
    if fitted.accuracy is not None and fitted.accuracy <= fitted.chance:
        raise SceneTraceError(
            f"the true boxes fit no better than any others ({100 * fitted.accuracy:.1f} %,"
            f" by chance {100 * fitted.chance:.1f} %): does the truth belong to this"
            " recording, and is --truth-size right?"
        )
    with whole_file(args.output, force=args.force) as file:
        file.write(to_toml({"part_features": fitted.features}).encode())
    if args.plot is not None:
        from replay.fitting.plots import plot

        plot(samples, fitted.features, args.plot, force=args.force)
    common.say(
        f"{args.output}: fitted on {fitted.groups} pairs of frames; {_held_out(fitted)}"
    )
    if fitted.groups < FEW:
        common.say(
            f"{args.output}: fewer than {FEW} pairs of frames say little; give a longer"
            " truth, or more recordings"
        )
    return Exit.DONE


def _held_out(fitted: Fitted) -> str:
    if fitted.accuracy is None or fitted.before is None:
        return "nothing could be held out, so how good the fit is is not known"
    return (
        f"where held out the true candidate scores highest in {100 * fitted.accuracy:.1f} %"
        f" ({100 * fitted.before:.1f} % with equal weights, {100 * fitted.chance:.1f} % by"
        " chance)"
    )
