"""Recording a source into a scene log, and what is read back."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from recorders import channels
from recorders.errors import OutputExistsError, SourceError, UsageError
from recorders.limits import Limits
from recorders.log import LogReader
from recorders.messages import NO_BLOB, Blob, Detections, Ellipse
from recorders.parameters import configure
from recorders.pictures import encode_jpeg, encode_png
from recorders.recording import (
    SECTIONS,
    InterruptedRecordingError,
    RecordOptions,
    record,
    with_blobs,
)
from recorders.scene import Frame, SceneLog
from recorders.segmentation import Segmented
from recorders.sources import open_source
from recorders.vision import cv2


def scene(k: int) -> np.ndarray:
    """Two dark bodies walk over a bright, textured ground."""
    ground = np.random.default_rng(1).integers(170, 200, (120, 160, 3), np.uint8)
    image = np.asarray(cv2.GaussianBlur(ground, (5, 5), 0), np.uint8)
    image[30:70, 5 + 5 * k : 20 + 5 * k] = (40, 30, 90)
    image[60:105, 140 - 5 * k : 155 - 5 * k] = (90, 60, 20)
    return image


FRAMES = 24


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "img1"
    path.mkdir()
    for k in range(FRAMES):
        (path / f"{k + 1:06}.jpg").write_bytes(encode_jpeg(scene(k)))
    return path


def frames_of(path: Path) -> list[Frame]:
    with SceneLog(path) as log:
        frames = list(log.frames())
        for f in frames:
            _ = f.image, f.mask
    return frames


def facts_of(path: Path) -> dict[str, str]:
    with LogReader(path) as log:
        return dict(log.metadata())["scenetrace"]


def test_pictures_are_recorded_byte_for_byte_with_masks_and_detections(
    tmp_path: Path, folder: Path
) -> None:
    done = record(
        open_source(folder, fps=8),
        tmp_path / "a.mcap",
        RecordOptions(start_ns=5_000_000_000),
    )
    assert (done.frames, done.width, done.height, done.detect, done.codec) == (
        FRAMES,
        160,
        120,
        "motion",
        "as is",
    )
    assert done.duration_ns == (FRAMES - 1) * 125_000_000
    with LogReader(tmp_path / "a.mcap") as log:
        images = list(log.messages(["/camera/image"]))
        assert [m.log_time_ns for m in images] == [
            5_000_000_000 + 125_000_000 * k for k in range(FRAMES)
        ]
        assert all(m.publish_time_ns == m.log_time_ns for m in images)
        recorded = [bytes(channels.decode("image", m.data).data) for m in images]
    assert recorded == [p.read_bytes() for p in sorted(folder.iterdir())]
    for f in frames_of(tmp_path / "a.mcap"):
        assert f.mask is not None
        assert set(np.unique(f.mask)) <= {0, 255}
        assert all(b >= 1 for b in f.detections.blobs)
        assert len(f.detections.boxes) >= 1
        count, _, stats, _ = cv2.connectedComponentsWithStats(f.mask, connectivity=8)
        assert [b.area for b in f.detections.components] == [
            int(stats[b.id, 4]) for b in f.detections.components
        ]
        assert count - 1 == len(f.detections.components)


def test_the_log_says_what_it_is_made_of(tmp_path: Path, folder: Path) -> None:
    source = open_source(folder, fps=8)
    done = record(source, tmp_path / "a.mcap", RecordOptions(camera="gate"))
    facts = facts_of(tmp_path / "a.mcap")
    listing = "".join(
        f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.name}\n"
        for p in sorted(folder.iterdir())
    )
    digest = hashlib.sha256(listing.encode()).hexdigest()
    assert done.source_digest == digest
    with LogReader(tmp_path / "a.mcap") as log:
        started = dict(log.metadata())["scenetrace.started"]
    # What both readings say of its quality is known at its end alone.
    assert started.pop("quality") != facts["quality"]
    assert started.items() < facts.items()
    assert facts["source_digest"] == f"sha256:{digest}"
    assert (facts["kind"], facts["camera"], facts["source"], facts["frames"]) == (
        "scene",
        "gate",
        "img1",
        str(FRAMES),
    )
    assert json.loads(facts["configuration"])["segmentation"]["min_area"] > 0
    assert {"scenetrace", "numpy", "av", "opencv-python-headless"} <= set(
        json.loads(facts["packages"])
    )
    assert str(tmp_path) not in json.dumps(facts)
    with LogReader(tmp_path / "a.mcap") as log:
        (attachment,) = log.attachments(["source.sha256"])
        assert attachment.data == listing.encode()
        assert {c.topic for c in log.channels} == {
            "/gate/image",
            "/gate/foreground",
            "/gate/detections",
        }


def test_the_same_source_gives_the_same_file_whatever_the_number_of_threads(
    tmp_path: Path, folder: Path
) -> None:
    before = cv2.getNumThreads()
    try:
        for name, threads in (("a", 1), ("b", 2)):
            cv2.setNumThreads(threads)
            record(
                open_source(folder, fps=8),
                tmp_path / f"{name}.mcap",
                RecordOptions(codec="h264"),
            )
    finally:
        cv2.setNumThreads(before)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


@pytest.mark.parametrize("codec", ["png", "h264", "none", "jpeg"])
def test_codecs(tmp_path: Path, folder: Path, codec: str) -> None:
    done = record(
        open_source(folder, fps=8),
        tmp_path / "a.mcap",
        RecordOptions(codec=codec, detect="none"),
    )
    assert done.codec == codec
    frames = frames_of(tmp_path / "a.mcap")
    originals = [f.image for f in open_source(folder, fps=8).frames()]
    assert len(frames) == FRAMES
    for f, original in zip(frames, originals, strict=True):
        if codec == "none":
            assert f.image is None
            continue
        assert f.image is not None
        assert original is not None
        if codec == "h264":
            assert np.abs(f.image.astype(int) - original).mean() < 12
        else:
            np.testing.assert_array_equal(f.image, original)
    with LogReader(tmp_path / "a.mcap") as log:
        kinds = {c.topic: c.schema.name for c in log.channels if c.schema is not None}
    wanted = {"h264": "foxglove.CompressedVideo", "none": None}.get(
        codec, "foxglove.CompressedImage"
    )
    assert kinds.get("/camera/image") == wanted


def test_h264_replays_from_the_middle(tmp_path: Path, folder: Path) -> None:
    record(
        open_source(folder, fps=8),
        tmp_path / "a.mcap",
        RecordOptions(codec="h264", detect="none"),
    )
    whole = frames_of(tmp_path / "a.mcap")
    with SceneLog(tmp_path / "a.mcap") as log:
        late = next(iter(log.frames(start_ns=whole[17].time_ns, first_index=17)))
        assert late.index == 17
        np.testing.assert_array_equal(late.image, whole[17].image)


def test_png_pictures_become_jpeg_only_when_asked(tmp_path: Path) -> None:
    folder = tmp_path / "png"
    folder.mkdir()
    (folder / "1.png").write_bytes(encode_png(scene(0)))
    for codec, kind in ((None, "png"), ("jpeg", "jpeg")):
        record(
            open_source(folder, fps=8),
            tmp_path / f"{kind}.mcap",
            RecordOptions(codec=codec, detect="none"),
        )
        with LogReader(tmp_path / f"{kind}.mcap") as log:
            (message,) = log.messages(["/camera/image"])
            assert channels.decode("image", message.data).format == kind


def test_given_detections_keep_their_boxes_and_take_the_blobs_of_the_mask(
    tmp_path: Path, folder: Path
) -> None:
    det = tmp_path / "det.txt"
    boxes = [
        f"{k + 1},-1,{4 + 5 * k},29,17,42,0.7\n{k + 1},-1,60,2,9,9,0.2"
        for k in range(FRAMES)
    ]
    det.write_text("\n".join(boxes) + "\n")
    record(
        open_source(folder, detections=det, fps=8),
        tmp_path / "a.mcap",
        RecordOptions(
            detect="motion",
            config=configure(SECTIONS, assignments=["fusion.fuse=false"]),
        ),
    )
    for f in frames_of(tmp_path / "a.mcap"):
        assert f.detections.boxes == [(4 + 5 * f.index, 29, 17, 42), (60, 2, 9, 9)]
        assert f.mask is not None
        _, labels = cv2.connectedComponents(f.mask, connectivity=8)
        assert f.detections.blobs == [labels[50, 12 + 5 * f.index], NO_BLOB]
        assert f.detections.blobs[0] in [b.id for b in f.detections.components]
    record(open_source(folder, detections=det, fps=8), tmp_path / "b.mcap")
    assert facts_of(tmp_path / "b.mcap")["detect"] == "none"
    assert all(
        f.mask is None and len(f.detections.boxes) == 2
        for f in frames_of(tmp_path / "b.mcap")
    )


def test_the_blob_that_fills_most_of_a_box_wins_ties_to_the_smaller_id() -> None:
    mask = np.zeros((20, 40), np.uint8)
    mask[5:10, 0:10] = mask[5:10, 20:30] = 255
    blobs = [
        Blob(1, (0, 5, 10, 5), 50, Ellipse(5, 7, 10, 5, 0)),
        Blob(2, (20, 5, 10, 5), 50, Ellipse(25, 7, 10, 5, 0)),
    ]
    found = Segmented(mask, Detections(0, 40, 20, components=blobs))
    boxes = [
        (5.0, 0.0, 20.0, 20.0),
        (6.0, 0.0, 20.0, 20.0),
        (12.0, 0.0, 5.0, 5.0),
        (-9.0, -9.0, 5.0, 5.0),
        (35.0, 0.0, 90.0, 9.0),
    ]
    given = Detections(0, 40, 20, boxes, [1.0] * 5, [""] * 5, [None] * 5, [NO_BLOB] * 5)
    answer = with_blobs(given, found)
    assert answer.blobs == [1, 2, NO_BLOB, NO_BLOB, NO_BLOB]
    assert (answer.boxes, answer.components) == (boxes, blobs)


def test_regions_come_first(tmp_path: Path, folder: Path) -> None:
    regions = tmp_path / "regions.json"
    regions.write_text('{"roi": [[10, 10], [150, 10], [150, 110], [10, 110]]}')
    record(
        open_source(folder, fps=8),
        tmp_path / "a.mcap",
        RecordOptions(detect="none", regions=regions),
    )
    frames = frames_of(tmp_path / "a.mcap")
    assert all(f.regions is not None and f.regions.roi[0][0] == (10, 10) for f in frames)


def test_regions_leave_the_masks_alone(tmp_path: Path, folder: Path) -> None:
    """EVENTS 3.2: pixels are classified in the whole picture, whatever is of interest."""
    regions = tmp_path / "regions.json"
    regions.write_text('{"roi": [[10, 10], [40, 10], [40, 30], [10, 30]]}')
    found = []
    for name, chosen in (("with", regions), ("without", None)):
        out = tmp_path / f"{name}.mcap"
        record(open_source(folder, fps=8), out, RecordOptions(regions=chosen))
        found.append([(f.mask.tobytes(), f.detections) for f in frames_of(out)])
    assert found[0] == found[1]
    assert any(detections.components for _, detections in found[0])


def test_detections_alone(tmp_path: Path) -> None:
    det = tmp_path / "det.txt"
    det.write_text("1,-1,1,2,3,4,0.5\n3,-1,1,2,3,4,0.5\n")
    done = record(open_source(det, fps=2, size=(64, 48)), tmp_path / "a.mcap")
    assert (done.frames, done.detections, done.detect, done.codec) == (3, 2, "none", "none")
    frames = frames_of(tmp_path / "a.mcap")
    assert [len(f.detections.boxes) for f in frames] == [1, 0, 1]
    assert [f.time_ns for f in frames] == [0, 500_000_000, 1_000_000_000]
    assert (
        facts_of(tmp_path / "a.mcap")["source_digest"]
        == "sha256:" + hashlib.sha256(det.read_bytes()).hexdigest()
    )
    with pytest.raises(UsageError, match="--detect motion needs pictures"):
        record(open_source(det), tmp_path / "b.mcap", RecordOptions(detect="motion"))
    with pytest.raises(UsageError, match="--codec jpeg needs pictures"):
        record(open_source(det), tmp_path / "b.mcap", RecordOptions(codec="jpeg"))


def test_an_output_is_never_overwritten_without_force(tmp_path: Path, folder: Path) -> None:
    out = tmp_path / "a.mcap"
    out.write_text("precious")
    with pytest.raises(OutputExistsError, match="exists already, not overwriting it"):
        record(open_source(folder, fps=8), out)
    assert out.read_text() == "precious"
    record(open_source(folder, fps=8), out, RecordOptions(force=True, detect="none"))
    assert len(frames_of(out)) == FRAMES
    det = tmp_path / "det.txt"
    det.write_text("1,-1,1,2,3,4,0.5\n")
    with pytest.raises(UsageError, match="is the source itself"):
        record(open_source(det), det, RecordOptions(force=True))


def test_what_does_not_fit_is_refused_before_anything_is_written(
    tmp_path: Path, folder: Path
) -> None:
    for options, message in (
        (RecordOptions(detect="magic"), "--detect magic: must be one of motion"),
        (RecordOptions(codec="gif"), "--codec gif: must be one of jpeg, png, h264, none"),
        (RecordOptions(camera="a/b"), "camera name 'a/b'"),
    ):
        with pytest.raises(UsageError, match=message):
            record(open_source(folder, fps=8), tmp_path / "a.mcap", options)
    assert not list(tmp_path.glob("a.mcap*"))


def test_a_source_that_breaks_leaves_a_part_file_and_says_how_to_recover_it(
    tmp_path: Path, folder: Path
) -> None:
    vast = struct.pack(">IIBBBBB", 30_000, 30_000, 8, 2, 0, 0, 0)
    (folder / "000021.jpg").write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + vast + bytes(99))
    with pytest.raises(InterruptedRecordingError) as e:
        record(
            open_source(folder, fps=8), tmp_path / "a.mcap", RecordOptions(detect="none")
        )
    assert "a picture claims 30000 x 30000 pixels" in str(e.value)
    assert "after 20 frames" in str(e.value)
    assert f"scenetrace recover {tmp_path / 'a.mcap.part'} -o " in str(e.value)
    assert (tmp_path / "a.mcap.part").exists()
    assert not (tmp_path / "a.mcap").exists()


def test_a_source_that_breaks_at_once_leaves_nothing(tmp_path: Path, folder: Path) -> None:
    for picture in folder.iterdir():
        picture.write_bytes(picture.read_bytes()[:-30])
    with pytest.raises(SourceError, match=r"000001\.jpg"):
        record(
            open_source(folder, fps=8), tmp_path / "a.mcap", RecordOptions(detect="none")
        )
    assert not list(tmp_path.glob("a.mcap*"))


def test_an_interrupted_run_leaves_what_was_recorded(tmp_path: Path, folder: Path) -> None:
    def stop(stage: str, done: int, total: int | None) -> None:
        if stage == "recording" and done == 15:
            raise KeyboardInterrupt

    with pytest.raises(
        InterruptedRecordingError,
        match="interrupted after 15 frames; keep them with: scenetrace recover",
    ):
        record(open_source(folder, fps=8), tmp_path / "a.mcap", RecordOptions(), stop)
    assert (tmp_path / "a.mcap.part").exists()


def test_progress_tells_stage_and_expectation(tmp_path: Path, folder: Path) -> None:
    told: list[tuple[str, int, int | None]] = []
    record(
        open_source(folder, fps=8),
        tmp_path / "a.mcap",
        RecordOptions(),
        lambda *t: told.append(t),
    )
    assert {stage for stage, _, _ in told} == {"looking", "recording"}
    assert told[-1] == ("recording", FRAMES, FRAMES)


def real_sources(real_data: Path) -> Iterator[tuple[Path, dict[str, object], int]]:
    yield real_data / "caviar-corridor/OneLeaveShopReenter1cor.mpg", {}, 390
    yield (
        real_data / "tud-campus/video.mp4",
        {"detections": real_data / "tud-campus/det.txt"},
        71,
    )
    yield real_data / "caviar/Meet_Crowd.xml", {}, 491
    yield real_data / "pets09-s2l1/det.txt", {"fps": 7, "size": (768, 576)}, 795


def test_real_sources_are_read_back_equal(tmp_path: Path, real_data: Path) -> None:
    for k, (path, arguments, count) in enumerate(real_sources(real_data)):
        source = open_source(path, **arguments)  # type: ignore[arg-type]
        record(source, tmp_path / f"{k}.mcap", RecordOptions(detect="none"))
        expected = list(source.frames())
        with SceneLog(tmp_path / f"{k}.mcap") as log:
            frames = list(log.frames())
            assert len(frames) == len(expected) == count
            for mine, original in zip(frames, expected, strict=True):
                assert mine.time_ns == original.time_ns
                if original.detections is not None:
                    assert mine.detections == original.detections
            if source.has_images:
                difference = np.abs(
                    np.asarray(frames[33].image).astype(int)
                    - np.asarray(expected[33].image)
                )
                assert difference.mean() < 3


def test_nothing_is_recorded_that_no_replay_takes(tmp_path: Path) -> None:
    det = tmp_path / "det.txt"
    det.write_text("1,-1,2,2,5,5,1\n1,-1,3,3,5,5,1\n1,-1,4,4,5,5,1\n")
    source = open_source(det, fps=5, size=(20, 20))
    few = Limits(max_detections_per_frame=2)
    with pytest.raises(SourceError, match=r"det\.txt: 3 detections, over the limit of 2"):
        record(source, tmp_path / "s.mcap", RecordOptions(limits=few))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["det.txt"]
