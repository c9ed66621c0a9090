"""What a first reading says of a recording, and how a log tells it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recorders.errors import RecordingError
from recorders.log import LogReader
from recorders.pictures import encode_png
from recorders.quality import GOOD, QualityMeasure, quality_text, recorded_quality
from recorders.segmentation.quality import LEAST_FOREGROUND, measures, worst
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
    """A ground on half of which everything differs from picture to picture, and nothing else."""
    rng = np.random.default_rng(4)
    folder.mkdir()
    for k in range(frames):
        picture = np.full((120, 160, 3), 90, np.uint8)
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
