"""What a log holds, in figures (`inspect`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log.blocks import checked_chunk, raw_chunk
from recorders.log.doctor import Finding, Severity, examine
from recorders.log.model import ChannelInfo
from recorders.log.reader import LogReader, read_attachment
from recorders.log.storage import RecordFile

__all__ = [
    "AttachmentInfo",
    "CompressionInfo",
    "Finding",
    "LogInfo",
    "Severity",
    "examine",
    "inspect",
]


@dataclass(frozen=True, slots=True)
class AttachmentInfo:
    """An attachment without its data."""

    name: str
    media_type: str
    size_bytes: int
    log_time_ns: int
    create_time_ns: int


@dataclass(frozen=True, slots=True)
class CompressionInfo:
    """The chunks of one compression ("" for none)."""

    compression: str
    chunks: int
    stored_bytes: int
    unpacked_bytes: int


@dataclass(frozen=True, slots=True)
class LogInfo:
    """What a log holds.

    ``is_indexed`` says whether its summary gave all of this; otherwise the file was scanned.
    """

    path: Path
    size_bytes: int
    profile: str
    library: str
    message_count: int
    start_ns: int | None
    end_ns: int | None
    channels: list[ChannelInfo]
    metadata: list[tuple[str, dict[str, str]]]
    attachments: list[AttachmentInfo]
    compression: list[CompressionInfo]
    is_indexed: bool

    @property
    def duration_ns(self) -> int:
        """From the earliest message to the latest; 0 without messages."""
        return (
            0
            if self.start_ns is None or self.end_ns is None
            else self.end_ns - self.start_ns
        )


def inspect(path: str | Path, limits: Limits = DEFAULT_LIMITS) -> LogInfo:
    """Sizes, times, channels with their counts, metadata, attachments, compression.

    Raises:
        RecordingError: the log cannot be read.
    """
    with LogReader(path, limits) as log, RecordFile(path, limits) as file:
        return LogInfo(
            path=log.path,
            size_bytes=file.size,
            profile=log.header.profile,
            library=log.header.library,
            message_count=log.message_count,
            start_ns=log.start_ns,
            end_ns=log.end_ns,
            channels=log.channels,
            metadata=log.metadata(),
            attachments=_attachments(log, file),
            compression=_compression(log, file),
            is_indexed=not log.index.scanned,
        )


def _attachments(log: LogReader, file: RecordFile) -> list[AttachmentInfo]:
    if log.index.attachment_indexes:
        return [
            AttachmentInfo(
                index.name,
                index.media_type,
                index.data_size,
                index.log_time_ns,
                index.create_time_ns,
            )
            for index in log.index.attachment_indexes
        ]
    found = (read_attachment(file, raw) for raw in log.index.attachments)
    return [
        AttachmentInfo(a.name, a.media_type, len(a.data), a.log_time_ns, a.create_time_ns)
        for a in found
    ]


def _compression(log: LogReader, file: RecordFile) -> list[CompressionInfo]:
    totals: dict[str, tuple[int, int, int]] = {}
    for block in log.index.blocks:
        if not block.chunked:
            continue
        # Times and sizes are told by the summary: is it true?
        head = (
            file.chunk_head(raw_chunk(block))
            if block.index is None
            else checked_chunk(file, block)[1]
        )
        chunks, stored, unpacked = totals.get(head.compression, (0, 0, 0))
        totals[head.compression] = (
            chunks + 1,
            stored + (block.index.compressed_size if block.index else block.length),
            unpacked + head.uncompressed_size,
        )
    return [CompressionInfo(name, *totals[name]) for name in sorted(totals)]
