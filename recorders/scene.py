"""A recorded scene, frame by frame: detections at once, pictures and masks only when somebody
asks for them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import islice, pairwise
from pathlib import Path
from statistics import median_low
from threading import Lock
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recorders import channels
from recorders.errors import LimitError, RecordingError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import ChannelInfo, LogReader, Message
from recorders.log.moments import by_time
from recorders.masks import Labels, RecordedMask, label_blobs
from recorders.messages import NO_BLOB, Detections, Regions
from recorders.pictures import VideoDecoder, decode_picture

Image = NDArray[np.uint8]
_SAMPLED_FRAMES = 64
LAST_NS = 2**63 - 1
"""The latest time that a frame may have (the year 2262 for times since 1970): times are signed
64-bit numbers.
"""


@dataclass(frozen=True)
class SceneInfo:
    """What is known of a recording before its first frame.

    Attributes:
        width, height: the picture's size in pixels.
        frame_ns: the nominal (median) time between frames in ns.
        has_images: there are pictures; without, a tracker works on boxes alone.
        has_masks: there are foreground masks.
    """

    width: int
    height: int
    frame_ns: int
    has_images: bool
    has_masks: bool


class Frame:
    """One recorded frame. Picture and mask are decoded when first asked for, once.

    In a second reading the detections are, too.

    Attributes:
        index: from 0.
        time_ns: log time.
        regions: the latest recorded regions, or None.
        messages: everything that was recorded for this frame, in the log's order, since the frame
            before.
    """

    def __init__(
        self,
        index: int,
        time_ns: int,
        detections: Detections | Callable[[], Detections],
        regions: Regions | None = None,
        load_image: Callable[[], Image] | None = None,
        load_mask: Callable[[], Image] | None = None,
        messages: tuple[Message, ...] = (),
        load_labels: Callable[[], Labels] | None = None,
    ) -> None:
        self.index = index
        self.time_ns = time_ns
        self._detections = detections
        self.regions = regions
        self.messages = messages
        self._load_image = load_image
        self._load_mask = load_mask
        self._load_labels = load_labels
        self._ahead: list[str] = []

    def prefetch(
        self, submit: Callable[[Callable[[], Image]], Future[Image]], like: Frame
    ) -> None:
        """Have picture and mask decoded by an executor, as far as they were asked for in the
        frame ``like``.
        """
        for name, wanted in (("_load_image", "image"), ("_load_mask", "mask")):
            load = getattr(self, name)
            if (
                load is not None
                and wanted in like.__dict__
                and wanted not in self.__dict__
                and name not in self._ahead
            ):
                setattr(self, name, submit(load).result)
                self._ahead.append(name)

    @cached_property
    def detections(self) -> Detections:
        """The recorded detections."""
        return (
            self._detections
            if isinstance(self._detections, Detections)
            else self._detections()
        )

    @cached_property
    def image(self) -> Image | None:
        """The picture, (height, width, 3) uint8 BGR, or None. Never write into it."""
        return None if self._load_image is None else self._load_image()

    @cached_property
    def mask(self) -> Image | None:
        """The foreground mask, (height, width) uint8, 0 or 255, or None. Never write into it."""
        return None if self._load_mask is None else self._load_mask()

    @cached_property
    def labels(self) -> Labels | None:
        """The mask's blobs, (height, width) uint16, component k of the detections as k + 1; None
        without a mask.

        Never write into it.
        """
        if self.mask is None:
            return None
        return (
            label_blobs(self.mask)[1] if self._load_labels is None else self._load_labels()
        )

    @cached_property
    def boxes(self) -> NDArray[np.float64]:
        """The detections' boxes, (N, 4) float64: x, y, w, h in pixels."""
        return np.array(self.detections.boxes, np.float64).reshape(-1, 4)


