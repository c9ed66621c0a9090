"""The rows that drawn zones and lines make, from where the tables say that everybody stood."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import duckdb
import numpy as np

from reasoning.questions.drawn import Drawn
from reasoning.questions.duckdb_tables import insert
from reasoning.questions.runs import JOINS
from reasoning.questions.schema import DRAWN, SURE, TABLES
from reasoning.questions.standing import Steps
from recorders.errors import UsageError

SCHEMA = "drawn"
_TABLES = {"zones": TABLES["zones"], **DRAWN}
_COLUMNS = "track, frame, t, x, y, w, h, seen, confidence, identity"
Insert = Callable[[str, Sequence[tuple[Any, ...]]], None]


def make_tables(con: duckdb.DuckDBPyConnection) -> dict[str, str]:
    """Make the empty tables; answers with a SELECT of each by name."""
    con.execute(f"CREATE SCHEMA {SCHEMA}")
    for name, columns in _TABLES.items():
        con.execute(
            f"CREATE TABLE {SCHEMA}.{name} ({', '.join(f'{c} {t}' for c, t in columns)})"
        )
    return {name: f"SELECT * FROM {SCHEMA}.{name}" for name in _TABLES}


def draw(con: duckdb.DuckDBPyConnection, drawn: Drawn) -> None:
    """Fill the tables, a recording at a time.

    Raises:
        UsageError: a zone or line lies beyond a picture, or is called as a recorded zone is.
    """
    if not drawn:
        return
    for line in drawn.lines:
        for way in line.directions:
            ends = (*line.start, *line.end)
            con.execute(
                f"INSERT INTO {SCHEMA}.lines VALUES (?, ?, ?, ?, ?, ?)",
                [line.name, way, *ends],
            )
    for name in drawn.names:
        taken = con.execute(
            "SELECT recording FROM zones WHERE zone = ? LIMIT 1", [name]
        ).fetchone()
        if taken is not None:
            raise UsageError(
                f"{name!r}: {taken[0]!r} has a recorded zone of that name; give what is drawn"
                " another"
            )
    recordings = con.execute(
        "SELECT recording, width, height FROM recordings ORDER BY recording"
    ).fetchall()
    for recording, width, height in recordings:
        drawn.check_size(recording, (width, height))
        zones: list[tuple[Any, ...]] = []
        crossings: list[tuple[Any, ...]] = []
        for track, steps in _steps(con, recording):
            zones += [(recording, *row) for row in drawn.zone_rows(track, steps)]
            crossings += [(recording, *row) for row in drawn.crossing_rows(track, steps)]
        insert(con, "zones", zones, _TABLES["zones"], SCHEMA)
        insert(con, "crossings", crossings, _TABLES["crossings"], SCHEMA)


def _steps(con: duckdb.DuckDBPyConnection, recording: str) -> Iterator[tuple[int, Steps]]:
    """Each target's steps, by its id."""
    frames = con.execute(
        "SELECT frame FROM frames WHERE recording = ? ORDER BY frame", [recording]
    ).fetchnumpy()["frame"]
    joins: dict[int, list[tuple[int, int]]] = {}
    kinds = ", ".join(f"'{kind}'" for kind in JOINS)
    for track, frame, event in con.execute(
        f"SELECT unnest(subjects), frame, event FROM {SURE}events WHERE recording = ?"
        f" AND kind IN ({kinds}) ORDER BY event",
        [recording],
    ).fetchall():
        joins.setdefault(track, []).append((frame, event))
    rows = con.execute(
        f"SELECT {_COLUMNS} FROM {SURE}tracks WHERE recording = ? AND present"
        " ORDER BY track, frame",
        [recording],
    ).fetchnumpy()
    found = {name: np.asarray(values) for name, values in rows.items()}
    tracks = found["track"]
    starts: list[int] = np.flatnonzero(np.diff(tracks, prepend=-1)).tolist()
    for first, end in zip(starts, [*starts[1:], len(tracks)], strict=True):
        cut = {name: values[first:end] for name, values in found.items()}
        number = cut["frame"].astype(np.int64)
        track = int(tracks[first])
        yield (
            track,
            Steps(
                frames=number,
                ranks=np.searchsorted(frames, number).astype(np.int64),
                t=cut["t"].astype(np.float64),
                boxes=np.stack([cut[c].astype(np.float64) for c in "xywh"], axis=1),
                seen=cut["seen"].astype(np.bool_),
                existence=cut["confidence"].astype(np.float64),
                identity=cut["identity"].astype(np.float64),
                joins=joins.get(track, ()),
            ),
        )
