"""MOTChallenge text, alone and beside pictures."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorders.errors import LimitError, SourceError, UsageError
from recorders.limits import Limits
from recorders.messages import NO_BLOB, Detections
from recorders.pictures import encode_png
from recorders.sources import Source, open_source


def text(folder: Path, *rows: str) -> Path:
    path = folder / "det.txt"
    path.write_text("\n".join(rows) + "\n")
    return path


def detections(source: Source) -> list[Detections]:
    found = [f.detections for f in source.frames()]
    assert all(d is not None for d in found)
    return [d for d in found if d is not None]


def test_rows_become_detections_with_every_frame_from_the_first(tmp_path: Path) -> None:
    path = text(
        tmp_path,
        "2,-1,10,20,30.5,40,0.9,-1,-1,-1",
        "2,-1,5,6,7,8,-3,-1,-1,-1",
        "4,-1,1,1,1,1,1,-1,-1,-1",
    )
    source = open_source(path, fps=10, size=(100, 80))
    assert not source.has_images
    assert (source.width, source.height, source.frame_count, source.notes) == (
        100,
        80,
        4,
        [],
    )
    found = detections(source)
    assert [d.frame for d in found] == [0, 1, 2, 3]
    assert [len(d.boxes) for d in found] == [0, 2, 0, 1]
    assert found[1].boxes == [(10, 20, 30.5, 40), (5, 6, 7, 8)]
    assert found[1].scores == [0.9, -3]
    assert found[1].blobs == [NO_BLOB, NO_BLOB]
    assert [f.time_ns for f in source.frames()] == [0, 10**8, 2 * 10**8, 3 * 10**8]
    assert source.losses == []


def test_size_and_rate_that_are_not_given_are_assumed_and_said(tmp_path: Path) -> None:
    source = open_source(text(tmp_path, "1,-1,10,20,30.5,40,1"))
    assert (source.width, source.height, source.frame_ns) == (41, 60, 40_000_000)
    assert [n.split(":")[1].split(";")[0] for n in source.notes] == [
        " assuming 25 frames per second",
        " assuming 41x60, as far as boxes reach",
    ]


def test_unsorted_frames_are_sorted_and_said(tmp_path: Path) -> None:
    path = text(
        tmp_path, "3,-1,3,1,5,5,1", "1,-1,1,1,5,5,1", "3,-1,2,1,5,5,1", "2,-1,4,1,5,5,1"
    )
    source = open_source(path, fps=1, size=(50, 50))
    assert [[b[0] for b in d.boxes] for d in detections(source)] == [[1], [4], [3, 2]]
    assert source.notes == ["det.txt: the frames are not in order; they were sorted"]
    assert source.losses == []


def test_repeated_rows_are_left_out_and_counted(tmp_path: Path) -> None:
    row = "1,-1,1,1,5,5,0.5"
    source = open_source(
        text(tmp_path, row, "1,-1,1,1,5,5,0.6", row, row), fps=1, size=(50, 50)
    )
    for _ in range(2):
        assert detections(source)[0].scores == [0.5, 0.6]
        assert source.losses == [
            "a row that repeats another row of its frame: 2 times, the first at det.txt:3"
        ]


def test_identities_do_not_reach_the_detections_even_by_their_order(tmp_path: Path) -> None:
    rows = [
        f"{f},{i},{10 * i + f},{50 - 3 * i},8,9,1" for f in range(1, 6) for i in range(1, 5)
    ]
    answers = []
    for seed in range(3):
        random.Random(seed).shuffle(rows)
        answers.append(
            detections(open_source(text(tmp_path, *rows), fps=1, size=(100, 100)))
        )
    assert answers[0] == answers[1] == answers[2]
    renamed = [r.replace(",1,", ",9,", 1) for r in rows]
    assert (
        detections(open_source(text(tmp_path, *renamed), fps=1, size=(100, 100)))
        == answers[0]
    )


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (
            "1,-1,60,2,3,4,1",
            (
                r"det\.txt:2: detections beyond the picture: a box at 60, 2 of 3 x 4, the"
                r" picture is 50x50"
            ),
        ),
        ("1,-1," + "1" * 70000, r"det\.txt:2: a line of over 65536 characters"),
        ("9" * 12 + ",-1,1,2,3,4,1", r"det\.txt:2: frame 999999999999, over the limit"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(
    tmp_path: Path, row: str, message: str
) -> None:
    path = text(tmp_path, "1,-1,1,2,3,4,1", row)
    with pytest.raises((SourceError, LimitError), match=message):
        open_source(path, fps=1, size=(50, 50))


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("1.5,-1,1,2,3,4,1", "frame 1.5: frames are whole numbers from 0 or 1"),
        ("1,-1,1,two,3,4,1", "y 'two' is not a number"),
        ("1,-1,1,1_0,3,4,1", "y '1_0' is not a number"),
    ],
)
def test_a_row_that_is_none_is_left_out(tmp_path: Path, row: str, told: str) -> None:
    source = open_source(text(tmp_path, "1,-1,1,2,3,4,1", row), fps=1, size=(50, 50))
    assert len(detections(source)) == 1
    assert source.losses == [f"a row that is none ({told}), at det.txt:2"]


def test_blanks_and_tabs_part_the_cells_of_a_row_without_commas(tmp_path: Path) -> None:
    path = text(tmp_path, "frame id x y w h", "1 -1 1 2 3 4", "2\t-1\t1\t2\t3\t4")
    found = detections(open_source(path, fps=1, size=(9, 9)))
    assert [d.boxes for d in found] == [[(1, 2, 3, 4)]] * 2


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("1,-1,nan,2,3,4,1", "a row with a number that is not finite"),
        ("1,-1,1,inf,3,4,1", "a row with a number that is not finite"),
        ("1,-1,1,2,3,4,nan", "a row with a number that is not finite"),
        ("1,-1,1,2,-3,4,1", "a box without width or height"),
        ("1,-1,1,2,3,0,1", "a box without width or height"),
        ("1,-1,1e9,2,3,4,1", "a box or a score beyond all reason"),
        ("1,-1,1,2,3,4", "a row that is cut short"),
    ],
)
def test_rows_that_are_no_boxes_are_left_out_and_told(
    tmp_path: Path, row: str, told: str
) -> None:
    rows = [f"{k},-1,1,2,3,4,1" for k in range(1, 20)]
    source = open_source(text(tmp_path, rows[0], row, *rows[1:]), fps=1, size=(50, 50))
    assert [len(d.boxes) for d in detections(source)] == [1] * 19
    assert source.losses == [f"{told}, at det.txt:2"]


def test_a_box_beyond_the_picture_is_left_out_where_it_is_alone(tmp_path: Path) -> None:
    rows = [f"{k},-1,1,2,3,4,1" for k in range(1, 20)]
    path = text(tmp_path, *rows, "20,-1,60,2,3,4,1")
    source = open_source(path, fps=1, size=(50, 50))
    assert sum(len(d.boxes) for d in detections(source)) == 19
    assert source.losses == ["a box beyond the picture, at det.txt:20"]


def test_a_separator_that_is_none_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        SourceError,
        match=r"det\.txt:1: 1 columns, wanted frame,id,x,y,w,h and more, separated by commas",
    ):
        open_source(text(tmp_path, "1!-1!1!2!3!4!1"))


def test_no_rows_and_binary_data(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no detections in this file"):
        open_source(text(tmp_path, "", ""))
    (tmp_path / "det.txt").write_bytes(b"\xff\xfe\x00\x01\n")
    with pytest.raises(SourceError, match=r"det\.txt:1: not text"):
        open_source(tmp_path / "det.txt")


def test_too_many_detections_in_a_frame(tmp_path: Path) -> None:
    path = text(tmp_path, *(f"1,-1,{k},1,5,5,1" for k in range(4)))
    with pytest.raises(
        LimitError, match=r"over 3 detections in frame 1 \(max_detections_per_frame\)"
    ):
        list(open_source(path, fps=1, limits=Limits(max_detections_per_frame=3)).frames())


def test_windows_lines_a_byte_order_mark_and_blank_lines_are_fine(tmp_path: Path) -> None:
    path = tmp_path / "det.txt"
    path.write_bytes(b"\xef\xbb\xbf1,-1,1,2,3,4,1\r\n\r\n2, -1, 1, 2, 3, 4, 1\r\n")
    assert [d.boxes for d in detections(open_source(path, fps=1, size=(9, 9)))] == [
        [(1, 2, 3, 4)]
    ] * 2


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    folder = tmp_path / "img1"
    folder.mkdir()
    for k in range(1, 4):
        (folder / f"{k:06}.png").write_bytes(encode_png(np.zeros((50, 100, 3), np.uint8)))
    return folder


def test_detections_beside_pictures(tmp_path: Path, pictures: Path) -> None:
    path = text(tmp_path, "1,-1,10,20,30,25,0.5", "3,-1,1,2,3,4,1")
    source = open_source(pictures, detections=path, fps=5)
    frames = list(source.frames())
    assert [len(f.detections.boxes) for f in frames if f.detections] == [1, 0, 1]
    assert all(f.encoded for f in frames)
    assert source.losses == []
    assert [name for name, _ in source.digests()] == [
        "000001.png",
        "000002.png",
        "000003.png",
        "det.txt",
    ]


def test_boxes_made_for_another_size_are_scaled_when_said_and_refused_when_not(
    tmp_path: Path, pictures: Path
) -> None:
    path = text(tmp_path, "1,-1,10,20,30,40,1", "2,-1,160,20,20,10,1")
    with pytest.raises(SourceError) as e:
        open_source(pictures, detections=path, fps=5)
    assert "det.txt:2: detections beyond the picture" in str(e.value)
    assert "the pictures are 100x50; the file's boxes reach to 180x60" in str(e.value)
    source = open_source(pictures, detections=path, fps=5, size=(200, 100))
    found = [f.detections.boxes for f in source.frames() if f.detections]
    assert found == [[(5, 10, 15, 20)], [(80, 10, 10, 5)], []]
    with pytest.raises(
        SourceError, match="the size given is 120x100 and the pictures are 100x50"
    ):
        open_source(pictures, detections=path, fps=5, size=(120, 100))


def test_detections_after_the_last_picture_are_left_out_and_said(
    tmp_path: Path, pictures: Path
) -> None:
    path = text(tmp_path, "1,-1,1,2,3,4,1", "4,-1,1,2,3,4,1", "9,-1,1,2,3,4,1")
    source = open_source(pictures, detections=path, fps=5)
    assert len(list(source.frames())) == 3
    assert source.losses == [
        "det.txt: 2 detections from frame 4 on come after the last picture (3 pictures) and"
        " were left out"
    ]


def test_detections_beside_detections_are_refused(tmp_path: Path) -> None:
    path = text(tmp_path, "1,-1,1,2,3,4,1")
    with pytest.raises(UsageError, match="--detections goes with pictures"):
        open_source(path, detections=path)


@pytest.mark.parametrize("fps", [0, -1, float("nan"), float("inf"), "fast", "1/0", 1e9])
def test_a_rate_must_be_a_number_over_zero(tmp_path: Path, fps: float | str) -> None:
    with pytest.raises(
        UsageError, match=r"--fps .*: must be a number of frames per second over 0"
    ):
        open_source(text(tmp_path, "1,-1,1,2,3,4,1"), fps=fps)


coordinate = st.floats(-50, 400, allow_nan=False).map(lambda v: round(v, 3))
side = st.floats(0.01, 300).map(lambda v: max(0.001, round(v, 3)))
box = st.tuples(coordinate, coordinate, side, side).filter(
    lambda b: b[0] + b[2] > 0 and b[1] + b[3] > 0
)


@given(
    st.dictionaries(
        st.integers(1, 30), st.lists(box, min_size=1, max_size=5, unique=True), min_size=1
    )
)
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, frames: dict[int, list[tuple[float, ...]]]
) -> None:
    rows = [
        f"{f},-1,{','.join(map(repr, b))},1" for f, boxes in frames.items() for b in boxes
    ]
    source = open_source(
        text(tmp_path_factory.mktemp("mot"), *rows), fps=1, size=(1000, 1000)
    )
    found = detections(source)
    assert {d.frame + 1: list(map(tuple, d.boxes)) for d in found if d.boxes} == frames
    assert len(found) == max(frames)


def test_the_real_detections(real_data: Path) -> None:
    source = open_source(real_data / "pets09-s2l1/det.txt", fps=7, size=(768, 576))
    found = detections(source)
    lines = (real_data / "pets09-s2l1/det.txt").read_text().splitlines()
    assert (len(found), sum(len(d.boxes) for d in found)) == (795, len(lines))
    assert found[0].boxes[0] == (649.441, 231.502, 44.417, 86.13)
    assert source.notes == source.losses == []
    with pytest.raises(SourceError, match="480x360; the file's boxes reach to 767x575"):
        open_source(
            real_data / "pets09-s2l1/video.avi",
            detections=real_data / "pets09-s2l1/det.txt",
        )
