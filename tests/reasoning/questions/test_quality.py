"""What a log says of its recording's quality, asked in SQL of logs and indexes."""

from __future__ import annotations

from pathlib import Path

import pytest

from fixtures.logs import export_images
from fixtures.scenes import generate
from reasoning.questions import Case
from reasoning.questions.index import build_index
from recorders import channels
from recorders.errors import RecordingError
from recorders.log import LogReader, LogWriter
from recorders.messages import Groups, Relations, Tracks
from recorders.quality import quality_text, recorded_quality
from recorders.segmentation.quality import measures
from replay.cli import main

ASKED = "SELECT recording, name, value, verdict FROM quality ORDER BY recording, name"


def annotated(path: Path, cameras: dict[str, str | None]) -> Path:
    """An annotated log of a few frames; camera to what its recording says of its quality."""
    with LogWriter(path) as log:
        for camera, quality in cameras.items():
            for name, empty in (
                ("tracks", Tracks),
                ("relations", Relations),
                ("groups", Groups),
            ):
                channel = log.channel(
                    channels.topic(camera, name), channels.schema(name), channels.message_encoding(name)
                )  # fmt: skip
                for n in range(3):
                    log.write(channel, channels.encode(name, empty(n, [])), n * 10**8)
            told = {} if quality is None else {"quality": quality}
            log.metadata("scenetrace.recording", {"camera": camera, **told})
    return path


def test_each_camera_has_its_own_rows_in_logs_and_indexes(tmp_path: Path) -> None:
    left, right = (
        measures(0.02, 50, True, True, False),
        measures(0.6, 0, False, False, True),
    )
    log = annotated(
        tmp_path / "two.mcap", {"left": quality_text(left), "right": quality_text(right)}
    )
    wanted = sorted(
        (f"two/{camera}", m.name, m.value, m.verdict)
        for camera, measured in (("left", left), ("right", right))
        for m in measured
    )
    indexes = [tmp_path / "case.duckdb", tmp_path / "case"]
    for index in indexes:
        build_index([log], index)
    for asked in (log, *indexes):
        with Case([asked]) as case:
            assert case.rows(ASKED) == wanted


def test_a_recording_that_says_nothing_has_no_rows(tmp_path: Path) -> None:
    with Case([annotated(tmp_path / "a.mcap", {"camera": None})]) as case:
        assert case.rows(ASKED) == []
        assert case.rows("SELECT count(*) FROM recordings") == [(1,)]


def test_what_is_no_quality_is_an_error_and_no_empty_table(tmp_path: Path) -> None:
    path = annotated(tmp_path / "a.mcap", {"camera": "fine"})
    with (
        pytest.raises(RecordingError, match="no list of name, value and verdict"),
        Case([path]) as case,
    ):
        case.rows(ASKED)


def test_what_record_measures_is_asked_after_replay(tmp_path: Path) -> None:
    folder, scene, out = tmp_path / "img1", tmp_path / "scene.mcap", tmp_path / "out.mcap"
    export_images(generate("pass_by", seed=3, frames=40), folder)
    assert main(["record", str(folder), "--fps", "10", "-o", str(scene)]) == 0
    assert main(["replay", str(scene), "-o", str(out)]) == 0
    with LogReader(scene) as log:
        (measured,) = recorded_quality(log.metadata(), scene).values()
    assert len(measured) >= 4
    assert measured[0].name == "overall"
    with Case([out]) as case:
        assert case.rows(ASKED) == sorted(
            ("out", m.name, m.value, m.verdict) for m in measured
        )
