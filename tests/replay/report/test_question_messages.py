"""What query, explain, evidence, report and index say to words that are off, and that they never
answer beside them.
"""

from __future__ import annotations

import csv
import io
import json
import shutil
from pathlib import Path

import pytest

from reasoning.questions import Answer
from reasoning.questions.unsure import Unsure
from replay.cli import main

FOLDER = "FOLDER"


def said(words: list[str], code: int, capsys: pytest.CaptureFixture[str]) -> str:
    assert main(words) == code, words
    return capsys.readouterr().err


def test_a_pattern_error_points_at_the_character(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    err = said(["query", str(log), "--pattern", "entered(a) ;     joind(a,b)"], 2, capsys)
    assert err.splitlines() == [
        (
            "scenetrace: error: pattern, character 18: no relation, state or event is"
            " called 'joind'; did you mean 'joined'?"
        ),
        "  entered(a) ;     joind(a,b)",
        "                   ^",
    ]
    err = said(
        ["query", str(log), "--pattern", "joint(a,b)\x1b[31m\n & joind(a,b)"], 2, capsys
    )
    assert "\x1b" not in err
    assert len(err.splitlines()) == 3
    assert err.splitlines()[2].index("^") == 2 + len("joint(a,b)")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        # What a pattern names must be there, as for --ask.
        (["--pattern", "interaction(a,77)"], "character 15: target '77': there is none; there are 1, 2"),
        (["--pattern", "present(a) & in(a,nowhere)"], "character 19: zone 'nowhere': there is none"),
        (["--pattern", "present(a)", "--recording", "elsewhere"], "--recording elsewhere: there is none"),
        # An option that a question does not take.
        (["--ask", "met", "1", "--min", "3s"], "--ask met takes no --min; it takes: --recording"),
        (["--ask", "timeline", "1", "--within", "3s"], "--ask timeline takes no --within"),
        (["--ask", "loitered", "scene", "--depth", "3"], "takes no --depth; it takes: --min, --gap, --recording"),
        (["--pattern", "present(a)", "--at", "1"], "--pattern takes no --at; it takes: --show-sql, --recording"),
        (["SELECT 1", "--show-sql"], "SQL takes no --show-sql"),
        (["SELECT 1", "--recording", "yard"], "SQL takes no --recording"),
        # A moment outside of the recording.
        (["--ask", "who-was-in", "scene", "--at", "frame:9999"], "yard has frames 0 to 49"),
        (["--ask", "who-was-in", "scene", "--at", "500"], "--at 500: outside of the recording; yard goes from 0"),
        (["--ask", "contacts", "1", "--at", "2031-01-01T00:00:00Z"], "outside of the recording"),
        # Words that are off.
        (["--ask", "met", "1", "1"], "two different targets"),
        (["--ask", "left-with", "1", "--within", "-1s"], "duration '-1s': must be a number, not negative"),
        (["SELECT 1", "--ask", "met", "1"], "--ask and SQL ('SELECT 1'): give one of them"),
        (["SELECT 1", "--pattern", "present(a)"], "--pattern and SQL"),
    ],
)  # fmt: skip
def test_wrong_words_are_said(
    log: Path, words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told in said(["query", str(log), *words], 2, capsys)


def test_sql_longer_than_a_name_can_be(capsys: pytest.CaptureFixture[str]) -> None:
    assert "no annotated log given" in said(
        ["query", "SELECT " + "1, " * 2000 + "1"], 2, capsys
    )


def test_sql_of_a_pattern_needs_no_log(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["query", "--pattern", "interaction(a,b)", "--show-sql"]) == 0
    sql = capsys.readouterr().out
    assert main(["query", str(log), sql, "--json"]) == 0
    assert [r["explain"] for r in json.loads(capsys.readouterr().out)] == [
        "relation:1-2@15"
    ]


def test_a_target_as_the_column_explain_writes_it(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["query", str(log), "--ask", "met", "track:1", "--json"]) == 0
    assert [r["other"] for r in json.loads(capsys.readouterr().out)] == [2]
    assert main(["query", str(log), "--ask", "left-with", "track:1"]) == 0
    assert "nobody left with target 1" in capsys.readouterr().err


def test_the_last_moment_as_it_is_shown_is_in_the_recording(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["query", str(log), "--ask", "who-was-in", "scene", "--at", "4.9", "--json"])
        == 0
    )
    assert [r["track"] for r in json.loads(capsys.readouterr().out)] == [1, 2]


