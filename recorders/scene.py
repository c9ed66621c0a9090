"""A recorded scene, frame by frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from threading import Event
from typing import Any

from recorders import channels
from recorders.clock import nominal_ns
from recorders.closing import Closing
from recorders.errors import RecordingError
from recorders.format_version import check_version
from recorders.frame_order import FrameOrder, two_frames
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import ChannelInfo, LogReader, Message
from recorders.log.growing import GrowingLog
from recorders.log.moments import by_time
from recorders.masks import RecordedMask
from recorders.messages import NO_BLOB, Detections, Regions, SceneChange
from recorders.pictures import Image, decode_picture
from recorders.quality import PIECES, recorded_quality
from recorders.scene_cameras import choose_camera
from recorders.scene_frame import Frame, SceneInfo
from recorders.scene_pictures import (
    ScenePictures,
    check_group,
    is_video,
    starts_group,
)
from recorders.unreadable import Unreadable
from recorders.waiting_frames import TimedPicture, WaitingFrames

__all__ = ["LAST_NS", "Frame", "SceneInfo", "SceneLog"]

_SAMPLED_FRAMES = 64
_ZSTD = b"\x28\xb5\x2f\xfd"
LAST_NS = 2**63 - 1
"""The latest time that a frame may have (the year 2262 for times since 1970): times are signed
64-bit numbers.
"""


class SceneLog(Closing):
    """A scene log, or an annotated log read as the scene that it holds.

    Attributes:
        path: the file.
        camera: the camera that is read.
        info: size, frame time, what there is.
        recorded: the channels that belong to the recording, not to an annotation.
        unreadable: the pictures that could not be decoded so far.
        regions: those that stand in place of all that were recorded, None: the recorded ones.
        grows: it is read while it is written, until the event ``follow`` is set or it ends.

    Raises:
        RecordingError: no detections, or none of that camera; the text says what the log holds
            instead.
    """

    def __init__(
        self,
        path: str | Path,
        camera: str | None = None,
        limits: Limits = DEFAULT_LIMITS,
        regions: Regions | None = None,
        follow: Event | None = None,
    ) -> None:
        self.path = Path(path)
        self.limits = limits
        self.regions = regions
        self.trailing: tuple[Message, ...] = ()
        self.unreadable = Unreadable("")
        self._log = (
            LogReader(path, limits) if follow is None else GrowingLog(path, limits, follow)
        )
        self.grows = follow is not None
        try:
            self.camera = choose_camera(self._log, camera)
            check_version(self._log.metadata(), self.path)
            self.recorded = [
                channel
                for channel in self._log.channels
                if not self._is_annotation(channel)
            ]
            self._topics = {
                name: channels.topic(self.camera, name) for name in channels.RECORDED
            }
            self.unreadable.topic = self._topics["image"]
            present = {channel.topic for channel in self._log.channels}
            if regions is not None:
                self._regions_channel = self._open_regions()
            self.info = self._describe(present)
        except BaseException:
            self._log.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._log.close()

    @property
    def log(self) -> LogReader:
        """The log underneath."""
        return self._log

    @property
    def ended(self) -> bool:
        """Its end was read, where it is read while it is written."""
        return not isinstance(self._log, GrowingLog) or self._log.complete

    def _is_annotation(self, channel: ChannelInfo) -> bool:
        camera, name = channels.split(channel.topic)
        return camera == self.camera and name in channels.ANNOTATED

    def _open_regions(self) -> ChannelInfo:
        """The channel of the regions that replace the recorded ones: theirs, where there is one."""
        topic = self._topics["regions"]
        for channel in self.recorded:
            if channel.topic == topic:
                return channel
        made = ChannelInfo(
            topic,
            channels.schema("regions"),
            channels.message_encoding("regions"),
            id=1 + max((c.id for c in self._log.channels), default=0),
        )
        self.recorded.append(made)
        return made

    def regions_message(self, time_ns: int) -> Message:
        """The regions that replace the recorded ones, as a message of the first frame."""
        assert self.regions is not None
        return Message(
            self._topics["regions"],
            time_ns,
            time_ns,
            0,
            channels.encode("regions", self.regions),
            self._regions_channel,
            (time_ns, 0, 0),
        )

    def _with_regions(
        self, group: list[Message], time_ns: int, *, first: bool
    ) -> list[Message]:
        """A moment's messages, with the regions that replace the recorded ones in the first
        frame's.
        """
        if self.regions is None:
            return group
        kept = [m for m in group if m.topic != self._topics["regions"]]
        return [self.regions_message(time_ns), *kept] if first else kept

    def _describe(self, present: set[str]) -> SceneInfo:
        sample: list[tuple[int, Detections]] = [
            (
                message.log_time_ns,
                self._decode("detections", message),
            )
            for message in islice(
                self._log.messages([self._topics["detections"]]), _SAMPLED_FRAMES
            )
        ]
        if not sample:
            raise RecordingError(
                "the detections channel is empty: nothing to replay", self.path
            )
        first = sample[0][1]
        return SceneInfo(
            first.width,
            first.height,
            nominal_ns([t for t, _ in sample]) or channels.NANOS // 25,
            self._topics["image"] in present,
            self._topics["foreground"] in present and not first.fused,
            self._pieces(),
        )

    def _pieces(self) -> float:
        """What the first reading measured, which stands in the log before its first frame."""
        measured = recorded_quality(self._log.metadata(), self.path).get(self.camera, [])
        return next((m.value for m in measured if m.name == PIECES), 1.0)

    def frame_times(self) -> Iterator[int]:
        """The frames' log times in ns, reading the detections' channel alone."""
        for message in self._log.messages([self._topics["detections"]]):
            yield self._time(message)

    def changes(self) -> Iterator[tuple[int, SceneChange]]:
        """How the picture changed as a whole, each with its frame's log time in ns, reading that
        channel alone.
        """
        for message in self._log.messages([self._topics["changes"]]):
            yield message.log_time_ns, self._decode("changes", message)

    def frames(
        self,
        start_ns: int | None = None,
        first_index: int = 0,
        again: bool = False,
        own: bool = False,
    ) -> Iterator[Frame]:
        """The frames in order; from ``start_ns`` on, the first one then counting as
        ``first_index``.

        ``again`` says that they have been read before: then detections are decoded and checked
        when asked for. ``own`` reads the camera's own channels alone, where nobody wants the
        others' messages a second time; `trailing` stays what it was.

        Messages of other channels travel with the first frame at or after their time. Those after
        the last frame are in no frame: see `trailing`.

        Raises:
            RecordingError: two frames at one time, or a damaged message.
        """
        self.trailing = self.trailing if own else ()
        latched = (
            self._log.latched(self._topics["regions"], start_ns - 1)
            if start_ns is not None and self.regions is None
            else None
        )
        regions = self.regions if latched is None else self._decode("regions", latched)
        pictures, last = self._pictures_at(start_ns)
        waiting = WaitingFrames(self.info.frame_ns // 2, self.info.has_images)
        order = FrameOrder()
        pending: list[Message] = []
        changes: list[SceneChange] = []
        index = first_index
        known = self._topics.values()
        topics = [c.topic for c in self.recorded if c.topic in known or not own]
        for now, group in by_time(
            self._log.messages(topics, start_ns), self.limits, self.path
        ):
            has_frame = any(m.topic == self._topics["detections"] for m in group)
            is_first = has_frame and index == first_index and start_ns is None
            group = self._with_regions(group, now, first=is_first)  # noqa: PLW2901
            pending += group
            yield from waiting.ready(now)
            detections: Detections | Callable[[], Detections] | None = None
            masked: Message | None = None
            for message in group:
                if message.topic == self._topics["detections"]:
                    if detections is not None:
                        raise two_frames(group, self._topics["detections"], self.path)
                    detections = (
                        partial(self._decode, "detections", message)
                        if again
                        else self._decode("detections", message)
                    )
                    self._time(message)
                elif message.topic == self._topics["regions"]:
                    regions = self._decode("regions", message)
                elif message.topic == self._topics["changes"]:
                    changes.append(self._decode("changes", message))
                elif message.topic == self._topics["image"]:
                    last = TimedPicture(message, pictures.loader(message))
                    yield from waiting.picture(last)
                elif message.topic == self._topics["foreground"]:
                    masked = message
            if detections is None:
                continue
            if isinstance(detections, Detections):
                self._check(detections, now, masked is not None)
                order.check(detections.frame, now, self.path, self._topics["detections"])
            mask = (
                self._mask(masked, detections)
                if masked is not None and self.info.has_masks
                else None
            )
            load_mask, load_labels = (
                (None, None) if mask is None else (mask.load, mask.labels)
            )
            frame = Frame(
                index=index,
                time_ns=now,
                detections=detections,
                regions=regions,
                load_image=None,
                load_mask=load_mask,
                messages=tuple(pending),
                load_labels=load_labels,
                changes=tuple(changes),
            )
            yield from waiting.frame(frame, last)
            pending, changes = [], []
            index += 1
        yield from waiting.rest()
        self.trailing = self.trailing if own else tuple(pending)

    def _time(self, message: Message) -> int:
        if message.log_time_ns > LAST_NS:
            raise RecordingError(
                f"a frame at {message.log_time_ns} ns: the latest time that a frame may"
                f" have is {LAST_NS} ns, and as a signed number this is"
                f" {message.log_time_ns - 2**64} ns; `scenetrace record LOG -o OUT` leaves"
                " such frames out",
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
        if message.data.startswith(_ZSTD):
            raise RecordingError(
                f"the message at {message.log_time_ns} ns is compressed by itself (zstd), as"
                " ROS 2's compression mode MESSAGE does; `scenetrace record LOG -o OUT`"
                " unpacks such logs",
                self.path,
                record=message.topic,
            )
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

    def _pictures_at(
        self, start_ns: int | None
    ) -> tuple[ScenePictures, TimedPicture | None]:
        """The pictures from there on, which have, where the reading starts inside a group of a
        video, that group's packets; and the last picture before.
        """
        pictures = ScenePictures(
            self.path, self.limits, (self.info.width, self.info.height), self.unreadable
        )
        last: TimedPicture | None = None
        if start_ns is None:
            return pictures, last
        before: list[Message] = []
        held = 0
        for message in self._log.messages(
            [self._topics["image"]], end_ns=start_ns, reverse=True
        ):
            before.append(message)
            if not is_video(message):
                break
            held += len(message.data)
            check_group(held, self.limits, message, self.path)
            if starts_group(message):
                break
        for message in reversed(before):
            last = TimedPicture(message, pictures.loader(message))
        return pictures, last

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
