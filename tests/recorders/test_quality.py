"""What a first reading says of a recording, and how a log tells it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fixtures.disturbed import dimmed, walk
from recorders.errors import RecordingError
from recorders.log import LogReader
from recorders.messages import Box, Detections
from recorders.pictures import encode_png
from recorders.quality import (
    FAIR,
    GOOD,
    POOR,
    QualityMeasure,
    graded,
    quality_text,
    recorded_quality,
)
from recorders.segmentation.quality import (
    LEAST_FOREGROUND,
    measures,
    of_detector,
    of_gaps,
    of_tally,
    overall,
    worst,
)
from recorders.segmentation.tally import Tally
from replay.cli import main


def verdicts(**changed: Any) -> dict[str, str]:
    usual: dict[str, Any] = {
        "foreground": 0.02,
        "sightings": 50,
        "usual": True,
        "upright": True,
    }
    return {m.name: m.verdict for m in measures(**{**usual, "noisy": False, **changed})}


def test_each_verdict_that_is_not_good_says_what_to_do() -> None:
    assert set(verdicts().values()) == {GOOD}
    assert "--regions" in verdicts(foreground=0.5)["foreground_share"]
    assert "--detect threshold" in verdicts(usual=False)["clean_sightings"]
    wrong: dict[str, dict[str, Any]] = {
        "foreground_share": {"foreground": 0.41},
        "clean_sightings": {"usual": False},
        "upright_bodies": {"upright": False},
        "noise": {"noisy": True},
    }
    for name, changed in wrong.items():
        told = {n: v for n, v in verdicts(**changed).items() if v != GOOD}
        assert list(told) == [name]
        assert "--model FILE" in told[name]


def test_sizes_are_missed_only_where_enough_moves() -> None:
    still = verdicts(usual=False, upright=False, foreground=LEAST_FOREGROUND / 2)
    assert set(still.values()) == {GOOD}
    assert verdicts(usual=False, foreground=LEAST_FOREGROUND)["clean_sightings"] != GOOD


def test_whether_bodies_are_upright_is_not_said_where_no_size_was_learnt() -> None:
    assert "upright_bodies" in verdicts(upright=False)
    assert "upright_bodies" not in verdicts(usual=False, upright=False)


def test_the_worse_of_two_is_told_and_a_limit_is_not() -> None:
    both = worst(measures(0.6, 2, False, False, True))
    assert both is not None
    assert both.name == "foreground_share"
    sized = worst(measures(0.2, 2, False, False, True))
    assert sized is not None
    assert sized.name == "clean_sightings"
    assert worst(measures(0.2, 20, True, False, True)) is None


def test_what_is_written_is_read_by_camera() -> None:
    left, right = (
        measures(0.02, 50, True, True, False),
        measures(0.6, 0, False, False, True),
    )
    records = [
        ("scenetrace", {"kind": "annotated", "camera": "left"}),
        ("scenetrace.started", {"camera": "left", "quality": quality_text(left)}),
        ("scenetrace.recording", {"camera": "left", "quality": quality_text(left)}),
        ("scenetrace.recording", {"camera": "right", "quality": quality_text(right)}),
        ("of somebody else", {"camera": "up", "quality": "fine"}),
    ]
    assert recorded_quality(records, "x.mcap") == {"left": left, "right": right}


@pytest.mark.parametrize(
    "text", ["fine", "{}", '[["a", "b", "c"]]', '[["a", 1]]', "[" * 9999]
)
def test_something_else_under_that_name_is_an_error(text: str) -> None:
    with pytest.raises(RecordingError, match="no list of name, value and verdict"):
        recorded_quality([("scenetrace", {"quality": text})], "x.mcap")


def waving(folder: Path, frames: int = 24) -> Path:
    """A paved ground on half of which everything differs from picture to picture, and nothing else."""
    rng = np.random.default_rng(4)
    folder.mkdir()
    stones = rng.integers(70, 110, (15, 20, 1), np.uint8).repeat(3, 2)
    ground = stones.repeat(8, 0).repeat(8, 1)
    for k in range(frames):
        picture = ground.copy()
        tiles = rng.integers(0, 2, (12, 8, 1), np.uint8) * 120 + 60
        picture[:, :80] = tiles.repeat(10, 0).repeat(10, 1)
        (folder / f"{k:04d}.png").write_bytes(encode_png(picture))
    return folder


def test_record_says_in_one_line_that_no_size_was_learnt(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "scene.mcap"
    assert main(["record", str(waving(tmp_path / "w")), "--fps", "5", "-o", str(out)]) == 0
    said = [line for line in capsys.readouterr().err.splitlines() if "--model" in line]
    assert len(said) == 1
    with LogReader(out) as log:
        (measured,) = recorded_quality(log.metadata(), out).values()
    told = worst(measured)
    assert told is not None
    assert said == [f"scenetrace: {told.verdict}"]


def test_a_measure_is_bad_unless_it_is_good() -> None:
    assert not QualityMeasure("noise", 0.0).bad
    assert QualityMeasure("noise", 1.0, "noise decides").bad


def stay(boxes: list[Box], frame: int) -> Detections:
    return Detections(frame, 100, 100, boxes)


def test_flicker_and_what_never_moves_are_counted() -> None:
    tally = Tally(fps=10.0)
    for k in range(300):
        rim = (5.0, 5.0, 10.0, 20.0)
        walker = (20.0 + k % 60, 50.0, 10.0, 20.0)
        speck = [(80.0, 80.0, 4.0, 4.0)] if k % 10 == 1 else []
        tally.count(stay([rim, walker, *speck], k))
    assert tally.flicker == pytest.approx(1 / 3, abs=0.02)
    assert tally.still_share(10.0, 1 / 3) == pytest.approx(0.5, abs=0.02)
    assert tally.longest_rest_s() == pytest.approx(29.5)
    told = {m.name: m for m in of_tally(tally)}
    assert told["flicker"].grade == FAIR
    assert told["never_moves"].grade == FAIR
    assert told["longest_rest_s"].grade == GOOD
    assert told["camera_shakes"].grade == GOOD


def test_a_verdict_is_good_or_has_a_grade_and_words() -> None:
    assert graded(0.1, 0.2, 0.5, "no") == GOOD
    assert QualityMeasure("x", 0.2, graded(0.2, 0.2, 0.5, "it is")).grade == FAIR
    assert QualityMeasure("x", 0.5, graded(0.5, 0.2, 0.5, "it is")).grade == POOR


def test_the_whole_is_as_bad_as_what_speaks_of_most_of_it() -> None:
    fair = QualityMeasure("waving_ground", 0.4, "poor: leaves")
    poor = QualityMeasure("pieces_per_body", 9.0, "poor: pieces")
    good = QualityMeasure("noise", 0.0)
    assert overall([good]).verdict == GOOD
    assert overall([good, fair]).verdict == "fair: see waving_ground"
    assert overall([good, fair, poor]).verdict == "poor: see pieces_per_body"
    assert worst([fair, poor]) == poor


def test_gaps_and_a_detector_that_sees_others_are_measured() -> None:
    assert of_gaps([]).verdict == GOOD
    told = of_gaps([3 * 10**9, 28_800 * 10**9])
    assert told.value == 2.0
    assert "28800 s" in told.verdict
    assert of_detector(100, 90).verdict == GOOD
    assert of_detector(100, 20).grade == POOR
    assert of_detector(0, 0).verdict == GOOD


def test_a_recording_whose_picture_changed_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Recorded, replayed and asked: the light of a street falls and comes back."""
    folder = tmp_path / "street"
    folder.mkdir()
    for k, image in enumerate(walk(90)):
        shown = dimmed(image, 0.6) if 40 <= k < 65 else image
        (folder / f"{k:04d}.png").write_bytes(encode_png(shown))
    scene, out = tmp_path / "scene.mcap", tmp_path / "out.mcap"
    assert main(["record", str(folder), "--fps", "10", "-o", str(scene)]) == 0
    assert "the light was switched or changed 2 times" in capsys.readouterr().err
    with LogReader(scene) as log:
        (measured,) = recorded_quality(log.metadata(), scene).values()
    grades = {one.name: one.grade for one in measured}
    assert grades["light_changes"] == FAIR
    assert grades["camera_moves"] == grades["gaps"] == GOOD
    assert main(["replay", str(scene), "-o", str(out), "--tracker", "events"]) == 0
    assert main(["verify", str(out)]) == 0
    capsys.readouterr()
    asked = "SELECT frame, subjects, text FROM events WHERE kind = 'scene_changed'"
    assert main(["query", str(out), asked, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    rows = rows["rows"] if isinstance(rows, dict) else rows
    assert len(rows) == 2
    assert "The light fell to 60% of what is usual here." in str(rows[0])
