"""What is asked alone is answered as if all tables were filled, and damage is told all the same."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from reasoning.questions import TABLES, Case
from reasoning.questions.literals import moment
from reasoning.questions.name_checks import check_words
from reasoning.questions.needed import (
    DIGEST,
    EVERYTHING,
    tables_asked,
    tables_of,
    tables_ready,
)
from reasoning.questions.patterns import SHIPPED, plan
from reasoning.questions.ready_questions import QUESTIONS, Options, question
from recorders import channels
from recorders.errors import RecordingError, SceneTraceError
from recorders.log import LogWriter
from recorders.messages import Tracks

GOLDEN = Path(__file__).parents[2] / "golden" / "three_way_group-events.mcap"
WORDS: Mapping[str, str] = {"A": "1", "B": "2", "ZONE": "bench", "LINE": "", "ZONE|LINE": "bench", "LABEL": "1",
                            "EVENT": "1", "T1": "1", "T2": "6"}  # fmt: skip
NO_LINES = ("crossed",)


@pytest.fixture(scope="module", params=["a story", "a golden log"])
def log(request: pytest.FixtureRequest, meeting_log: Path) -> Path:
    return meeting_log if request.param == "a story" else GOLDEN


@pytest.fixture(scope="module")
def whole(log: Path) -> Iterator[Case]:
    with Case([log]) as case:
        yield case


def told(case: Case, sql: str) -> tuple[list[str], list[str], list[tuple[Any, ...]]]:
    answer = case.sql(sql)
    return answer.columns, answer.types, list(answer.rows)


@pytest.mark.parametrize("table", TABLES)
def test_a_table_alone(log: Path, whole: Case, table: str) -> None:
    for sql in (f"SELECT * FROM sure_{table}", f"FROM {table.upper()}"):
        with Case([log], tables=tables_asked(sql)) as case:
            assert told(case, sql) == told(whole, sql)


@pytest.mark.parametrize("name", [name for name in QUESTIONS if name not in NO_LINES])
def test_a_ready_question_alone(log: Path, whole: Case, name: str) -> None:
    asked = question(name)
    words = [
        WORDS[w.strip("[]")] for w in asked.arguments.split() if w.strip("[]") in WORDS
    ]
    options = Options(at=moment("2") if "at" in asked.takes else None, certainty=0.0)
    sql = asked.sql(words, options)
    with Case([log], tables=tables_ready(sql, asked.kinds())) as case:
        assert told(case, sql) == told(whole, sql)


@pytest.mark.parametrize("name", SHIPPED)
def test_a_pattern_alone(log: Path, whole: Case, name: str) -> None:
    sql = plan(name, None)
    with Case([log], tables=tables_of(sql)) as case:
        assert told(case, sql) == told(whole, sql)


def test_what_was_not_said_before_is_filled_when_it_is_asked(
    log: Path, whole: Case
) -> None:
    with Case([log], tables=frozenset({"frames"})) as case:
        for table in (*TABLES, "metres", "frames"):
            sql = f"SELECT * FROM {table}"
            assert told(case, sql) == told(whole, sql)


def test_a_name_that_is_put_together_is_found(log: Path, whole: Case) -> None:
    for sql in (
        "SELECT * FROM query_table('enc' || 'ounters')",
        "SELECT * FROM query('SELECT * FROM ' || 'tra' || 'cks')",
        'SELECT "Tracks".* FROM main."TRACKS" WHERE track = 1',
    ):
        with Case([log], tables=tables_asked(sql)) as case:
            assert told(case, sql) == told(whole, sql)


def test_no_table_is_filled_that_a_question_does_not_name() -> None:
    met = question("met").sql(["3"], Options())
    assert tables_of(met) == {"relations"}
    assert "encounters" not in tables_asked("SELECT count(*) FROM tracks")
    assert tables_of("SELECT start_ns FROM recordings") == {"recordings"}
    assert DIGEST in tables_asked("SELECT r FROM recordings r")
    assert tables_of("SELECT * FROM duckdb_tables()") == EVERYTHING


def test_words_are_looked_for_in_what_is_filled(log: Path) -> None:
    asked = question("met")
    sql = asked.sql(["99"], Options())
    with (
        Case([log], tables=tables_of(sql)) as case,
        pytest.raises(SceneTraceError, match="target '99': there is none"),
    ):
        check_words(case, asked, ["99"], Options())


@pytest.mark.parametrize("name", ["relations", "groups", "events"])
def test_damage_where_nobody_asks_is_told(tmp_path: Path, name: str) -> None:
    path = tmp_path / "damaged.mcap"
    with LogWriter(path) as out:
        for kind, data in (("tracks", channels.encode("tracks", Tracks(0))), (name, b"{")):
            channel = out.channel(
                channels.topic("camera", kind), channels.schema(kind), channels.message_encoding(kind)
            )  # fmt: skip
            out.write(channel, data, 1_000)
    with pytest.raises(RecordingError, match=name):
        Case([path], tables=frozenset({"frames"}))


@pytest.mark.parametrize("where", ["tracks", "relations", "groups", "events"])
def test_an_id_that_fits_no_table_is_told(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any], where: str
) -> None:
    large, still = 2**40, (0, 4, (1.0, 1.0, 5.0, 9.0), (0.0, 0.0))
    story = story_type(
        5,
        {large if where == "tracks" else 1: still},
        relations=[(1, large, "JOINT", 0, 4)] if where == "relations" else (),
        groups=[(large, [1], 0, 4, [])] if where == "groups" else (),
        events=[("entered", [large], 0, [], {})] if where == "events" else (),
    )
    path = write_story(story, tmp_path / "big.mcap")
    for tables in (EVERYTHING, frozenset({"frames"})):
        with pytest.raises(SceneTraceError, match=f"a row of {where} does not fit"):
            Case([path], tables=tables)
