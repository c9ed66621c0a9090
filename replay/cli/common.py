"""What the commands share: parsers with an example, times, progress."""

from __future__ import annotations

import argparse
import dataclasses
import difflib
import io
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import IO, TYPE_CHECKING, Any, ParamSpec, Protocol, cast

from recorders.errors import UsageError
from recorders.limits import Limits
from recorders.told_times import after_start, colon_time

if TYPE_CHECKING:
    from recorders.scene import SceneLog

NANOS = 1_000_000_000
P = ParamSpec("P")


class Commands(Protocol):
    """What a command adds its parser to."""

    def add_parser(self, name: str, **options: Any) -> argparse.ArgumentParser:
        """A new command's parser."""
        ...


def command(
    commands: Commands,
    name: str,
    summary: str,
    description: str,
    example: str,
) -> argparse.ArgumentParser:
    """A command's parser: its help ends with an example that works."""
    return commands.add_parser(
        name,
        help=summary,
        description=description,
        epilog="example:\n"
        + "\n".join(f"  {line}" for line in example.strip().splitlines()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def add_configuration(parser: argparse.ArgumentParser) -> None:
    """``--config`` and ``--set``."""
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="parameters as TOML (see `scenetrace config`)",
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="assignments",
        help="one parameter, section.field=value; may be repeated",
    )  # fmt: skip


def add_tracker(parser: argparse.ArgumentParser, otherwise: str) -> None:
    """``--tracker``."""
    parser.add_argument(
        "--tracker",
        metavar="NAME",
        help=f"events, shells or parts; an installed plug-in's name; or module:Class of code"
        f" of your own; {otherwise}",
    )


def add_camera(parser: argparse.ArgumentParser) -> None:
    """``--camera`` of a log that is there."""
    parser.add_argument(
        "--camera", metavar="NAME", help="which camera, where the log has several"
    )


def add_span(parser: argparse.ArgumentParser) -> None:
    """``--from`` and ``--to``."""
    parser.add_argument(
        "--from",
        dest="start",
        metavar="T",
        help="first time: seconds, 1:20, 12:03:40, frame:N or RFC 3339",
    )
    parser.add_argument("--to", dest="end", metavar="T", help="the end, excluded")


def add_limits(parser: argparse.ArgumentParser) -> None:
    """``--limit``."""
    parser.add_argument(
        "--limit", action="append", default=[], metavar="NAME=VALUE",
        help="how much an input may ask for, as max_chunk_bytes=1073741824; may be repeated",
    )  # fmt: skip


def parse_limits(words: Sequence[str]) -> Limits:
    """The limits that inputs are held to, the named ones changed.

    Raises:
        UsageError: no such limit, or its value is no whole number over 0.
    """
    known = {field.name: field.default for field in dataclasses.fields(Limits)}
    changed = {}
    for word in words:
        name, _, value = word.partition("=")
        if name not in known:
            close = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(known)}"
            raise UsageError(f"--limit {word}: no such limit; {hint}")
        if not re.fullmatch(r"[1-9]\d{0,17}", value):
            raise UsageError(
                f"--limit {word}: must be a whole number over 0, as {name}={known[name]}"
            )
        changed[name] = int(value)
    return Limits(**changed)


_OUTPUTS = {"output": "-o", "plot": "--plot", "html": "--html"}
_INPUTS = {"scene": "the recording itself", "source": "the source itself"}
_READ = "read by the same command"
_WORDS = ("words", "references")
"""Arguments that are words, some of which may name files; other words never do."""


def check_outputs(args: argparse.Namespace) -> None:
    """Refuse to write over what the same command reads: every output against every other file
    that was named.

    Without ``--force`` nothing is written over anyway, and a command says that in its own words.

    Raises:
        UsageError: an output is one of the inputs, or two outputs are one file.
    """
    given = vars(args)
    if not given.get("force", True):
        return
    outputs = {name: given[name] for name in _OUTPUTS if isinstance(given.get(name), Path)}
    for name, out in outputs.items():
        for other, value in given.items():
            if other == name:
                continue
            for path in value if isinstance(value, list | tuple) else [value]:
                named = isinstance(path, Path) or (
                    other in _WORDS and isinstance(path, str)
                )
                if named and _one_file(out, Path(path), both_written=other in outputs):
                    what = (
                        f"what {_OUTPUTS[other]} is to write"
                        if other in outputs
                        else _INPUTS.get(other, _READ)
                    )
                    raise UsageError(
                        f"{_OUTPUTS[name]} {out}: is {what}; name another file"
                    )


