"""Reading truth and results: what is taken, and what every wrong file is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from recorders.errors import SceneTraceError, SourceError
from replay.evaluate import MotTable, fit_truth, read_caviar, read_mot, read_truth


def wrote(folder: Path, text: str, name: str = "gt.txt") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_rows_in_any_order_frames_from_one(tmp_path: Path) -> None:
    table = read_mot(
        wrote(tmp_path, "2,1,5,6,7,8,1\n\n1, 9, 1.5,2,3,4,0.25\r\n1 3 0 0\t1 1 1\n")
    )
    assert table.frames.tolist() == [0, 0, 1]
    assert table.ids.tolist() == [9, 3, 1]
    assert table.boxes[0].tolist() == [1.5, 2.0, 3.0, 4.0]
    assert table.confidences.tolist() == [0.25, 1.0, 1.0]


def test_a_header_is_skipped_and_no_rows_are_no_error(tmp_path: Path) -> None:
    named = read_mot(wrote(tmp_path, "frame,id,x,y,w,h,conf\n1,9,1,2,3,4,1\n"))
    assert named.ids.tolist() == [9]
    assert len(read_mot(wrote(tmp_path, ""))) == 0


def test_truth_of_confidence_zero_does_not_count(tmp_path: Path) -> None:
    path = wrote(tmp_path, "1,1,0,0,9,9,1\n1,2,0,0,9,9,0\n2,1,0,0,9,9,-1\n")
    assert len(read_mot(path)) == 3
    assert read_truth(path).ids.tolist() == [1, 1]
    with pytest.raises(SourceError, match="no row has a confidence other than 0"):
        read_truth(wrote(tmp_path, "1,2,0,0,9,9,0\n", "none.txt"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,1,0,0,5\n", r"gt.txt:1: 5 columns, wanted 6 to 10"),
        (
            "1,1,0,0,5,5\n1,2,x,0,5,5\n",
            r"gt.txt:2: x 'x' is not a number: not MOTChallenge text",
        ),
        (
            "1,1,0,0,5,5,1\n1,2,0,0,5,5\n",
            r"gt.txt:2: 6 columns, wanted 7 as in the first row",
        ),
        ("1,1,0,0,5,0\n", r"a box of width 5 and height 0: both must be over 0"),
        ("id,frame,x,y,w,h\n1,1,0,0,5,5\n", r"gt.txt:1: the columns 'id,frame,x,y,w,h'"),
        ("frame,id,x1,y1,x2,y2\n1,1,0,0,5,5\n", r"wanted frame,id,x,y,w,h"),
        ("1.5,1,0,0,5,5\n", r"frame 1.5: frames are whole numbers"),
        ("1,1.5,0,0,5,5\n", r"identity 1.5: must be a whole number"),
        ("1,1e300,0,0,5,5\n", r"identity 1e300: must be a whole number"),
        ("1,1,nan,0,5,5\n", r"x is nan, a finite number is wanted"),
        ("1,1,0,0,-5,5\n", r"a box of width -5 and height 5: both must be over 0"),
        (
            "1,4,0,0,5,5\n2,4,0,0,5,5\n1,4,1,1,5,5\n",
            r"gt.txt:3: identity 4 occurs twice in frame 1 \(line 1\)",
        ),
        ("1,-1,0,0,5,5\n1,-1,1,1,5,5\n", r"these are detections, not tracks"),
    ],
)
def test_wrong_rows_are_named(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=message):
        read_mot(wrote(tmp_path, text))


def test_no_file_and_no_text(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="cannot be read: No such file"):
        read_mot(tmp_path / "absent.txt")
    (tmp_path / "binary.txt").write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(SourceError, match="not MOTChallenge text"):
        read_mot(tmp_path / "binary.txt")


CAVIAR = """<?xml version="1.0"?><dataset name="t">
<frame number="0"><objectlist><object id="3"><box h="20" w="10" xc="50" yc="60"/></object></objectlist></frame>
<frame number="1"><objectlist><object id="3"><box h="20" w="10" xc="52" yc="60"/></object>
<object id="4"><box h="8" w="6" xc="9" yc="9"/></object></objectlist><grouplist/></frame></dataset>"""


def test_caviar_boxes_are_by_centre_and_frames_from_zero(tmp_path: Path) -> None:
    table = read_truth(wrote(tmp_path, CAVIAR, "t.xml"))
    assert table.frames.tolist() == [0, 1, 1]
    assert table.ids.tolist() == [3, 3, 4]
    assert table.boxes[0].tolist() == [45.0, 50.0, 10.0, 20.0]
    assert table.centres[1].tolist() == [52.0, 60.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<dataset><frame", "not CAVIAR XML"),
        ("<html/>", "no frame holds an object"),
        (
            "<!DOCTYPE d [<!ENTITY a 'b'>]><dataset>&a;</dataset>",
            "a DOCTYPE in the XML: refused",
        ),
        (
            CAVIAR.replace('xc="52"', ""),
            'frame 1: an object with xc="": a whole number is wanted',
        ),
        (CAVIAR.replace('w="6"', 'w="nan"'), 'frame 1: an object with w="nan"'),
        (CAVIAR.replace('id="4"', ""), "frame 1: an object without id"),
        (CAVIAR.replace('id="4"', 'id="3"'), "identity 3 occurs twice in frame 1"),
    ],
)
def test_wrong_xml_is_named(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=message):
        read_caviar(wrote(tmp_path, text, "t.xml"))


@pytest.mark.real
def test_every_caviar_file_is_read(real_data: Path) -> None:
    files = sorted((real_data / "caviar").glob("*.xml"))
    assert len(files) == 12
    for path in files:
        table = read_caviar(path)
        assert len(table) > 100
        assert table.frames[0] >= 0


def boxes_to(right: float, bottom: float) -> MotTable:
    return MotTable.from_rows(
        [
            (f, 1, right * f / 10 - 5, bottom * f / 10 - 5, 10.0, 10.0, 1.0)
            for f in range(11)
        ]
    )


def test_truth_of_another_size_must_be_said() -> None:
    truth = boxes_to(760, 570)
    with pytest.raises(
        SceneTraceError,
        match=r"reaches to \(765, 575\) but the recording is 480x360.*--truth-size",
    ):
        fit_truth(truth, (480, 360), None)
    with pytest.raises(SceneTraceError, match="picture given by --truth-size is 640x480"):
        fit_truth(truth, (480, 360), (640, 480))
    fitted = fit_truth(truth, (480, 360), (768, 576))
    assert fitted.boxes[-1].tolist() == pytest.approx(
        [755 * 0.625, 565 * 0.625, 6.25, 6.25]
    )


def test_truth_may_reach_over_the_edge_a_little() -> None:
    truth = boxes_to(478, 358)
    assert fit_truth(truth, (480, 360), None) is truth
    stretched = fit_truth(truth, (960, 360), (480, 360))
    assert stretched.boxes[:, 2].tolist() == pytest.approx([20.0] * 11)
    assert stretched.boxes[:, 3].tolist() == pytest.approx([10.0] * 11)
