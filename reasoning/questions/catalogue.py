"""The catalogue of a case: Parquet tables where they lie, one small file per recording or one
larger file per camera and day.

``tables/<table>/camera=<name>/date=<day>/<file>.parquet``. A recording's file has the name of its
digest; a compacted one begins with ``whole-``. The file of the table ``recordings`` is put there
last, so a recording belongs to the catalogue from then on, whole. ``snapshots/<number>.json`` says
which recordings a compacted file stands for; what it replaced stays until the next compaction, so
that a query that runs beside it keeps its files.
"""

from __future__ import annotations

import hashlib
import re
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import duckdb
import msgspec
from msgspec import Struct

from reasoning.encounters import EncounterParameters
from reasoning.questions.duckdb_tables import insert, reason
from reasoning.questions.ingest import read_recordings
from reasoning.questions.literals import literal
from reasoning.questions.recording_facts import RecordingFacts
from reasoning.questions.schema import TABLES, create_statements
from recorders.errors import RecordingError, SceneTraceError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.stores import FolderStore, Store

TABLES_FOLDER = "tables"
SNAPSHOTS_FOLDER = "snapshots"
SCHEMA_FILE = "tables/schema.json"
NO_DATE = "unknown"
"""The day of a recording whose times are not wall times."""
WHOLE = "whole-"
_FETCHERS = 8
_SHOWN = 10
"""So many cameras are named to who asks for one that is not there."""
_LAST = "recordings"
_PLACE = re.compile(
    r"tables/(?P<table>\w+)/camera=(?P<camera>[^/]*)/date=(?P<date>[^/]*)/(?P<file>[^/]+)\.parquet"
)
_DAY = re.compile(r"\d{4}-\d\d-\d\d")
_FIRST_WALL_NS = 365 * 86_400 * 1_000_000_000
"""Log times of before 1971 count from 0, not from 1970."""


class Snapshot(Struct, frozen=True):
    """What a compaction left.

    Attributes:
        number: counts compactions, from 1.
        whole: a compacted file's place (camera and date, file name) to the digests in it.
        replaced: keys of the files that it stands for; the next compaction removes them.
    """

    number: int = 0
    whole: dict[str, list[str]] = {}
    replaced: list[str] = []

    def inside(self) -> set[str]:
        """The places of the recordings' own files that compacted ones stand for."""
        return {
            f"{place.rpartition('/')[0]}/{digest}"
            for place, digests in self.whole.items()
            for digest in digests
        }


@dataclass(frozen=True, order=True)
class Piece:
    """One file of each table: a recording's, or a compacted one.

    Attributes:
        camera: the camera's name.
        date: its day, ``YYYY-MM-DD`` in UTC, or `NO_DATE`.
        file: the file's name without suffix.
    """

    camera: str
    date: str
    file: str

    def key(self, table: str) -> str:
        """Where its rows of a table are."""
        return f"{TABLES_FOLDER}/{table}/{self.place}.parquet"

    @property
    def place(self) -> str:
        """Its place in the folder of each table."""
        return f"camera={quote(self.camera, safe='')}/date={self.date}/{self.file}"


@dataclass(frozen=True)
class Choice:
    """Which part of a catalogue a question is asked of.

    Attributes:
        camera: only this camera's recordings.
        dates: first and last day, both ``YYYY-MM-DD``.
    """

    camera: str | None = None
    dates: tuple[str, str] | None = None

    def holds(self, piece: Piece) -> bool:
        """Whether the file can have rows that were asked for."""
        if self.camera is not None and piece.camera != self.camera:
            return False
        if self.dates is None:
            return True
        return self.dates[0] <= piece.date <= self.dates[1] and piece.date != NO_DATE


def choose_dates(word: str) -> tuple[str, str]:
    """First and last day of ``2026-01-31`` or ``2026-01-01..2026-01-31``.

    Raises:
        UsageError: it is neither.
    """
    first, _, last = word.partition("..")
    days = (first, last or first)
    try:
        for day in days:
            if not _DAY.fullmatch(day):
                raise ValueError(day)
            datetime.fromisoformat(day)
    except ValueError:
        raise UsageError(
            f"--date {word}: must be a day as 2026-01-31, or two as 2026-01-01..2026-01-31"
        ) from None
    if days[1] < days[0]:
        raise UsageError(f"--date {word}: ends before it begins")
    return days