def _one_file(a: Path, b: Path, *, both_written: bool) -> bool:
    try:
        return a.samefile(b) and not a.is_dir()
    except OSError:
        # What is not there yet cannot be read, but be written twice; some file systems take upper
        # and lower case for the same.
        return both_written and (
            str(a.absolute()).casefold() == str(b.absolute()).casefold()
        )
    except ValueError:
        return False  # a word that is no path


def say(text: str) -> None:
    """A message to the person: on stderr, so that results stay clean."""
    print(printable(text), file=sys.stderr)


def printable(text: str) -> str:
    r"""A text from a file as one line for a terminal: what would move its cursor or colour it is
    spelt out.

    >>> print(printable("door\x1b[2J\n"))
    door\x1b[2J\n
    """
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text
    )


def shown() -> IO[str]:
    """stdout; on a terminal, what would steer it is spelt out."""
    return cast("IO[str]", _Shown(sys.stdout)) if sys.stdout.isatty() else sys.stdout


class _Shown(io.TextIOBase):
    def __init__(self, out: IO[str]) -> None:
        self._out = out

    def write(self, text: str, /) -> int:
        lines = text.replace("\r\n", "\n").split("\n")
        return self._out.write("\n".join(printable(line) for line in lines))


def parse_time(text: str, scene: SceneLog) -> int:
    """A time as log time in ns: seconds from the start, ``1:20``, ``12:03:40`` (a time of day,
    UTC, where the recording has a clock, else from the start), ``frame:N``, or RFC 3339.

    Raises:
        UsageError: it is none of them, or the frame is not there.
    """
    if match := re.fullmatch(r"frame:(\d+)", text):
        wanted = int(match[1])
        for index, time_ns in enumerate(scene.frame_times()):
            if index == wanted:
                return time_ns
        raise UsageError(f"{text}: {scene.path} has frames 0 to {index}")
    if re.fullmatch(r"\d+(\.\d*)?", text):
        start = next(scene.frame_times())
        whole, _, fraction = text.partition(".")
        return start + int(whole) * NANOS + int(fraction[:9].ljust(9, "0") or 0)
    return parse_clock(text, lambda: next(scene.frame_times()))


def parse_clock(text: str, start_ns: Callable[[], int]) -> int:
    """``1:20``, ``12:03:40`` or RFC 3339 as log time in ns, the first two from a start.

    Raises:
        UsageError: it is none of them.
    """
    told = colon_time(text)
    if told is None:
        return parse_rfc3339(text)
    start = start_ns()
    seconds = after_start(told.seconds, start, "UTC") if told.of_day else told.seconds
    return start + round(seconds * NANOS)


def parse_rfc3339(text: str) -> int:
    """An RFC 3339 time as ns since 1970.

    Raises:
        UsageError: it is none.
    """
    match = re.fullmatch(
        r"(\d{4}-\d\d-\d\d[Tt ]\d\d:\d\d:\d\d)(\.\d+)?([Zz]|[+-]\d\d:\d\d)", text
    )
    try:
        if match is None:
            raise ValueError(text)
        zone = "+00:00" if match[3] in "Zz" else match[3]
        seconds = int(
            (
                datetime.fromisoformat(match[1] + zone) - datetime(1970, 1, 1, tzinfo=UTC)
            ).total_seconds()
        )
    except ValueError:
        raise UsageError(
            f"time {text!r}: must be seconds from the start (12.5), minutes and seconds"
            " (1:20), a time of day (12:03:40), frame:N, or RFC 3339"
            " (2026-01-31T12:00:00Z)"
        ) from None
    return seconds * NANOS + int((match[2] or ".0")[1:10].ljust(9, "0"))


