"""``scenetrace config``."""

from __future__ import annotations

import argparse

from replay.cli import common
from replay.cli.exit_codes import Exit


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "config",
        "every parameter with unit, range and source, as TOML",
        "Print every parameter of every method as TOML: meaning, unit, range and source"
        " (paper and section, or ours).\nThe output is a file for --config; --set"
        " section.field=value reaches each parameter alone.",
        "scenetrace config --tracker shells > s.toml\nscenetrace replay scene.mcap -o"
        " out.mcap --config s.toml",
    )
    common.add_tracker(parser, "what a replay with it reads; default: all of scenetrace's")
    common.add_configuration(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the configuration."""
    from recorders.parameters import configure, to_toml
    from replay.configuration import all_sections, sections

    everything = all_sections()
    wanted = everything if args.tracker is None else sections(args.tracker)
    print(
        to_toml(configure(wanted, args.config, args.assignments, others=everything)), end=""
    )
    return Exit.DONE
