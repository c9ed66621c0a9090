"""query, index, explain and evidence as a person types them."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import duckdb
import pytest

from reasoning.questions import asking as asking_module
from replay.cli import main


def test_formats(log: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    query = "SELECT event, kind, t, subjects, evidence, text, NULL AS nothing FROM events"
    assert main(["query", str(log), query]) == 0
    table = capsys.readouterr().out.splitlines()
    assert table[0].split() == [
        "event",
        "kind",
        "t",
        "subjects",
        "evidence",
        "text",
        "nothing",
    ]
    assert "\x1b" not in table[2]
    assert main(["query", str(log), query, "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["subjects"], row["evidence"]["shell_gap_px"], row["nothing"]) == (
        [1, 2],
        -1.5,
        None,
    )
    assert main(["query", str(log), "--format", "csv", query]) == 0
    (row,) = csv.DictReader(io.StringIO(capsys.readouterr().out))
    assert (row["kind"], row["subjects"]) == ("interaction_started", "[1, 2]")
    out = tmp_path / "answer.parquet"
    assert main(["query", str(log), query, "--format", "parquet", "-o", str(out)]) == 0
    assert duckdb.sql(f"SELECT kind, subjects FROM read_parquet('{out}')").fetchall() == [
        ("interaction_started", [1, 2])
    ]
    assert main(["query", str(log), query, "--format", "csv", "-o", str(out)]) == 1
    assert "not overwriting" in capsys.readouterr().err
    assert (
        main(["query", str(log), query, "--format", "csv", "-o", str(out), "--force"]) == 0
    )
    assert out.read_text().startswith("event,kind,")


def test_no_rows(log: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    query = "SELECT event FROM events WHERE event > 99"
    assert main(["query", str(log), query, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == []
    assert main(["query", str(log), query]) == 0
    assert capsys.readouterr().out == "event\n-----\n"
    assert (
        main(
            [
                "query",
                str(log),
                query,
                "--format",
                "parquet",
                "-o",
                str(tmp_path / "e.parquet"),
            ]
        )
        == 0
    )
    assert duckdb.sql(
        f"SELECT count(*) FROM read_parquet('{tmp_path / 'e.parquet'}')"
    ).fetchall() == [(0,)]


def test_asking(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["query", "--ask", "list"]) == 0
    assert "grouping-and-splitting" in capsys.readouterr().out
    assert main(["query", "--pattern", "list"]) == 0
    assert "leaving_object" in capsys.readouterr().out
    assert main(["query", str(log), "--ask", "met", "1", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["explain"] == "relation:1-2@15"
    assert main(["query", str(log), "--ask", "met", "1", "--show-sql"]) == 0
    sql = capsys.readouterr().out
    assert main(["query", str(log), sql, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == [row]
    assert (
        main(
            [
                "query",
                str(log),
                "--ask",
                "who-was-in",
                "scene",
                "--at",
                "frame:3",
                "--format",
                "csv",
            ]
        )
        == 0
    )
    assert len(capsys.readouterr().out.splitlines()) == 3
    assert (
        main(["query", str(log), "--pattern", "interaction(a,b)[>1s]", "--format", "csv"])
        == 0
    )
    assert "relation:1-2@15" in capsys.readouterr().out


@pytest.mark.parametrize(
    "question",
    [
        ["--ask", "timeline", "1"],
        ["--pattern", "interaction(a,b)"],
        ["--ask", "met", "1", "2"],
    ],
)
def test_one_recording_alone_is_asked_also_where_many_are_asked_by_and_by(
    log: Path,
    other_log: Path,
    question: list[str],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(asking_module, "_FIRST_ROWS", 1)
    assert main(["query", str(log), str(other_log), "--json", *question]) == 0
    assert {row["recording"] for row in json.loads(capsys.readouterr().out)} == {
        "yard",
        "garden",
    }
    assert (
        main(
            ["query", str(log), str(other_log), "--json", "--recording", "yard", *question]
        )
        == 0
    )
    assert {row["recording"] for row in json.loads(capsys.readouterr().out)} == {"yard"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["query"], "give annotated logs"),
        (["query", "LOG"], "what is the question"),
        (["query", "--ask", "met", "1"], "no annotated log given"),
        (["query", "LOG", "--ask", "nobody"], "no ready question"),
        (
            ["query", "LOG", "--ask", "met", "1", "--pattern", "joint(a,b)"],
            "give one of them",
        ),
        (["query", "LOG", "--pattern", "joint(a,b"], "character 10"),
        (["query", "LOG", "SELECT 1", "--time-limit", "0"], "--time-limit"),
        (["query", "LOG", "SELECT 1", "--json", "--format", "csv"], "--json"),
        (["explain", "LOG", "99"], "there is none"),
        (["explain", "LOG", "why"], "give an event's number"),
    ],
)
def test_wrong_words(
    log: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(log) if w == "LOG" else w for w in words]) == 2
    assert said in capsys.readouterr().err


def test_refused(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["query", str(log), "COPY events TO 'x.csv'"]) == 1
    err = capsys.readouterr().err
    assert "COPY is refused" in err
    assert not Path("x.csv").exists()
    assert (
        main(
            ["query", str(log), "SELECT length(repeat('x', 4000000000))", "--memory", "256"]
        )
        == 1
    )
    assert "256 MiB" in capsys.readouterr().err


@pytest.mark.skipif(
    sys.platform != "linux", reason="bounds on a process are tested on Linux"
)
def test_a_query_that_cannot_be_interrupted_ends_the_process(log: Path) -> None:
    query = "SELECT levenshtein(repeat('ab', 200000), repeat('ba', 200000))"
    code = ("import reasoning.questions.guard as g; g.GRACE_S = 0.3; import sys; from replay.cli import main; "
            "sys.exit(main(sys.argv[1:]))")  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", code, "query", str(log), query, "--time-limit", "0.5"],
        capture_output=True, text=True, timeout=60, check=False, env={**os.environ},
    )  # fmt: skip
    assert done.returncode == 1
    assert "stopped after 0.5 s (--time-limit)" in done.stderr


def test_index_command(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "case.duckdb"
    assert main(["index", str(log.parent), "-o", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "added": ["yard"],
        "known": [],
        "left_out": [],
    }
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(b"")
    assert main(["index", str(bad), str(log), "-o", str(out), "--keep-going"]) == 3
    assert "left out" in capsys.readouterr().err
    assert main(["query", str(out), "--ask", "contacts", "1", "--format", "csv"]) == 0
    assert "relation:1-2@15" in capsys.readouterr().out
    assert main(["index", str(tmp_path / "nothing-here.mcap"), "-o", str(out)]) == 1
    (tmp_path / "empty").mkdir()
    assert main(["index", str(tmp_path / "empty"), "-o", str(out)]) == 2


def test_explain_command(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["explain", str(log), "1", "relation:1-2@20", "-o", str(tmp_path / "why")])
        == 0
    )
    told = capsys.readouterr().out
    assert "\x1b" not in told  # what a log says must not steer the terminal
    assert "rule:  SHELLS 2.3 case II" in told
    assert "shell_gap_px = -1.5, wanted <= 0: met by 1.5" in told
    assert "safety_distance = 1.25, wanted <= 1: missed by 0.25" in told
    pictures = sorted(p.name for p in (tmp_path / "why").glob("*.png"))
    assert "event_1_frame_000005.png" in pictures
    assert "event_1_frame_000015.png" in pictures
    assert "event_1_frame_000025.png" in pictures
    assert (
        (tmp_path / "why" / "event_1_frame_000015.png").read_bytes().startswith(b"\x89PNG")
    )
    assert main(["explain", str(log), "1", "-o", str(tmp_path / "why")]) == 1
    assert main(["explain", str(log), "event:1", "--json"]) == 0
    (facts,) = json.loads(capsys.readouterr().out[len("") :])
    assert facts["evidence"]["case"] == "II"


def test_evidence_command(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "evidence"
    assert (
        main(["evidence", str(log), "--events", "1,relation:1-2@20", "-o", str(out)]) == 0
    )
    assert main(["evidence", str(log), "--events", "1", "-o", str(out)]) == 1
    sums = (line.split("  ") for line in (out / "SHA256SUMS").read_text().splitlines())
    listed = {name: digest for digest, name in sums}
    files = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file()} - {
        "SHA256SUMS",
        "manifest.json",
    }
    assert set(listed) == files
    assert all(
        hashlib.sha256((out / name).read_bytes()).hexdigest() == digest
        for name, digest in listed.items()
    )
    facts = json.loads((out / "facts.json").read_text())
    assert facts["log_sha256"] == hashlib.sha256(log.read_bytes()).hexdigest()
    assert facts["configuration"] == {"a": {"b": 1}}
    page = (out / "index.html").read_text()
    assert "They meet" in page
    assert "<script" not in page
    assert "loading=lazy" not in page, "a page is printed with all of its pictures"
    assert (
        page.index("SHA-256 of the log")
        < page.index("<h2>event:1")
        < page.index("how it was made")
    )
    assert page.count("<img") == len(
        [f for f in files if f.endswith((".png", ".jpg")) and "_recorded" not in f]
    )
    assert (out / "evidence.pdf").read_bytes().startswith(b"%PDF")
    assert all((out / name).is_file() for name in re.findall(r'src="([^"]+)"', page))
    assert "1970-" not in page, "a recording without a clock has no wall time"
    again = tmp_path / "again"
    assert (
        main(
            [
                "evidence",
                str(log),
                "--events",
                "1",
                "--events",
                "relation:1-2@20",
                "-o",
                str(again),
            ]
        )
        == 0
    )
    assert {p.name for p in again.iterdir() if p.is_dir()} == {
        p.name for p in out.iterdir() if p.is_dir()
    }
    assert main(["verify", "--manifest", str(out / "manifest.json")]) == 0
    (out / "facts.json").write_text("{}")
    assert main(["verify", "--manifest", str(out / "manifest.json")]) == 4
    for name in ("clip.mp4", "plain.mp4"):
        assert b"ftyp" in (out / "event_1" / name).read_bytes()[:16]
    assert len(list((out / "event_1").glob("*_recorded.*"))) == 3
    assert main(["evidence", str(log), "--events", "77", "-o", str(tmp_path / "none")]) == 2
    assert not (tmp_path / "none").exists()
    assert list(tmp_path.glob("*.part")) == []
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["met", "77"], "target '77': there is none; there are 1, 2"),
        (["together", "1", "9"], "target '9': there is none"),
        (["group-history", "44"], "group '44': there is none; no group was formed"),
        (["before", "99"], "event '99': there is none; there are"),
        (["who-was-in", "nowhere", "--at", "1"], "zone 'nowhere': there is none"),
        (
            ["met", "1", "--recording", "elsewhere"],
            "--recording elsewhere: there is none of that name; there are: ",
        ),
    ],
)
def test_what_is_not_there_is_an_error_that_says_what_is(
    log: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["query", str(log), "--ask", *words]) == 2
    assert said in capsys.readouterr().err


def test_an_empty_answer_says_what_it_means(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["query", str(log), "--pattern", "joint(1,2)"]) == 0
    told = capsys.readouterr()
    assert "nothing in these recordings fits the pattern" in told.err
    assert len(told.out.splitlines()) == 2
    assert main(["query", str(log), "--ask", "left-with", "1", "--json"]) == 0
    told = capsys.readouterr()
    assert "see `timeline 1`" in told.err
    assert json.loads(told.out) == []
