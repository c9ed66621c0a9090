"""The recorded pictures as they are stored, for formats that take them undecoded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from recorders import channels
from recorders.annotated.reader import AnnotatedLog
from recorders.log import LogReader
from recorders.payloads import PayloadError, VideoPacket, read_picture
from recorders.payloads.pictures import Still

_MAGIC = {b"\xff\xd8": "jpeg", b"\x89PNG": "png", b"RIFF": "webp"}


@dataclass(frozen=True)
class StoredPicture:
    """A picture's bytes: ``kind`` is jpeg, png or webp, or a video's codec as FFmpeg calls it."""

    time_ns: int
    kind: str
    data: bytes

    @property
    def is_video(self) -> bool:
        """A packet of a video."""
        return self.kind not in _MAGIC.values()


@dataclass
class StoredPictures:
    """The pictures of a camera, in order.

    Attributes:
        log: where they are.
        left_out: how many are stored in a way that this does not take.
    """

    log: AnnotatedLog
    left_out: int = field(default=0, init=False)

    def before(self, time_ns: int) -> int:
        """How many there are before a log time."""
        topic = channels.topic(self.log.camera, "image")
        with LogReader(self.log.path, self.log.limits) as reader:
            return sum(1 for _ in reader.messages([topic], end_ns=time_ns))

    def __iter__(self) -> Iterator[StoredPicture]:
        topic = channels.topic(self.log.camera, "image")
        with LogReader(self.log.path, self.log.limits) as reader:
            for message in reader.messages([topic]):
                try:
                    found = read_picture(message.channel, message.data)
                except PayloadError:
                    self.left_out += 1
                    continue
                if isinstance(found, VideoPacket):
                    yield StoredPicture(message.log_time_ns, found.codec, found.data)
                elif isinstance(found, Still) and (kind := _kind(found.data)):
                    yield StoredPicture(message.log_time_ns, kind, found.data)
                else:
                    self.left_out += 1


def _kind(data: bytes) -> str:
    return next((kind for magic, kind in _MAGIC.items() if data.startswith(magic)), "")
