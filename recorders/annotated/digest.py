"""The digest chain: what makes two replays provably the same, and names the frame and channel
where they are not.

Every frame's annotated payloads are hashed by channel; a link hashes the link before it, the
frame's number, its time, its recorded messages and its channels' hashes. The last link is the
output digest.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable, Sequence
from functools import lru_cache

from recorders.log import Message
from recorders.messages import Digest

START = "0" * 64
Payloads = Sequence[tuple[str, bytes]]
# Numbers are hashed as 16 bytes, little end first; those of MCAP are not negative and fill the
# lower eight at most.
_MESSAGE = struct.Struct("<Q8xQ8xQ8xQ8x")
_SIZE = struct.Struct("<Q8x")


def _number(value: int) -> bytes:
    return value.to_bytes(16, "little", signed=True)


def _framed(*parts: bytes) -> bytes:
    return b"".join([piece for part in parts for piece in (_number(len(part)), part)])


@lru_cache(maxsize=256)
def _framed_text(*parts: str) -> bytes:
    return _framed(*(part.encode() for part in parts))


_HEX_BYTES = _number(64)


def _framed_hex(digest: str) -> bytes:
    return _HEX_BYTES + digest.encode() if len(digest) == 64 else _framed(digest.encode())


def recorded_digest(messages: Iterable[Message]) -> str:
    """SHA-256 of recorded messages: topic, schema, times, sequence number, payload.

    Messages of one time are taken by topic, and of one topic in their order in the file: how a
    writer distributes channels over chunks moves them in the file and changes nothing that a
    replay sees.
    """
    h = hashlib.sha256()
    for message in sorted(messages, key=lambda m: (m.log_time_ns, m.topic)):
        name = message.channel.schema.name if message.channel.schema is not None else ""
        h.update(
            _framed_text(message.topic, name, message.channel.message_encoding)
            + _MESSAGE.pack(
                message.log_time_ns,
                message.publish_time_ns,
                message.sequence,
                len(message.data),
            )
        )
        h.update(message.data)
    return h.hexdigest()


def chain_link(previous: str, digest: str) -> str:
    """The next link of a chain of digests: the input digest is the last link over
    `recorded_digest` of each frame.
    """
    return hashlib.sha256(f"{previous}{digest}".encode()).hexdigest()


def channel_digests(payloads: Payloads) -> dict[str, str]:
    """SHA-256 per channel over its payloads in order, channels by name."""
    parts: dict[str, list[bytes]] = {}
    size = _SIZE.pack
    for name, payload in payloads:
        if name in parts:
            parts[name] += size(len(payload)), payload
        else:
            parts[name] = [size(len(payload)), payload]
    sha256 = hashlib.sha256
    return {name: sha256(b"".join(parts[name])).hexdigest() for name in sorted(parts)}


def link(
    previous: str, frame: int, time_ns: int, recorded: str, channels: dict[str, str]
) -> str:
    """The chain's next link."""
    pieces = [previous.encode(), _number(frame), _number(time_ns), recorded.encode()]
    for name in sorted(channels):
        pieces += (_framed_text(name), _framed_hex(channels[name]))
    return hashlib.sha256(b"".join(pieces)).hexdigest()


def digest(
    previous: str, frame: int, time_ns: int, recorded: str, payloads: Payloads
) -> Digest:
    """The digest message of a frame."""
    channels = channel_digests(payloads)
    return Digest(
        frame, recorded, channels, link(previous, frame, time_ns, recorded, channels)
    )
