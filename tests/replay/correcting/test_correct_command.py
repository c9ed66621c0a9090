"""Corrections from the command line to the answers: replayed, verified, compared, explained."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from fixtures.logs import write_scene_log
from fixtures.planted_differences import copy_log
from fixtures.scenes import generate
from recorders.annotated.provenance import provenance_of, with_fact_digests
from recorders.log import LogReader
from replay.cli import main
from replay.trackers.catalogue import TRACKERS
from replay.verification import verify, verify_chain

WHO = ["--by", "Jo Doe", "--why", "the same coat", "--date", "2026-01-31"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene of three people and its replay by each tracker."""
    folder = tmp_path_factory.mktemp("correct")
    made = generate("three_way_group", seed=1, size=(160, 120), frames=60)
    write_scene_log(made, folder / "scene.mcap", style="merged")
    for tracker in TRACKERS:
        out = folder / f"{tracker}.mcap"
        assert main(["replay", str(folder / "scene.mcap"), "-o", str(out), "--tracker", tracker]) == 0  # fmt: skip
    return folder


def correct(log: Path, file: Path, *words: str) -> int:
    return main(["correct", str(log), "-o", str(file), *words, *WHO])


def replayed(folder: Path, tracker: str, file: Path, out: Path, *more: str) -> Path:
    words = ["replay", str(folder / "scene.mcap"), "-o", str(out), "--tracker", tracker]
    assert main([*words, "--corrections", str(file), *more]) == 0
    return out


def tracks(log: Path, capsys: pytest.CaptureFixture[str]) -> dict[int, int]:
    capsys.readouterr()
    query = "SELECT track, count(*) AS n FROM tracks WHERE present GROUP BY track"
    assert main(["query", str(log), query, "--json"]) == 0
    return {row["track"]: row["n"] for row in json.loads(capsys.readouterr().out)}


@pytest.mark.parametrize("tracker", TRACKERS)
def test_corrected_replays_verify_and_go_on_from_anywhere(
    folder: Path, tmp_path: Path, tracker: str, capsys: pytest.CaptureFixture[str]
) -> None:
    log, file = folder / f"{tracker}.mcap", tmp_path / "c.jsonl"
    ids = sorted(tracks(log, capsys))
    a, b = ids[0], ids[1]
    assert correct(log, file, "swap", str(a), str(b), "--at", "1.0") == 0
    assert correct(log, file, "split", str(a), "--at", "1.5") == 0
    assert correct(log, file, "label", str(b), "the red one") == 0
    whole = replayed(folder, tracker, file, tmp_path / "whole.mcap", "--checkpoint", "1")
    assert set(tracks(whole, capsys)) == {*ids, max(ids) + 1}
    assert verify_chain(whole).identical
    found = verify(whole)
    assert found.identical, found
    with LogReader(whole) as opened:
        facts = provenance_of(opened)
    assert facts.corrections is not None
    assert facts.corrections.text == file.read_text()
    # From the nearest checkpoint and from the start: the same messages.
    span = ["--from", "1.6", "--to", "2.2"]
    one = replayed(folder, tracker, file, tmp_path / "one.mcap", *span)
    again = replayed(folder, tracker, file, tmp_path / "two.mcap", *span, "--checkpoints", str(whole))  # fmt: skip
    digests = []
    for path in (one, again):
        with LogReader(path) as opened:
            digests.append(provenance_of(opened).output_digest)
    assert digests[0] == digests[1]
    # A checkpoint of other corrections is refused.
    words = ["replay", str(folder / "scene.mcap"), "-o", str(tmp_path / "no.mcap"), *span]
    assert main([*words, "--tracker", tracker, "--checkpoints", str(whole)]) == 2
    assert "another configuration" in capsys.readouterr().err


