"""``scenetrace replay --follow``: a log that is still written, annotated as it grows."""

from __future__ import annotations

import argparse
from threading import Event
from typing import TYPE_CHECKING

from recorders.errors import UsageError
from replay.cli import common
from replay.cli.exit_codes import Exit
from replay.plurals import count_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from recorders.parameters import Config
    from replay.trackers.choice import TrackerChoice

_WHOLE = {
    "start": "--from",
    "end": "--to",
    "checkpoint": "--checkpoint",
    "checkpoints": "--checkpoints",
    "against": "--against",
    "regions": "--regions",
    "corrections": "--corrections",
}
"""What needs a recording that is whole."""


def run(args: argparse.Namespace, assignments: Sequence[str]) -> int:
    """Follow."""
    from replay.annotated_writer import replay
    from replay.run import ReplayOptions
    from replay.trackers.choice import DEFAULT_TRACKER, choose

    for name, option in _WHOLE.items():
        if getattr(args, name) is not None:
            raise UsageError(f"--follow: {option} needs a recording that is complete")
    tracker = choose(args.tracker or DEFAULT_TRACKER)
    stop = Event()
    options = ReplayOptions(
        tracker=tracker,
        config=without_hindsight(tracker, args, assignments),
        annotations_only=args.annotations_only,
        force=args.force,
        camera=args.camera,
        limits=common.parse_limits(args.limit),
        follow=stop,
    )
    common.say(
        f"{args.scene}: followed until it ends, or Ctrl-C; what is annotated is in"
        f" {args.output}.part until then"
    )
    with common.progress(None) as bar, common.ends_at_interrupt(stop.set):
        done = replay(args.scene, args.output, options, bar)
    made = ((done.frames, "frame"), (done.tracks, "track"), (done.events, "event"))
    said = ", ".join(count_of(n, name) for n, name in made)
    common.say(f"{args.output}: {said}, output digest {done.output_digest[:16]}")
    for line in done.gaps:
        common.say(f"scenetrace: {line}")
    broken = not done.ended and not stop.is_set()
    if broken:
        common.say(
            f"scenetrace: left out: {args.scene} ended without its end, its writer was killed;"
            " `scenetrace recover` makes a log of it"
        )
    return Exit.LEFT_OUT if broken or done.unreadable else Exit.DONE


def without_hindsight(
    tracker: TrackerChoice, args: argparse.Namespace, assignments: Sequence[str]
) -> Config:
    """The configuration, hindsight off: nobody knows yet what comes later.

    Raises:
        UsageError: a parameter is wrong, or the tracker cannot do without hindsight.
    """
    from replay.configuration import replay_config

    config = replay_config(tracker, args.config, assignments)
    if not tracker.wants_hindsight(config):
        return config
    found = [
        section for section in tracker.sections if hasattr(config.get(section), "hindsight")
    ]
    if not found:
        raise UsageError(
            f"--follow: the tracker {tracker.title} wants hindsight, and what is still recorded"
            " has none"
        )
    off = [*assignments, *(f"{section}.hindsight=false" for section in found)]
    return replay_config(tracker, args.config, off)