def test_lists_and_bytes_in_csv_are_json(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    query = (
        "SELECT ['a, b', NULL] AS l, {'x': [true], 'y': 'z'} AS s, 'ab'::BLOB AS b, [['q']]"
        " AS deep, MAP {'k': 1} AS m"
    )
    assert main(["query", str(log), query, "--format", "csv"]) == 0
    (row,) = csv.DictReader(io.StringIO(capsys.readouterr().out))
    assert json.loads(row["l"]) == ["a, b", None]
    assert json.loads(row["s"]) == {"x": [True], "y": "z"}
    assert json.loads(row["deep"]) == [["q"]]
    assert json.loads(row["m"]) == {"k": 1}
    assert row["b"] == "6162"
    assert main(["query", str(log), "SELECT 'ab'::BLOB AS b", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == [{"b": "6162"}]


def test_an_index_has_no_pictures_and_says_whose_it_is(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    index = tmp_path / "case.duckdb"
    assert main(["index", str(log), "-o", str(index)]) == 0
    capsys.readouterr()
    for words in (
        ["explain", str(index), "1", "-o", str(tmp_path / "why")],
        ["evidence", str(index), "--events", "1", "-o", str(tmp_path / "why")],
        ["report", str(index), "-o", str(tmp_path / "r.html")],
    ):
        assert f"an index has no pictures; give the annotated log itself: {log}" in said(
            words, 2, capsys
        )
    assert main(["explain", str(index), "1"]) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["case.duckdb"]


def test_explain_of_what_is_not_there(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "--camera gate: there is none of that name; there are: camera" in said(
        ["explain", str(log), "1", "--camera", "gate"], 2, capsys
    )
    assert "--recording gate: there is none of that name; there are: yard" in said(
        ["explain", str(log), "1", "--recording", "gate"], 2, capsys
    )


def test_what_an_index_leaves_out_is_named_once(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(b"")
    assert (
        main(
            ["index", str(bad), str(log), "-o", str(tmp_path / "i.duckdb"), "--keep-going"]
        )
        == 3
    )
    assert capsys.readouterr().err.count(str(bad)) == 1


def test_a_manifests_folder_is_told_what_to_give(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert str(tmp_path / "manifest.json") in said(
        ["verify", "--manifest", str(tmp_path)], 1, capsys
    )


def test_thresholds_are_those_that_the_index_was_made_with(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    index = tmp_path / "case.duckdb"
    own = ["--set", "encounters.near_sizes=3", "--set", "encounters.least_s=0.5"]
    own += [
        "--set",
        "encounters.pace_sizes_per_s=5",
        "--set",
        "encounters.drift_sizes_per_s=5",
    ]
    assert main(["index", str(log), "-o", str(index), *own]) == 0
    assert (
        main(["query", str(index), "SELECT a, b, start_frame FROM encounters", "--json"])
        == 0
    )
    (row,) = json.loads(capsys.readouterr().out)
    reference = f"encounter:{row['a']}-{row['b']}@{row['start_frame']}"
    assert main(["explain", str(index), reference]) == 0
    told = capsys.readouterr().out
    assert "wanted <= 3: met by" in told
    assert "missed" not in told, "a row that is there was found with its own thresholds"
    assert main(["explain", str(log), reference, *own]) == 0
    assert capsys.readouterr().out == told

    # Another threshold than the index's own cannot be had from it, and is not passed over.
    for command in (
        ["query", str(index), "FROM encounters"],
        ["explain", str(index), reference],
    ):
        assert "the encounters of 'yard' in the index were found with 3" in said(
            [*command, "--set", "encounters.near_sizes=1"], 2, capsys
        )
        assert main([*command, "--set", "encounters.near_sizes=3"]) == 0
    assert "were found with 3" in said(
        ["index", str(log), "-o", str(index), "--set", "encounters.near_sizes=1"], 3, capsys
    )
    config = tmp_path / "s.toml"
    config.write_text("[encounters]\nnear_sizes = 1.0\n")
    assert "were found with 3" in said(
        ["query", str(index), "FROM events", "--config", str(config)], 2, capsys
    )


def test_evidence_with_its_own_thresholds(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = [
        "--set",
        "encounters.pace_sizes_per_s=5",
        "--set",
        "encounters.drift_sizes_per_s=5",
    ]
    own += ["--set", "encounters.least_s=0.5", "--set", "encounters.near_sizes=3"]
    words = [
        "evidence",
        str(log),
        "--events",
        "encounter:1-2@29",
        "-o",
        str(tmp_path / "e"),
    ]
    assert "there is none" in said(words, 2, capsys)
    assert main([*words, *own]) == 0
    facts = json.loads((tmp_path / "e" / "facts.json").read_text())
    assert {m["threshold"] for m in facts["explanations"][0]["measures"]} >= {3.0, 5.0}


def test_two_frames_of_one_interval_are_one_piece_of_evidence(
    log: Path, tmp_path: Path
) -> None:
    out = tmp_path / "e"
    assert (
        main(
            [
                "evidence",
                str(log),
                "--events",
                "relation:1-2@20",
                "relation:2-1@30",
                "-o",
                str(out),
            ]
        )
        == 0
    )
    assert [p.name for p in sorted(out.iterdir()) if p.is_dir()] == ["relation_1-2_at_15"]
    assert (out / "index.html").read_text().count("<h2>relation:1-2@15") == 1


@pytest.mark.parametrize("command", ["evidence", "explain"])
def test_strangers_files_are_never_touched(
    command: str, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"

    def words(*references: str) -> list[str]:
        given = ["--events", *references] if command == "evidence" else list(references)
        return [command, str(log), *given, "-o", str(out), "--force"]

    out.mkdir()
    (out / "diary.txt").write_text("mine")
    assert "holds 'diary.txt' and no" in said(words("1"), 2, capsys)
    assert [p.name for p in out.iterdir()] == ["diary.txt"]
    shutil.rmtree(out)

    assert main(words("1", "relation:1-2@20")) == 0
    (out / "diary.txt").write_text("mine")
    assert main(words("relation:1-2@20")) == 0
    assert (out / "diary.txt").read_text() == "mine"
    assert list(tmp_path.glob("*.part")) == []
    capsys.readouterr()
    if (
        command == "evidence"
    ):  # what the older manifest listed has gone, and the stranger is named
        assert not (out / "event_1").exists()
        assert main(["verify", "--manifest", str(out / "manifest.json")]) == 4
        assert "added: diary.txt" in capsys.readouterr().out
        (out / "diary.txt").unlink()
        assert main(["verify", "--manifest", str(out / "manifest.json")]) == 0


def test_a_file_added_to_sealed_evidence_is_named(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "e"
    assert main(["evidence", str(log), "--events", "1", "-o", str(out)]) == 0
    moved = out.rename(tmp_path / "elsewhere")
    assert main(["verify", "--manifest", str(moved / "manifest.json")]) == 0
    (moved / "event_1" / "frame.png").write_bytes(b"another picture")
    capsys.readouterr()
    assert main(["verify", "--manifest", str(moved / "manifest.json")]) == 4
    assert "added: event_1/frame.png" in capsys.readouterr().out


def test_a_manifest_removes_nothing_outside_of_its_folder(
    log: Path, tmp_path: Path
) -> None:
    out, precious = tmp_path / "e", tmp_path / "precious.txt"
    assert main(["evidence", str(log), "--events", "1", "-o", str(out)]) == 0
    precious.write_text("mine")
    manifest = json.loads((out / "manifest.json").read_text())
    manifest["files"][0]["name"] = "../precious.txt"
    (out / "manifest.json").write_text(json.dumps(manifest))
    assert main(["evidence", str(log), "--events", "1", "-o", str(out), "--force"]) == 0
    assert precious.read_text() == "mine"


@pytest.mark.parametrize(
    "table", ["events", "tracks", "recordings", "encounter_parameters"]
)
@pytest.mark.parametrize("damage", ["cut", "nonsense", "gone"])
def test_a_damaged_part_of_parquet_is_one_line(
    table: str, damage: str, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "case"
    assert main(["index", str(log), "-o", str(folder)]) == 0
    file = folder / "part-000000" / f"{table}.parquet"
    data = file.read_bytes()
    if damage == "gone" and table != "recordings":
        file.unlink()
    else:
        file.write_bytes(
            data[: len(data) // 2] if damage == "cut" else b"PAR1 nothing of the sort PAR1"
        )
    capsys.readouterr()
    err = said(["query", str(folder), "SELECT count(*) FROM events"], 1, capsys)
    assert len(err.splitlines()) == 1
    assert str(folder) in err


def test_rows_that_are_not_sure_are_left_out_and_counted() -> None:
    rows = [(1, 0.9), (2, 0.49), (3, None), (4, 0.5), (5, 0.0)]
    unsure = Unsure(0.5)
    answer = Answer(["track", "certainty"], ["INTEGER", "DOUBLE"], iter(rows))
    assert [t for t, _ in unsure.left_out_of(answer).rows] == [1, 3, 4]
    assert unsure.count == 2
    assert unsure.told().startswith("2 rows are less sure than 0.5 and left out")
    other = Answer(["track"], ["INTEGER"], iter([(1,)]))
    assert list(Unsure(0.5).left_out_of(other).rows) == [(1,)]


def test_every_row_says_how_sure_it_is(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["query", str(log), "--ask", "met", "1", "--json"]
    assert main([*asked, "--certainty", "0"]) == 0
    every = json.loads(capsys.readouterr().out)
    assert every
    for row in every:
        parts = [row["seen_share"], row["existence"], row["identity"]]
        assert row["certainty"] == min(parts)
    assert "must be 0 to 1" in said([*asked, "--certainty", "2"], 2, capsys)
    assert "takes no --certainty" in said(
        ["query", str(log), "SELECT 1", "--certainty", "0.5"], 2, capsys
    )
