"""The command line: the composition root. It parses, calls, prints; the work is done by the
library.
"""

from __future__ import annotations

import argparse
import importlib
import io
import os
import signal
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from typing import NoReturn

from recorders.errors import SceneTraceError, UsageError
from recorders.unreadable import Unreadable, noticed
from replay.cli import exit_codes
from replay.cli.common import check_outputs, say
from replay.cli.exit_codes import Exit
from replay.cli.memory import ADVICE, out_of_memory

# Command, the module that has it, its line in the overview. A module is imported when its command
# is called.
COMMANDS: tuple[tuple[str, str, str], ...] = (
    (
        "demo",
        "demo",
        "a synthetic scene, recorded, replayed, questioned and reported; no input needed",
    ),
    ("record", "record", "a video, pictures or detections into a scene log"),
    ("replay", "replay", "a scene log through a tracker into an annotated log"),
    ("correct", "correct", "say who a track really is, by whom and why"),
    ("verify", "verify", "replay again and compare digests"),
    ("diff", "diff", "what happens in one annotated log and not in another"),
    ("query", "query", "ask annotated logs: SQL or a ready question"),
    ("find", "find", "targets by colours, or like somebody"),
    ("explain", "explain", "why an event was reported: rule, values, frames, pictures"),
    ("view", "view", "the report with the whole recording behind it, in a browser"),
    ("report", "report", "one HTML file that opens offline"),
    ("evidence", "evidence", "a folder with clip, frames and facts of chosen events"),
    ("index", "index", "many annotated logs into one database"),
    (
        "batch",
        "batch",
        "many sources through record, replay and tables, here or on a cluster",
    ),
    ("export", "export", "tracks, tables, graph, video, or a file for other viewers"),
    ("eval", "evaluate", "score tracks against truth: HOTA, MOTA, IDF1"),
    ("fit", "fit", "fit the part features' models to annotated recordings"),
    ("seal", "seal", "a manifest of digests over a case's files"),
    ("cut", "cut", "a span of a log that stands alone"),
    ("filter", "filter", "some topics of a log"),
    ("merge", "merge", "several logs as one, in order of time"),
    ("sort", "sort", "a log again in order of time"),
    ("info", "info", "what a log holds"),
    ("doctor", "doctor", "check a log's structure and checksums"),
    ("recover", "recover", "what is whole of a damaged log into a new one"),
    ("config", "config", "every parameter with unit, range and source, as TOML"),
)
EXAMPLE = """example:
  scenetrace record video.avi --fps 7 -o scene.mcap
  scenetrace replay scene.mcap -o annotated.mcap --tracker events
  scenetrace query annotated.mcap "SELECT kind, t, text FROM events"
"""


class Parser(argparse.ArgumentParser):
    """argparse whose errors are ours: one line, exit code 2, and where help is."""

    def error(self, message: str) -> NoReturn:
        """Wrong words.

        Raises:
            UsageError: always.
        """
        raise UsageError(f"{message}; see `{self.prog} --help`")


def parser(command: str | None = None) -> Parser:
    """The parser; only the named command's options are loaded (all of them for None)."""
    top = Parser(
        prog="scenetrace",
        description=(
            "Replay recorded camera scenes, bit for bit the same, and say who interacted"
            " with whom."
        ),
        epilog=f"{EXAMPLE}\n{exit_codes.TEXT}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="store_true", help="print the version and exit")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", title="commands")
    for name, module, line in COMMANDS:
        if command is None or name == command:
            importlib.import_module(f"replay.cli.{module}").add(commands)
        else:
            commands.add_parser(name, help=line)
    return top


def main(  # noqa: PLR0911
    argv: Sequence[str] | None = None,
) -> int:
    """Run a command; returns the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    named = next((word for word in words if not word.startswith("-")), "")
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A file's name may hold bytes that no encoding has: spelt out, never a crash.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        _check_command(named)
        args = parser(named).parse_args(words)
        if args.version:
            from importlib.metadata import version

            print(f"scenetrace {version('scenetrace')}")
            return Exit.DONE
        if args.command is None:
            raise UsageError("no command given; `scenetrace --help` lists them")
        check_outputs(args)
        with noticed() as found:
            code: int = args.run(args)
        sys.stdout.flush()
        return _left_out(code, found)
    except UsageError as error:
        say(f"scenetrace: error: {error.headline}")
        for line in error.below:
            say(line)
        return Exit.WRONG_USAGE
    except SceneTraceError as error:
        say(f"scenetrace: error: {error}")
        return Exit.FAILED
    except KeyboardInterrupt:
        print(
            "scenetrace: error: interrupted; nothing half-written has the output's name",
            file=sys.stderr,
        )
        return Exit.FAILED
    except BrokenPipeError:
        # The reader of our output has gone (`| head`): not an error of ours, and nothing more to
        # say to it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except OSError as error:
        say(
            f"scenetrace: error: {error.filename or _written(words)}: {error.strerror or error}"
        )
        return Exit.FAILED
    except Exception as error:
        if not out_of_memory(error):
            raise
        say(f"scenetrace: error: {ADVICE}")
        return Exit.FAILED


def _left_out(code: int, found: Sequence[Unreadable]) -> int:
    """Say which pictures could not be decoded, each once; the exit code with that."""
    lines = dict.fromkeys(line for one in found for line in one.lines())
    for line in lines:
        say(f"scenetrace: left out: {line}")
    return Exit.LEFT_OUT if lines and code == Exit.DONE else code


def _written(words: Sequence[str]) -> str:
    """What a failed write without a name was for."""
    from tempfile import gettempdir

    flag = next((word for word in words if word in ("-o", "--output")), None)
    output = "" if flag is None else "".join(words[words.index(flag) + 1 :][:1])
    return f"{output or 'standard output'} (or a temporary file in {gettempdir()})"


def _check_command(named: str) -> None:
    names = [name for name, _, _ in COMMANDS]
    if named and named not in names:
        close = get_close_matches(named, names, 1)
        meant = f"did you mean {close[0]!r}?" if close else f"there are: {', '.join(names)}"
        raise UsageError(f"no command {named!r}; {meant}")
