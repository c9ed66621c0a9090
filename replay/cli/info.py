"""``scenetrace info``."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from msgspec import to_builtins

from replay.cli import cases, common
from replay.cli.exit_codes import Exit

if TYPE_CHECKING:
    from recorders.log.info import LogInfo
    from recorders.quality import QualityMeasure
    from recorders.stores import Store

# Times before this are seconds from a recording's start, not dates.
_FIRST_DATE_NS = 365 * 86_400 * common.NANOS
_COLUMNS = 80
_MOST_TOPIC, _LEAST_SCHEMA = 40, 20
_MOST_CAMERAS = 10
_OURS = ("scenetrace", "scenetrace.recording")


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "info",
        "what a log holds",
        "Print what a log holds: size, time, channels, attachments, and where a scene was"
        " recorded or replayed with\nscenetrace, everything that its result depends on:"
        " tracker, configuration, package versions, digests.\nOf a CASE of `scenetrace"
        " batch`: recordings, frames, cameras, days.",
        "scenetrace info annotated.mcap\nscenetrace info annotated.mcap --json",
    )
    parser.add_argument(
        "log",
        type=cases.log_or_case,
        metavar="LOG|CASE",
        help="any MCAP file; a case, as a folder or a URI",
    )
    parser.add_argument("--json", action="store_true", help="as JSON")
    common.add_limits(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print it."""
    from recorders.log.info import inspect

    case = cases.case_at(args.log)
    if case is not None:
        return _of_case(case, args.json)
    info = inspect(args.log, common.parse_limits(args.limit))
    quality = _quality(info)
    if args.json:
        print(json.dumps(_plain(info, quality), indent=2, sort_keys=True))
    else:
        _print(info, quality)
    return Exit.DONE


def _of_case(case: Store, as_json: bool) -> int:
    from replay.batch.inspection import case_facts

    facts = case_facts(case)
    if as_json:
        print(json.dumps(to_builtins(facts), indent=2, sort_keys=True))
        return Exit.DONE
    more = f" ({facts.left_out} with something left out)" if facts.left_out else ""
    lines = [
        f"{facts.case}: a case of `scenetrace batch`",
        f"  recordings: {facts.recordings}{more}, {facts.frames} frames; {facts.set_aside} sources"
        " set aside",
        f"  cameras: {len(facts.cameras)}: {_some(facts.cameras)}",
        f"  days: {' to '.join(dict.fromkeys(facts.days)) or 'none tells its day'}",
        f"  compactions: {facts.compactions}",
    ]
    for line in lines:
        print(common.printable(line))
    return Exit.DONE


def _some(names: list[str]) -> str:
    return ", ".join(names[:_MOST_CAMERAS]) + (" ..." if len(names) > _MOST_CAMERAS else "")


def _quality(info: LogInfo) -> dict[str, list[QualityMeasure]] | None:
    """What was measured of each camera's recording; None where another program wrote something
    else under that name, which is shown as it is.
    """
    from recorders.errors import RecordingError
    from recorders.quality import recorded_quality

    try:
        return recorded_quality(info.metadata, info.path)
    except RecordingError:
        return None


def _plain(
    info: LogInfo, quality: dict[str, list[QualityMeasure]] | None
) -> dict[str, Any]:
    channels = [
        {
            "topic": channel.topic,
            "schema": None if channel.schema is None else channel.schema.name,
            "message_encoding": channel.message_encoding,
            "messages": channel.message_count,
        }
        for channel in info.channels
    ]
    return {
        "file": str(info.path),
        "size_bytes": info.size_bytes,
        "profile": info.profile,
        "library": info.library,
        "messages": info.message_count,
        "start_ns": info.start_ns,
        "end_ns": info.end_ns,
        "indexed": info.is_indexed,
        "channels": channels,
        "attachments": [asdict(attachment) for attachment in info.attachments],
        "metadata": [
            {"name": name, "values": dict(values)} for name, values in info.metadata
        ],
        "compression": [asdict(c) for c in info.compression],
        "quality": [
            {"camera": camera, **asdict(measure)}
            for camera, measured in (quality or {}).items()
            for measure in measured
        ],
    }