class SceneLog:
    """A scene log, or an annotated log read as the scene that it holds.

    Attributes:
        path: the file.
        camera: the camera that is read.
        info: size, frame time, what there is.
        recorded: the channels that belong to the recording, not to an annotation.

    Raises:
        RecordingError: no detections, or none of that camera; the text says what the log holds
            instead.
    """

    def __init__(
        self, path: str | Path, camera: str | None = None, limits: Limits = DEFAULT_LIMITS
    ) -> None:
        self.path = Path(path)
        self.limits = limits
        self.trailing: tuple[Message, ...] = ()
        self._log = LogReader(path, limits)
        try:
            self.camera = _choose_camera(self._log, camera)
            self.recorded = [
                channel
                for channel in self._log.channels
                if not self._is_annotation(channel)
            ]
            self._topics = {
                name: channels.topic(self.camera, name) for name in channels.RECORDED
            }
            present = {channel.topic for channel in self._log.channels}
            self.info = self._describe(present)
        except BaseException:
            self._log.close()
            raise

    def __enter__(self) -> SceneLog:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._log.close()

    @property
    def log(self) -> LogReader:
        """The log underneath."""
        return self._log

    def _is_annotation(self, channel: ChannelInfo) -> bool:
        camera, name = channels.split(channel.topic)
        return camera == self.camera and name in channels.ANNOTATED

    def _describe(self, present: set[str]) -> SceneInfo:
        sample: list[tuple[int, Detections]] = [
            (
                message.log_time_ns,
                channels.decode(
                    "detections", message.data, path=str(self.path), limits=self.limits
                ),
            )
            for message in islice(
                self._log.messages([self._topics["detections"]]), _SAMPLED_FRAMES
            )
        ]
        if not sample:
            raise RecordingError(
                "the detections channel is empty: nothing to replay", self.path
            )
        steps = [b[0] - a[0] for a, b in pairwise(sample)]
        first = sample[0][1]
        return SceneInfo(
            first.width,
            first.height,
            median_low(steps) if steps else channels.NANOS // 25,
            self._topics["image"] in present,
            self._topics["foreground"] in present,
        )

    def frame_times(self) -> Iterator[int]:
        """The frames' log times in ns, reading the detections' channel alone."""
        for message in self._log.messages([self._topics["detections"]]):
            yield self._time(message)

    def frames(
        self, start_ns: int | None = None, first_index: int = 0, again: bool = False
    ) -> Iterator[Frame]:
        """The frames in order; from ``start_ns`` on, the first one then counting as
        ``first_index``.

        ``again`` says that they have been read before: then detections are decoded and checked
        when asked for.

        Messages of other channels travel with the first frame at or after their time. Those after
        the last frame are in no frame: see `trailing`.

        Raises:
            RecordingError: two frames at one time, or a damaged message.
        """
        self.trailing = ()
        latched = (
            self._log.latched(self._topics["regions"], start_ns - 1)
            if start_ns is not None
            else None
        )
        regions = None if latched is None else self._decode("regions", latched)
        video = self._video_at(start_ns)
        pending: list[Message] = []
        index = first_index
        topics = [c.topic for c in self.recorded]
        for now, group in by_time(
            self._log.messages(topics, start_ns), self.limits, self.path
        ):
            pending += group
            detections: Detections | Callable[[], Detections] | None = None
            image: Callable[[], Image] | None = None
            masked: Message | None = None
            for message in group:
                if message.topic == self._topics["detections"]:
                    if detections is not None:
                        raise RecordingError(
                            f"two frames at {now} ns; frames need times of their own",
                            self.path,
                        )
                    detections = (
                        partial(self._decode, "detections", message)
                        if again
                        else self._decode("detections", message)
                    )
                    self._time(message)
                elif message.topic == self._topics["regions"]:
                    regions = self._decode("regions", message)
                elif message.topic == self._topics["image"]:
                    image = video.loader(message)
                elif message.topic == self._topics["foreground"]:
                    masked = message
            if detections is None:
                continue
            if isinstance(detections, Detections):
                self._check(detections, now, masked is not None)
            mask = None if masked is None else self._mask(masked, detections)
            load_mask, load_labels = (
                (None, None) if mask is None else (mask.load, mask.labels)
            )
            yield Frame(
                index,
                now,
                detections,
                regions,
                image,
                load_mask,
                tuple(pending),
                load_labels,
            )
            pending = []
            index += 1
        self.trailing = tuple(pending)

    def _time(self, message: Message) -> int:
        if message.log_time_ns > LAST_NS:
            raise RecordingError(
                f"a frame at {message.log_time_ns} ns: the latest time that a frame may"
                f" have is {LAST_NS} ns",
                self.path,
                record=message.topic,
            )
        return message.log_time_ns

    def _check(self, detections: Detections, now: int, has_mask: bool) -> None:
        """Hold a frame's detections to the recording's size and to its mask's blobs."""
        size = (detections.width, detections.height)
        if size != (self.info.width, self.info.height):
            raise RecordingError(
                f"the detections at {now} ns are made for a picture of {size[0]}x{size[1]},"
                f" the first ones for {self.info.width}x{self.info.height}; record each"
                " size by itself",
                self.path,
                record=self._topics["detections"],
            )
        if (
            has_mask
            and not detections.components
            and max(detections.blobs, default=NO_BLOB) > 0
        ):
            raise RecordingError(
                f"the detections at {now} ns name blobs of the mask, but list no"
                " components",
                self.path,
                record=self._topics["detections"],
            )

    def _decode(self, name: str, message: Message) -> Any:
        return channels.decode(name, message.data, path=str(self.path), limits=self.limits)

    def _mask(
        self, message: Message, detections: Detections | Callable[[], Detections]
    ) -> RecordedMask:
        def picture() -> Image:
            data = self._decode("foreground", message).data
            return self.sized(
                decode_picture(data, gray=True, path=self.path, limits=self.limits),
                "foreground",
                message,
            )

        def count() -> int:
            return len(
                (
                    detections if isinstance(detections, Detections) else detections()
                ).components
            )

        return RecordedMask(picture, count, message, self.path)

    def _video_at(self, start_ns: int | None) -> _Video:
        """A decoder that has, where the reading starts inside a group of pictures, that group's
        packets.
        """
        video = _Video(self)
        if start_ns is None:
            return video
        before: list[Message] = []
        held = 0
        for message in self._log.messages(
            [self._topics["image"]], end_ns=start_ns, reverse=True
        ):
            if not _is_video(message):
                break
            before.append(message)
            held += len(message.data)
            _check_group(held, self, message)
            packet = self._decode("video", message).data
            if VideoDecoder.is_key(packet):
                break
        for message in reversed(before):
            video.append(message)
        return video

    def sized(self, picture: Image, name: str, message: Message) -> Image:
        """The picture itself, if it has the size that the detections say.

        Raises:
            RecordingError: it has another.
        """
        height, width = picture.shape[:2]
        if (width, height) != (self.info.width, self.info.height):
            raise RecordingError(
                f"the {name} at {message.log_time_ns} ns is {width}x{height}, "
                f"the detections say {self.info.width}x{self.info.height}",
                self.path,
                record=message.topic,
            )
        return picture


