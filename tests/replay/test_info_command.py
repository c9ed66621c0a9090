"""What `info` and `doctor` print of logs that other programs, or nobody's friends, have written."""

from __future__ import annotations

import json
import platform
from pathlib import Path

import pytest

from fixtures.logs import export_video
from fixtures.scenes import generate
from recorders.log import LogWriter
from recorders.quality import quality_text
from recorders.segmentation.quality import measures
from replay.cli import main


@pytest.mark.parametrize("configuration", ["{", "[1]", '{"a": 1}', "[" * 100_000])
def test_a_configuration_that_is_none_is_shown_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], configuration: str
) -> None:
    with LogWriter(tmp_path / "x.mcap") as log:
        log.metadata("scenetrace", {"configuration": configuration})
    assert main(["info", str(tmp_path / "x.mcap")]) == 0
    assert f"configuration: {configuration}" in capsys.readouterr().out


def test_texts_of_a_log_do_not_steer_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with LogWriter(tmp_path / "x.mcap", profile="\x1b[31m") as log:
        log.channel("/a\x1b]0;title\x07", None, "json")
        log.attach("b\rc", "text/\x9b2J", b"")
        log.metadata("d\x1b[2J", {"e\nf": "g\u202eh"})
    assert main(["info", str(tmp_path / "x.mcap")]) == 0
    out = capsys.readouterr().out
    assert not set(out) & set("\x1b\x07\r\x9b\u202e")
    assert r"/a\x1b]0;title\x07" in out
    assert r"e\nf: g\u202eh" in out


def test_names_that_are_not_utf8_are_recorded_spelt_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "gate\udcff.txt"
    try:
        source.write_text("1,-1,2,2,5,5,1\n2,-1,3,2,5,5,1\n")
    except (OSError, UnicodeEncodeError):
        pytest.skip("this file system takes UTF-8 names only")
    scene, out = tmp_path / "scene\udcfe.mcap", tmp_path / "annotated.mcap"
    assert (
        main(["record", str(source), "-o", str(scene), "--fps", "5", "--size", "20x20"])
        == 0
    )
    assert main(["replay", str(scene), "-o", str(out)]) == 0
    capsys.readouterr()
    assert main(["info", str(out)]) == 0
    shown = capsys.readouterr().out
    assert r"source: gate\udcff.txt" in shown
    assert r"scene: scene\udcfe.mcap" in shown


def test_a_scene_log_says_what_its_masks_and_detections_depend_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    export_video(generate("pass_by", size=(96, 72), frames=8), tmp_path / "v.avi")
    assert (
        main(["record", str(tmp_path / "v.avi"), "-o", str(tmp_path / "scene.mcap")]) == 0
    )
    capsys.readouterr()
    assert main(["info", str(tmp_path / "scene.mcap")]) == 0
    said = capsys.readouterr().out
    for words in (
        f"python: CPython {platform.python_version()}",
        f"machine: {platform.machine()}, numpy with ",
        "opencv_build: Version control",
        "IPP in use: no",
        '"numpy":"2',
    ):
        assert words in said


def test_the_quality_of_a_recording_is_told_once_with_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    measured = measures(0.6, 0, False, False, False)
    facts = {"camera": "left", "quality": quality_text(measured)}
    with LogWriter(tmp_path / "x.mcap") as log:
        log.metadata("scenetrace.started", facts)
        log.metadata("scenetrace", facts)
    assert main(["info", str(tmp_path / "x.mcap")]) == 0
    out = capsys.readouterr().out
    assert out.count("60% of the picture differs from its background") == 1
    assert "quality   of left\n  foreground_share 0.6: poor: 60%" in out
    assert "  noise 0: good\n" in out
    assert main(["info", str(tmp_path / "x.mcap"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["quality"]
    assert told == [
        {"camera": "left", "name": m.name, "value": m.value, "verdict": m.verdict}
        for m in measured
    ]


def test_something_else_under_the_name_quality_is_shown_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with LogWriter(tmp_path / "x.mcap") as log:
        log.metadata("scenetrace", {"quality": "very\x1b[2J fine"})
    assert main(["info", str(tmp_path / "x.mcap")]) == 0
    assert r"quality: very\x1b[2J fine" in capsys.readouterr().out
    assert main(["info", str(tmp_path / "x.mcap"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["quality"] == []
