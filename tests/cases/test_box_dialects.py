"""Boxes as tools and spreadsheets of all kinds write them: read alike, or asked about."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from recorders.errors import SourceError, UsageError
from recorders.formats.columns import parse_columns
from recorders.formats.opening import BoxOptions
from recorders.messages import Box
from recorders.sources import open_source
from replay.evaluate.truth import read_table

WIDTH, HEIGHT, FRAMES = 320, 240, 30
Row = tuple[int, int, float, float, float, float]


def box(k: int, who: int) -> Box:
    """Two bodies that walk towards each other."""
    left = (10.25 + 3.5 * k, 60.5, 20.0, 56.25)
    return left if who == 0 else (280.75 - 3.25 * k, 80.5, 24.0, 61.5)


ROWS: list[Row] = [(k, who, *box(k, who)) for k in range(FRAMES) for who in (0, 1)]
Cells = Callable[[Row], list[Any]]


def mot(row: Row) -> list[Any]:
    k, who, *place = row
    return [k + 1, who + 1, *place, 0.9, -1, -1, -1]


def corners(row: Row) -> list[float]:
    _, _, x, y, w, h = row
    return [x, y, x + w, y + h]


def lines(cells: Cells, separator: str = ",", head: str = "", comma: bool = False) -> str:
    """A row a line; ``comma``: with decimal commas."""
    texts = [[str(cell) for cell in cells(row)] for row in ROWS]
    if comma:
        texts = [[cell.replace(".", ",") for cell in text] for text in texts]
    return "\n".join([*([head] if head else []), *map(separator.join, texts)])


def quoted(row: Row) -> list[Any]:
    return [f'"{cell}"'.replace(".", ",") for cell in mot(row)[:7]]


def objects(make: Callable[[Row], dict[str, Any]]) -> str:
    return "\n".join(json.dumps(make(row)) for row in ROWS)


def frames(make: Callable[[Row], dict[str, Any]]) -> list[list[dict[str, Any]]]:
    return [[make(row) for row in ROWS if row[0] == k] for k in range(FRAMES)]


def plain(row: Row) -> dict[str, Any]:
    return {"bbox": list(row[2:]), "score": 0.9}


def share(row: Row) -> dict[str, Any]:
    _, _, x, y, w, h = row
    place = {
        "center_x": (x + w / 2) / WIDTH,
        "center_y": (y + h / 2) / HEIGHT,
        "width": w / WIDTH,
        "height": h / HEIGHT,
    }
    return {"name": "person", "relative_coordinates": place, "confidence": 0.9}


def box2d(row: Row) -> dict[str, Any]:
    return {"box2d": dict(zip(("x1", "y1", "x2", "y2"), corners(row), strict=True))}


def frigate(row: Row) -> dict[str, Any]:
    after = {"frame_time": 1.7e9 + row[0] / 25, "label": "person", "box": corners(row)}
    return {"type": "update", "before": {}, "after": after}


def columns() -> dict[str, dict[str, Any]]:
    names = ("frame", "who", "x", "y", "w", "h")
    return {
        n: {str(at): row[k] for at, row in enumerate(ROWS)} for k, n in enumerate(names)
    }


TEXTS: dict[str, tuple[str, str]] = {
    "pipes": (".txt", lines(mot, "|")),
    "pipes with names": (".csv", lines(lambda r: [r[0], *r[2:]], "|", "frame|x|y|w|h")),
    "decimal commas in quotes": (".csv", lines(quoted)),
    "decimal commas behind a comma and a blank": (".txt", lines(mot, ", ", comma=True)),
    "a spreadsheet's separator": (
        ".csv",
        lines(lambda r: [r[0], *r[2:]], ";", "sep=;\nframe;x;y;w;h", comma=True),
    ),
    "a comment of another kind": (".txt", "% made by me\n" + lines(mot, " ")),
    "dots in names": (
        ".csv",
        lines(lambda r: [r[0], *corners(r)], head="frame,box.x1,box.y1,box.x2,box.y2"),
    ),
    "times": (
        ".csv",
        lines(lambda r: [r[0] / 25, *r[2:]], head="timestamp,x,y,w,h"),
    ),
    "times in milliseconds": (
        ".csv",
        lines(lambda r: [r[0] * 40, *r[2:]], head="time_ms,x,y,w,h"),
    ),
    "times of a calendar": (
        ".csv",
        lines(lambda r: [1_750_000_000_000 + r[0] * 40, *r[2:]], head="time_ms,x,y,w,h"),
    ),
    "times as texts": (
        ".jsonl",
        objects(lambda r: {"time": f"2026-01-01T00:00:{r[0] / 25:06.3f}", **plain(r)}),
    ),
    "lists by frame": (".json", json.dumps(dict(enumerate(frames(plain))))),
    "lists by name": (
        ".json",
        json.dumps({f"{k:05d}.jpg": one for k, one in enumerate(frames(plain))}),
    ),
    "a list of frames": (
        ".json",
        json.dumps({"frames": [{"frame": k, "objects": f} for k, f in enumerate(frames(plain))]}),
    ),
    "Darknet": (
        ".json",
        json.dumps([{"frame_id": k, "objects": f} for k, f in enumerate(frames(share))]),
    ),
    "Scalabel": (
        ".json",
        json.dumps([{"frameIndex": k, "labels": f} for k, f in enumerate(frames(box2d))]),
    ),
    "columns": (".json", json.dumps(columns())),
    "Frigate's messages": (".jsonl", objects(frigate)),
}  # fmt: skip


def boxes_of(path: Path, **more: Any) -> list[list[Box]]:
    source = open_source(path, size=(WIDTH, HEIGHT), fps=25, **more)
    found = [f.detections for f in source.frames()]
    assert source.losses == []
    return [[] if one is None else one.boxes for one in found]


def assert_all(found: list[list[Box]]) -> None:
    assert len(found) == FRAMES
    for k, one in enumerate(found):
        for got, wanted in zip(sorted(one), [box(k, 0), box(k, 1)], strict=True):
            assert got == pytest.approx(wanted, abs=2e-3), k


@pytest.mark.parametrize("name", TEXTS)
def test_every_dialect_says_the_same(tmp_path: Path, name: str) -> None:
    suffix, text = TEXTS[name]
    path = tmp_path / f"found{suffix}"
    path.write_text(text)
    assert_all(boxes_of(path))


def yolo(row: Row, name: str = "0") -> str:
    _, _, x, y, w, h = row
    return f"{name} {(x + w / 2) / WIDTH} {(y + h / 2) / HEIGHT} {w / WIDTH} {h / HEIGHT}"


def kitti(row: Row, name: str = "person 0.0") -> str:
    return " ".join([name, "0 0.0", *(f"{v:f}" for v in corners(row)), *["0.0"] * 7, "0.9"])


def voc(row: Row) -> str:
    names = ("xmin", "ymin", "xmax", "ymax")
    sides = "".join(f"<{n}>{v}</{n}>" for n, v in zip(names, corners(row), strict=True))
    return f"<object><name>p</name><bndbox>{sides}</bndbox></object>"


def numbered(
    folder: Path, name: str, of_row: Callable[[Row], str], around: str = "{}"
) -> Path:
    for k in range(FRAMES):
        path = folder / name.format(k)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(around.format("\n".join(of_row(r) for r in ROWS if r[0] == k)))
    return folder


FOLDERS: dict[str, tuple[str, Callable[[Row], str], str, set[str]]] = {
    "ultralytics": ("labels/walk_{}.txt", yolo, "{}", {"0"}),
    "a data set": ("labels/train/{:06d}.txt", yolo, "{}", {"0"}),
    "class names": ("{:06d}.txt", lambda r: yolo(r, "person"), "{}", {"person"}),
    "DeepStream": ("00_000_{:06d}.txt", kitti, "{}", {"person"}),
    "a class of two words": (
        "{:06d}.txt", lambda r: kitti(r, "Road Sign 0.0"), "{}", {"Road Sign"},
    ),
    "another country": (
        "{:06d}.txt", lambda r: kitti(r).replace(".", ","), "{}", {"person"},
    ),
    "tracks": ("{:06d}.txt", lambda r: kitti(r, f"person {r[1] + 7} 0.0"), "{}", {"person"}),
    "Pascal VOC": ("Annotations/{:06d}.xml", voc, "<annotation>{}</annotation>", {"p"}),
}  # fmt: skip


@pytest.mark.parametrize("name", FOLDERS)
def test_folders_as_tools_lay_them_out(tmp_path: Path, name: str) -> None:
    form, of_row, around, labels = FOLDERS[name]
    folder = numbered(tmp_path / "found", form, of_row, around)
    assert_all(boxes_of(folder))
    source = open_source(folder, size=(WIDTH, HEIGHT), fps=25)
    found = [f.detections for f in source.frames()]
    assert {label for d in found if d is not None for label in d.labels} == labels
    scores = {score for d in found if d is not None for score in d.scores}
    assert scores == (
        {0.9} if of_row not in (yolo, voc) and "class" not in name else scores
    )


def test_several_folders_of_boxes_are_asked_about(tmp_path: Path) -> None:
    numbered(tmp_path, "labels/train/{:06d}.txt", yolo)
    numbered(tmp_path, "labels/val/{:06d}.txt", yolo)
    with pytest.raises(UsageError, match=r"several folders \(labels/train, labels/val\)"):
        open_source(tmp_path, size=(WIDTH, HEIGHT))


ASKED: dict[str, tuple[str, str, str, str]] = {
    "corners in a column": (
        ".csv",
        lines(lambda r: [r[0], f'"{corners(r)}"'], head="frame,bbox"),
        "as x2 does with x1",
        "frame,xyxy",
    ),
    "corners in lines": (
        ".jsonl",
        objects(lambda r: {"frame": r[0], "bbox": corners(r)}),
        "as x2 does with x1",
        "frame,xyxy",
    ),
    "a class behind": (
        ".txt",
        lines(lambda r: [r[0], *map(int, r[2:6]), r[1] + 2]),
        "a score or a class",
        "",
    ),
    "times without a unit": (
        ".csv",
        lines(lambda r: [r[0] * 40, *r[2:]], head="timestamp,x,y,w,h"),
        "its times are 40 apart",
        "time_ms,x,y,w,h",
    ),
    "times of a clock that began somewhere": (
        ".csv",
        lines(
            lambda r: [12 * 10**12 + r[0] * 40_000_000, *r[2:]], head="timestamp,x,y,w,h"
        ),
        "nor a time of the calendar",
        "",
    ),
    "names of pictures": (
        ".csv",
        lines(lambda r: [f"img/{r[0]:05d}.jpg", *corners(r), "person"]),
        "the first column names pictures",
        "file,x1,y1,x2,y2,label",
    ),
}


@pytest.mark.parametrize("name", ASKED)
def test_what_may_be_two_things_is_asked_about(tmp_path: Path, name: str) -> None:
    suffix, text, asked, answer = ASKED[name]
    path = tmp_path / f"found{suffix}"
    path.write_text(text)
    with pytest.raises(UsageError, match=asked) as caught:
        boxes_of(path)
    if answer:
        assert answer in str(caught.value)
        assert_all(boxes_of(path, boxes=BoxOptions(columns=parse_columns(answer))))


def test_commas_for_everything_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "found.txt"
    path.write_text(lines(lambda r: [r[0], 1, *(f"{v:.2f}" for v in r[2:])], comma=True))
    with pytest.raises(SourceError, match="separate columns and are decimal points"):
        boxes_of(path)


def test_a_class_has_its_name_where_it_has_a_number_too(tmp_path: Path) -> None:
    path = tmp_path / "found.csv"
    head = "x_min,y_min,x_max,y_max,class_id,confidence,class_name,frame_index"
    path.write_text(lines(lambda r: [*corners(r), 2, 0.9, "car", r[0]], head=head))
    source = open_source(path, size=(WIDTH, HEIGHT), fps=25)
    assert {d for f in source.frames() if f.detections for d in f.detections.labels} == {
        "car"
    }


def test_cvats_key_frames_stand_for_those_between(tmp_path: Path) -> None:
    def shape(row: Row) -> str:
        names = ("xtl", "ytl", "xbr", "ybr")
        sides = " ".join(f'{n}="{v}"' for n, v in zip(names, corners(row), strict=True))
        return f'<box frame="{row[0]}" keyframe="1" outside="0" {sides}/>'

    keys = [*range(0, FRAMES, 7), FRAMES - 1]
    assert max(b - a for a, b in pairwise(keys)) == 7
    tracks = "".join(
        f'<track id="{who}" label="p">'
        + "".join(shape(r) for r in ROWS if r[1] == who and r[0] in keys)
        + "</track>"
        for who in (0, 1)
    )
    path = tmp_path / "found.xml"
    path.write_text(f"<annotations>{tracks}</annotations>")
    assert_all(boxes_of(path))


def test_cvats_key_frames_too_far_apart_are_told(tmp_path: Path) -> None:
    sides = 'keyframe="1" outside="0" xtl="10" ytl="10" xbr="30" ybr="60"'
    boxes = "".join(f'<box frame="{frame}" {sides}/>' for frame in (0, 4, 200_004))
    path = tmp_path / "found.xml"
    path.write_text(f'<annotations><track id="0" label="p">{boxes}</track></annotations>')
    source = open_source(path, size=(WIDTH, HEIGHT), fps=25)
    found = sum(len(f.detections.boxes) for f in source.frames() if f.detections)
    assert found == 6
    assert source.losses == [
        "over 100,000 frames between two key frames of a track (the boxes between them),"
        " at found.xml, frame 4"
    ]


def test_columns_that_do_not_fit_are_told(tmp_path: Path) -> None:
    path = tmp_path / "found.jsonl"
    path.write_text(objects(lambda r: {"frame": r[0], "bbox": corners(r)}))
    options = BoxOptions(columns=parse_columns("frame,xyxy,score"))
    with pytest.raises(UsageError, match="says 3 columns; it holds 2: frame, bbox"):
        boxes_of(path, boxes=options)


TRUTHS: dict[str, tuple[str, str]] = {
    name: TEXTS[name]
    for name in ("pipes", "decimal commas in quotes", "a comment of another kind")
} | {
    "decimal commas behind a comma and a blank": (".txt", lines(mot, ", ", comma=True)),
    "semicolons": (".txt", lines(mot, ";", "sep=;", comma=True)),
    "tabs": (".txt", lines(mot, "\t", comma=True)),
    "nine columns from 0": (".txt", lines(lambda r: [*r, 1, 3, 1.0], ";")),
}


@pytest.mark.parametrize("name", TRUTHS)
def test_a_truth_may_be_written_alike(tmp_path: Path, name: str) -> None:
    suffix, text = TRUTHS[name]
    path = tmp_path / f"gt{suffix}"
    path.write_text(text)
    table = read_table(path)
    assert table.frames.tolist() == [row[0] for row in ROWS]
    assert len(set(table.ids.tolist())) == 2
    for got, row in zip(table.boxes.tolist(), ROWS, strict=True):
        assert got == pytest.approx(row[2:])
    if name.startswith("nine"):
        assert table.classes is not None
        assert set(table.classes.tolist()) == {3}


def test_corners_are_no_truth(tmp_path: Path) -> None:
    path = tmp_path / "gt.txt"
    path.write_text(lines(lambda r: [r[0] + 1, r[1] + 1, *corners(r), 1, -1, -1, -1]))
    with pytest.raises(SourceError, match="as x2 does with x1"):
        read_table(path)


def test_a_row_without_a_time_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "found.csv"
    text = lines(lambda r: [r[0] / 25, *r[2:]], head="time,x,y,w,h")
    path.write_text(text + "\n,1,2,30,40\n")
    source = open_source(path, size=(WIDTH, HEIGHT), fps=25)
    found = [f.detections for f in source.frames()]
    assert_all([[] if one is None else one.boxes for one in found])
    assert any("neither a frame nor a time" in one for one in source.losses)


def test_classes_count_that_the_first_row_does_not_have(tmp_path: Path) -> None:
    path = tmp_path / "found.jsonl"
    rows: list[dict[str, Any]] = [{"frame": 0, "bbox": [1, 2, 30, 40]}]
    rows += [{"frame": k, "bbox": [1, 2, 30, 40], "label": "dog"} for k in range(1, 5)]
    path.write_text("\n".join(map(json.dumps, rows)))
    found = [f.detections for f in open_source(path, size=(WIDTH, HEIGHT), fps=25).frames()]
    assert [d.labels for d in found if d] == [[""], *[["dog"]] * 4]


def test_a_truths_identities_may_be_words_and_what_is_no_box_is_told(
    tmp_path: Path,
) -> None:
    path = tmp_path / "gt.csv"
    head = "frame,id,x,y,w,h"
    path.write_text(lines(lambda r: [r[0], ("anna", "bert")[r[1] % 2], *r[2:]], head=head))
    table = read_table(path)
    assert len(table) == len(ROWS)
    assert len(set(table.ids.tolist())) == 2
    assert not table.left_out
    path.write_text(path.read_text().rstrip() + "\n3,anna,here,2,3,4\n")
    assert read_table(path).left_out
