"""`scenetrace query`: SQL, ready questions and patterns over annotated logs and indexes."""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recorders.errors import OutputExistsError, UsageError
from recorders.stores import is_uri
from replay.cli.common import (
    Commands,
    add_configuration,
    add_limits,
    command,
    parse_limits,
    say,
    shown,
    take_words_anywhere,
)
from replay.cli.drawing import (
    add_clock,
    add_drawing,
    add_ground,
    drawn_of,
    ground_of,
    start_of,
    without_cases,
)
from replay.cli.exit_codes import Exit

if TYPE_CHECKING:
    from reasoning.questions import Answer, Case
    from reasoning.questions.literals import Recordings
    from reasoning.questions.ready_questions import Options

EXAMPLE = """\
scenetrace query annotated.mcap "SELECT kind, t, subjects, text FROM events ORDER BY t"
scenetrace query annotated.mcap --ask met 3
scenetrace query annotated.mcap --line gate=192,100,192,280 --ask crossed gate --clips out/
scenetrace query monday.mcap tuesday.mcap --ask who-was-in bench --at 12.5 --format json
scenetrace query case.duckdb --ask contacts 3 --depth 4 --show-sql
scenetrace query case.duckdb --pattern "meeting(a,b) ; joint(a,b)[>2s] ; exited(a)[<30s]"
scenetrace query --ask list"""
_MOST_CLIPS = 1000
DESCRIPTION = """Ask annotated logs, an index, a folder of Parquet, or a case (case.toml: all its logs).

Tables: frames, tracks, relations, groups, encounters, events; also recordings, presence, bits, zones, phases
(`query LOG "DESCRIBE tracks"` shows columns). Times are seconds from the recording's start, frames count from 0.
A query only reads: no files, no settings, no extensions, within --time-limit and --memory."""


def add(commands: Commands) -> None:
    """Declare the command."""
    parser = command(
        commands,
        "query",
        "ask annotated logs: SQL or a ready question",
        DESCRIPTION,
        EXAMPLE,
    )
    parser.add_argument(
        "words",
        nargs="*",
        metavar='ANNOTATED... "SQL"',
        help="logs, indexes, Parquet folders, a case (case.toml); then the SQL",
    )
    parser.add_argument(
        "--ask",
        nargs="+",
        metavar=("NAME", "ARG"),
        help="a ready question; `--ask list` shows them",
    )
    parser.add_argument(
        "--pattern",
        metavar="PATTERN",
        help="a pattern over time, or the name of a shipped one; `list` shows them",
    )
    parser.add_argument(
        "--format", choices=("table", "json", "csv", "parquet"), help="default: table"
    )
    parser.add_argument("--json", action="store_true", help="the same as --format json")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="OUT", help="write there instead of to stdout"
    )
    parser.add_argument("--force", action="store_true", help="overwrite OUT")
    parser.add_argument(
        "--clips", type=Path, metavar="DIR",
        help="also a clip of each row there: subjects marked, two seconds around; and the same plain",
    )  # fmt: skip
    parser.add_argument(
        "--blur-others", action="store_true",
        help="with --clips: of everybody but the subjects no pixel is left",
    )  # fmt: skip
    parser.add_argument(
        "--show-sql",
        action="store_true",
        help="print a question's or pattern's SQL instead of its answer",
    )
    fleet = parser.add_argument_group("options of a case of `scenetrace batch`")
    fleet.add_argument("--camera", metavar="NAME", help="only this camera's recordings")
    fleet.add_argument(
        "--date",
        metavar="DAY",
        help="only those of this day, as 2026-01-31, or days, as 2026-01-01..2026-01-31"
        " (UTC)",
    )
    asking = parser.add_argument_group("options of questions")
    asking.add_argument("--recording", metavar="NAME", help="only this recording")
    asking.add_argument(
        "--at",
        metavar="T",
        help="a moment: seconds, 1:20, 12:03:40 (time of day), frame:N, or RFC 3339",
    )
    asking.add_argument(
        "--min", metavar="TIME", dest="least", help="shortest stay, like 30s"
    )
    asking.add_argument("--within", metavar="TIME", help="how far apart in time, like 60s")
    asking.add_argument(
        "--gap", metavar="TIME", help="gaps in a stay up to this are closed, like 2s"
    )
    asking.add_argument(
        "--depth", type=int, metavar="N", help="longest chain of contacts (default 3)"
    )
    asking.add_argument(
        "--by",
        metavar="WHAT",
        help="a contact is: relations (default), joint, encounters, groups",
    )
    asking.add_argument(
        "--direction", metavar="WAY", help="only crossings to the left, right, up or down"
    )
    asking.add_argument(
        "--every", metavar="TIME", help="count by spans so long, like 1h (default 1h)"
    )
    add_clock(asking)
    asking.add_argument(
        "--certainty",
        type=float,
        metavar="P",
        help="leave out rows of a ready question that are less sure than P, 0 to 1"
        " (default 0.5); stderr says how many",
    )
    asking.add_argument(
        "--brief",
        action="store_true",
        help="events for people: without what trackers say of themselves (confirmed, lost,"
        " mode changed ...)",
    )
    add_drawing(parser)
    add_ground(parser)
    add_configuration(parser)
    add_limits(parser)
    limits = parser.add_argument_group("limits")
    limits.add_argument(
        "--time-limit", type=float, default=60.0, metavar="S", help="seconds (default 60)"
    )
    limits.add_argument(
        "--memory",
        type=int,
        default=2048,
        metavar="MIB",
        help="memory in MiB (default 2048)",
    )
    parser.set_defaults(run=run)
    take_words_anywhere(parser)