class _Video:
    """Pictures of one reading: JPEG and PNG stand alone, H.264 needs every packet since the last
    key frame.
    """

    def __init__(self, scene: SceneLog) -> None:
        self._scene = scene
        self._group: list[bytes] = []
        self._group_bytes = 0
        self._decoder: VideoDecoder | None = None
        self._decoding: list[bytes] = []
        self._decoded = 0
        self._lock = Lock()

    def loader(self, message: Message) -> Callable[[], Image]:
        """What decodes this message's picture when called."""
        scene = self._scene
        if not _is_video(message):

            def load_still() -> Image:
                picture = channels.decode(
                    "image", message.data, path=str(scene.path), limits=scene.limits
                )
                image = decode_picture(picture.data, path=scene.path, limits=scene.limits)
                return scene.sized(image, "image", message)

            return load_still
        group, position = self.append(message)
        return lambda: scene.sized(self._load(group, position, message), "image", message)

    def append(self, message: Message) -> tuple[list[bytes], int]:
        """Take a packet into its group of pictures; the group and the packet's place in it."""
        packet = channels.decode(
            "video", message.data, path=str(self._scene.path), limits=self._scene.limits
        ).data
        if VideoDecoder.is_key(packet):
            self._group, self._group_bytes = [], 0
        self._group.append(packet)
        self._group_bytes += len(packet)
        _check_group(self._group_bytes, self._scene, message)
        return self._group, len(self._group) - 1

    def _load(self, group: list[bytes], position: int, message: Message) -> Image:
        with self._lock:
            if (
                self._decoder is None
                or self._decoding is not group
                or self._decoded > position
            ):
                self._decoder = VideoDecoder(
                    path=self._scene.path, limits=self._scene.limits
                )
                self._decoding, self._decoded = group, 0
            image: Image | None = None
            while self._decoded <= position:
                image = self._decoder.decode(group[self._decoded])
                self._decoded += 1
        if image is None:
            raise RecordingError(
                f"no picture in the video packet at {message.log_time_ns} ns",
                self._scene.path,
                record=message.topic,
            )
        return image


def _check_group(held: int, scene: SceneLog, message: Message) -> None:
    """Packets are kept until the next key frame, since any of them may be asked for."""
    if held > scene.limits.max_open_bytes:
        raise LimitError(
            f"{held} bytes of video up to {message.log_time_ns} ns without a key frame,"
            f" over the limit max_open_bytes = {scene.limits.max_open_bytes}",
            scene.path,
            record=message.topic,
        )


def _is_video(message: Message) -> bool:
    return (
        message.channel.schema is not None
        and message.channel.schema.name == "foxglove.CompressedVideo"
    )


def _choose_camera(log: LogReader, wanted: str | None) -> str:
    cameras = sorted(
        {
            c
            for c, name in (channels.split(channel.topic) for channel in log.channels)
            if c and name == "detections"
        }
    )
    if wanted is not None:
        if wanted not in cameras:
            raise UsageError(
                f"{log.path}: no camera {wanted!r}; it has: {', '.join(cameras) or 'none'}"
            )
        return wanted
    if not cameras:
        topics = (
            ", ".join(channel.topic for channel in log.channels[:6]) or "no channels at all"
        )
        raise RecordingError(
            f"no detections to replay (a channel /<camera>/detections); it holds {topics}. "
            "Make a scene log with `scenetrace record SOURCE -o scene.mcap`",
            log.path,
        )
    if len(cameras) > 1:
        raise UsageError(
            f"{log.path}: several cameras ({', '.join(cameras)}); choose one with --camera"
        )
    return cameras[0]
