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
from recorders.payloads import (
    PayloadError,
    RawPicture,
    Still,
    VideoPacket,
    own_stamp_ns,
    read_picture,
)
from recorders.payloads.pictures import bits_used, is_deep, raw_pixels
from recorders.payloads.stream import VideoStream, other_codec
from recorders.pictures import Image, check_size, is_whole
from recorders.sources.packet_times import Packet, PacketTimes
from recorders.sources.source import PictureError
from recorders.stills import (
    StillHeader,
    decode_still,
    still_header,
    stored_values,
    to_bgr,
)
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
        clipped: how many pictures have values of more bits than that.
    """

    def __init__(self, path: Path, left_out: LeftOut, limits: Limits) -> None:
        self._path = path
        self._left_out = left_out
        self._limits = limits
        self._video: VideoStream | None = None
        self._times = PacketTimes()
        self._number = 0
        self._count = 0
        self.bits = 0
        self.clipped = 0

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
            return [self._lost(f"{error}", message, own_stamp_ns(message))]
        except RecordingError as error:
            return [self._lost(error.reason, message, own_stamp_ns(message))]

    def rest(self) -> list[Pictured]:
        """What a video's decoder still holds back."""
        if self._video is None:
            return []
        return self._given(self._video.rest(), reorders=False, ended=True)

    def _lost(self, reason: str, message: Message, stamp_ns: int = 0) -> Pictured:
        where = f"{message.log_time_ns} ns on {message.topic} (picture {self._count})"
        self._left_out.note(reason, where)
        self._count += 1
        return Pictured(message, stamp_ns)

    def _still(self, message: Message, found: Still) -> Pictured:
        header = still_header(found.data, self._path)
        if header.format in ("jpeg", "png") and not is_whole(found.data, header.format):
            raise RecordingError(f"a {header.format} picture that is cut off", self._path)
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
            if header.bits > 8:
                check_size(header.width, header.height, self._path, self._limits)
                values = stored_values(data, header, self._path)
                self._fill(still_bits(values))
                return to_bgr(values, header.orientation, self.bits)
            return decode_still(data, header, path=self._path, limits=self._limits)
        except LimitError:
            raise
        except RecordingError as error:
            raise PictureError(
                error.reason, self._path, f"{message.topic} at {message.log_time_ns} ns"
            ) from error

    def _raw(self, message: Message, found: RawPicture) -> Pictured:
        if is_deep(found):
            self._fill(bits_used(found))
        image = raw_pixels(found, self.bits or 16, self._limits)
        self._count += 1
        return Pictured(
            message, found.stamp_ns, (image.shape[1], image.shape[0]), lambda: image
        )

    def _fill(self, bits: int) -> None:
        self.bits = self.bits or bits
        self.clipped += bits > self.bits

    def _packet(self, message: Message, found: VideoPacket) -> list[Pictured]:
        before: list[Pictured] = []
        if self._video is None or self._video.codec != found.codec:
            before = self.rest()
            self._video = VideoStream(found.codec, self._path, self._limits)
        video = self._video
        if video.holds_no_picture(found.data):
            video.decode(self._number, found.data)
            return before
        index = self._number
        self._number += 1
        self._times.put(index, Packet(message, found.stamp_ns))
        try:
            pictures = video.decode(index, found.data)
        except LimitError:
            raise
        except RecordingError as error:
            self._times.lost(index, error.reason)
            pictures = []
        else:
            if video.waits_for_key and index not in {number for number, _ in pictures}:
                self._times.lost(index, _without_key(found.codec, found.data))
        return before + self._given(pictures, video.reorders)

    def _given(
        self, pictures: list[tuple[int, Image]], reorders: bool, ended: bool = False
    ) -> list[Pictured]:
        for index, image in pictures:
            self._times.picture(index, image)
        found = []
        codec = "" if self._video is None else self._video.codec
        for one in self._times.ready(reorders, ended):
            (message, stamp), picture = one.packet, one.image
            if picture is None:
                reason = one.reason or f"a packet of {codec} that gives no picture"
                found.append(self._lost(reason, message, stamp))
                continue
            self._count += 1
            size = (picture.shape[1], picture.shape[0])
            found.append(Pictured(message, stamp, size, partial(_same, picture)))
        return found


def _without_key(codec: str, data: bytes) -> str:
    if other := other_codec(codec, data):
        return f"a packet of {other} that is said to be {codec}"
    return f"a packet of {codec} without a whole key frame before it"


def bits_of(message: Message, path: Path, limits: Limits) -> int:
    """How many bits the values of a picture of more than eight fill; 0 of any other."""
    try:
        found = read_picture(message.channel, message.data)
        if isinstance(found, RawPicture) and is_deep(found):
            check_size(found.width, found.height, path, limits)
            return bits_used(found)
        if isinstance(found, Still):
            header = still_header(found.data, path)
            if header.bits > 8:
                check_size(header.width, header.height, path, limits)
                return still_bits(stored_values(found.data, header, path))
    except (PayloadError, RecordingError):
        pass
    return 0


def _same(image: Image) -> Image:
    return image