def when(time_ns: int | None) -> str:
    """A log time for a person: a date, or seconds where the recording has none."""
    if time_ns is None:
        return "-"
    if time_ns < _FIRST_DATE_NS:
        return f"{time_ns / common.NANOS:.3f} s"
    seconds, nanos = divmod(time_ns, common.NANOS)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{nanos // 1_000_000:03d}Z"


def _shortened(text: str, width: int) -> str:
    """A text of at most ``width``: its start and its end, where it is longer.

    >>> _shortened("/front/camera/image_raw/compressed", 20)
    '/front/ca…compressed'
    """
    if len(text) <= width:
        return text
    end = width // 2
    return f"{text[: width - end - 1]}…{text[-end:]}"


def _print_quality(quality: dict[str, list[QualityMeasure]]) -> None:
    for camera, measured in quality.items():
        print(common.printable(f"quality   of {camera or 'the recording'}"))
        for measure in measured:
            line = f"  {measure.name} {measure.value:g}: {measure.verdict}"
            print(common.printable(line))


def _print(info: LogInfo, quality: dict[str, list[QualityMeasure]] | None) -> None:
    from rich.cells import cell_len, set_cell_size

    from recorders.format_version import RECORDS
    from recorders.quality import QUALITY

    packed = (
        ", ".join(
            f"{c.chunks} chunks {c.compression or 'uncompressed'}" for c in info.compression
        )
        or "no chunks"
    )
    print(f"file      {info.path}, {info.size_bytes:,} bytes, {packed}")
    print(
        common.printable(
            f"written   by {info.library or 'unknown'}, profile {info.profile or 'none'}"
        )
    )
    if not info.is_indexed:
        print("index     none: the file was scanned (unfinished or written without one)")
    span = (
        f"{info.duration_ns / common.NANOS:.3f} s, from {when(info.start_ns)} to"
        f" {when(info.end_ns)}"
    )
    print(
        f"messages  {info.message_count:,}"
        + (f" over {span}" if info.message_count else "")
    )
    topics = [common.printable(channel.topic) or '""' for channel in info.channels]
    usual = [cell_len(t) for t in topics if cell_len(t) <= _MOST_TOPIC]
    width = max(usual, default=_MOST_TOPIC)
    for channel, topic in zip(info.channels, topics, strict=True):
        schema = (
            "no schema"
            if channel.schema is None
            else f"{channel.schema.name} [{channel.schema.encoding}]"
        )
        count = channel.message_count if channel.message_count is not None else "?"
        room = max(_LEAST_SCHEMA, _COLUMNS - width - 13)
        print(
            f"  {set_cell_size(_shortened(topic, width), width)}  {count:>7} "
            f" {_shortened(common.printable(schema), room)}"
        )
    _print_quality(quality or {})
    for attachment in info.attachments:
        print(
            common.printable(
                f"attached  {_shortened(attachment.name, _COLUMNS)}, {attachment.size_bytes:,} bytes,"
                f" {_shortened(attachment.media_type, _COLUMNS)}, at"
                f" {when(attachment.log_time_ns)}"
            )
        )
    for name, values in info.metadata:
        print(f"metadata  {common.printable(_shortened(name, _COLUMNS))}")
        for key, value in sorted(values.items()):
            if name in _OURS and key == "fact_digests":
                continue  # a digest of each of the others: for `verify`, and in --json
            if name in RECORDS and key == QUALITY and quality is not None:
                continue  # told above
            sections = (
                _sections(value) if name in _OURS and key == "configuration" else None
            )
            if sections is None:
                mine = name in _OURS and key == "corrections"
                told = _corrections(value) if mine else value
                print(f"  {common.printable(key)}: {common.printable(told)}")
                continue
            print(f"  {key}:")
            for section, fields in sections:
                print(
                    common.printable(
                        f"    [{section}] "
                        + ", ".join(f"{k}={field}" for k, field in sorted(fields.items()))
                    )
                )


def _corrections(text: str) -> str:
    """What the corrections come to; the text itself where another program wrote it."""
    from recorders.corrections import parse_corrections
    from recorders.errors import SourceError

    try:
        return parse_corrections(text, "").summary()
    except SourceError:
        return text


def _sections(text: str) -> list[tuple[str, dict[str, Any]]] | None:
    """A recorded configuration's sections; None where another program wrote something else under
    that name.
    """
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(found, dict) or not all(
        isinstance(fields, dict) for fields in found.values()
    ):
        return None
    return sorted(found.items())
