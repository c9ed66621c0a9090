"""``scenetrace demo``."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from recorders.errors import OutputExistsError, SceneTraceError
from replay.cli import common
from replay.cli.exit_codes import Exit

SCRIPT = "demo"
QUESTION = (
    "SELECT round(t, 1) AS t, kind, subjects, text FROM events WHERE kind IN ('entered',"
    " 'grouping', 'splitting', 'group_formed', 'group_changed', 'group_ended', 'exited')"
    " ORDER BY event"
)
FILES = (
    "scene.mp4",
    "truth.txt",
    "regions.json",
    "scene.mcap",
    "annotated.mcap",
    "annotated.mp4",
    "report.html",
)


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "demo",
        "a synthetic scene, recorded, replayed, questioned and reported; no input needed",
        "Render a scripted scene into a video (people meet, group, part, hide and leave),"
        " then run the commands that\na recording of your own would take, printing each:"
        " record, replay, verify, query, eval, export, report.",
        "scenetrace demo -o demo-out",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("demo-out"),
        metavar="DIR",
        help="default: demo-out",
    )
    common.add_tracker(parser, "default events")
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        help="another seed moves courses, gaits, ground and noise",
    )
    parser.add_argument(
        "--force", action="store_true", help="overwrite an earlier demo in the same folder"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Render, then run the commands."""
    from fixtures.logs import export_video, write_regions, write_truth
    from fixtures.scenes import generate
    from replay.trackers.choice import DEFAULT_TRACKER

    folder: Path = args.output
    files = {name: str(folder / name) for name in FILES}
    if not args.force:
        for file in files.values():
            if Path(file).exists():
                raise OutputExistsError(file)
    if folder.exists() and not folder.is_dir():
        raise SceneTraceError(f"{folder}: is a file; name a folder for the demo's files")
    folder.mkdir(parents=True, exist_ok=True)
    scene = generate(SCRIPT, args.seed)
    print(
        f"# rendering {scene.frame_count} frames into {files['scene.mp4']}, the truth into"
        f" {files['truth.txt']}"
    )
    export_video(scene, files["scene.mp4"], force=True)
    write_truth(scene, files["truth.txt"], force=True)
    write_regions(scene, files["regions.json"], force=True)

    annotated = files["annotated.mcap"]
    for words in (
        [
            "record",
            files["scene.mp4"],
            "--regions",
            files["regions.json"],
            "-o",
            files["scene.mcap"],
            "--force",
        ],
        [
            "replay",
            files["scene.mcap"],
            "-o",
            annotated,
            "--tracker",
            args.tracker or DEFAULT_TRACKER,
            "--force",
        ],
        ["verify", annotated, *(["--tracker", args.tracker] if args.tracker else [])],
        ["query", annotated, QUESTION],
        ["query", annotated, "--ask", "met", "1"],
        ["eval", annotated, "--truth", files["truth.txt"]],
        ["export", annotated, "--to", "video", "-o", files["annotated.mp4"], "--force"],
        ["report", annotated, "-o", files["report.html"], "--force"],
    ):
        _command(words)
    print(
        f"\n# open {files['report.html']} in a browser, {files['annotated.mp4']} in a"
        " player"
    )
    return Exit.DONE


def _command(words: list[str]) -> None:
    from replay.cli import parser

    print(f"\n$ scenetrace {' '.join(map(_quoted, words))}", flush=True)
    args = parser(words[0]).parse_args(words)
    code: int = args.run(args)
    if code:
        raise SceneTraceError(f"`scenetrace {words[0]}` ended with exit code {code}")


def _quoted(word: str) -> str:
    """A word for a shell; SQL is full of single quotes, so double ones where they do."""
    return (
        f'"{word}"' if "'" in word and not set(word) & set('"$`\\!') else shlex.quote(word)
    )
