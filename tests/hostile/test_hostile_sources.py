"""Sources that are not what they should be: each gives one clear line, quickly, and allocates
nothing it claims.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorders.errors import LimitError, SceneTraceError, SourceError
from recorders.limits import Limits
from recorders.recording import RecordOptions, record
from recorders.sources import open_source, read_regions
from tests.lying_files import png

HEAD = '<?xml version="1.0"?>'


def read_all(path: Path, **arguments: object) -> list[int]:
    """Read a source whole, with its pictures; the times of its frames."""
    times = []
    for frame in open_source(path, **arguments).frames():  # type: ignore[arg-type]
        _ = frame.image
        times.append(frame.time_ns)
    return times


def fails(path: Path, message: str, **arguments: object) -> SceneTraceError:
    """Opening and reading fails with our own error; its one line holds the path and the message."""
    with pytest.raises(SceneTraceError, match=message) as e:
        read_all(path, **arguments)
    assert "\n" not in str(e.value)
    assert path.name in str(e.value)
    return e.value


@pytest.mark.parametrize("name", ["none.avi", "none.txt", "none.xml", "none"])
def test_no_such_file(tmp_path: Path, name: str) -> None:
    fails(tmp_path / name, "no such file")


@pytest.mark.parametrize("name", ["a.avi", "a.mp4", "a.txt", "a.xml", "a"])
def test_empty_file(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    fails(tmp_path / name, "the file is empty")


def test_a_cut_log_and_a_single_picture_are_no_sources(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n")
    fails(tmp_path / "a.mcap", "the file ends within a record")
    (tmp_path / "1.png").write_bytes(png(3, 3))
    fails(
        tmp_path / "1.png",
        "one picture is not a recording: give the folder that it lies in",
    )


@pytest.mark.parametrize("name", ["a.avi", "a.mp4", "a.mpg", "a", "a.nfo"])
def test_text_as_video(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("This is not a video.\n" * 500)
    fails(tmp_path / name, "not a video that can be read")


@pytest.mark.parametrize(
    "text",
    [
        "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nfile:{other}\n#EXT-X-ENDLIST\n",
        "ffconcat version 1.0\nfile '{other}'\n",
    ],
)
def test_a_playlist_reaches_for_no_other_file(tmp_path: Path, text: str) -> None:
    other = tmp_path / "other.mkv"
    with av.open(str(other), "w") as container:
        stream = container.add_stream("mpeg4", rate=25)
        stream.width = stream.height = 64
        container.mux(
            stream.encode(
                av.VideoFrame.from_ndarray(np.zeros((96, 64), np.uint8), "yuv420p")
            )
        )
        container.mux(stream.encode(None))
    assert len(list(open_source(other).frames())) == 1
    path = tmp_path / "list.avi"
    path.write_text(text.format(other=other))
    fails(path, "not a video that can be read")


def test_a_name_is_a_name_and_not_a_protocol(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    fails(Path("http:x.avi"), "no such file")
    Path("concat:a|b.avi").write_text("x" * 99)
    fails(Path("concat:a|b.avi"), "not a video that can be read")


def test_a_picture_that_claims_30000_x_30000(tmp_path: Path) -> None:
    (tmp_path / "1.png").write_bytes(png(30_000, 30_000))
    error = fails(tmp_path, "claims 30000 x 30000 pixels, over the limit of 16384 a side")
    assert isinstance(error, LimitError)


def test_a_later_picture_that_claims_30000_x_30000(tmp_path: Path) -> None:
    (tmp_path / "1.png").write_bytes(png(3, 3))
    (tmp_path / "2.png").write_bytes(png(30_000, 30_000))
    fails(tmp_path, "claims 30000 x 30000 pixels")


def test_a_picture_with_too_little_in_it(tmp_path: Path) -> None:
    (tmp_path / "1.png").write_bytes(png(300, 300))
    fails(tmp_path, "a damaged png picture")


def test_a_picture_of_no_pixels(tmp_path: Path) -> None:
    (tmp_path / "1.png").write_bytes(png(0, 5))
    fails(tmp_path, "claims 0 x 5 pixels")


def test_a_huge_picture_file_is_refused_by_its_size(tmp_path: Path) -> None:
    (tmp_path / "1.png").write_bytes(png(3, 3) + b"\0" * 5000)
    fails(
        tmp_path,
        "over the limit of 1000 .max_message_bytes.",
        limits=Limits(max_message_bytes=1000),
    )


@pytest.mark.parametrize(
    "body",
    [
        (
            '<!DOCTYPE dataset SYSTEM "file:///etc/passwd"><dataset><frame'
            ' number="0"/></dataset>'
        ),
        (
            '<!DOCTYPE d [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><dataset><frame'
            ' number="0">&b;</frame></dataset>'
        ),
        (
            '<!DOCTYPE d [<!ENTITY x SYSTEM "file:///etc/passwd">]><dataset><frame'
            ' number="0">&x;</frame></dataset>'
        ),
        "<!DOCTYPE dataset><dataset/>",
    ],
)
def test_a_doctype_is_refused(tmp_path: Path, body: str) -> None:
    path = tmp_path / "a.xml"
    path.write_text(HEAD + body)
    fails(path, "a DOCTYPE in the XML: refused")


def box(**values: object) -> str:
    attributes = {"h": 4, "w": 4, "xc": 10, "yc": 10, **values}
    inside = " ".join(f'{k}="{v}"' for k, v in attributes.items() if v is not None)
    return (
        '<dataset><frame number="3"><objectlist><object id="0"><box'
        f" {inside}/></object></objectlist></frame></dataset>"
    )


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("", "not well-formed XML"),
        ("<dataset>", "not well-formed XML"),
        ("<dataset/>", "no frames in this file: not CAVIAR XML"),
        ("<html><body><p>hello</p></body></html>", "no frames in this file"),
        ("<dataset><frame/></dataset>", 'a frame with number=""'),
        ('<dataset><frame number="x"/></dataset>', 'a frame with number="x"'),
        ('<dataset><frame number="-1"/></dataset>', "frame -1 after frame -1"),
        (
            '<dataset><frame number="2"/><frame number="1"/></dataset>',
            "frame 1 after frame 2: numbers must increase",
        ),
        (
            '<dataset><frame number="2"/><frame number="2"/></dataset>',
            "frame 2 after frame 2: numbers must increase",
        ),
        (
            '<dataset><frame number="999999999"/></dataset>',
            "over the limit of 100000000 frames",
        ),
        (
            (
                "<dataset><frame"
                ' number="0"><objectlist><object/></objectlist></frame></dataset>'
            ),
            "an object without a box",
        ),
        (box(w=0), "frame 3: an object of width 0 and height 4"),
        (box(h=-4), "frame 3: an object of width 4 and height -4"),
        (box(w="nan"), 'frame 3: an object with w="nan": a whole number is wanted'),
        (box(xc="1e5"), 'with xc="1e5"'),
        (box(xc=None), 'with xc=""'),
        (box(yc="٣"), 'with yc="٣"'),
        (box(xc="9" * 5000), "a whole number is wanted"),
        (
            box(xc=1000),
            (
                "detections beyond the picture: frame 3: an object at 1000, 10 of 4 x 4,"
                " the picture is 384x288"
            ),
        ),
        ("<dataset>" + "<a>" * 100, "nested over 32 deep"),
    ],
)
def test_xml_that_is_not_as_it_must_be(tmp_path: Path, body: str, message: str) -> None:
    path = tmp_path / "a.xml"
    path.write_text(HEAD + body)
    fails(path, message)


def test_xml_with_an_endless_frame(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_text(HEAD + '<dataset><frame number="0">' + "<a/>" * 2000)
    fails(path, "over 1000 elements in a frame", limits=Limits(max_detections_per_frame=10))


def test_detections_are_checked_before_anything_is_written(tmp_path: Path) -> None:
    (tmp_path / "1.png").write_bytes(png(3, 3))
    det = tmp_path / "det.txt"
    for row in (
        "1,-1,nan,1,1,1,1",
        "1,-1,1,1,-5,1,1",
        "1,-1,1,1,0,1,1",
        "1,-1,900,900,5,5,1",
    ):
        det.write_text(row + "\n")
        with pytest.raises(SourceError, match=r"det\.txt:1"):
            record(
                open_source(tmp_path, detections=det, fps=5),
                tmp_path / "a.mcap",
                RecordOptions(detect="none"),
            )
    assert not list(tmp_path.glob("a.mcap*"))


@given(
    st.binary(min_size=1, max_size=300),
    st.sampled_from(["a.txt", "a.xml", "a.mp4", "regions.json"]),
)
def test_any_bytes_are_read_or_refused_with_our_error(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, name: str
) -> None:
    path = tmp_path_factory.mktemp("any") / name
    path.write_bytes(data)
    with contextlib.suppress(SceneTraceError):
        if name == "regions.json":
            read_regions(path, 10, 10)
        else:
            read_all(path)


@given(st.data())
def test_a_video_with_flipped_bytes_is_read_as_far_as_possible_or_refused(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("flip")
    whole = folder / "a.mkv"
    with av.open(str(whole), "w") as container:
        stream = container.add_stream("mpeg4", rate=25)
        stream.width = stream.height = 64
        for k in range(6):
            planes = np.random.default_rng(k).integers(0, 256, (96, 64), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(planes, "yuv420p")))
        container.mux(stream.encode(None))
    content = bytearray(whole.read_bytes())
    for _ in range(data.draw(st.integers(1, 5))):
        content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(
            st.integers(1, 255)
        )
    whole.write_bytes(content)
    with contextlib.suppress(SceneTraceError):
        times = read_all(whole, limits=Limits(max_picture_pixels=100_000))
        assert times == sorted(set(times))
