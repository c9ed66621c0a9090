"""``scenetrace demo``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from recorders.errors import OutputExistsError
from recorders.messages import Regions
from replay.cli import common

SCRIPT = "demo"
QUESTION = (
    "SELECT round(t, 2) AS t, kind, subjects, text FROM events "
    "WHERE kind IN ('entered', 'grouping', 'grouped', 'splitting', 'single', 'group_formed', 'group_changed', "
    "'group_ended', 'exited') ORDER BY event"
)
FILES = ("regions.json", "truth.txt", "scene.mcap", "annotated.mcap", "annotated.mp4", "report.html")


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    p = common.command(
        commands,
        "demo",
        "a synthetic scene, recorded, replayed, questioned and reported; no input needed",
        "Render a scripted scene (people meet, group, part, hide and leave), record it from its pixels, replay it\n"
        "through a tracker, score it against the exact truth, ask who met whom, and write a report and a video.",
        "scenetrace demo -o demo-out",
    )
    p.add_argument("-o", "--output", type=Path, default=Path("demo-out"), metavar="DIR", help="default: demo-out")
    p.add_argument("--tracker", default="events", metavar="NAME", help="events (default), shells or parts")
    p.add_argument("--seed", type=int, default=0, help="another seed moves courses, gaits, ground and noise")
    p.add_argument("--force", action="store_true", help="overwrite an earlier demo in the same folder")
    p.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the whole tool on a generated scene."""
    from fixtures.logs import as_source, write_truth
    from fixtures.scenes import generate
    from reasoning.questions import Database, format_table
    from recorders.recording import RecordOptions, record
    from replay.configuration import replay_config
    from replay.evaluate import evaluate, read_mot
    from replay.export import export_mot, export_video
    from replay.replaying import ReplayOptions
    from replay.report import write_report
    from replay.verifying import verify
    from replay.writing import replay

    folder: Path = args.output
    files = {name: folder / name for name in FILES}
    if not args.force:
        for file in files.values():
            if file.exists():
                raise OutputExistsError(file)
    folder.mkdir(parents=True, exist_ok=True)
    scene = generate(SCRIPT, args.seed)
    step = _Steps(folder)

    step.say("record", f"{scene.frame_count} rendered frames into", "scene.mcap")
    files["regions.json"].write_text(_regions_json(scene.truth.regions), encoding="utf-8")
    write_truth(scene, files["truth.txt"], force=True)
    options = RecordOptions(regions=files["regions.json"], detect="motion", force=True)
    with common.progress(scene.frame_count) as progress:
        record(as_source(scene), files["scene.mcap"], options, lambda stage, done, _: progress(stage, done - 1))

    step.say("replay", f"through the tracker {args.tracker} into", "annotated.mcap")
    replaying = ReplayOptions(tracker=args.tracker, config=replay_config(args.tracker), force=True)
    with common.progress(scene.frame_count) as progress:
        done = replay(files["scene.mcap"], files["annotated.mcap"], replaying, progress)
    print(f"   {done.frames} frames, {done.tracks} tracks, {done.events} events")

    step.say("verify", "replayed a second time from what it says of itself", "annotated.mcap")
    verdict = verify(files["annotated.mcap"])
    print(f"   {'identical' if verdict.identical else verdict.difference}: output digest {done.output_digest}")

    step.say("query", "who grouped, split, came and went", "annotated.mcap")
    with Database([files["annotated.mcap"]]) as database:
        print(format_table(database.query(QUESTION)))

    step.say("eval", "against the exact truth", "truth.txt")
    export_mot(files["annotated.mcap"], folder / "tracks.txt", force=True)
    scores = evaluate(read_mot(files["truth.txt"]), read_mot(folder / "tracks.txt"))
    print(f"   HOTA {100 * scores.hota:.1f}, MOTA {100 * scores.mota:.1f}, IDF1 {100 * scores.idf1:.1f}")

    step.say("export", "the picture with everything drawn into it", "annotated.mp4")
    export_video(files["annotated.mcap"], files["annotated.mp4"], force=True)
    step.say("report", "open it in any browser", "report.html")
    write_report(files["annotated.mcap"], files["report.html"], force=True)
    return 0 if verdict.identical else 1


class _Steps:
    """Numbers the steps and says the command that does each by hand."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._number = 0

    def say(self, command: str, what: str, file: str) -> None:
        """Announce a step."""
        self._number += 1
        print(f"{self._number}. {command:<7} {what} {self._folder / file}", flush=True)


def _regions_json(regions: Regions) -> str:
    document = {
        "roi": regions.roi,
        "border": regions.border,
        "zones": {zone.name: zone.polygon for zone in regions.zones},
    }
    return json.dumps(document, indent=2) + "\n"
