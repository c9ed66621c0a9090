"""Names in a recording that would steer a page, a terminal, a spreadsheet, or a path."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from recorders.log import LogWriter, Schema
from replay.cli import main

NASTY = (
    '"><img src=x onerror=alert(1)>',
    "</script><script>alert(1)</script>",
    "\x1b[2J\x1b]0;owned\x07",
    "=HYPERLINK(A1)",
    "../../escaped",
    "'; DROP TABLE tracks; --",
    "}</style><style>*{display:none;owned:1}",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene whose zones and labels bear those names, replayed."""
    folder = tmp_path_factory.mktemp("nasty")
    square = [[0, 0], [640, 0], [640, 480], [0, 480]]
    zones = {name: [[x + k, y] for x, y in square] for k, name in enumerate(NASTY)}
    (folder / "regions.json").write_text(json.dumps({"roi": square, "zones": zones}))
    with (folder / "det.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["frame", "x1", "y1", "x2", "y2", "score", "label"])
        for frame in range(40):
            for k, name in enumerate(NASTY):
                x = 20 + 80 * k + frame
                rows.writerow([frame, x, 200, x + 40, 300, 0.9, name])
    scene, log = str(folder / "scene.mcap"), str(folder / "annotated.mcap")
    source = str(folder / "det.csv")
    words = ["--fps", "25", "--size", "640x480", "--regions", str(folder / "regions.json")]
    assert main(["record", source, "-o", scene, *words]) == 0
    assert main(["replay", scene, "-o", log]) == 0
    return folder


def outside(folder: Path) -> set[str]:
    return {str(path) for path in folder.parent.rglob("*escaped*")}


def test_a_terminal_is_not_steered(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = str(folder / "annotated.mcap")
    for words in (
        ["query", log, "SELECT DISTINCT zone FROM zones"],
        ["query", log, "SELECT DISTINCT label FROM tracks"],
        ["info", log],
    ):
        capsys.readouterr()
        assert main(words) == 0
        said = capsys.readouterr()
        assert "\x1b" not in said.out + said.err
        assert "\x07" not in said.out + said.err


def test_a_spreadsheet_computes_nothing(folder: Path, tmp_path: Path) -> None:
    log = str(folder / "annotated.mcap")
    answer, tables = tmp_path / "answer.csv", tmp_path / "tables"
    query = "SELECT zone FROM zones ORDER BY zone"
    assert main(["query", log, query, "--format", "csv", "-o", str(answer)]) == 0
    assert main(["export", log, "--to", "csv", "-o", str(tables)]) == 0
    cells = [
        cell
        for path in (answer, tables / "zones.csv", tables / "tracks.csv")
        for row in csv.reader(path.read_text().splitlines())
        for cell in row
    ]
    assert "'=HYPERLINK(A1)" in cells
    formulas = [c for c in cells if c.startswith(("=", "+", "@", "\t", "\r"))]
    assert formulas == []


def test_pages_hold_no_script_of_a_recording(folder: Path, tmp_path: Path) -> None:
    log = str(folder / "annotated.mcap")
    assert main(["report", log, "-o", str(tmp_path / "report.html")]) == 0
    assert main(
        ["evidence", log, "--event-kind", "track_confirmed", "-o", str(tmp_path / "e")]
    ) in (0, 2)
    pages = [*tmp_path.rglob("*.html")]
    assert pages
    for page in pages:
        text = page.read_text()
        assert "<img src=x" not in text
        assert "<script>alert" not in text
        # Within the page's own style sheet nothing of a recording can stand.
        for style in re.findall(r"<style[^>]*>(.*?)</style>", text, re.DOTALL):
            assert "owned" not in style


def test_no_name_leads_out_of_the_output(folder: Path, tmp_path: Path) -> None:
    log = str(folder / "annotated.mcap")
    before = outside(folder)
    for kind in ("csv", "parquet", "coco", "graphml", "srt"):
        assert main(["export", log, "--to", kind, "-o", str(tmp_path / kind)]) in (0, 2, 3)
    assert outside(folder) == before
    assert not outside(tmp_path)


def test_a_name_is_no_sql(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = str(folder / "annotated.mcap")
    capsys.readouterr()
    for name in NASTY:
        assert main(["query", log, "--ask", "who-was-in", name, "--at", "1", "--json"]) == 0
        assert json.loads(capsys.readouterr().out)


def test_a_terminal_is_not_steered_by_csv_or_json_either(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = str(folder / "annotated.mcap")
    for form in ("csv", "json"):
        terminal = Terminal()
        monkeypatch.setattr(sys, "stdout", terminal)
        query = "SELECT DISTINCT label FROM tracks ORDER BY label"
        assert main(["query", log, query, "--format", form]) == 0
        said = terminal.getvalue()
        assert said.count("\n") > len(NASTY)
        assert all(c.isprintable() for c in said.replace("\n", "")), repr(said)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("kind", ["cvat", "graphml"])
def test_xml_is_well_formed_whatever_the_labels(
    folder: Path, tmp_path: Path, kind: str
) -> None:
    out = tmp_path / "out.xml"
    assert (
        main(["export", str(folder / "annotated.mcap"), "--to", kind, "-o", str(out)]) == 0
    )
    root = ElementTree.fromstring(out.read_bytes())
    if kind == "cvat":
        assert NASTY[1] in [track.get("label") for track in root.iter("track")]


def test_subtitles_hold_no_markup_of_a_recording(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.srt"
    assert (
        main(["export", str(folder / "annotated.mcap"), "--to", "srt", "-o", str(out)]) == 0
    )
    text = out.read_text()
    blocks = text.strip().split("\n\n")
    assert [block.split("\n")[0] for block in blocks] == [
        str(number) for number in range(1, len(blocks) + 1)
    ]
    assert "<" not in text
    assert "\x1b" not in text


def nasty_log(path: Path, camera: str) -> Path:
    """A log of another writer whose every name is hostile: topic, schema, metadata, attachment."""
    with LogWriter(path, profile=camera[:20]) as log:
        topic = log.channel(
            f"/{camera}/detections",
            Schema("scenetrace.Detections", "jsonschema", b"{}"),
            "json",
        )
        other = log.channel(camera, Schema(camera, "jsonschema", b"{}"), "json")
        for frame in range(12):
            boxes = [[20.0 + 4 * frame, 90.0, 24.0, 60.0]]
            said = {"frame": frame, "width": 320, "height": 240, "boxes": boxes, "scores": [0.9],
                    "labels": [camera], "ellipses": [None], "blobs": [-1], "components": []}  # fmt: skip
            log.write(topic, json.dumps(said).encode(), frame * 40_000_000)
            log.write(other, b"{}", frame * 40_000_000)
        log.attach(camera, camera, b"data", 0, 0)
        log.metadata(camera, {camera: camera})
    return path


CAMERAS = {
    "escapes": "\x1b[2J\x1b]0;owned\x07cam",
    "a path": "../../escaped",
    "a script": "<script>alert(1)</script>",
    "lines": "a\n\n99\n00:00:00,000 --> 09:00:00,000\nowned",
    "5,000 letters": "a" * 5000,
    "reversed": "\u202egnp.exe",
}


@pytest.mark.parametrize("what", CAMERAS)
def test_topics_and_metadata_of_others_steer_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], what: str
) -> None:
    path = nasty_log(tmp_path / "log.mcap", CAMERAS[what])
    scene, made = str(tmp_path / "scene.mcap"), str(tmp_path / "made.mcap")
    assert main(["record", str(path), "-o", scene]) == 0
    assert main(["replay", scene, "-o", made]) == 0
    for words in (["info", str(path)], ["doctor", str(path)], ["info", made]):
        assert main(words) in (0, 3)
    for kind in ("ros2", "csv"):
        assert main(["export", made, "--to", kind, "-o", str(tmp_path / kind)]) == 0
    assert main(["report", made, "-o", str(tmp_path / "report.html")]) == 0
    said = capsys.readouterr()
    for line in (said.out + said.err).split("\n"):
        assert line.isprintable(), repr(line)
    assert "<script>alert" not in (tmp_path / "report.html").read_text()
    assert not outside(tmp_path)


@pytest.mark.parametrize("words", [
    ["query", "LOG", "SELECT 1", "--format", "csv", "-o", "OUT", "--force"],
    ["query", "LOG", "SELECT 1", "--format", "parquet", "-o", "OUT", "--force"],
    ["export", "LOG", "--to", "mot", "-o", "OUT", "--force"],
    ["report", "LOG", "-o", "OUT", "--force"],
    ["seal", "LOG", "-o", "OUT", "--force"],
    ["recover", "LOG", "-o", "OUT", "--force"],
])  # fmt: skip
def test_a_link_in_the_way_is_never_written_through(
    folder: Path, tmp_path: Path, words: list[str]
) -> None:
    precious, out = tmp_path / "precious", tmp_path / "out"
    precious.write_text("precious")
    for name in ("out", "out.part", "out.recovering.part"):
        (tmp_path / name).symlink_to(precious)
    log = str(folder / "annotated.mcap")
    code = main([{"LOG": log, "OUT": str(out)}.get(word, word) for word in words])
    assert code in (0, 1, 2)
    assert precious.read_text() == "precious"


def test_a_link_in_a_folder_leads_nowhere(folder: Path, tmp_path: Path) -> None:
    log, out, elsewhere = (
        str(folder / "annotated.mcap"),
        tmp_path / "e",
        tmp_path / "elsewhere",
    )
    elsewhere.mkdir()
    words = ["evidence", log, "--events", "1", "-o", str(out), "--force"]
    assert main(words) in (0, 3)
    inner = next(p for p in sorted(out.iterdir()) if p.is_dir())
    shutil.rmtree(inner)
    inner.symlink_to(elsewhere, target_is_directory=True)
    assert main(words) in (0, 1, 2, 3)
    assert list(elsewhere.iterdir()) == []