def run(args: argparse.Namespace) -> int:
    """Answer."""
    from reasoning.questions import Case, QueryLimits
    from reasoning.questions.catalogue import Choice, choose_dates
    from reasoning.questions.clocks import starts, with_clocks
    from reasoning.questions.guard import guarded
    from reasoning.questions.name_checks import check_thresholds
    from reasoning.questions.unsure import Unsure
    from replay.asking_configuration import chosen_encounters, encounter_config

    if _listed(args):
        return Exit.DONE
    form = _format(args)
    _check_options(args)
    given = list(args.words)
    args.words = without_cases(given)
    inputs, query = _split(args)
    if args.show_sql:
        print(query)
        return Exit.DONE
    if not 0 < args.time_limit <= 1e6 or not 16 <= args.memory <= 1_048_576:
        raise UsageError(
            "--time-limit must be over 0 and at most 1e6 seconds, --memory 16 to"
            " 1048576 MiB"
        )
    if args.output is not None and args.output.exists() and not args.force:
        raise OutputExistsError(args.output)
    encounters = encounter_config(args.config, args.assignments)
    with Case(
        inputs,
        QueryLimits(args.time_limit, args.memory),
        log_limits=parse_limits(args.limit),
        encounters=encounters,
        brief=args.brief,
        drawn=drawn_of(args, given),
        start_ns=start_of(args, given),
        looks=asks_for_looks(query),
        ground=ground_of(args),
        choice=Choice(args.camera, choose_dates(args.date) if args.date else None),
        tables=_tables(query, args),
    ) as case:
        check_thresholds(case, chosen_encounters(args.config, args.assignments))
        ask, nothing = _asked(case, query, args)
        unsure = Unsure(_certainty(args) if args.ask else None)
        with guarded(case.limits):
            begun = starts(case) if args.ask or args.pattern else {}
            answer = with_clocks(unsure.left_out_of(ask()), begun, args.timezone)
            scenes = Scenes(args)
            if args.ask and args.ask[0] == "heatmap" and _is_picture(args.output):
                return _heatmap(case, answer, args)
            count = _answer(scenes.of(answer), form, args)
            if args.ask:
                unsure.add_contacts(case, args.ask[0], _options(args))
        if unsure.count:
            say(unsure.told())
        elif count == 0 and nothing:
            say(f"no rows: {nothing}")
        return scenes.write(case)


class Scenes:
    """Takes down what the rows of an answer show while they are written, for ``--clips``."""

    def __init__(self, args: argparse.Namespace) -> None:
        self._args = args
        self._columns: list[str] = []
        self._rows: list[tuple[Any, ...]] = []
        if args.clips is not None:
            from replay.export.answer_clips import INDEX
            from replay.export.output import check_folder

            check_folder(args.clips, INDEX, force=args.force)
        elif args.blur_others:
            raise UsageError("--blur-others goes with --clips DIR")

    def of(self, answer: Answer) -> Answer:
        """The answer, whose rows are kept as they are read."""
        if self._args.clips is None:
            return answer
        self._columns = answer.columns
        return replace(answer, rows=self._kept(answer.rows))

    def _kept(self, rows: Iterator[tuple[Any, ...]]) -> Iterator[tuple[Any, ...]]:
        for row in rows:
            if len(self._rows) >= _MOST_CLIPS:
                raise UsageError(
                    f"--clips: over {_MOST_CLIPS} rows; ask for fewer, or for one --recording"
                )
            self._rows.append(row)
            yield row

    def write(self, case: Case) -> int:
        """Write the clips, outside of the query's limits; the exit code."""
        args = self._args
        if args.clips is None:
            return Exit.DONE
        from replay.cli.common import progress
        from replay.export.answer_clips import scenes_of, write_answer_clips

        scenes = scenes_of(case, self._columns, self._rows)
        if not scenes:
            say(f"{args.clips}: no rows, no clips")
            return Exit.DONE
        with progress(None) as bar:
            left_out = write_answer_clips(
                case, scenes, args.clips, hide=args.blur_others, zone=args.timezone,
                force=args.force, progress=bar,
            )  # fmt: skip
        say(f"{args.clips}: {len(scenes)} clips, marked and plain; clips.csv says of what")
        for line in left_out:
            say(f"left out {line}")
        return Exit.LEFT_OUT if left_out else Exit.DONE


