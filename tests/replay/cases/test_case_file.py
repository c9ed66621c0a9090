"""A case: what it names is found, asked, sealed; what is wrong in it is told in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from recorders.errors import SourceError, UsageError
from replay.cases import Note, add_note, read_case, read_notes
from replay.cases.case_file import chosen
from replay.cli import main

CASE = """
title = "The hall"
reference = "2026/7"
examiner = "Jo Doe"
date = 2026-03-02
note = "who met whom"
notes = "notes.jsonl"
[[recordings]]
log = "a.mcap"
scene = "scene.mcap"
corrections = "c.jsonl"
start = 2026-03-01T12:00:00+01:00
[zones]
lawn = [[1, 1], [40, 1], [40, 40]]
[lines]
door = [[1, 1], [40, 1]]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene, its replay, and the case of them."""
    folder = tmp_path_factory.mktemp("case")
    made = generate("three_way_group", seed=1, size=(160, 120), frames=40)
    write_scene_log(made, folder / "scene.mcap", style="merged")
    assert main(["replay", str(folder / "scene.mcap"), "-o", str(folder / "a.mcap")]) == 0
    (folder / "case.toml").write_text(CASE)
    return folder


def test_a_case_is_asked_as_its_logs(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["SELECT count(*) AS n FROM frames", "--json"]
    assert main(["query", str(folder / "case.toml"), *words]) == 0
    assert json.loads(capsys.readouterr().out) == [{"n": 40}]


def test_a_case_is_sealed_with_all_that_it_names(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = str(folder / "a.mcap")
    who = ["--by", "Jo", "--why", "seen"]
    correct = ["correct", log, "-o", str(folder / "c.jsonl"), "label", "1", "red", *who]
    assert main(correct) == 0
    add_note(folder / "notes.jsonl", Note("a", 3, 0.3, "here", "Jo"))
    capsys.readouterr()
    out = folder / "manifest.json"
    assert main(["seal", str(folder / "case.toml"), "-o", str(out)]) == 0
    said = capsys.readouterr()
    assert "a.mcap was not made with c.jsonl as it is now: replay it with" in said.err
    manifest = json.loads(out.read_text())
    assert [entry["name"] for entry in manifest["files"]] == [
        "a.mcap", "c.jsonl", "case.toml", "notes.jsonl", "scene.mcap",
    ]  # fmt: skip
    assert (manifest["examiner"], manifest["date"]) == ("Jo Doe", "2026-03-02")
    assert manifest["note"] == "The hall: who met whom"
    assert manifest["tool"].startswith("scenetrace ")
    assert main(["verify", "--manifest", str(out)]) == 0
    assert "sealed: Jo Doe, 2026-03-02, scenetrace" in capsys.readouterr().out
    add_note(folder / "notes.jsonl", Note("a", 4, 0.4, "there", "Jo"))
    assert main(["verify", "--manifest", str(out)]) == 4
    assert "altered: notes.jsonl" in capsys.readouterr().out
    assert [note.frame for note in read_notes(folder / "notes.jsonl")] == [3, 4]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "missing required field `recordings`"),
        ("recordings = []", "`array` of length >= 1"),
        (CASE.replace("a.mcap", "b.mcap"), "names b.mcap, which is not there"),
        (CASE + "[[recordings]]\nlog='x/a.mcap'\n", "two recordings are called 'a'"),
        (CASE.replace("[40, 40]", "[40]"), "zones"),
        (CASE.replace("title", "titel"), "unknown field `titel`"),
        ("title = ", "not a case"),
    ],
)
def test_what_is_wrong_in_a_case_is_told(folder: Path, text: str, said: str) -> None:
    path = folder / "wrong.toml"
    path.write_text(text)
    with pytest.raises(SourceError) as error:
        read_case(path)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_the_recording_that_is_meant(folder: Path) -> None:
    case = read_case(folder / "case.toml")
    assert chosen("case.toml", case, None).name == "a"
    with pytest.raises(UsageError, match=r"--recording b: case\.toml has a"):
        chosen("case.toml", case, "b")


def test_a_line_that_is_no_note_is_named(tmp_path: Path) -> None:
    path = tmp_path / "notes.jsonl"
    path.write_text('{"recording":"a","frame":1,"t":0.1}\nx\n')
    with pytest.raises(SourceError, match=r"notes.jsonl:2: no note"):
        read_notes(path)
