"""Metres, heatmaps, and clocks that sources have of their own."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fixtures.scenes import GeneratedScene
from fixtures.scripts import Script, walk
from reasoning.questions import Case
from reasoning.questions.metres import (
    GroundPlane,
    from_heights,
    homography,
    placed,
    read_points,
)
from reasoning.questions.ready_questions import Options, question
from recorders.errors import UsageError
from recorders.pictures import decode_picture
from recorders.sources.own_clock import own_clock
from replay.cli import main

Filmed = Callable[..., tuple[GeneratedScene, Path]]
CAMERA = (900.0, 320.0, 120.0, 4.0)
"""Focal length, middle and horizon in pixels, height in metres."""


def seen_from_above(east: float, ahead: float) -> tuple[float, float]:
    focal, middle, horizon, height = CAMERA
    return middle + focal * east / ahead, horizon + focal * height / ahead


CORNERS = [(-4.0, 8.0), (4.0, 8.0), (5.0, 20.0), (-5.0, 20.0), (0.0, 12.0)]
WALKS = Script(
    "Two walk at their own paces", 8.0,
    (walk("0 .1 .8; 8 .9 .8", "red"), walk("0 .9 .95; 8 .5 .95", "blue")), fps=10,
)  # fmt: skip


def test_points_on_the_ground_give_the_ground() -> None:
    fit = homography([(seen_from_above(*p), p) for p in CORNERS])
    assert fit.residual_m < 1e-6
    for place in ((-3.0, 9.0), (2.0, 15.0), (4.0, 25.0)):
        assert placed(fit.matrix, seen_from_above(*place)) == pytest.approx(place, abs=1e-5)


def test_a_point_that_is_off_shows_in_the_error() -> None:
    pairs = [(seen_from_above(*p), p) for p in CORNERS]
    pairs[0] = (pairs[0][0], (-4.5, 8.0))
    assert 0.05 < homography(pairs).residual_m < 0.5


def test_people_all_along_the_ground_give_a_rough_one() -> None:
    focal, _, _, _ = CAMERA
    seen = []
    for k in range(200):
        ahead = 8.0 + 0.08 * k
        seen.append((seen_from_above(0.0, ahead)[1], 1.75 * focal / ahead))
    fit = from_heights(seen, (640, 480), 1.75)
    assert fit is not None
    for one, other in (((-2.0, 10.0), (2.0, 10.0)), ((0.0, 10.0), (0.0, 14.0))):
        pixels = (seen_from_above(*place) for place in (one, other))
        found = math.dist(*(placed(fit.matrix, p) for p in pixels))
        assert found == pytest.approx(4.0, rel=fit.share)
    flat = from_heights([(float(y), 50.0) for y in range(200)], (640, 480), 1.75)
    assert flat is not None
    assert placed(flat.matrix, (100.0, 0.0)) == pytest.approx((3.5, 0.0))
    assert from_heights(seen[:5], (640, 480), 1.75) is None


def test_how_far_and_how_fast(filmed: Filmed) -> None:
    """Ten pixels a metre, flat: 320 pixels are 32 m."""
    scene, path = filmed("walks", WALKS)
    square = ((0.0, 0.0), (320.0, 0.0), (320.0, 240.0), (0.0, 240.0))
    ground = GroundPlane(points=tuple((p, (p[0] / 10, p[1] / 10)) for p in square))
    with Case([path], ground=ground) as case:
        rows = list(case.sql(question("moved").sql([], Options())).rows)
        names = case.sql(question("moved").sql([], Options())).columns
        told = [dict(zip(names, row, strict=True)) for row in rows]
        for row, pixels in zip(told, (0.8 * 320, 0.4 * 320), strict=True):
            wanted = pixels / 10 / scene.script.seconds
            assert abs(row["mean_mps"] - wanted) <= row["mps_error"]
            assert row["mean_mps"] == pytest.approx(wanted, rel=0.1)
            assert row["metres"] == pytest.approx(row["straight_m"], rel=0.1)
        near = case.sql(question("apart").sql(["1", "2"], Options()))
        (row,) = (dict(zip(near.columns, r, strict=True)) for r in near.rows)
        wanted = min(
            math.dist(a.foot, b.foot) / 10
            for f in scene.truth.frames
            if (a := f.actor(1)) and (b := f.actor(2))
        )
        assert abs(row["least_m"] - wanted) <= max(row["least_error"], 0.5)
    with Case([path]) as case:
        assert case.rows("SELECT * FROM metres") == []


def test_points_that_are_none_are_said(tmp_path: Path) -> None:
    for text, said in (
        ("x,y\n1,2\n", "wanted the columns"),
        ("x,y,X,Y\n1,2,3,4\n", "at least 4"),
        ("x,y,X,Y\n1,2,3,here\n", "line 2 holds no four numbers"),
    ):
        file = tmp_path / "points.csv"
        file.write_text(text)
        with pytest.raises(UsageError, match=said):
            read_points(file)
    with pytest.raises(UsageError, match="lie on a line"):
        homography([((float(k), float(k)), (float(k), float(k))) for k in range(5)])


def test_a_heatmap_is_warm_where_people_were(filmed: Filmed, tmp_path: Path) -> None:
    scene, path = filmed("walks", WALKS)
    out = tmp_path / "heat.png"
    assert main(["query", str(path), "--ask", "heatmap", "1", "-o", str(out)]) == 0
    image = decode_picture(out.read_bytes())
    assert image.shape == (scene.height, scene.width, 3)
    colour = image.max(axis=2).astype(int) - image.min(axis=2)
    foot = round(0.8 * scene.height)
    assert (colour[foot, 60:260] > 40).mean() > 0.9
    assert (colour[: foot - 40] > 40).mean() < 0.01
    assert main(["query", str(path), "--ask", "heatmap", "-o", str(out)]) == 1
    again = tmp_path / "again.png"
    main(["query", str(path), "--ask", "heatmap", "1", "-o", str(again)])
    assert again.read_bytes() == out.read_bytes()


@pytest.mark.parametrize(
    ("name", "wanted"),
    [("cam_20260131_120340.avi", "2026-01-31T12:03:40Z"), ("2026-01-31 12.03.mp4", "2026-01-31T12:03:00Z"),
     ("frame_000123.avi", ""), ("20261399_990000.avi", "")],
)  # fmt: skip
def test_a_files_name_may_say_when(name: str, wanted: str) -> None:
    assert [when for when, _ in own_clock(Path(name))] == ([wanted] if wanted else [])


def test_record_offers_a_sources_own_clock(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import av

    video = tmp_path / "door.mp4"
    with av.open(str(video), "w") as container:
        container.metadata["creation_time"] = "2026-01-31T12:03:40.000000Z"
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for k in range(12):
            picture = np.full((48, 64, 3), 10 * k, np.uint8)
            container.mux(
                stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24"))
            )
        container.mux(stream.encode())
    log = tmp_path / "door.mcap"
    assert main(["record", str(video), "-o", str(log)]) == 0
    assert "--start 2026-01-31T12:03:40Z takes it" in capsys.readouterr().err
    assert main(["record", str(video), "-o", str(log), "--force", "--start", "2026-01-31T12:00:00Z"]) == 0  # fmt: skip
    assert "clock of its own" not in capsys.readouterr().err
