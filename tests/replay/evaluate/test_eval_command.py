"""`scenetrace eval` from end to end: a log or a text against a truth."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from replay.cli import main


def truth_rows(frames: range = range(30), factor: float = 1.0) -> str:
    rows = []
    for f in frames:
        for identity, x, y in ((1, 10.0 + 2 * f, 40.0), (2, 130.0 - 2 * f, 42.5)):
            box = ",".join(str(v * factor) for v in (x, y, 20.0, 40.0))
            rows.append(f"{f + 1},{identity},{box},1,-1,-1,-1\n")
    return "".join(rows)


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    path = tmp_path / "gt.txt"
    path.write_text(truth_rows())
    return path


def scored(capsys: pytest.CaptureFixture[str], *words: Any) -> dict[str, Any]:
    assert main(["eval", *map(str, words), "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_a_log_against_its_truth(
    write_annotated: Any, truth: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = scored(capsys, write_annotated(), "--truth", truth)
    assert (found["HOTA"], found["MOTA"], found["IDF1"]) == (100.0, 100.0, 100.0)
    # Track 3 is never held to be present, so it is no false alarm.
    assert (found["FP"], found["result_ids"], found["switches"], found["fragments"]) == (
        0,
        2,
        0,
        0,
    )
    assert found["size"] == [160, 120]
    assert found["trajectories"]["mostly_tracked_single_id"] == 2


def test_truth_in_other_pixels(
    write_annotated: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    large = tmp_path / "large.txt"
    large.write_text(truth_rows(factor=1.6))
    log = write_annotated()
    assert main(["eval", str(log), "--truth", str(large)]) == 1
    assert "the recording is 160x120" in capsys.readouterr().err
    assert scored(capsys, log, "--truth", large, "--truth-size", "256x192")["MOTA"] == 100.0


def test_truth_beyond_the_recording_is_left_out_and_said(
    write_annotated: Any, truth: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_annotated(frames=range(5, 15))
    assert main(["eval", str(log), "--truth", str(truth), "--json"]) == 0
    out = capsys.readouterr()
    assert json.loads(out.out)["true_boxes_left_out"] == 40
    assert json.loads(out.out)["MOTA"] == 100.0
    assert "40 of 60 true boxes are in frames that are not scored" in out.err


def test_a_text_against_a_truth_and_a_span(
    truth: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    half = tmp_path / "result.txt"
    half.write_text(truth_rows(range(15)))
    assert scored(capsys, half, "--truth", truth)["recall"] == 50.0
    assert scored(capsys, half, "--truth", truth, "--frames", ":15")["recall"] == 100.0
    assert main(["eval", str(half), "--truth", str(truth), "--frames", "90:"]) == 1
    assert (
        "no truth in the frames to score; it has frames 0 to 29" in capsys.readouterr().err
    )


def test_a_log_without_recorded_messages_needs_no_size_unless_scaled(
    write_annotated: Any, truth: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_annotated(recorded=False)
    assert scored(capsys, log, "--truth", truth)["MOTA"] == 100.0
    assert main(["eval", str(log), "--truth", str(truth), "--truth-size", "320x240"]) == 2
    assert "--truth-size needs the size of the tracks' picture" in capsys.readouterr().err
    assert (
        scored(
            capsys, log, "--truth", truth, "--truth-size", "160x120", "--size", "160x120"
        )["MOTA"]
        == 100.0
    )


def test_tables_for_a_person(
    write_annotated: Any, truth: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["eval", str(write_annotated()), "--truth", str(truth)]) == 0
    out = capsys.readouterr().out
    for words in (
        "HOTA",
        "IDF1",
        "mostly tracked under a single id",
        "centre by coordinate",
        "0-29",
    ):
        assert words in out


def test_wrong_words_and_files(
    write_annotated: Any, truth: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_annotated()
    for words, code, message in (
        (["--truth", str(tmp_path / "absent.txt")], 1, "cannot be read"),
        (["--truth", str(truth), "--iou", "1.5"], 2, "--iou 1.5"),
        (["--truth", str(truth), "--camera", "roof"], 2, "no tracks of a camera 'roof'"),
    ):
        assert main(["eval", str(log), *words]) == code
        assert message in capsys.readouterr().err
    assert main(["eval", str(tmp_path / "absent.mcap"), "--truth", str(truth)]) == 1
    assert "absent.mcap" in capsys.readouterr().err
    for bad in (["--truth-size", "768"], ["--frames", "7"]):
        assert main(["eval", str(log), "--truth", str(truth), *bad]) == 2
        assert "must be" in capsys.readouterr().err


def test_plot_is_written_once(
    write_annotated: Any, truth: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    log, plot = write_annotated(), tmp_path / "plot.png"
    words = ["eval", str(log), "--truth", str(truth), "--plot", str(plot)]
    assert main(words) == 0
    first = plot.read_bytes()
    assert first.startswith(b"\x89PNG")
    assert main(words) == 1
    assert "exists already" in capsys.readouterr().err
    assert main([*words, "--force"]) == 0
    assert plot.read_bytes() == first
    assert main([*words[:-1], str(tmp_path / "plot.xyz")]) == 2
    assert "must end in .png, .pdf or .svg" in capsys.readouterr().err


def test_plot_without_matplotlib_says_what_to_install(
    write_annotated: Any,
    truth: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    words = [
        "eval",
        str(write_annotated()),
        "--truth",
        str(truth),
        "--plot",
        str(tmp_path / "p.png"),
    ]
    assert main(words) == 1
    assert "pip install 'scenetrace[plot]'" in capsys.readouterr().err
