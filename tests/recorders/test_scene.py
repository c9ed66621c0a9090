"""Scenes read from logs: what is inconsistent between a frame's messages is an error that says
where.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from recorders import channels
from recorders.errors import LimitError, RecordingError
from recorders.limits import Limits
from recorders.log import LogWriter
from recorders.masks import label_blobs
from recorders.messages import Blob, Detections, Ellipse
from recorders.pictures import VideoDecoder, VideoEncoder, encode_mask
from recorders.scene import LAST_NS, SceneLog

Put = Callable[[LogWriter, dict[str, int]], None]
FRAME_NS = 100_000_000


def write(path: Path, put: Put, video: bool = False) -> Path:
    with LogWriter(path) as log:
        ids = {}
        for name in ("image", "foreground", "detections"):
            kind = "video" if video and name == "image" else name
            topic = channels.topic("camera", name)
            ids[name] = log.channel(
                topic, channels.schema(kind), channels.message_encoding(kind)
            )
        put(log, ids)
    return path


def detections(
    frame: int, width: int = 32, height: int = 24, blobs: tuple[int, ...] = ()
) -> bytes:
    boxes = [(1.0, 2.0, 3.0, 4.0)] * len(blobs)
    return channels.encode(
        "detections", Detections(frame, width, height, boxes, blobs=list(blobs))
    )


def test_detections_of_another_size_than_the_first(tmp_path: Path) -> None:
    def put(log: LogWriter, ids: dict[str, int]) -> None:
        log.write(ids["detections"], detections(0), 0)
        log.write(ids["detections"], detections(1, width=64), FRAME_NS)

    with (
        SceneLog(write(tmp_path / "s.mcap", put)) as scene,
        pytest.raises(RecordingError, match=r"64x24.*32x24"),
    ):
        list(scene.frames())


def test_blobs_of_a_mask_without_components(tmp_path: Path) -> None:
    mask = encode_mask(np.full((24, 32), 255, np.uint8))

    def put(log: LogWriter, ids: dict[str, int]) -> None:
        log.write(ids["foreground"], channels.compressed_image(mask, "png", 0, "camera"), 0)
        log.write(ids["detections"], detections(0, blobs=(1,)), 0)

    with (
        SceneLog(write(tmp_path / "s.mcap", put)) as scene,
        pytest.raises(RecordingError, match="list no components"),
    ):
        list(scene.frames())


@pytest.mark.parametrize("listed", [0, 1, 3])
def test_a_mask_of_other_components_than_the_detections_list(
    tmp_path: Path, listed: int
) -> None:
    pixels = np.zeros((24, 32), np.uint8)
    pixels[2:6, 2:6] = pixels[10:14, 2:6] = 255
    blob = Ellipse(4.0, 4.0, 4.0, 4.0, 0.0)
    components = [Blob(k, (2.0, 2.0, 4.0, 4.0), 16, blob) for k in range(1, listed + 1)]

    def put(log: LogWriter, ids: dict[str, int]) -> None:
        mask = channels.compressed_image(encode_mask(pixels), "png", 0, "camera")
        log.write(ids["foreground"], mask, 0)
        log.write(
            ids["detections"],
            channels.encode("detections", Detections(0, 32, 24, components=components)),
            0,
        )

    with SceneLog(write(tmp_path / "s.mcap", put)) as scene:
        frame = next(scene.frames())
        with pytest.raises(
            RecordingError, match=f"has 2 components, its detections list {listed}"
        ):
            _ = frame.mask


def test_a_frames_labels_are_the_components_of_its_mask(tmp_path: Path) -> None:
    pixels = np.zeros((24, 32), np.uint8)
    pixels[2:6, 2:6] = pixels[10:14, 2:6] = 255
    components = [
        Blob(k, (2.0, 8.0 * k - 6, 4.0, 4.0), 16, Ellipse(4.0, 8.0 * k - 4, 4.0, 4.0, 0.0))
        for k in (1, 2)
    ]

    def put(log: LogWriter, ids: dict[str, int]) -> None:
        log.write(
            ids["foreground"],
            channels.compressed_image(encode_mask(pixels), "png", 0, "camera"),
            0,
        )
        log.write(
            ids["detections"],
            channels.encode("detections", Detections(0, 32, 24, components=components)),
            0,
        )
        log.write(ids["detections"], detections(1), FRAME_NS)

    with SceneLog(write(tmp_path / "s.mcap", put)) as scene:
        first, second = scene.frames()
        assert first.labels is not None
        assert first.labels[3, 3] == 1
        assert first.labels[11, 3] == 2
        assert np.count_nonzero(first.labels) == 32
        assert second.labels is None


@pytest.mark.parametrize("side", [511, 513])
def test_blobs_beyond_16_bits_are_counted(side: int) -> None:
    mask = np.zeros((side, side), np.uint8)
    mask[::2, ::2] = 255
    assert label_blobs(mask)[0] == ((side + 1) // 2) ** 2


def test_times_are_signed_64_bit_numbers(tmp_path: Path) -> None:
    def put(log: LogWriter, ids: dict[str, int]) -> None:
        log.write(ids["detections"], detections(0), LAST_NS)
        log.write(ids["detections"], detections(1), LAST_NS + 1)

    with SceneLog(write(tmp_path / "s.mcap", put)) as scene:
        frames = scene.frames()
        assert next(frames).time_ns == LAST_NS
        with pytest.raises(RecordingError, match="latest time that a frame may have"):
            next(frames)
        with pytest.raises(RecordingError, match="latest time that a frame may have"):
            list(scene.frame_times())


def test_video_without_key_frames_is_not_gathered_for_ever(tmp_path: Path) -> None:
    encoder = VideoEncoder(32, 24, Fraction(10))
    rng = np.random.Generator(np.random.PCG64(1))
    packets = [
        encoder.encode(rng.integers(0, 256, (24, 32, 3), np.uint8)) for _ in range(20)
    ]
    assert [VideoDecoder.is_key(p) for p in packets] == [True] + [False] * 19

    def put(log: LogWriter, ids: dict[str, int]) -> None:
        for k, packet in enumerate(packets):
            log.write(
                ids["image"],
                channels.compressed_image(packet, "h264", k * FRAME_NS, "camera"),
                k * FRAME_NS,
            )
            log.write(ids["detections"], detections(k), k * FRAME_NS)

    path = write(tmp_path / "s.mcap", put, video=True)
    with SceneLog(path) as scene:
        assert [f.image is not None for f in scene.frames()] == [True] * 20
    few = Limits(max_open_bytes=sum(map(len, packets)) // 2)
    with SceneLog(path, limits=few) as scene:
        with pytest.raises(
            LimitError, match="without a key frame, over the limit max_open_bytes"
        ):
            list(scene.frames())
        with pytest.raises(LimitError, match="without a key frame"):
            next(scene.frames(19 * FRAME_NS))
