"""Corrections of every kind on PETS from its detections: which answers they change."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from recorders.annotated.reader import AnnotatedLog
from replay.cli import main
from replay.correcting import Book

WHO = ["--by", "Jo", "--why", "looked at the pictures"]


@pytest.fixture(scope="module")
def folder(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pets")
    det = real_data / "pets09-s2l1" / "det.txt"
    scene = ["--fps", "7", "--size", "768x576", "-o", str(folder / "scene.mcap")]
    assert main(["record", str(det), *scene]) in (0, 3)
    assert main(["replay", str(folder / "scene.mcap"), "-o", str(folder / "a.mcap")]) == 0
    return folder


@pytest.fixture(scope="module")
def book(folder: Path) -> Book:
    with AnnotatedLog(folder / "a.mcap") as log:
        return Book.of(log)


def asked(log: Path, query: str, capsys: pytest.CaptureFixture[str]) -> list[Any]:
    capsys.readouterr()
    assert main(["query", str(log), query, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def corrected(folder: Path, name: str, *words: str) -> Path:
    file, out = folder / f"{name}.jsonl", folder / f"{name}.mcap"
    log = str(folder / "a.mcap")
    assert main(["correct", log, "-o", str(file), *words, *WHO]) == 0
    scene = str(folder / "scene.mcap")
    assert main(["replay", scene, "-o", str(out), "--corrections", str(file)]) == 0
    return out


LIVES = "SELECT track, label, first_t, last_t FROM targets ORDER BY track"


def test_a_join_of_hindsight_is_undone(
    folder: Path, book: Book, capsys: pytest.CaptureFixture[str]
) -> None:
    """`not-same` of a track and a part of it: two lives, with nothing drawn between them."""
    track, parts = next((t, p) for t, p in sorted(book.joined.items()) if p)
    out = corrected(folder, "apart", "not-same", str(track), str(parts[-1]))
    before = {row["track"] for row in asked(folder / "a.mcap", LIVES, capsys)}
    after = {row["track"] for row in asked(out, LIVES, capsys)}
    assert parts[-1] not in before
    # He is told under his own number, or held back as too short to be believed.
    with AnnotatedLog(out) as log:
        told = Book.of(log)
    assert parts[-1] not in told.joined.get(track, [])
    assert track in after
    assert main(["verify", str(out)]) == 0
    # Who goes on as whom is known after a replay: until then nothing more is said of either.
    file = str(folder / "apart.jsonl")
    words = ["split", str(track), "--at", "1", *WHO]
    capsys.readouterr()
    assert main(["correct", str(folder / "a.mcap"), "-o", file, *words]) == 2
    assert "undoes a join" in capsys.readouterr().err
    # What was said of both together has to be taken back before.
    label, apart = (["label", str(track), "x"], ["not-same", str(track), str(parts[-1])])
    file = str(folder / "late.jsonl")
    assert main(["correct", str(folder / "a.mcap"), "-o", file, *label, *WHO]) == 0
    assert main(["correct", str(folder / "a.mcap"), "-o", file, *apart, *WHO]) == 2
    assert "undo 1 first" in capsys.readouterr().err


def test_every_other_kind(
    folder: Path, book: Book, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {row["track"]: row for row in asked(folder / "a.mcap", LIVES, capsys)}
    spans = {t: (p.frames[0], p.frames[-1]) for t, p in book.tracks.items()}
    first, second = next(
        (a, b) for a in spans for b in spans if spans[a][1] < spans[b][0]
    )  # one after the other
    long = max(spans, key=lambda t: spans[t][1] - spans[t][0])
    middle = sum(spans[long]) // 2
    merged = asked(
        corrected(folder, "merge", "merge", str(first), str(second)), LIVES, capsys
    )
    assert {row["track"] for row in merged} == set(before) - {second}
    (one,) = (row for row in merged if row["track"] == first)
    assert (one["first_t"], one["last_t"]) == (
        before[first]["first_t"],
        before[second]["last_t"],
    )
    out = corrected(folder, "split", "split", str(long), "--at", f"frame:{middle}")
    rows = {row["track"]: row for row in asked(out, LIVES, capsys)}
    (new,) = set(rows) - set(before)
    assert rows[long]["last_t"] < rows[new]["first_t"]
    assert rows[new]["last_t"] == before[long]["last_t"]
    out = corrected(folder, "delete", "delete", str(long))
    assert long not in {row["track"] for row in asked(out, LIVES, capsys)}
    for table in ("relations", "encounters"):
        query = f"SELECT count(*) AS n FROM {table} WHERE a = {long} OR b = {long}"
        assert (
            asked(folder / "a.mcap", query, capsys) != [{"n": 0}] or table == "encounters"
        )
        assert asked(out, query, capsys) == [{"n": 0}]
    out = corrected(folder, "label", "label", str(long), "red coat")
    labels = {r["track"]: r["label"] for r in asked(out, LIVES, capsys)}
    assert labels[long] == "red coat"
    out = corrected(folder, "same", "same", str(long), "monday:4")
    query = "SELECT kind, tracks, other FROM corrections"
    assert asked(out, query, capsys) == [
        {"kind": "same", "tracks": [long], "other": "monday:4"}
    ]
