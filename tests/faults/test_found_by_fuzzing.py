"""Inputs that once ended in an exception that was none of ours, each kind once."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from reasoning.questions.patterns import parse
from recorders.detectors.model_file import parse_names
from recorders.errors import LimitError, SceneTraceError, UsageError
from recorders.formats.opening import open_rows
from recorders.log import ChannelInfo, Schema
from recorders.parameters import configure
from recorders.payloads import PayloadError, read_picture
from recorders.recording import SECTIONS
from replay.batch.sources import sources_of
from replay.cases.case_file import read_case
from tests.faults.small import annotated, run

DIGITS = "9" * 4400
VIDEO_KEY = {"frame": 1, "x": 1, "y": 1, "width": 5, "height": 5, "enabled": True}


def rows(path: Path, text: str) -> int:
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    target = path.parent if path.parent.name == "folder" else path
    return sum(1 for _ in open_rows(target, (640, 480)).rows(lambda *_: None))


def studio(value: dict[str, object], name: str = "a.jpg") -> str:
    size = {"original_width": 640, "original_height": 480}
    result = {"type": "videorectangle", "value": value, **size}
    return json.dumps([{"data": {"image": name}, "annotations": [{"result": [result]}]}])


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("folder/000001.txt", "1e999 0.5 0.5 0.1 0.1\n"),
        ("folder/000001.txt", f"{DIGITS} 0.5 0.5 0.1 0.1\n"),
        ("folder/1.json", "-1"),
        ("folder/1.json", '{"imageWidth": 5, "imageHeight": "6", "shapes": [5]}'),
        ("studio.json", studio({"x": 1, "y": 1, "width": 5, "height": 5}, f"{DIGITS}.jpg")),
        (
            "cvat.xml",
            "<annotations><meta><original_size><width>\u00b2</width><height>\u00b2</height>"
            "</original_size></meta></annotations>",
        ),
        ("det.txt", f"1,1,10,20,30,40,1,{DIGITS},1\n"),
    ],
)
def test_boxes_are_read_or_refused(tmp_path: Path, name: str, text: str) -> None:
    with suppress(SceneTraceError):
        assert rows(tmp_path / name, text) <= 1


def test_key_frames_that_claim_boxes_without_end_are_refused(tmp_path: Path) -> None:
    value = {"sequence": [VIDEO_KEY], "framesCount": 90_000_000}
    with pytest.raises(LimitError, match="boxes in its videos"):
        rows(tmp_path / "studio.json", studio(value))


def test_base64_of_other_letters_is_told() -> None:
    schema = Schema("foxglove.CompressedImage", "jsonschema", b"{}")
    data = '{"format": "png", "data": "aGFs\u00e9\u00e9\u00e9\u00e9bG8="}'.encode()
    with pytest.raises(PayloadError, match="no base64"):
        read_picture(ChannelInfo("/x", schema, "json"), data)


@pytest.mark.parametrize("text", ["{1e999: 'car'}", f"{{{DIGITS}: 'car'}}", "{-1: 'car'}"])
def test_names_under_numbers_that_are_none_are_no_names(text: str) -> None:
    assert parse_names(text) == []


def test_a_configuration_of_endless_digits_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(f"[segmentation]\nthreshold_levels = {DIGITS}\n")
    with pytest.raises(SceneTraceError, match="not TOML"):
        configure(SECTIONS, path)


def test_a_case_of_endless_digits_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(f"title = {DIGITS}\n")
    with pytest.raises(SceneTraceError):
        read_case(path)


@pytest.mark.parametrize(
    "ask",
    [
        lambda: parse(f"stay(a, door){{{DIGITS}}}"),
        lambda: parse("stay(a, door){\u00b2}"),
    ],
)
def test_patterns_with_endless_digits_are_refused(ask: Callable[[], object]) -> None:
    with pytest.raises(SceneTraceError):
        ask()


def test_a_list_that_names_what_is_too_long_is_refused(tmp_path: Path) -> None:
    (tmp_path / "list.txt").write_text(f"a.mp4{DIGITS}\n")
    with pytest.raises(UsageError, match=r"list\.txt:1"):
        sources_of([f"@{tmp_path / 'list.txt'}"])


@pytest.mark.parametrize("ids", ["\u00b2", DIGITS, "1,\u0663"])
def test_identities_that_are_no_digits_are_told(
    tmp_path: Path, ids: str, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = annotated(tmp_path), str(tmp_path / "o.txt")
    with suppress(SystemExit):
        code, told = run("export", str(log), "--to", "mot", "-o", out, "--only", ids)
        assert code == 2
        assert "must be track ids" in told
        return
    assert "must be track ids" in capsys.readouterr().err
