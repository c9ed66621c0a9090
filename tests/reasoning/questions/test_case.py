"""The tables of a case, what goes wrong with inputs, and that a query can do nothing but read."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import duckdb
import pytest

from reasoning.questions import CONTRACT, TABLES, Case, QueryError, QueryLimits
from reasoning.questions.index import build_index
from recorders.errors import RecordingError, UsageError


@pytest.fixture(scope="module")
def case(meeting_log: Path) -> Iterator[Case]:
    with Case([meeting_log]) as c:
        yield c


def test_columns_are_the_contract(case: Case) -> None:
    wanted = {
        "frames": "recording frame t",
        "tracks": (
            "recording frame t track x y w h vx vy mode confidence grouping grouped"
            " splitting group_id scene label present"
        ),
        "relations": "recording a b state start_frame end_frame start_t end_t",
        "groups": (
            "recording group_id members start_frame end_frame start_t end_t formed_from"
            " ended_by"
        ),
        "encounters": (
            "recording a b kind start_frame end_frame start_t end_t confidence seen_share"
            " identity"
        ),
        "events": "recording event kind frame t subjects rule evidence text",
        "targets": (
            "recording track label first_t last_t seen_share identity upper_colour"
            " lower_colour height"
        ),
        "held_back": "recording t x y w h reason",
        "quality": "recording name value verdict",
    }
    assert tuple(wanted) == CONTRACT
    for table, columns in wanted.items():
        assert case.sql(f"SELECT * FROM {table}").columns == columns.split(), table


def test_rows_are_what_the_log_says(case: Case, meeting_story: Any) -> None:
    assert case.rows("SELECT count(*), min(t), max(t) FROM frames") == [(300, 0.0, 11.96)]
    lives = sum(e - s + 1 for s, e, *_ in meeting_story.tracks.values())
    assert case.rows("SELECT count(*) FROM tracks") == [(lives,)]
    assert case.rows(
        "SELECT x, vx, mode, scene, group_id FROM tracks WHERE track = 1 AND frame = 120"
    ) == [(160.0, 12.5, "motion", "inside", 1)]
    assert case.rows(
        "SELECT a, b, state, start_frame, end_frame FROM relations ORDER BY start_frame, a"
    ) == sorted(meeting_story.relations, key=lambda r: (r[3], r[0]))
    assert case.rows("SELECT group_id, members, formed_from, ended_by FROM groups ORDER BY group_id") == [
        (1, [1, 2], [], "group_ended"), (2, [3, 4], [], "group_changed"), (3, [2, 3, 4], [2], "group_ended"),
    ]  # fmt: skip
    assert case.rows(
        "SELECT evidence->>'overlap', subjects FROM events WHERE event = 3"
    ) == [("0.2", [1, 2])]
    assert case.rows(
        "SELECT track, zone, start_frame, end_frame FROM zones ORDER BY 1, 2, 3"
    ) == sorted(meeting_story.zones)
    assert case.rows(
        "SELECT track, part, start_frame, end_frame FROM hidden ORDER BY 1, 2, 3"
    ) == sorted(meeting_story.hidden)
    assert case.rows("SELECT bit, partners, start_frame, end_frame FROM bits ORDER BY start_frame, bit") == [
        ("grouping", [1], 40, 99), ("grouped", [1], 100, 149), ("splitting", [1], 150, 179),
        ("grouping", [3], 170, 200),
    ]  # fmt: skip


def test_a_group_that_lives_to_the_end_was_ended_by_nothing(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any]
) -> None:
    story = story_type(20, {1: (0, 19, (9.0, 9.0, 5.0, 9.0), (0.0, 0.0)), 2: (0, 19, (9.0, 9.0, 5.0, 9.0), (0.0, 0.0))},
                       groups=[(7, [1, 2], 5, 19, [])])  # fmt: skip
    with Case([write_story(story, tmp_path / "a.mcap")]) as c:
        assert c.rows("SELECT group_id, end_frame, ended_by FROM groups") == [(7, 19, None)]


def test_a_cut_out_span_keeps_the_recordings_time(
    tmp_path: Path, meeting_story: Any, write_story: Callable[..., Any]
) -> None:
    with Case([write_story(meeting_story, tmp_path / "cut.mcap", first=100)]) as c:
        assert c.rows("SELECT min(frame), min(t) FROM frames") == [(100, 4.0)]


def test_two_intervals_of_one_state_stay_two(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any]
) -> None:
    box = (9.0, 9.0, 5.0, 9.0)
    story = story_type(
        30,
        {1: (0, 29, box, (0.0, 0.0)), 2: (0, 29, box, (0.0, 0.0))},
        relations=[(1, 2, "INTERACTION", 3, 9), (1, 2, "INTERACTION", 12, 20)],
    )
    with Case([write_story(story, tmp_path / "two.mcap")]) as c:
        assert c.rows("SELECT start_frame, end_frame FROM relations ORDER BY 1") == [
            (3, 9),
            (12, 20),
        ]


def test_several_logs_and_cameras(
    tmp_path: Path, meeting_story: Any, write_story: Callable[..., Any], meeting_log: Path
) -> None:
    (tmp_path / "b").mkdir()
    other = write_story(
        dataclasses.replace(meeting_story, frames=50, camera="door"),
        tmp_path / "b" / "meeting.mcap",
    )
    with Case([meeting_log, other, meeting_log]) as c:
        assert c.rows("SELECT recording, camera, frames FROM recordings ORDER BY 1") == [
            ("meeting", "camera", 300), ("meeting~2", "door", 50),
        ]  # fmt: skip
        assert c.rows("SELECT count(*) FROM frames") == [(350,)]


def test_wall_time_in_a_zone(case: Case) -> None:
    (row,) = case.rows(
        "SELECT wall_time(recording, 2.5), wall_time(recording, 2.5, zone := 'Asia/Tokyo'),"
        " epoch(wall_instant(recording, 0.0)) FROM recordings"
    )
    assert [str(v) for v in row[:2]] == [
        "2023-11-14 22:13:22.500000",
        "2023-11-15 07:13:22.500000",
    ]
    assert row[2] == 1_700_000_000
    with pytest.raises(QueryError, match="as text"):
        case.rows("SELECT wall_instant(recording, 0.0) FROM recordings")


def test_exactly_one_of_allens_thirteen_holds(case: Case) -> None:
    from reasoning.questions.macros import ALLEN

    ends = "SELECT s, e FROM range(5) a(s), range(5) b(e) WHERE s <= e"
    held = " + ".join(f"allen_{name}(x.s, x.e, y.s, y.e)::INTEGER" for name in ALLEN)
    rows = case.rows(f"SELECT {held} AS n, allen(x.s, x.e, y.s, y.e) AS name, allen(y.s, y.e, x.s, x.e) AS back "
                     f"FROM ({ends}) x, ({ends}) y")  # fmt: skip
    assert {r[0] for r in rows} == {1}
    assert {r[1] for r in rows} == set(ALLEN)
    inverse = dict(zip(ALLEN, reversed(ALLEN), strict=True))
    assert all(inverse[name] == back for _, name, back in rows)
    assert case.rows(
        "SELECT overlap_s(0.0, 2.0, 1.5, 4.0), gap_s(0.0, 2.0, 1.5, 4.0), gap_s(5.0, 6.0,"
        " 1.0, 2.0)"
    ) == [(0.5, 0.0, 3.0)]


REFUSED = {
    "read a file": "SELECT * FROM read_csv('/etc/passwd')",
    "read text": "SELECT * FROM read_text('/etc/passwd')",
    "read by name": "SELECT * FROM '/etc/passwd'",
    "read a blob": "SELECT * FROM read_blob('{meeting}')",
    "list files": "SELECT * FROM glob('/etc/*')",
    "sniff a file": "SELECT * FROM sniff_csv('/etc/passwd')",
    "read parquet": "SELECT * FROM parquet_scan('/etc/passwd')",
    "read json": "SELECT * FROM read_json('/etc/passwd')",
    "hide it": "SELECT * FROM query('SELECT * FROM read_csv(''/etc/passwd'')')",
    "reach the net": "SELECT * FROM read_csv('http://127.0.0.1/x.csv')",
    "attach": "ATTACH '{folder}/other.duckdb' AS other",
    "attach memory": "ATTACH ':memory:' AS other",
    "detach": "DETACH memory",
    "install": "INSTALL httpfs",
    "load": "LOAD httpfs",
    "copy out": "COPY (SELECT 1) TO '{folder}/out.csv'",
    "copy in": "COPY tracks FROM '/etc/passwd'",
    "export": "EXPORT DATABASE '{folder}/out'",
    "import": "IMPORT DATABASE '{folder}/out'",
    "pragma": "PRAGMA database_list",
    "call": "CALL pragma_database_size()",
    "set": "SET enable_external_access = true",
    "reset": "RESET lock_configuration",
    "create": "CREATE TABLE mine AS SELECT 1",
    "create temp": "CREATE TEMP TABLE mine AS SELECT 1",
    "macro": "CREATE MACRO wall_time(a, b) AS 1",
    "insert": "INSERT INTO logs.tracks SELECT * FROM logs.tracks",
    "update": "UPDATE logs.relations SET state = 'JOINT'",
    "delete": "DELETE FROM logs.events",
    "drop": "DROP VIEW events",
    "alter": "ALTER TABLE logs.events RENAME TO gone",
    "truncate": "TRUNCATE logs.events",
    "prepare": "PREPARE p AS SELECT 1",
    "begin": "BEGIN TRANSACTION",
    "vacuum": "VACUUM",
    "checkpoint": "CHECKPOINT",
    "use": "USE logs",
    "analyze": "EXPLAIN ANALYZE SELECT 1",
    "analyze hidden": "EXPLAIN (ANALYZE, FORMAT json) SELECT 1",
    "two": "SELECT 1; DROP VIEW events",
    "none": "-- nothing",
    "secrets": "CREATE SECRET s (TYPE s3)",
    "python": "SELECT * FROM os",
    "python scan": "SELECT * FROM arrow_scan(1, 2, 3)",
    "environment": "SELECT getenv('HOME')",
    "which secret": "SELECT * FROM which_secret('s3://x', 's3')",
    "update extensions": "UPDATE EXTENSIONS",
    "force install": "FORCE INSTALL httpfs FROM 'http://127.0.0.1'",
    "load a library": "LOAD '/tmp/x.duckdb_extension'",
    "https": "SELECT * FROM read_parquet('https://127.0.0.1/x.parquet')",
    "s3": "SELECT * FROM read_csv('s3://bucket/x.csv')",
    "csv lines": "SELECT * FROM read_csv_auto('/dev/stdin')",
    "json lines": "SELECT * FROM read_ndjson_objects('/etc/passwd')",
    "metadata": "SELECT * FROM parquet_metadata('{meeting}')",
    "a database file": "SELECT * FROM read_duckdb('{folder}/other.duckdb')",
    "serialized": (
        "FROM json_execute_serialized_sql(json_serialize_sql('SELECT * FROM"
        " read_text(''/etc/passwd'')'))"
    ),
    "two in a query": "SELECT * FROM query('SELECT 1; DROP VIEW events')",
    "a table by name": "SELECT * FROM query_table('/etc/passwd')",
    "log to a file": (
        "CALL enable_logging('QueryLog', storage = 'file', storage_path = '{folder}/log')"
    ),
    "variable": "SET VARIABLE x = 1",
    "more memory": "SET memory_limit = '100GB'",
    "unlock": "SET lock_configuration = false",
    "directories": "SET allowed_directories = ['/']",
    "execute": "EXECUTE p",
    "deallocate": "DEALLOCATE p",
    "write in a query": (
        "WITH gone AS (DELETE FROM logs.events RETURNING *) SELECT * FROM gone"
    ),
    "insert in a query": (
        "WITH new AS (INSERT INTO logs.events SELECT * FROM logs.events RETURNING *)"
        " FROM new"
    ),
    "merge": (
        "MERGE INTO logs.events e USING logs.events f ON e.event = f.event WHEN MATCHED"
        " THEN DELETE"
    ),
    "replace a table": "CREATE OR REPLACE VIEW events AS SELECT 1",
    "replace a macro": "CREATE OR REPLACE MACRO overlap_s(a, b, c, d) AS 1",
    "table macro": "CREATE MACRO events() AS TABLE SELECT 1",
    "type": "CREATE TYPE mine AS ENUM ('a')",
    "sequence": "CREATE SEQUENCE mine",
    "index": "CREATE INDEX mine ON logs.events (event)",
    "comment": "COMMENT ON VIEW events IS 'mine'",
    "copy in an explanation": "EXPLAIN ANALYZE COPY events TO '{folder}/e.csv'",
    "copy to the terminal": "COPY (SELECT 1) TO '/dev/stdout'",
    "copy databases": "COPY FROM DATABASE memory TO other",
    "describe a file": "DESCRIBE '/etc/passwd'",
    "summarize a file": "SUMMARIZE '/etc/passwd'",
    "pragma function": "PRAGMA enable_profiling",
    "call checkpoint": "CALL force_checkpoint()",
    "after a comment": "/* SELECT */ DROP VIEW events",
    "three": "SELECT 1; SELECT 2; DETACH memory",
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_query_only_reads(
    case: Case, name: str, tmp_path: Path, meeting_log: Path
) -> None:
    query = REFUSED[name].format(folder=tmp_path, meeting=meeting_log)
    before = case.rows("SELECT count(*) FROM events")
    with pytest.raises(QueryError):
        case.rows(query)
    assert list(tmp_path.iterdir()) == []
    assert case.rows("SELECT count(*) FROM events") == before


def test_an_index_is_not_written_by_a_query(meeting_log: Path, tmp_path: Path) -> None:
    out = tmp_path / "case.duckdb"
    build_index([meeting_log], out)
    before = out.read_bytes()
    with Case([out]) as c:
        for query in (
            "DELETE FROM source_0.events",
            "CREATE TABLE source_0.mine (a INTEGER)",
            "ATTACH 'x' AS y",
        ):
            with pytest.raises(QueryError):
                c.rows(query)
        assert c.rows("SELECT count(*) FROM events") == [(13,)]
    assert out.read_bytes() == before


def test_a_folder_of_parquet_shows_its_tables_and_nothing_else(
    meeting_log: Path, tmp_path: Path
) -> None:
    out = tmp_path / "case"
    build_index([meeting_log], out)
    (out / "part-000000" / "diary.parquet").write_bytes(
        (out / "part-000000" / "events.parquet").read_bytes()
    )
    (tmp_path / "secret.txt").write_text("secret")
    with Case([out]) as c:
        assert c.rows("SELECT count(*) FROM events") == [(13,)]
        for query in (
            f"SELECT * FROM glob('{out}/**')",
            f"SELECT * FROM glob('{out}/../*')",
            f"SELECT * FROM read_text('{out}/part-000000/../../secret.txt')",
            f"SELECT * FROM read_parquet('{out}/part-000000/*.parquet')",
            f"SELECT * FROM read_parquet('{out}/part-000000/diary.parquet')",
            f"COPY events TO '{out}/part-000000/events.parquet'",
        ):
            with pytest.raises(QueryError):
                c.rows(query)


COMMAND = "import sys; from replay.cli import main; sys.exit(main(sys.argv[1:]))"
GREEDY = {
    "a long text": "SELECT repeat('x', 1000000000000)",
    "a long padding": "SELECT length(lpad('x', 2000000000, 'y'))",
    "a long number": "SELECT printf('%1000000000d', 1)",
    "a long list": "SELECT list_resize([1], 2000000000)",
    "many texts": "SELECT string_agg(repeat('x', 10000000)) FROM range(10000)",
    "a text that doubles": (
        "WITH RECURSIVE r AS (SELECT 'xxxx' i UNION ALL SELECT i || i FROM r) FROM r"
    ),
    "a product": "SELECT sum(x * y) FROM range(10000000) a(x), range(10000000) b(y)",
    "one long call": "SELECT levenshtein(repeat('a', 200000), repeat('b', 200000))",
    "many matches": "SELECT len(regexp_extract_all(repeat('ab', 100000000), '(a|b)'))",
}


@pytest.mark.parametrize("name", GREEDY)
def test_a_greedy_query_ends_in_time_and_memory(name: str, meeting_log: Path) -> None:
    """As the command runs it, in a process of its own: an error, soon, and never much memory."""
    import resource

    from reasoning.questions.guard import GRACE_S

    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    arguments = [
        "query",
        str(meeting_log),
        GREEDY[name],
        "--time-limit",
        "1",
        "--memory",
        "256",
    ]
    start = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1, done.stdout[:200]
    assert done.stderr.startswith("scenetrace: error: SQL: ")
    assert len(done.stderr) < 400
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before < 4 * (
        1 + GRACE_S
    )
    assert time.monotonic() - start < 120


def test_a_runaway_query_is_stopped(meeting_log: Path) -> None:
    with Case([meeting_log], QueryLimits(seconds=0.4)) as c:
        for query in (
            (
                "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT"
                " max(i) FROM n"
            ),
            "SELECT count(*) FROM range(1000000000000) WHERE range % 7 = 99",
            "SELECT * FROM range(1000000000000)",
        ):
            start = time.monotonic()
            with pytest.raises(QueryError, match=r"stopped after 0\.4 s \(--time-limit\)"):
                for _ in c.sql(query).rows:
                    pass
            assert time.monotonic() - start < 5
        assert c.rows("SELECT 1") == [(1,)]


def test_a_greedy_query_is_stopped(meeting_log: Path) -> None:
    with Case([meeting_log], QueryLimits(memory_mib=128)) as c:
        with pytest.raises(QueryError, match=r"128 MiB of memory \(--memory\)"):
            c.rows("SELECT list_sort(list(hash(range))) FROM range(100000000)")
        assert c.rows("SELECT 1") == [(1,)]


def test_errors_name_the_place(case: Case) -> None:
    with pytest.raises(QueryError, match=r'column "frme".*"frame".*line 1, column 8'):
        case.rows("SELECT frme FROM tracks")
    with pytest.raises(QueryError, match="line 2, column 6"):
        case.rows("SELECT *\nFROM nowhere")


def test_bad_inputs(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no recordings"):
        Case([])
    for name, content, said in (
        ("empty.mcap", b"", "an empty file"),
        ("text.mcap", b"hello there", "neither an MCAP log"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(RecordingError, match=said):
            Case([tmp_path / name])
    with pytest.raises(RecordingError, match="No such file"):
        Case([tmp_path / "absent.mcap"])
    (tmp_path / "folder").mkdir()
    with pytest.raises(RecordingError, match="a folder without parts"):
        Case([tmp_path / "folder"])
    stranger = tmp_path / "stranger.duckdb"
    with duckdb.connect(str(stranger)) as con:
        con.execute("CREATE TABLE t (a INTEGER)")
    with pytest.raises(RecordingError, match="no index of scenetrace"):
        Case([stranger])


def test_ids_that_do_not_fit_are_an_error(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any]
) -> None:
    story = story_type(5, {2**40: (0, 4, (1.0, 1.0, 5.0, 9.0), (0.0, 0.0))})
    with pytest.raises(Exception, match="does not fit"):
        Case([write_story(story, tmp_path / "big.mcap")])


def test_the_same_recording_twice_is_said(tmp_path: Path, meeting_log: Path) -> None:
    build_index([meeting_log], tmp_path / "a.duckdb")
    build_index([meeting_log], tmp_path / "b")
    with pytest.raises(UsageError, match="in another input already"):
        Case([tmp_path / "a.duckdb", tmp_path / "b"])
    with Case([meeting_log, tmp_path / "a.duckdb"]) as c:
        assert c.rows("SELECT count(*) FROM recordings") == [(1,)]


def test_every_table_has_a_recording_column() -> None:
    assert all(columns[0] == ("recording", "VARCHAR") for columns in TABLES.values())
    assert os.sep not in "".join(TABLES)
