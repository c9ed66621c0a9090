"""The summary section that a writer puts at a log's end."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field

from recorders.log import encoding, wire


@dataclass(slots=True)
class SummaryBuilder:
    """What is gathered while writing: schemas and channels serialised, indexes, checksums."""

    schemas: dict[int, bytes] = field(default_factory=dict)
    channels: list[bytes] = field(default_factory=list)
    chunks: list[wire.ChunkIndexRecord] = field(default_factory=list)
    attachments: list[wire.AttachmentIndexRecord] = field(default_factory=list)
    metadata: list[wire.MetadataIndexRecord] = field(default_factory=list)
    checksums: list[tuple[int, int, int]] = field(default_factory=list)

    def add_chunk(self, entry: wire.ChunkIndexRecord) -> None:
        """Take in a written chunk."""
        self.chunks.append(entry)

    def encode(self, start: int, counts: dict[int, int]) -> bytes:
        """Summary, summary offsets and footer, for a summary that begins at byte ``start`` of the
        file.

        ``counts`` are the numbers of messages by channel id.
        """
        groups = [
            (wire.SCHEMA, [self.schemas[identity] for identity in sorted(self.schemas)]),
            (wire.CHANNEL, self.channels),
            (wire.STATISTICS, [self._statistics(counts)]),
            (
                wire.CHUNK_INDEX,
                [encoding.encode_chunk_index(entry) for entry in self.chunks],
            ),
            (
                wire.ATTACHMENT_INDEX,
                [encoding.encode_attachment_index(entry) for entry in self.attachments],
            ),
            (wire.METADATA_INDEX, [_metadata_index(entry) for entry in self.metadata]),
            (wire.CHECKSUMS, [encoding.encode_checksums(self.checksums)]),
        ]
        body, offsets = bytearray(), bytearray()
        for opcode, members in groups:
            if members:
                content = b"".join(members)
                offsets += encoding.record(
                    wire.SUMMARY_OFFSET,
                    struct.pack("<BQQ", opcode, start + len(body), len(content)),
                )
                body += content
        footer = wire.PREFIX.pack(wire.FOOTER, wire.FOOTER_BODY.size)
        footer += struct.pack("<QQ", start, start + len(body))
        tail = bytes(body + offsets) + footer
        return tail + wire.U32.pack(zlib.crc32(tail))

    def _statistics(self, counts: dict[int, int]) -> bytes:
        filled = [entry for entry in self.chunks if entry.message_index_offsets]
        return encoding.encode_statistics(
            wire.StatisticsRecord(
                message_count=sum(counts.values()),
                schema_count=len(self.schemas),
                channel_count=len(self.channels),
                attachment_count=len(self.attachments),
                metadata_count=len(self.metadata),
                chunk_count=len(self.chunks),
                start_ns=min((entry.start_ns for entry in filled), default=0),
                end_ns=max((entry.end_ns for entry in filled), default=0),
                channel_message_counts=counts,
            )
        )


def _metadata_index(entry: wire.MetadataIndexRecord) -> bytes:
    return encoding.record(
        wire.METADATA_INDEX,
        struct.pack("<QQ", entry.offset, entry.length),
        encoding.text(entry.name),
    )
