"""CAVIAR XML: boxes by centre, nothing of who is who."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from recorders.messages import Detections
from recorders.sources import Source, open_source

OBJECT = """<object id="{id}"><orientation>0</orientation><box h="{h}" w="{w}" xc="{xc}" yc="{yc}"/>
<appearance>visible</appearance><hypothesislist><hypothesis id="1"><role>walker</role></hypothesis>
</hypothesislist></object>"""


def document(
    folder: Path, *frames: tuple[int, list[tuple[int, int, int, int, int]]]
) -> Path:
    """Frames of (number, objects); an object is (id, xc, yc, w, h)."""
    text = ""
    for number, objects in frames:
        inside = "".join(
            OBJECT.format(id=i, xc=x, yc=y, w=w, h=h) for i, x, y, w, h in objects
        )
        text += (
            "<frame"
            f' number="{number}"><objectlist>{inside}</objectlist><grouplist/></frame>'
        )
    path = folder / "scene.xml"
    path.write_text(
        f'<?xml version="1.0" encoding="UTF-8"?><dataset name="scene">{text}</dataset>'
    )
    return path


def detections(source: Source) -> list[Detections]:
    return [f.detections for f in source.frames() if f.detections is not None]


def test_boxes_are_by_their_centre(tmp_path: Path) -> None:
    source = open_source(document(tmp_path, (0, []), (1, [(7, 100, 50, 21, 40)])))
    assert (source.width, source.height, source.frame_ns, source.frame_count) == (
        384,
        288,
        40_000_000,
        2,
    )
    assert not source.has_images
    found = detections(source)
    assert found[0].boxes == []
    assert found[1].boxes == [(89.5, 30, 21, 40)]
    assert found[1].scores == [1.0]
    assert source.notes == source.losses == []


def test_rate_and_size_can_be_said(tmp_path: Path) -> None:
    source = open_source(
        document(tmp_path, (0, []), (1, [(7, 500, 50, 20, 40)])), fps=10, size=(640, 480)
    )
    assert [f.time_ns for f in source.frames()] == [0, 100_000_000]
    assert (source.width, source.height) == (640, 480)


def test_ids_and_their_order_do_not_reach_the_detections(tmp_path: Path) -> None:
    objects = [(1, 200, 50, 20, 40), (2, 100, 60, 20, 40), (3, 150, 10, 20, 40)]
    first = detections(open_source(document(tmp_path, (0, objects))))
    renamed = [(9 - i, x, y, w, h) for i, x, y, w, h in reversed(objects)]
    assert detections(open_source(document(tmp_path, (0, renamed)))) == first
    assert [b[0] for b in first[0].boxes] == [90, 140, 190]


def test_frames_that_are_left_out_have_no_detections_and_numbers_count_from_the_first(
    tmp_path: Path,
) -> None:
    source = open_source(
        document(tmp_path, (5, [(1, 10, 10, 4, 4)]), (7, [(1, 12, 10, 4, 4)]))
    )
    assert [(d.frame, len(d.boxes)) for d in detections(source)] == [(0, 1), (1, 0), (2, 1)]


def test_groups_are_ignored(tmp_path: Path) -> None:
    path = document(tmp_path, (0, [(1, 10, 10, 4, 4)]))
    group = (
        '<grouplist><group id="0"><box h="50" w="50" xc="50"'
        ' yc="50"/><members>1,2</members></group></grouplist>'
    )
    path.write_text(path.read_text().replace("<grouplist/>", group))
    assert detections(open_source(path))[0].boxes == [(8, 8, 4, 4)]


@pytest.mark.parametrize("name", ["Walk1", "Meet_Crowd", "Fight_OneManDown1"])
def test_the_real_sequences_hold_the_labelled_boxes_and_nothing_else(
    real_data: Path, name: str
) -> None:
    path = real_data / f"caviar/{name}.xml"
    expected = []
    for frame in ElementTree.parse(path).iter("frame"):
        boxes = [o.find("box") for o in frame.iterfind("objectlist/object")]
        values = [
            [int(b.get(k, "")) for k in ("xc", "yc", "w", "h")]
            for b in boxes
            if b is not None
        ]
        expected.append(sorted((xc - w / 2, yc - h / 2, w, h) for xc, yc, w, h in values))
    found = detections(open_source(path))
    assert [[tuple(b) for b in d.boxes] for d in found] == expected
    assert all(set(d.labels) <= {""} for d in found)


def test_every_real_sequence_is_read(real_data: Path) -> None:
    paths = sorted((real_data / "caviar").glob("*.xml"))
    assert len(paths) == 12
    for path in paths:
        source = open_source(path)
        frames = len(re.findall(rb"<frame ", path.read_bytes()))
        assert len(list(source.frames())) == source.frame_count == frames
