"""The summary section that a writer puts at a log's end."""

from __future__ import annotations

from dataclasses import dataclass, field

from recorders.log import records, wire


@dataclass(slots=True)
class SummaryBuilder:
    """What is gathered while writing: schemas and channels serialised, indexes, checksums."""

    schemas: dict[int, bytes] = field(default_factory=dict)
    channels: list[bytes] = field(default_factory=list)
    chunks: list[records.ChunkIndexRecord] = field(default_factory=list)
    attachments: list[records.AttachmentIndexRecord] = field(default_factory=list)
    metadata: list[records.MetadataIndexRecord] = field(default_factory=list)
    checksums: list[tuple[int, int, int]] = field(default_factory=list)

    def add_chunk(self, entry: records.ChunkIndexRecord) -> None:
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
                [records.encode_chunk_index(entry) for entry in self.chunks],
            ),
            (
                wire.ATTACHMENT_INDEX,
                [records.encode_attachment_index(entry) for entry in self.attachments],
            ),
            (
                wire.METADATA_INDEX,
                [records.encode_metadata_index(entry) for entry in self.metadata],
            ),
            (wire.CHECKSUMS, [records.encode_checksums(self.checksums)]),
        ]
        body, offsets = bytearray(), bytearray()
        for opcode, members in groups:
            if members:
                content = b"".join(members)
                offsets += records.encode_summary_offset(
                    opcode, start + len(body), len(content)
                )
                body += content
        before = bytes(body + offsets)
        return before + records.encode_footer(start, start + len(body), before)

    def _statistics(self, counts: dict[int, int]) -> bytes:
        filled = [entry for entry in self.chunks if entry.offsets]
        return records.encode_statistics(
            records.StatisticsRecord(
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
