"""What the plots draw: values counted by hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from replay.cli import main
from replay.evaluate import MotTable
from replay.evaluate.clear import match
from replay.evaluate.overlap import Overlap, overlap
from replay.evaluate.plots import mota_over_time, own_pairs, plot
from replay.evaluate.trajectories import centre_distance

Row = tuple[int, int, float, float, float, float, float]


def table(*paths: tuple[int, Callable[[int], float], range]) -> MotTable:
    rows: list[Row] = [
        (f, i, x(f), 0.0, 20.0, 40.0, 1.0) for i, x, frames in paths for f in frames
    ]
    return MotTable.from_rows(sorted(rows))


def distances(both: Overlap) -> dict[int, dict[int, float]]:
    """Distance to the own track by true identity and frame."""
    pairs = own_pairs(both)
    out: dict[int, dict[int, float]] = {}
    for pair, d in zip(pairs.tolist(), centre_distance(both, pairs).tolist(), strict=True):
        row = both.true_row[pair]
        out.setdefault(int(both.truth.ids[row]), {})[int(both.truth.frames[row])] = d
    return out


def test_distance_is_that_of_the_identitys_own_track_also_when_it_is_far_off() -> None:
    truth = table((1, lambda f: 10.0 * f, range(10)), (2, lambda f: 500.0, range(10)))
    # 7 follows 1 but lags by 3, then stays behind; 8 takes over for the last two frames. 9
    # follows 2 but for frame 4.
    result = table(
        (7, lambda f: 10.0 * min(f, 6) - 3, range(10)),
        (8, lambda f: 10.0 * f, range(8, 10)),
        (9, lambda f: 504.0, range(4)),
        (9, lambda f: 504.0, range(5, 10)),
    )
    found = distances(overlap(truth, result))
    assert found[1] == {f: (3.0 if f <= 6 else 3.0 + 10 * (f - 6)) for f in range(10)}
    assert found[2] == dict.fromkeys([0, 1, 2, 3, 5, 6, 7, 8, 9], 4.0)


def test_after_a_swap_both_tracks_are_far_off() -> None:
    truth = table((1, lambda f: 0.0, range(10)), (2, lambda f: 300.0, range(10)))
    result = table(
        (1, lambda f: 0.0 if f < 7 else 300.0, range(10)),
        (2, lambda f: 300.0 if f < 7 else 0.0, range(10)),
    )
    found = distances(overlap(truth, result))
    assert all(found[i][f] == (0.0 if f < 7 else 300.0) for i in (1, 2) for f in range(10))


def test_who_was_never_matched_has_no_track() -> None:
    both = overlap(
        table((1, lambda f: 0.0, range(3))), table((5, lambda f: 400.0, range(3)))
    )
    assert not len(own_pairs(both))


def test_mota_so_far_counts_misses_extras_and_switches_as_they_come() -> None:
    truth = table((1, lambda f: 0.0, range(1, 5)))
    result = table((5, lambda f: 0.0, range(3)), (6, lambda f: 0.0, range(4, 5)))
    both = overlap(truth, result)
    said = mota_over_time(both, match(both, 0.5))
    # Frame 0: an extra before any truth. 1, 2: hits. 3: a miss. 4: a hit, which is a switch.
    assert np.isnan(said[0])
    assert said[1:].tolist() == pytest.approx([0.0, 50.0, 100 / 3, 25.0])


def test_several_results_are_drawn_side_by_side(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    truth = table((1, lambda f: 10.0 * f, range(10)))
    plot(truth, truth, tmp_path / "one.svg")
    plot(truth, truth, tmp_path / "two.svg", name="mine", also=[("theirs", truth)])
    assert (tmp_path / "two.svg").read_text() != (tmp_path / "one.svg").read_text()
    gt, other = tmp_path / "gt.txt", tmp_path / "other.txt"
    gt.write_text("".join(f"{f},1,{10 * f},0,20,40,1,1,1\n" for f in range(1, 11)))
    other.write_text("".join(f"{f},1,{10 * f},0,20,40,1,-1,-1,-1\n" for f in range(1, 11)))
    words = ["eval", str(other), "--truth", str(gt), "--also", str(other)]
    assert main([*words, "--plot", str(tmp_path / "plot.png")]) == 0
    assert (tmp_path / "plot.png").exists()
    assert main(words) == 2
    assert "--plot" in capsys.readouterr().err