def _is_picture(path: Path | None) -> bool:
    return path is not None and path.suffix.lower() == ".png"


def _heatmap(case: Case, answer: Answer, args: argparse.Namespace) -> int:
    from replay.report.heatmap import draw_heatmap

    rows = list(answer.rows)
    most = draw_heatmap(case, answer.columns, rows, args.output, force=args.force)
    say(f"{args.output}: {len(rows)} squares, {most:.1f} s in the warmest")
    return Exit.DONE


def _check_options(args: argparse.Namespace) -> None:
    """That options of questions stand with a question; which of them a ready question takes, it
    says itself.
    """
    if args.ask is not None:
        return
    from reasoning.questions.ready_questions import FLAGS

    kind = "SQL" if args.pattern is None else "--pattern"
    given = {
        "--show-sql": args.show_sql or None,
        "--recording": args.recording,
        "--at": args.at,
        "--min": args.least,
        "--within": args.within,
        "--gap": args.gap,
        "--depth": args.depth,
        "--by": args.by,
        "--direction": args.direction,
        "--every": args.every,
        "--certainty": args.certainty,
    }
    taken = ("--show-sql", FLAGS["recordings"]) if args.pattern is not None else ()
    for flag, value in given.items():
        if value is not None and flag not in taken:
            instead = (
                "what it takes stands in it"
                if args.pattern is None
                else f"it takes: {', '.join(taken)}"
            )
            raise UsageError(f"{kind} takes no {flag}; {instead}")


def _asked(
    case: Case, query: str, args: argparse.Namespace
) -> tuple[Callable[[], Answer], str]:
    """What asks the question, and what an empty answer means; what it names is there."""
    from reasoning.questions.gaps import unrecorded
    from reasoning.questions.literals import only
    from reasoning.questions.name_checks import check_pattern, check_recording, check_words

    if args.ask is None and args.pattern is None:
        return lambda: case.sql(query), ""
    check_recording(case, args.recording)
    chosen = only(args.recording)
    if args.pattern is not None:
        from reasoning.questions.patterns import parse, plan, shipped_or_given

        text = shipped_or_given(args.pattern)
        check_pattern(case, parse(text), chosen)
        nothing = unrecorded(
            case, None, chosen, "nothing in these recordings fits the pattern"
        )
        return lambda: case.by_recording(lambda some: plan(text, some), chosen), nothing
    from reasoning.questions.ready_questions import question

    asked, words, options = question(args.ask[0]), args.ask[1:], _options(args)
    check_words(case, asked, words, options)

    def make(some: Recordings | None) -> str:
        return asked.sql(words, replace(options, recordings=some))

    return lambda: case.by_recording(
        make, chosen, keeps_few=asked.keeps_few(words)
    ), unrecorded(case, options.at, options.recordings, asked.why_empty(words))


def _options(args: argparse.Namespace) -> Options:
    from reasoning.questions.literals import duration, moment, only
    from reasoning.questions.ready_questions import Options

    def seconds(text: str | None) -> float | None:
        return None if text is None else duration(text)

    return Options(
        recordings=only(args.recording),
        at=None if args.at is None else moment(args.at, args.timezone),
        least_s=seconds(args.least),
        within_s=seconds(args.within),
        gap_s=seconds(args.gap),
        depth=args.depth,
        by=args.by,
        certainty=_certainty(args),
        direction=args.direction,
        every_s=seconds(args.every),
        timezone=args.timezone,
    )


def _certainty(args: argparse.Namespace) -> float | None:
    """What a row must be, None where a question is asked however sure it is."""
    from reasoning.questions.unsure import wanted_certainty

    return wanted_certainty(args.ask[0], args.certainty, "--certainty")


