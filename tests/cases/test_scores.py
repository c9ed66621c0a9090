"""Truths and results as people have them, judged as TrackEval judges them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from replay.cli import main
from tests.cases.conftest import Case


def scores(
    case: Case, capsys: pytest.CaptureFixture[str], kind: str, *more: str
) -> tuple[dict[str, Any], str]:
    folder = case("video/e_eval", kind)
    words = ["eval", str(folder / "res.txt"), "--truth", str(folder / "gt.txt"), "--json"]
    assert main([*words, "--size", "320x240", *more]) == 0
    said = capsys.readouterr()
    return json.loads(said.out), said.err


def test_a_mannequin_that_is_followed_costs_nothing(
    case: Case, capsys: pytest.CaptureFixture[str]
) -> None:
    judged, said = scores(case, capsys, "mot17")
    assert judged["MOTA"] == pytest.approx(100)
    assert "100 boxes of the result lay on distractors; --raw judges all" in said
    raw, _ = scores(case, capsys, "mot17", "--raw")
    assert raw["MOTA"] < 60


def test_other_classes_are_no_misses(
    case: Case, capsys: pytest.CaptureFixture[str]
) -> None:
    judged, _ = scores(case, capsys, "classes")
    assert judged["MOTA"] == pytest.approx(100)
    raw, _ = scores(case, capsys, "classes", "--raw")
    assert raw["MOTA"] < 60


def test_labels_of_whole_bodies_reach_beyond_the_picture(
    case: Case, capsys: pytest.CaptureFixture[str]
) -> None:
    judged, _ = scores(case, capsys, "edge")
    assert judged["MOTA"] == pytest.approx(100)


def test_frames_without_labels_can_be_left_out(
    case: Case, capsys: pytest.CaptureFixture[str]
) -> None:
    everywhere, _ = scores(case, capsys, "noframes")
    labelled, _ = scores(case, capsys, "noframes", "--labelled-frames-only")
    assert everywhere["MOTA"] < 0
    assert labelled["MOTA"] == pytest.approx(100)


@pytest.mark.parametrize("kind", ["half", "confneg", "later"])
def test_the_others_are_scored(
    case: Case, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    judged, _ = scores(case, capsys, kind)
    assert judged["MOTA"] <= 100


def test_tracks_with_frames_from_0(case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    truth = case("video/m_mot", "gt9", suffix=".txt")
    tracks = case("video/m_mot", "tracks", suffix=".txt")
    words = ["eval", str(tracks), "--truth", str(truth), "--json", "--size", "320x240"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["MOTA"] == pytest.approx(100)


@pytest.mark.parametrize("form", ["kitti", "coco"])
def test_what_nobody_labelled_is_not_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], form: str
) -> None:
    here = [(10.0 + 5 * k, 20.0, 30.0, 60.0) for k in range(8)]
    crowd = (180.0, 20.0, 100.0, 80.0)
    inside = (200.0, 30.0, 20.0, 50.0)
    lines = []
    for k, box in enumerate(here):
        for who, (x, y, w, h) in enumerate((box, inside), 1):
            lines.append(f"{k + 1},{who},{x},{y},{w},{h},1,-1,-1,-1")
    (tmp_path / "res.txt").write_text("\n".join(lines))
    if form == "kitti":
        truth = tmp_path / "gt.txt"
        rows = []
        for k, box in enumerate(here):
            for name, who, (x, y, w, h) in (("Car", 3, box), ("DontCare", -1, crowd)):
                corners = f"{x} {y} {x + w} {y + h}"
                rows.append(f"{k} {who} {name} 0 0 -10 {corners} {' '.join(['-1'] * 7)}")
        truth.write_text("\n".join(rows))
    else:
        truth = tmp_path / "gt.json"
        images = [{"id": k, "file_name": f"{k}.jpg"} for k in range(len(here))]
        entries: list[dict[str, Any]] = []
        for k, box in enumerate(here):
            entries.append({"image_id": k, "bbox": box, "track_id": 5})
            entries.append({"image_id": k, "bbox": crowd, "iscrowd": 1})
        truth.write_text(json.dumps({"images": images, "annotations": entries}))
    words = ["eval", str(tmp_path / "res.txt"), "--truth", str(truth), "--json"]
    assert main([*words, "--size", "320x240"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["MOTA"] == pytest.approx(100)
    assert (
        "8 boxes of the result lay where the truth says that nobody was labelled"
        in said.err
    )
    assert main([*words, "--size", "320x240", "--raw"]) == 0
    assert json.loads(capsys.readouterr().out)["MOTA"] == pytest.approx(0)
