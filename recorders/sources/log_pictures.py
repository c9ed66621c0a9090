"""The pictures of one topic: decoded where they must be, left out and named where they cannot be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from recorders.errors import LimitError, RecordingError
from recorders.left_out import LeftOut
from recorders.limits import Limits
from recorders.log import Message
from recorders.payloads import PayloadError, RawPicture, Still, VideoPacket, read_picture
from recorders.payloads.pictures import bits_used, is_deep, raw_pixels
from recorders.payloads.stream import VideoStream
from recorders.pictures import Image, is_whole
from recorders.sources.source import PictureError
from recorders.stills import StillHeader, decode_still, still_header, stored_values
from recorders.stills import bits_used as still_bits


@dataclass(slots=True)
class Pictured:
    """A message's picture, ready to be recorded.

    Attributes:
        message: where it came from.
        stamp_ns: its own stamp, 0 where there is none.
        size: width and height; None where it cannot be decoded.
        load: decodes it; None where it cannot be.
        encoded, format: its bytes, where they can be recorded as they are.
    """

    message: Message
    stamp_ns: int
    size: tuple[int, int] | None = None
    load: Callable[[], Image] | None = None
    encoded: bytes | None = None
    format: str | None = None


class PictureReader:
    """Messages into pictures, in order; a video's come when its decoder gives them.

    Attributes:
        bits: how many bits the values of pictures of more than eight fill, 0 until one is met.
    """

    def __init__(self, path: Path, left_out: LeftOut, limits: Limits) -> None:
        self._path = path
        self._left_out = left_out
        self._limits = limits
        self._video: VideoStream | None = None
        self._packets: dict[int, tuple[Message, int]] = {}
        self._count = 0
        self.bits = 0

    def take(self, message: Message) -> list[Pictured]:
        """The pictures that this message completes; one that cannot be decoded is a picture
        without pixels.
        """
        try:
            found = read_picture(message.channel, message.data)
            if isinstance(found, VideoPacket):
                return self._packet(message, found)
            if isinstance(found, RawPicture):
                return [self._raw(message, found)]
            return [self._still(message, found)]
        except LimitError:
            raise
        except PayloadError as error:
            return [self._lost(f"{error}", message)]
        except RecordingError as error:
            return [self._lost(error.reason, message)]

    def rest(self) -> list[Pictured]:
        """What a video's decoder still holds back."""
        return [] if self._video is None else self._given(self._video.rest())

    def _lost(self, reason: str, message: Message, stamp_ns: int = 0) -> Pictured:
        where = f"{message.log_time_ns} ns on {message.topic} (picture {self._count})"
        self._left_out.note(reason, where)
        self._count += 1
        return Pictured(message, stamp_ns)

    def _still(self, message: Message, found: Still) -> Pictured:
        header = still_header(found.data, self._path)
        if header.format in ("jpeg", "png") and not is_whole(found.data, header.format):
            raise RecordingError(f"a {header.format} picture that is cut off", self._path)
        if header.bits > 8 and not self.bits:
            self.bits = still_bits(stored_values(found.data, header, self._path))
        self._count += 1
        keep = header.as_is
        return Pictured(
            message,
            found.stamp_ns,
            (header.width, header.height),
            partial(self._load_still, found.data, header, message),
            found.data if keep else None,
            header.format if keep else None,
        )

    def _load_still(self, data: bytes, header: StillHeader, message: Message) -> Image:
        try:
            return decode_still(
                data, header, bits=self.bits or 16, path=self._path, limits=self._limits
            )
        except LimitError:
            raise
        except RecordingError as error:
            raise PictureError(
                error.reason, self._path, f"{message.topic} at {message.log_time_ns} ns"
            ) from error

    def _raw(self, message: Message, found: RawPicture) -> Pictured:
        if is_deep(found) and not self.bits:
            self.bits = bits_used(found)
        image = raw_pixels(found, self.bits or 16, self._limits)
        self._count += 1
        return Pictured(
            message, found.stamp_ns, (image.shape[1], image.shape[0]), lambda: image
        )

    def _packet(self, message: Message, found: VideoPacket) -> list[Pictured]:
        if self._video is None or self._video.codec != found.codec:
            self._video = VideoStream(found.codec, self._path, self._limits)
        index = self._count
        self._packets[index] = (message, found.stamp_ns)
        try:
            given = self._video.decode(index, found.data)
        except LimitError:
            raise
        except RecordingError as error:
            del self._packets[index]
            return [self._lost(error.reason, message, found.stamp_ns)]
        if not given and self._video.waits_for_key:
            del self._packets[index]
            reason = f"a packet of {found.codec} without a whole key frame before it"
            return [self._lost(reason, message, found.stamp_ns)]
        self._count += 1
        return self._given(given)

    def _given(self, given: list[tuple[int, Image]]) -> list[Pictured]:
        found = []
        for index, image in given:
            entry = self._packets.pop(index, None)
            if entry is not None:
                size = (image.shape[1], image.shape[0])
                found.append(Pictured(entry[0], entry[1], size, partial(_same, image)))
        # What came before and gave nothing never will: parameter sets sent apart.
        newest = max((index for index, _ in given), default=-1)
        for index in [packet for packet in self._packets if packet < newest - 64]:
            del self._packets[index]
        return found


def _same(image: Image) -> Image:
    return image