def _format(args: argparse.Namespace) -> str:
    if args.json and args.format not in (None, "json"):
        raise UsageError(f"--json and --format {args.format}: give one of them")
    return "json" if args.json else (args.format or "table")


def _listed(args: argparse.Namespace) -> bool:
    if args.ask is not None and args.pattern is not None:
        raise UsageError("--ask and --pattern: give one of them")
    if args.ask == ["list"]:
        from reasoning.questions.ready_questions import all_questions

        for question in all_questions():
            print(f"{question.name + ' ' + question.arguments:34s} {question.about}")
        return True
    if args.pattern == "list":
        from reasoning.questions.patterns import SHIPPED

        for name, shipped in SHIPPED.items():
            print(f"{name}: {shipped.about}\n    {shipped.text}")
        return True
    return False


def asks_for_looks(query: str) -> bool:
    """Whether a query reads what only pictures tell: of logs they are looked at then alone."""
    return re.search(r"(?i)_colour\b|\blooks\b", query) is not None


def _tables(query: str, args: argparse.Namespace) -> frozenset[str]:
    """The tables that are going to be read."""
    from reasoning.questions.needed import tables_asked, tables_ready

    if args.ask is not None:
        from reasoning.questions.ready_questions import question

        return tables_ready(query, question(args.ask[0]).kinds()[: len(args.ask) - 1])
    if args.pattern is not None:
        return tables_ready(query)
    return tables_asked(query)


def _split(args: argparse.Namespace) -> tuple[list[str | Path], str]:
    """The inputs and the SQL; for a ready question or a pattern the SQL that answers it."""
    words = list(args.words)
    if args.ask is not None:
        from reasoning.questions.ready_questions import question

        query = question(args.ask[0]).sure_sql(args.ask[1:], _options(args))
    elif args.pattern is not None:
        from reasoning.questions.literals import only
        from reasoning.questions.patterns import plan

        query = plan(args.pattern, only(args.recording))
    else:
        if not words:
            raise UsageError(
                'give annotated logs and a query: scenetrace query annotated.mcap "SELECT *'
                ' FROM events"'
            )
        query = words.pop()
        if not words and _is_there(query):
            raise UsageError(
                f"{query}: and what is the question? Give SQL, --ask NAME or --pattern"
                " PATTERN"
            )
    if not words and not args.show_sql:
        raise UsageError(
            "no annotated log given; put logs, an index or a Parquet folder before the"
            " question"
        )
    if args.ask is not None or args.pattern is not None:
        kind = "--ask" if args.ask is not None else "--pattern"
        sql = next(
            (word for word in words if _looks_like_sql(word) and not _is_there(word)), None
        )
        if sql is not None:
            raise UsageError(f"{kind} and SQL ({sql[:40]!r}): give one of them")
    return [w if is_uri(w) else Path(w) for w in words], query


def _is_there(word: str) -> bool:
    """Whether a word is the name of a file or folder; SQL may be longer than any name can be."""
    try:
        return Path(word).exists()
    except OSError:
        return False


def _looks_like_sql(word: str) -> bool:
    verb, _, rest = word.lstrip(" (\n").partition(" ")
    return bool(rest) and verb.upper() in (
        "SELECT",
        "WITH",
        "FROM",
        "DESCRIBE",
        "SUMMARIZE",
        "EXPLAIN",
    )


def _answer(answer: Answer, form: str, args: argparse.Namespace) -> int | None:
    """Write the answer; the number of its rows, None if nobody counted."""
    from reasoning.questions.answer_text import write

    if form == "parquet":
        _parquet(answer, args)
        return None
    if args.output is None:
        return write(answer, form, shown() if form != "table" else sys.stdout)
    from replay.export.output import whole_text

    with whole_text(args.output, force=args.force) as out:
        count = write(answer, form, out)
    say(f"{args.output}: {count} rows")
    return count


def _parquet(answer: Answer, args: argparse.Namespace) -> None:
    from reasoning.questions import QueryLimits
    from reasoning.questions.parquet import write_parquet

    limits = QueryLimits(args.time_limit, args.memory)
    if args.output is not None:
        write_parquet(answer, args.output, limits)
        say(f"{args.output}: written")
        return
    if sys.stdout.isatty():
        raise UsageError("Parquet is binary: give -o OUT, or pipe it into a file")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "answer.parquet"
        write_parquet(answer, out, limits)
        sys.stdout.buffer.write(out.read_bytes())