@contextmanager
def progress(
    total: int | None, unit: str = "frames"
) -> Iterator[Callable[[str, int], None]]:
    """A progress bar on stderr, on a terminal only: a callable of the stage's name and the number
    done.

    It shows the rate and the time left.
    """
    if not sys.stderr.isatty():
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description:>10}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(f"{{task.fields[rate]}} {unit}/s"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        tasks: dict[str, int] = {}

        def update(stage: str, index: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=total, rate="-")
            task = bar.tasks[tasks[stage]]
            rate = "-" if task.speed is None else f"{task.speed:.0f}"
            bar.update(task.id, completed=index + 1, rate=rate)

        yield update


@contextmanager
def interrupts_at(report: Callable[P, None]) -> Iterator[Callable[P, None]]:
    """Let Ctrl-C take effect where a report of progress is made, between frames; a second one
    does so at once.

    One that falls into the inside of a thread pool leaves its locks held, and whoever then waits
    for the pool waits for ever.
    """
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield report
        return
    pressed = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal pressed
        if pressed:
            signal.default_int_handler(number, frame)
        pressed = True

    def safely(*args: P.args, **kwargs: P.kwargs) -> None:
        if pressed:
            raise KeyboardInterrupt
        report(*args, **kwargs)

    signal.signal(signal.SIGINT, note)
    try:
        yield safely
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


_SAME_SIGNAL_S = 1.0
"""A terminal or a supervisor may send a signal to the process and to its group: that is one."""


@contextmanager
def ends_at_interrupt(stop: Callable[[], None]) -> Iterator[None]:
    """Let Ctrl-C and SIGTERM end what is live: ``stop`` is called, what there is is finished; a
    second one interrupts at once.
    """
    usual = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # What whoever started us has others look after stays theirs: `nohup ... &` ignores Ctrl-C.
    before = {n: h for n, h in usual.items() if signal.getsignal(n) == h}
    first: float | None = None

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal first
        now = time.monotonic()
        if first is None:
            first = now
            stop()
        elif now - first > _SAME_SIGNAL_S:
            signal.default_int_handler(number, frame)

    for number in before:
        signal.signal(number, note)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


_UNITS = {"": 1, "s": 1, "sec": 1, "m": 60, "min": 60, "h": 3600, "d": 86400}


def duration_ns(text: str) -> int:
    """A length of time as ``10min``, ``90s``, ``1.5h``, ``600``.

    Raises:
        ArgumentTypeError: it is none, or not over 0.
    """
    match = re.fullmatch(r"(\d{1,9}(?:\.\d{1,9})?)\s*([a-z]*)", text, re.ASCII)
    if match is None or match[2] not in _UNITS or float(match[1]) <= 0:
        raise argparse.ArgumentTypeError(
            f"{text!r}: must be a length of time over 0, as 10min, 90s, 1.5h"
        )
    return round(float(match[1]) * _UNITS[match[2]] * NANOS)


def picture_size(text: str) -> tuple[int, int]:
    """Width and height of ``768x576``, each at most six digits.

    Raises:
        ArgumentTypeError: it is not such a size.
    """
    match = re.fullmatch(r"([1-9]\d{0,5})[xX×]([1-9]\d{0,5})", text, re.ASCII)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r}: must be WIDTHxHEIGHT, like 768x576")
    return int(match[1]), int(match[2])


def take_words_anywhere(parser: argparse.ArgumentParser) -> None:
    """Let options stand between the inputs and the SQL, which argparse does not do in a
    subcommand by itself.
    """
    plain, mixing = parser.parse_known_args, False

    def parse(
        args: Any = None, namespace: Any = None
    ) -> tuple[argparse.Namespace, list[str]]:
        nonlocal mixing
        if mixing:
            return plain(args, namespace)
        mixing = True
        try:
            return parser.parse_known_intermixed_args(args, namespace)
        finally:
            mixing = False

    parser.parse_known_args = parse  # type: ignore[method-assign, assignment]
    # `--within -1s` is a wrong time, which its reader says, and no option that lacks its argument.
    # argparse has no public way to say so.
    parser._negative_number_matcher = re.compile(r"-\.?\d.*")