def is_catalogue(folder: Path) -> bool:
    """Whether a folder is a case that `scenetrace batch` made."""
    return (folder / TABLES_FOLDER / _LAST).is_dir()


def date_of(start_ns: int) -> str:
    """The day (UTC) of a log time in ns, `NO_DATE` where it is no wall time."""
    if start_ns < _FIRST_WALL_NS:
        return NO_DATE
    return datetime.fromtimestamp(start_ns // 10**9, UTC).strftime("%Y-%m-%d")


def schema_version() -> str:
    """Names the tables' columns and types: another version cannot be asked together with it."""
    text = msgspec.json.encode(
        [(table, list(columns)) for table, columns in TABLES.items()]
    )
    return hashlib.sha256(text).hexdigest()[:16]


def write_tables(
    log: Path,
    folder: Path,
    *,
    name: str,
    digest: str,
    shown_path: str,
    limits: Limits = DEFAULT_LIMITS,
    encounters: EncounterParameters | None = None,
) -> list[tuple[Piece, RecordingFacts]]:
    """The tables of an annotated log as Parquet below a folder, as they lie in a catalogue.

    Args:
        log: the annotated log.
        folder: gets ``tables/...``; the same log gives the same bytes.
        name: the recording's name.
        digest: of source and configuration: the files' name.
        shown_path: where the log will be, for the table ``recordings``.
        limits: bounds on what the log may make us allocate.
        encounters: thresholds for the encounters.

    Raises:
        RecordingError: no annotated log, or a damaged one.
        SceneTraceError: the tables cannot be written.
    """
    con = duckdb.connect(":memory:", config={"threads": "1"})
    try:
        for statement in create_statements():
            con.execute(statement)
        path_column = [column for column, _ in TABLES[_LAST]].index("path")

        def take(table: str, rows: Sequence[tuple[Any, ...]]) -> None:
            if table == _LAST:
                rows = [
                    (*row[:path_column], shown_path, *row[path_column + 1 :])
                    for row in rows
                ]
            insert(con, table, rows)

        found = read_recordings(
            log,
            take,
            name=name,
            digest=digest,
            limits=limits,
            encounters=encounters,
            looks=True,
        )
        pieces = []
        for facts in found:
            piece = Piece(facts.camera, date_of(facts.start_ns), digest)
            for table in TABLES:
                out = folder / piece.key(table)
                out.parent.mkdir(parents=True, exist_ok=True)
                con.execute(
                    f"COPY (SELECT * FROM {table} WHERE recording = $name)"
                    f" TO {literal(str(out))} (FORMAT parquet, COMPRESSION zstd)",
                    {"name": facts.recording},
                )
            pieces.append((piece, facts))
    except duckdb.Error as error:
        raise SceneTraceError(f"{folder}: cannot be written: {reason(error)}") from error
    finally:
        con.close()
    return pieces


def tables_in_order() -> list[str]:
    """The order in which a recording's files are put into a catalogue: ``recordings`` last."""
    return [table for table in TABLES if table != _LAST] + [_LAST]


def check_schema(store: Store, *, write: bool = False) -> None:
    """That a catalogue's tables are those of this version.

    Args:
        store: the case.
        write: say so in a case that is new.

    Raises:
        RecordingError: they are of another version.
    """
    now = schema_version()
    if not store.exists(SCHEMA_FILE):
        if write:
            store.write(SCHEMA_FILE, msgspec.json.encode({"version": now}))
        return
    try:
        there = msgspec.json.decode(store.read(SCHEMA_FILE), type=dict[str, str])["version"]
    except (msgspec.MsgspecError, KeyError) as error:
        raise RecordingError(f"{SCHEMA_FILE} is damaged: {error}", store.uri) from error
    if there != now:
        raise RecordingError(
            "its tables are of another version of scenetrace; make them anew from the logs"
            " that it keeps: scenetrace batch CASE/annotated -o NEW --keep tables, or ask"
            " with the version that made them",
            store.uri,
        )


def snapshot(store: Store) -> Snapshot:
    """The newest compaction's, an empty one where there was none.

    Raises:
        RecordingError: it is damaged.
    """
    keys = store.keys(SNAPSHOTS_FOLDER)
    if not keys:
        return Snapshot()
    try:
        return msgspec.json.decode(store.read(keys[-1]), type=Snapshot)
    except msgspec.MsgspecError as error:
        raise RecordingError(f"{keys[-1]} is damaged: {error}", store.uri) from error


def pieces(
    store: Store, choice: Choice | None = None, held: Snapshot | None = None
) -> list[Piece]:
    """What belongs to the catalogue now, each recording once, by camera, day and name.

    Args:
        store: the case.
        choice: the part of it that is asked for.
        held: the newest snapshot, where it is known already.

    Raises:
        RecordingError: a snapshot is damaged.
    """
    chosen = choice or Choice()
    held = held or snapshot(store)
    inside = held.inside()
    found = []
    for key in store.keys(_prefix(chosen)):
        piece = piece_of(key)
        if piece is None or not chosen.holds(piece) or piece.place in inside:
            continue
        if piece.file.startswith(WHOLE) and piece.place not in held.whole:
            continue  # of a compaction that did not end, or of one before the last
        found.append(piece)
    return sorted(found)


def none_chosen(store: Store, choice: Choice) -> str:
    """Why nothing was chosen: what there is instead."""
    there = pieces(store)
    if not there:
        return "no recording yet"
    cameras = sorted({piece.camera for piece in there})
    if choice.camera is not None and choice.camera not in cameras:
        more = " ..." if len(cameras) > _SHOWN else ""
        return (
            f"no recording of that camera; there are: {', '.join(cameras[:_SHOWN])}{more}"
        )
    days = sorted(
        {p.date for p in there if choice.camera is None or p.camera == choice.camera}
    )
    if days == [NO_DATE]:
        return "no recording of that day: none tells its day (record --start)"
    days = [day for day in days if day != NO_DATE]
    return f"no recording of that day; there are {days[0]} to {days[-1]}"


def _prefix(chosen: Choice) -> str:
    """The narrowest folder that holds what was chosen."""
    folder = f"{TABLES_FOLDER}/{_LAST}"
    if chosen.camera is None:
        return folder
    folder += f"/camera={quote(chosen.camera, safe='')}"
    if chosen.dates is not None and chosen.dates[0] == chosen.dates[1]:
        folder += f"/date={chosen.dates[0]}"
    return folder


def piece_of(key: str) -> Piece | None:
    """The piece that a key is a file of, None where it is of none."""
    match = _PLACE.fullmatch(key)
    if match is None:
        return None
    return Piece(unquote(match["camera"]), match["date"], match["file"])


def local_tables(store: Store, chosen: Sequence[Piece], cache: Path) -> Path:
    """The folder below which the files of all tables lie: the case itself, or copies of a remote
    one.

    A file never changes under its name, so one that was copied before is not copied again.
    """
    if isinstance(store, FolderStore):
        return store.folder
    root = cache / hashlib.sha256(store.uri.encode()).hexdigest()[:16]
    wanted = [piece.key(table) for piece in chosen for table in TABLES]
    # brings logging with it, and most questions are asked of no catalogue
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(_FETCHERS) as pool:
        for _ in pool.map(partial(_fetch, store, root), wanted):
            pass
    return root


def _fetch(store: Store, root: Path, key: str) -> None:
    out = root / key
    if out.is_file():
        return
    out.parent.mkdir(parents=True, exist_ok=True)
    part = out.with_name(f".{out.name}.{secrets.token_hex(4)}.part")
    try:
        store.fetch(key, part)
        part.replace(out)
    finally:
        part.unlink(missing_ok=True)
