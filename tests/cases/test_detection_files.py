"""Detections as people's files have them: read, asked about, or left out and told."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from recorders.errors import SourceError, UsageError
from recorders.formats.columns import parse_columns
from recorders.formats.opening import BoxOptions
from recorders.messages import Detections
from recorders.sources import Source, open_source
from tests.cases.conftest import Case

SIZE = (320, 240)


def read(path: Path, **more: object) -> tuple[Source, list[Detections]]:
    source = open_source(path, fps=25, size=SIZE, **more)  # type: ignore[arg-type]
    found = [f.detections for f in source.frames()]
    return source, [d for d in found if d is not None]


@pytest.fixture(scope="session")
def plain(case: Case) -> list[Detections]:
    """The walkers as MOTChallenge has them."""
    return read(case("video/m_mot", "negid", suffix=".txt"))[1]


@pytest.mark.parametrize(
    "kind",
    [
        "header", "hash", "space", "tab", "semicolon", "commaspace", "decimalcomma", "floats",
        "emptyid", "c6", "c7", "c8", "c9", "c11", "feat", "trailing", "ragged", "bom", "utf16",
        "cr", "dup", "unsorted", "hugeid", "uuid", "id0", "sameid", "tracks", "confneg",
    ],
)  # fmt: skip
def test_every_width_and_separator_says_the_same(
    case: Case, plain: list[Detections], kind: str
) -> None:
    _, found = read(case("video/m_mot", kind, suffix=".txt"))
    for one, wanted in zip(found, plain, strict=True):
        assert sorted(one.boxes) == sorted(wanted.boxes), kind


@pytest.mark.parametrize("kind", ["frame0", "frame0t", "kitti", "sv"])
def test_frames_from_0_are_the_same_frames(
    case: Case, plain: list[Detections], kind: str
) -> None:
    path = case("video/m_mot", kind, suffix=".txt")
    if kind.startswith("frame0"):
        # No row of frame 0 tells: it is said, and can be told.
        assert any("frames counted from 1 (--first-frame" in n for n in read(path)[0].notes)
        source, found = read(path, boxes=BoxOptions(first_frame=0))
    else:
        source, found = read(path)
    with_boxes = [d.frame for d in found if d.boxes]
    wanted = [d.frame for d in plain if d.boxes]
    assert with_boxes == wanted
    assert any("frames counted from 0" in note for note in source.notes)


@pytest.mark.parametrize(
    ("kind", "labels"),
    [("vid", {"person"}), ("visdrone", {"4"}), ("mixedclass", {"1", "3"}), ("gt9", {"1"})],
)
def test_classes_are_kept(case: Case, kind: str, labels: set[str]) -> None:
    _, found = read(case("video/m_mot", kind, suffix=".txt"))
    assert {label for d in found for label in d.labels} == labels


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        ("nan", "a row with a number that is not finite"),
        ("zero", "a box without width or height"),
        ("neg", "a box without width or height"),
        ("off", "a box beyond the picture"),
    ],
)
def test_a_row_that_is_no_box_is_left_out(
    case: Case, plain: list[Detections], kind: str, told: str
) -> None:
    source, found = read(case("video/m_mot", kind, suffix=".txt"))
    total = sum(len(d.boxes) for d in plain)
    assert sum(len(d.boxes) for d in found) == total - 1
    assert source.losses == [f"{told}, at m_mot.txt:41"]


def test_corners_are_asked_about(case: Case, plain: list[Detections]) -> None:
    path = case("video/m_mot", "xyxy", suffix=".txt")
    with pytest.raises(UsageError, match="as x2 does with x1; say which it is: --columns"):
        read(path)
    columns = parse_columns("frame,id,x1,y1,x2,y2,score")
    _, found = read(path, boxes=BoxOptions(columns))
    for one, wanted in zip(found, plain, strict=True):
        assert [x for box in one.boxes for x in box] == pytest.approx(
            [x for box in wanted.boxes for x in box]
        )


def test_shares_of_the_picture_are_asked_about(case: Case, plain: list[Detections]) -> None:
    path = case("video/m_mot", "norm", suffix=".txt")
    with pytest.raises(UsageError, match="between 0 and 1, as shares of the picture do"):
        read(path)
    _, found = read(path, boxes=BoxOptions(parse_columns("frame,id,xn,yn,wn,hn,score")))
    for one, wanted in zip(found, plain, strict=True):
        assert [x for box in one.boxes for x in box] == pytest.approx(
            [x for box in wanted.boxes for x in box]
        )


def test_six_columns_are_asked_about_where_they_may_be_corners(tmp_path: Path) -> None:
    path = tmp_path / "det.csv"
    path.write_text("".join(f"{k},{10 + k}.5,20,40,60,0.9\n" for k in range(1, 10)))
    with pytest.raises(UsageError, match="six columns"):
        read(path)


@pytest.mark.parametrize("kind", ["empty", "onlyheader"])
def test_a_file_without_rows_is_named(case: Case, kind: str) -> None:
    with pytest.raises(SourceError, match=r"the file is empty|no detections in this file"):
        read(case("video/m_mot", kind, suffix=".txt"))


FORMATS = ["coco.json", "coco_results.json", "sv.csv", "sv.json", "lines.jsonl", "yolo", "kitti",
           "labelme", "cvat.xml"]  # fmt: skip


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_says_the_same(case: Case, name: str) -> None:
    folder = case("video/d_formats")
    _, found = read(folder / name)
    _, wanted = read(folder / "lines.jsonl")
    assert len(found) == 100
    assert sum(len(d.boxes) for d in found) == 162
    for one, other in zip(found, wanted, strict=True):
        assert [x for box in sorted(one.boxes) for x in box] == pytest.approx(
            [x for box in sorted(other.boxes) for x in box], abs=0.11
        )
    if name in ("coco.json", "kitti", "labelme", "cvat.xml"):
        assert {label for d in found for label in d.labels} == {"person"}


@pytest.mark.parametrize("name", ["dlc.csv", "idtracker.csv"])
def test_points_without_boxes_are_refused_by_name(case: Case, name: str) -> None:
    with pytest.raises(SourceError, match="no column of frames"):
        read(case("video/d_formats") / name)


def test_events_of_frigate(case: Case) -> None:
    source, found = read(case("video/d_formats") / "events.json")
    assert found[0].boxes == [pytest.approx((32.0, 48.0, 32.0, 72.0))]
    assert "each event gives one box, at its start" in source.notes


def test_detections_go_with_the_pictures_of_their_number(case: Case) -> None:
    folder = case("video/f_det_gap")
    source = open_source(folder, detections=f"{folder}.det.txt", fps=25)
    frames = list(source.frames())
    assert [f.index for f in frames] == list(range(60))
    assert [f.index for f in frames if not f.has_picture] == [20, 21, 40]
    assert [f.time_ns for f in frames] == [k * 40_000_000 for k in range(60)]
    assert sum(len(f.detections.boxes) for f in frames if f.detections) == 111
    for f in frames:
        # The first walker goes by 1.6 px a frame.
        x = min((b[0] for b in f.detections.boxes), default=0.0) if f.detections else 0.0
        assert x == pytest.approx(max(-20 + 1.6 * f.index, 0), abs=25)


BOX = (14.0, 20.0, 30.0, 60.0)


def test_a_coco_object_without_a_box_has_that_of_its_polygon_and_a_crowd_is_none(
    tmp_path: Path,
) -> None:
    images = [{"id": 7, "file_name": "img_1.jpg", "width": 320, "height": 240}]
    polygon = [14, 20, 44, 20, 44, 80, 14, 80]
    annotations = [
        {"id": 1, "image_id": 7, "category_id": 1, "segmentation": [polygon]},
        {"id": 2, "image_id": 7, "category_id": 1, "bbox": [5, 5, 9, 9], "iscrowd": 1},
    ]
    document = {
        "images": images,
        "annotations": annotations,
        "categories": [{"id": 1, "name": "person"}],
    }
    path = tmp_path / "coco.json"
    path.write_text(json.dumps(document))
    source, found = read(path)
    assert [d.boxes for d in found] == [[BOX]]
    assert source.losses == [
        "a crowd, which is no single object, at coco.json, annotation 2"
    ]


def test_a_region_that_kitti_does_not_care_about_is_no_object(tmp_path: Path) -> None:
    rest = "-1 -1 -1 -1000 -1000 -1000 -10"
    path = tmp_path / "0000.txt"
    path.write_text(
        f"0 1 Pedestrian 0 0 -10 14 20 44 80 {rest}\n0 -1 DontCare -1 -1 -10 5 5 50 50 {rest}\n"
    )
    source, found = read(path)
    assert [(d.boxes, d.labels) for d in found] == [([BOX], ["Pedestrian"])]
    assert not source.losses


def test_a_json_row_with_nan_is_left_out_alone(tmp_path: Path) -> None:
    rows = [
        {"frame": 0, "x1": 14.0, "y1": 20.0, "x2": 44.0, "y2": 80.0},
        {"frame": 0, "x1": 14.0, "y1": 20.0, "x2": 44.0, "y2": float("nan")},
    ]
    path = tmp_path / "rows.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    source, found = read(path)
    assert [d.boxes for d in found] == [[BOX]]
    assert source.losses == ["a row with a number that is not finite, at rows.jsonl:2"]
