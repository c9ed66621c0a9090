"""A recorder that pauses for a night: nobody knows what happened then, and everything says so."""

from __future__ import annotations

from pathlib import Path

import pytest

from replay.cli import main
from tests.cases.conftest import Case
from tests.cases.test_logs import recorded, replayed, tables


@pytest.fixture(scope="module")
def night(case: Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The annotated log of two seconds in the evening and two in the morning."""
    folder = tmp_path_factory.mktemp("night")
    return replayed(recorded(case("video/t_nightgap", "8", suffix=".mkv"), folder), folder)


@pytest.mark.parametrize("tracker", ["events", "shells", "parts"])
def test_tracks_end_over_a_gap(
    case: Case, night: Path, tmp_path: Path, tracker: str
) -> None:
    log = tmp_path / "a.mcap"
    words = ["replay", str(night), "-o", str(log), "--tracker", tracker]
    assert main(words) == 0
    spans = tables(log, "SELECT start_frame, end_frame FROM presence", tmp_path)
    assert len(spans) >= 4
    assert all(first >= 50 or last < 50 for first, last in spans)  # type: ignore[operator]


def test_a_question_about_the_gap_is_answered_with_it(
    night: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (["--at", "14400"], ["--at", "4h"]):
        assert main(["query", str(night), "--ask", "who-was-in", "scene", *words]) == 0
        told = "nothing was recorded then: from 1.96 s to 28802.00 s, 28800 s (8 h 0 min)"
        assert told in capsys.readouterr().err
    assert main(["query", str(night), "--ask", "who-was-in", "scene", "--at", "1.5"]) == 0
    assert "recorded" not in capsys.readouterr().err
    assert main(["query", str(night), "--pattern", "meeting(a,b)"]) == 0
    assert "Nothing was recorded from 1.96 s to 28802.00 s" in capsys.readouterr().err


def test_a_film_bridges_the_gap_with_a_title(night: Path, tmp_path: Path) -> None:
    import av

    film = tmp_path / "film.mp4"
    assert main(["export", str(night), "--to", "video", "-o", str(film)]) == 0
    with av.open(str(film)) as container:
        pictures = [(float(f.time or 0), f.to_ndarray(format="gray")) for f in container.decode(video=0)]  # fmt: skip
    assert len(pictures) == 101
    times = [time for time, _ in pictures]
    assert times[49:52] == pytest.approx([1.96, 2.0, 4.96], abs=0.01)
    assert times[-1] == pytest.approx(6.92, abs=0.01)
    before, title = pictures[49][1], pictures[50][1]
    assert title.mean() < before.mean() / 3
    height, width = title.shape
    middle = title[height // 2 - 12 : height // 2 + 16, width // 4 : -width // 4]
    assert (middle > 180).sum() > 200, "white letters"
