"""A digest of a log's messages that does not depend on how the file is laid out."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Collection
from pathlib import Path

from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log.model import ChannelInfo
from recorders.log.reader import LogReader

_HEAD = struct.Struct("<QQIQ")


def content_digest(
    path: str | Path, limits: Limits = DEFAULT_LIMITS, topics: Collection[str] | None = None
) -> str:
    """SHA-256, in hex, of what a log says, not of its bytes.

    It covers every channel (topic, schema, encodings, metadata) and each channel's messages in
    their total order with log time, publish time, sequence number and payload; not chunking,
    compression, channel ids, attachments, metadata records, nor how messages of different
    channels with one log time lie in the file. A log written again with the same messages has the
    same digest.

    Args:
        path: the log.
        limits: bounds for reading it.
        topics: only the channels of these topics.
    """
    with LogReader(path, limits) as log:
        return content_digest_of(log, topics)


def content_digest_of(log: LogReader, topics: Collection[str] | None = None) -> str:
    """`content_digest` of an open log."""
    streams: dict[bytes, hashlib._Hash] = {}
    by_id: dict[int, hashlib._Hash] = {}
    for channel in log.channels:
        if topics is None or channel.topic in topics:
            key = _describe(channel)
            # Two channels that differ in nothing but their id are one stream.
            by_id[channel.id] = streams.setdefault(key, hashlib.sha256(key))
    pack = _HEAD.pack
    for message in log.messages(topics):
        data = message.data
        stream = by_id[message.channel.id]
        stream.update(
            pack(message.log_time_ns, message.publish_time_ns, message.sequence, len(data))
        )
        stream.update(data)
    whole = hashlib.sha256(b"scenetrace log digest 1\n")
    for key in sorted(streams):
        whole.update(streams[key].digest())
    return whole.hexdigest()


def _describe(channel: ChannelInfo) -> bytes:
    """The channel as bytes: every field with its length before it."""
    fields = [channel.topic.encode(), channel.message_encoding.encode()]
    if channel.schema is not None:
        fields += [
            channel.schema.name.encode(),
            channel.schema.encoding.encode(),
            channel.schema.data,
        ]
    for name in sorted(channel.metadata):
        fields += [name.encode(), channel.metadata[name].encode()]
    parts = [struct.pack("<QB", len(fields), channel.schema is not None)]
    for field in fields:
        parts += [struct.pack("<Q", len(field)), field]
    return b"".join(parts)