def test_every_kind_changes_its_answer(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = folder / "events.mcap"
    before = tracks(log, capsys)
    a, b = sorted(before)[:2]
    kinds: dict[str, tuple[list[str], Callable[[dict[int, int]], bool]]] = {
        "swap": (["swap", str(a), str(b), "--at", "1"], lambda t: set(t) == set(before)),
        "split": (["split", str(a), "--at", "1"], lambda t: len(t) == len(before) + 1),
        "rename": (["rename", str(a), "77"], lambda t: t[77] == before[a] and a not in t),
        "delete": (["delete", str(a)], lambda t: a not in t and len(t) == len(before) - 1),
        "label": (["label", str(a), "red"], lambda t: t == before),
        "same": (["same", str(a), "monday:4"], lambda t: t == before),
        "not-same": (["not-same", str(a), str(b)], lambda t: t == before),
    }
    for name, (words, holds) in kinds.items():
        file = tmp_path / f"{name}.jsonl"
        assert correct(log, file, *words) == 0
        out = replayed(folder, "events", file, tmp_path / f"{name}.mcap")
        assert holds(tracks(out, capsys)), name
        query = "SELECT kind, made_by, why, date FROM corrections"
        main(["query", str(out), query, "--json"])
        assert json.loads(capsys.readouterr().out) == [
            {
                "kind": name,
                "made_by": "Jo Doe",
                "why": "the same coat",
                "date": "2026-01-31",
            }
        ]
        assert main(["explain", str(out), "correction:1"]) == 0
        assert "the word of Jo Doe: the same coat" in capsys.readouterr().out
    main(["query", str(tmp_path / "label.mcap"), f"SELECT label FROM targets WHERE track = {a}", "--json"])  # fmt: skip
    assert json.loads(capsys.readouterr().out) == [{"label": "red"}]


def test_merge_of_a_split_is_the_uncorrected_story(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, file = folder / "events.mcap", tmp_path / "c.jsonl"
    a = min(tracks(log, capsys))
    assert correct(log, file, "split", str(a), "--at", "1") == 0
    new = capsys.readouterr().out.split()[-1]
    split = replayed(folder, "events", file, tmp_path / "split.mcap")
    assert main(["diff", str(log), str(split)]) == 4
    said = capsys.readouterr().out
    assert f"correction 1 (Jo Doe): target {a} is another from 1.0" in said
    # The numbers of the corrected log go on from there.
    assert correct(split, file, "merge", str(a), new) == 0
    merged = replayed(folder, "events", file, tmp_path / "merged.mcap")
    capsys.readouterr()
    assert main(["diff", str(log), str(merged)]) == 0, capsys.readouterr().out
    # Taken back, both, it is the uncorrected replay, bit for bit.
    assert main(["correct", str(log), "-o", str(file), "undo", "1", *WHO]) == 2
    assert main(["correct", str(log), "-o", str(file), "undo", "2", *WHO]) == 0
    assert main(["correct", str(log), "-o", str(file), "undo", "1", *WHO]) == 0
    back = replayed(folder, "events", file, tmp_path / "back.mcap")
    digests = []
    for path in (log, back):
        with LogReader(path) as opened:
            digests.append(provenance_of(opened).output_digest)
    assert digests[0] == digests[1]
    capsys.readouterr()
    assert main(["correct", str(log), "-o", str(file), "list"]) == 0
    assert "taken back by correction 4" in capsys.readouterr().out


def test_altered_corrections_are_found(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, file = folder / "events.mcap", tmp_path / "c.jsonl"
    a = min(tracks(log, capsys))
    assert correct(log, file, "label", str(a), "red") == 0
    file.write_text(file.read_text().replace('"correction":1', '"correction":2'))
    words = ["replay", str(folder / "scene.mcap"), "-o", str(tmp_path / "o.mcap")]
    capsys.readouterr()
    assert main([*words, "--corrections", str(file)]) == 1
    error = capsys.readouterr().err
    assert f"{file}:2: correction 2 was not written after the lines before it" in error
    assert not (tmp_path / "o.mcap").exists()


def test_forged_corrections_are_named(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, file = folder / "events.mcap", tmp_path / "c.jsonl"
    a, b = sorted(tracks(log, capsys))[:2]
    assert correct(log, file, "swap", str(a), str(b), "--at", "1") == 0
    out = replayed(folder, "events", file, tmp_path / "out.mcap")

    def other_author(facts: dict[str, str]) -> dict[str, str]:
        return facts | {"corrections": facts["corrections"].replace("Jo Doe", "Al Roe")}

    def another_time(facts: dict[str, str]) -> dict[str, str]:
        text = facts["corrections"].replace('"frame":', '"frame":1')
        plain = {k: v for k, v in facts.items() if k != "fact_digests"}
        return with_fact_digests(plain | {"corrections": text})

    copy_log(out, tmp_path / "author.mcap", facts=other_author)
    found = verify(tmp_path / "author.mcap")
    assert not found.identical
    assert any(
        "corrections" in reason for reason in [*found.reasons, str(found.difference)]
    )
    # With its digest made anew: then the replay is another one, or cannot be.
    copy_log(out, tmp_path / "time.mcap", facts=another_time)
    assert main(["verify", str(tmp_path / "time.mcap")]) in (1, 4)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["mrge", "1", "2", *WHO], "did you mean merge?"),
        (["merge", "1", "2"], "give --by NAME"),
        (["merge", "1", "2", "--by", "Jo"], "give --why TEXT"),
        (["undo", "x", *WHO], "undo takes the number of a correction"),
    ],
)
def test_wrong_words_are_told(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    said: str,
) -> None:
    file = tmp_path / "c.jsonl"
    log = str(folder / "events.mcap")
    assert main(["correct", log, "-o", str(file), *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not file.exists()
    assert main(["correct", log, *words]) == 2
    assert "give -o corrections.jsonl" in capsys.readouterr().err


def test_a_file_of_another_tracker_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "c.jsonl"
    a = min(tracks(folder / "events.mcap", capsys))
    assert correct(folder / "events.mcap", file, "label", str(a), "red") == 0
    assert correct(folder / "shells.mcap", file, "label", str(a), "red") == 2
    assert "is of camera camera and tracker events" in capsys.readouterr().err
    words = ["replay", str(folder / "scene.mcap"), "-o", str(tmp_path / "o.mcap")]
    assert main([*words, "--tracker", "shells", "--corrections", str(file)]) == 2
    assert "which numbers its targets otherwise" in capsys.readouterr().err
