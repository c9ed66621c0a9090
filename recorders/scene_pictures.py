"""The pictures of a scene: each decoded when it is asked for, whatever its encoding.

Pictures that stand alone are decoded alone; a video's needs every packet since the last key frame.
One that cannot be decoded is no picture: its frame goes without, and the scene says so.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import Any

from recorders.errors import LimitError, RecordingError
from recorders.limits import Limits
from recorders.log import Message
from recorders.payloads import (
    PICTURES,
    PayloadError,
    VideoPacket,
    payload_kind,
    read_picture,
)
from recorders.payloads.pictures import RawPicture, raw_pixels
from recorders.payloads.stream import VideoStream, is_key
from recorders.pictures import Image, VideoDecoder
from recorders.stills import decode_still, still_header
from recorders.unreadable import Unreadable

Load = Callable[[int], "Image | None"]
_VIDEO = ("CompressedVideo", "FFMPEGPacket")


def is_video(message: Message) -> bool:
    """Whether a message is a packet of a video."""
    schema = message.channel.schema
    return schema is not None and schema.name.endswith(_VIDEO)


def starts_group(message: Message) -> bool:
    """Whether decoding may start at this packet of a video."""
    try:
        packet = read_picture(message.channel, message.data)
    except PayloadError:
        return False
    return isinstance(packet, VideoPacket) and is_key(packet.codec, packet.data)


def stamp_of(message: Message) -> int:
    """When a picture's message says that it was taken; its log time where it does not."""
    try:
        return read_picture(message.channel, message.data).stamp_ns or message.log_time_ns
    except PayloadError:
        return message.log_time_ns


class ScenePictures:
    """The pictures of one reading.

    Args:
        path: the log, for the errors' texts.
        limits: what a picture may ask for.
        size: the recording's width and height in pixels; a picture of another is none of it.
        unreadable: where those that cannot be decoded are noted.
    """

    def __init__(
        self,
        path: Path,
        limits: Limits,
        size: tuple[int, int],
        unreadable: Unreadable,
    ) -> None:
        self._path = path
        self._limits = limits
        self._size = size
        self._unreadable = unreadable
        self._group: list[bytes] = []
        self._group_bytes = 0
        self._keyed = False
        self._decoder: VideoDecoder | VideoStream | None = None
        self._decoding: list[bytes] = []
        self._decoded = 0
        self._lock = Lock()

    def loader(self, message: Message) -> Load:
        """What decodes this message's picture when called with its frame's number; None where it
        cannot be.
        """
        if is_video(message):
            load = self.append(message)
        else:

            def load() -> Image:
                return self._still(message)

        def guarded(frame: int) -> Image | None:
            try:
                picture = load()
            except LimitError:
                raise
            except (PayloadError, _BadPictureError) as error:
                self._unreadable.note(message.log_time_ns, str(error), frame)
                return None
            height, width = picture.shape[:2]
            if (width, height) == self._size:
                return picture
            reason = f"a picture of {width}x{height}, the detections say {'x'.join(map(str, self._size))}"
            self._unreadable.note(message.log_time_ns, reason, frame)
            return None

        return guarded

    def _still(self, message: Message) -> Image:
        kind = payload_kind(message.channel)
        if kind not in PICTURES:
            raise RecordingError(
                f"messages of {kind or 'no schema'} are no pictures; known are"
                f" {', '.join(sorted(PICTURES))}",
                self._path,
                record=message.topic,
            )
        picture = read_picture(message.channel, message.data)
        try:
            if isinstance(picture, RawPicture):
                return raw_pixels(picture, limits=self._limits)
            header = still_header(picture.data, self._path)
            return decode_still(picture.data, header, path=self._path, limits=self._limits)
        except LimitError:
            raise
        except RecordingError as error:
            raise _BadPictureError(error.reason) from error

    def append(self, message: Message) -> Callable[[], Image]:
        """Take a packet into its group of pictures; what decodes it."""
        try:
            packet = read_picture(message.channel, message.data)
        except PayloadError as error:
            return _failing(error)
        assert isinstance(packet, VideoPacket)
        if is_key(packet.codec, packet.data):
            self._group, self._group_bytes, self._keyed = [], 0, True
        if not self._keyed:
            return _failing(
                _BadPictureError(
                    f"a packet of {packet.codec} without a key frame before it"
                )
            )
        self._group.append(packet.data)
        self._group_bytes += len(packet.data)
        check_group(self._group_bytes, self._limits, message, self._path)
        group, position, codec = self._group, len(self._group) - 1, packet.codec
        return lambda: self._load(group, position, codec)

    def _load(self, group: list[bytes], position: int, codec: str) -> Image:
        with self._lock:
            if (
                self._decoder is None
                or self._decoding is not group
                or self._decoded > position
            ):
                self._decoder = self._fresh(codec)
                self._decoding, self._decoded = group, 0
            image: Image | None = None
            while self._decoded <= position:
                image = self._next(group[self._decoded], self._decoded)
                self._decoded += 1
        if image is None:
            raise _BadPictureError(f"a packet of {codec} that gives no picture")
        return image

    def _fresh(self, codec: str) -> VideoDecoder | VideoStream:
        if codec == "h264":
            return VideoDecoder(path=self._path, limits=self._limits)
        return VideoStream(codec, self._path, self._limits, low_delay=True)

    def _next(self, data: bytes, position: int) -> Image | None:
        """The next packet's picture; None where it is damaged and not the one that is wanted."""
        decoder: Any = self._decoder
        try:
            if isinstance(decoder, VideoDecoder):
                return decoder.decode(data)
            found: dict[int, Image] = dict(decoder.decode(position, data))
        except LimitError:
            raise
        except RecordingError as error:
            raise _BadPictureError(error.reason) from error
        return found.get(position)


class _BadPictureError(Exception):
    """A picture that cannot be decoded; the text is the reason."""


def _failing(error: Exception) -> Callable[[], Image]:
    def fail() -> Image:
        raise error

    return fail


def check_group(held: int, limits: Limits, message: Message, path: Path) -> None:
    """Packets are kept until the next key frame, since any of them may be asked for.

    Raises:
        LimitError: they take too much.
    """
    if held > limits.max_open_bytes:
        raise LimitError(
            f"{held} bytes of video up to {message.log_time_ns} ns without a key frame,"
            f" over the limit max_open_bytes = {limits.max_open_bytes}",
            path,
            record=message.topic,
        )
