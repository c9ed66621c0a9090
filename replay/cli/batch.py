"""``scenetrace batch``."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recorders.errors import UsageError
from replay.cli import common
from replay.cli.exit_codes import Exit
from replay.plurals import count_of

if TYPE_CHECKING:
    from recorders.stores import Store
    from replay.batch import BatchSummary, Job, Outcome
    from replay.batch.engines import JobEngine

DESCRIPTION = """Record, replay and tabulate many sources into a CASE: a folder or a URI (s3://, gs://, az://, hdfs://, sftp://).

SOURCE is a video, folder of pictures, log or bag; a folder or pattern of them; @list.txt with one on each line
(options of its own behind it); or a URI. Options of `record` and `replay` hold for all of them; {stem}, {name},
{folder} and {dir} stand for a source's name without and with suffix, its folder's name, and the folder's path.

CASE gets scene/, annotated/, tables/ (Parquet, by camera and day) and status/. The same command again does what is
not done yet. What fails is set aside with its reason, and the rest goes on (exit code 3). `scenetrace query CASE`
asks all of it, --camera and --date a part."""
EXAMPLE = """\
scenetrace batch recordings/ -o case --camera '{folder}' --workers 8
scenetrace batch 's3://unit/2026-11/*.mp4' -o s3://unit/case --engine ray --address auto
scenetrace batch --status case
scenetrace batch --compact case
scenetrace query case --ask met 3"""
KEPT = ("all", "annotated", "tables")


def add(commands: common.Commands) -> None:
    """Declare the command."""
    from replay.cli import record

    parser = common.command(
        commands,
        "batch",
        "many sources through record, replay and tables, here or on a cluster",
        DESCRIPTION,
        EXAMPLE,
    )
    parser.add_argument("sources", nargs="*", metavar="SOURCE", help="see above")
    parser.add_argument("-o", "--output", metavar="CASE", help="a folder or a URI")
    parser.add_argument(
        "--keep",
        choices=KEPT,
        default="all",
        help="all (default): scene logs, annotated logs, tables; annotated: no scene logs;"
        " tables: no logs",
    )
    work = parser.add_argument_group("work")
    work.add_argument(
        "--engine",
        choices=("local", "ray"),
        default="local",
        help="local: processes of this machine (default); ray: a Ray cluster",
    )
    work.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="recordings at a time; default: as many as there are processors",
    )
    work.add_argument(
        "--address",
        metavar="A",
        help="ray: auto, or ray://host:10001; default: a cluster of this machine alone",
    )
    work.add_argument(
        "--retries",
        type=int,
        default=2,
        metavar="N",
        help="how often a recording is tried again whose worker or store failed (default"
        " 2); a source that cannot be read is not",
    )
    work.add_argument(
        "--again",
        action="store_true",
        help="try those anew that an earlier run set aside",
    )
    work.add_argument(
        "--memory",
        type=int,
        default=4096,
        metavar="MIB",
        help="what one recording may take (default 4096; 0: no limit)",
    )
    work.add_argument(
        "--time-limit",
        type=float,
        default=6 * 3600.0,
        metavar="S",
        help="how long one recording may take (default 6 hours; 0: no limit)",
    )
    work.add_argument(
        "--ship",
        action="append",
        default=[],
        type=Path,
        metavar="FOLDER",
        help="a folder with code of yours (a tracker, a detector), for the workers too; may"
        " be repeated",
    )
    work.add_argument(
        "--wheel",
        type=Path,
        metavar="FILE",
        help="ray: scenetrace as a wheel, for nodes that do not have this version",
    )
    asked = parser.add_argument_group("asked of a case that is there")
    asked.add_argument("--status", metavar="CASE", help="how far it is, and what failed")
    asked.add_argument(
        "--compact",
        metavar="CASE",
        help="put small files of the tables together, one for each camera and day",
    )
    parser.add_argument(
        "--json", action="store_true", help="what was done, or --status, as JSON"
    )
    parser.add_argument(
        "--json-lines",
        action="store_true",
        help="a line of JSON on stdout for each recording, and one for the whole at the end",
    )
    common.add_tracker(parser, "default events")
    common.add_configuration(parser)
    common.add_limits(parser)
    record.add_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Do all of them, or say how far a case is."""
    from recorders.stores import open_store

    asked = [flag for flag in ("status", "compact") if getattr(args, flag) is not None]
    if asked:
        if len(asked) > 1 or args.sources or args.output is not None:
            raise UsageError(f"--{asked[0]} CASE stands alone, without sources and -o")
        store = open_store(getattr(args, asked[0]))
        return _status(store, args) if asked[0] == "status" else _compact(store)
    if not args.sources:
        raise UsageError("no source: give files, folders, patterns, @list.txt or URIs")
    if args.output is None:
        raise UsageError("no case: give -o FOLDER or a URI")
    return _batch(args)


def _status(store: Store, args: argparse.Namespace) -> int:
    from reasoning.questions.catalogue import check_schema
    from replay.batch.driver import status_summary

    check_schema(store)
    found = status_summary(store)
    if not found["done"] and not found["failed"]:
        raise UsageError(
            f"{store.uri}: no case of `scenetrace batch`, or nothing ended yet"
        )
    if args.json or args.json_lines:
        print(json.dumps(found))
        return Exit.DONE
    left_out = f", {found['left_out']} of them with something left out"
    print(
        f"{count_of(found['done'], 'recording')} done ({found['frames']} frames"
        f"{left_out if found['left_out'] else ''}), {found['failed']} set aside"
    )
    for one in found["failures"]:
        print(common.printable(_why(one["source"], one["step"], one["reason"])))
    return Exit.DONE


def _compact(store: Store) -> int:
    from reasoning.questions.compaction import compact

    done = compact(store)
    common.say(
        f"{store.uri}: {count_of(done.files, 'file')} of each table became {done.into};"
        f" {count_of(done.removed, 'file')} of the compaction before removed"
    )
    return Exit.DONE


def _batch(args: argparse.Namespace) -> int:
    from replay.batch import BatchOptions, run_batch

    jobs, unread = jobs_of(args)
    for line in unread:
        common.say(f"scenetrace: left out: {line}")
    if args.retries < 0:
        raise UsageError(f"--retries {args.retries}: must be 0 or more")
    engine = _engine(args)
    begun = time.monotonic()
    try:
        with common.progress(len(jobs), "recordings") as bar:

            def told(summary: BatchSummary, outcome: Outcome | None) -> None:
                if summary.ended:
                    bar("batch", summary.ended - 1)
                _tell(summary, outcome, args)

            report = BatchOptions(args.retries, args.again)
            done = run_batch(jobs, engine, report, told)
    finally:
        engine.close()
    code = _summed_up(done, args, time.monotonic() - begun, len(unread))
    return Exit.LEFT_OUT if unread and code == Exit.DONE else code


def _why(source: str, step: str, reason: str) -> str:
    where = step if reason.startswith(source) else f"{source}: {step}"
    return f"{where}: {reason}"


def _tell(summary: BatchSummary, outcome: Outcome | None, args: argparse.Namespace) -> None:
    if outcome is None:
        return
    status = outcome.status
    if args.json_lines:
        facts: dict[str, Any] = {
            "source": status.source,
            "state": "known" if outcome.known else status.state,
            "digest": status.digest,
            "recordings": status.recordings,
            "frames": status.frames,
            "seconds": round(outcome.seconds, 3),
            "tries": status.tries,
        }
        if status.state == "failed":
            facts |= {"step": status.step, "reason": status.reason}
        print(json.dumps(facts), flush=True)
    if status.state == "failed":
        why = _why(status.source, status.step, status.reason)
        common.say(f"set aside ({summary.ended} of {summary.total}): {why}")


def _summed_up(
    done: BatchSummary, args: argparse.Namespace, seconds: float, unread: int
) -> int:
    left_out = [status for status in done.done if status.left_out]
    rate = f"{done.frames / seconds:.0f} frames/s" if seconds > 0 else ""
    if args.json_lines or args.json:
        print(
            json.dumps(
                {
                    "done": len(done.done),
                    "known": done.known,
                    "failed": len(done.failed),
                    "left_out": len(left_out),
                    "unread_folders": unread,
                    "frames": done.frames,
                    "seconds": round(seconds, 3),
                }
            )
        )
    for status in left_out:
        for line in status.said:
            if "left out" in line:
                common.say(f"{status.source}: {line.removeprefix('scenetrace: ')}")
    common.say(
        f"{args.output}: {count_of(len(done.done), 'recording')} done"
        f" ({done.frames} frames, {rate}), {done.known} were there, {len(done.failed)} set"
        " aside"
        + (f"; `scenetrace batch --status {args.output}` lists them" if done.failed else "")
    )
    if done.failed and not done.done and not done.known:
        return Exit.FAILED
    return Exit.LEFT_OUT if done.failed or left_out else Exit.DONE


def _engine(args: argparse.Namespace) -> JobEngine:
    from replay.batch.engines import LocalEngine, RayEngine, RayOptions

    if args.workers is not None and not 1 <= args.workers <= 10_000:
        raise UsageError(f"--workers {args.workers}: must be 1 to 10000")
    if args.engine == "local":
        for flag in ("address", "wheel"):
            if getattr(args, flag) is not None:
                raise UsageError(f"--{flag} goes with --engine ray")
        return LocalEngine(args.workers or os.cpu_count() or 1)
    ship = tuple(str(path.absolute()) for path in args.ship)
    wheel = None if args.wheel is None else str(args.wheel.absolute())
    return RayEngine(RayOptions(args.address, args.workers, wheel, ship), args.memory)


def jobs_of(args: argparse.Namespace) -> tuple[list[Job], list[str]]:
    """The jobs that a command line means, and a line for each folder that could not be searched;
    what is wrong with its words is found here, once.

    Raises:
        UsageError: a word is wrong, or names nothing.
    """
    from importlib.metadata import version

    from recorders.parameters import configure
    from recorders.recording import SECTIONS
    from recorders.stores import is_uri
    from replay.batch import Job, Limit, sources_of
    from replay.batch.jobs import filled
    from replay.configuration import all_sections, replay_config
    from replay.trackers.choice import DEFAULT_TRACKER, choose

    if args.memory < 0 or args.time_limit < 0:
        raise UsageError("--memory and --time-limit must be 0 or more")
    paths = [str(path.absolute()) for path in args.ship]
    sys.path[:0] = [path for path in paths if path not in sys.path]
    tracker = choose(args.tracker or DEFAULT_TRACKER)
    of_record = [
        word for word in args.assignments if word.partition(".")[0].strip() in SECTIONS
    ]
    of_replay = [word for word in args.assignments if word not in of_record]
    replay_config(tracker, args.config, of_replay)
    configure(SECTIONS, args.config, of_record, others=all_sections())
    common.parse_limits(args.limit)
    case = args.output if is_uri(args.output) else str(Path(args.output).absolute())
    shared = [*_words(args, _SHARED)]
    flags = {a.dest: a.option_strings[-1] for a in _record_options()._actions}
    record = [*_words(args, flags), *shared, *_set(of_record)]
    replay = ["--tracker", tracker.name, *shared, *_set(of_replay)]
    made = f"{version('scenetrace')} {tracker.version}"
    limit = Limit(args.memory, args.time_limit)
    jobs = []
    sources, unread = sources_of(args.sources)
    for source, own in sources:
        recording = filled([*record, *_checked(own, source)], source)
        configuration = _configuration(recording, replay, made)
        jobs.append(
            Job(
                source=source,
                case=case,
                record=recording,
                replay=replay,
                configuration=configuration,
                keep=args.keep,
                limit=limit,
                paths=paths,
            )
        )
    return jobs, unread


def _checked(own: list[str], source: str) -> list[str]:
    """A source's own options, with the files that they name as absolute paths.

    Raises:
        UsageError: `record` has no such option, or not with such a value.
    """
    from replay.cli import Parser, record

    if not own:
        return own
    parser = Parser(prog="scenetrace record", add_help=False)
    record.add_options(parser)
    common.add_configuration(parser)
    common.add_limits(parser)
    try:
        values = vars(parser.parse_args(own)).values()
    except UsageError as error:
        raise UsageError(f"{source}: {error.headline}") from error
    flat = [one for v in values for one in (v if isinstance(v, list) else [v])]
    paths = {str(one) for one in flat if isinstance(one, Path) and "{" not in str(one)}
    return [str(Path(word).absolute()) if word in paths else word for word in own]


_SHARED = {"config": "--config", "limit": "--limit"}


def _set(assignments: Sequence[str]) -> list[str]:
    return [word for one in assignments for word in ("--set", one)]


@cache
def _record_options() -> argparse.ArgumentParser:
    """The options of `record` that are passed on."""
    from replay.cli import record

    parser = argparse.ArgumentParser(add_help=False)
    record.add_options(parser)
    return parser


def _words(args: argparse.Namespace, flags: Mapping[str, str]) -> Iterator[str]:
    """The words that gave options (destination to flag) their values."""
    for name, flag in flags.items():
        value = getattr(args, name)
        if value is None or value == [] or value == _record_options().get_default(name):
            continue
        for one in value if isinstance(value, list) else [value]:
            text = f"{one[0]}x{one[1]}" if isinstance(one, tuple) else str(one)
            is_file = isinstance(one, Path) and "{" not in text
            yield from (flag, str(Path(text).absolute()) if is_file else text)


def _configuration(record: Sequence[str], replay: Sequence[str], made: str) -> str:
    """The digest of a configuration; a file that a word names counts by its bytes."""
    from replay.batch.jobs import configuration_digest

    return configuration_digest(
        {"record": list(map(_by_bytes, record)), "replay": list(map(_by_bytes, replay))},
        made,
    )


@cache
def _by_bytes(word: str) -> str:
    from recorders.files import sha256

    path = Path(word)
    try:
        return f"sha256 {sha256(path)}" if path.is_absolute() and path.is_file() else word
    except OSError:
        return word
