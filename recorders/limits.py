"""What a recording may make us allocate: every bound is a named field with a default."""

from __future__ import annotations

from dataclasses import dataclass

MIB = 1024 * 1024


@dataclass(frozen=True, slots=True)
class Limits:
    """Upper bounds, checked before allocating. A recording is untrusted data.

    Attributes:
        max_record_bytes: one MCAP record outside a chunk.
        max_chunk_bytes: a chunk's uncompressed size, declared and real.
        max_attachment_bytes: one attachment.
        max_message_bytes: one message's payload.
        max_picture_pixels: width times height, from the picture's header.
        max_picture_side: width or height, from the picture's header.
        max_json_depth: nesting of a JSON payload.
        max_messages_per_frame: messages of one frame over all channels.
        max_detections_per_frame: detections in one frame.
        max_channels: channels in one log.
        max_summary_bytes: the summary section at a log's end.
        max_messages_per_chunk: messages in one chunk.
        max_open_bytes: decoded chunks held at once while chunks that overlap in time are merged;
            beyond it their payloads wait in a temporary file.
        max_unpacked_bytes: what a whole file that is compressed unpacks to.
    """

    max_record_bytes: int = 256 * MIB
    max_chunk_bytes: int = 256 * MIB
    max_attachment_bytes: int = 256 * MIB
    max_message_bytes: int = 128 * MIB
    max_picture_pixels: int = 64_000_000
    max_picture_side: int = 16_384
    max_json_depth: int = 32
    max_messages_per_frame: int = 10_000
    max_detections_per_frame: int = 10_000
    max_channels: int = 10_000
    max_summary_bytes: int = 64 * MIB
    max_messages_per_chunk: int = 2_000_000
    max_open_bytes: int = 256 * MIB
    max_unpacked_bytes: int = 64 * 1024 * MIB


DEFAULT_LIMITS = Limits()
