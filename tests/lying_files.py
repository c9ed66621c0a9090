"""Files of a few bytes that claim to be large, made by hand."""

from __future__ import annotations

import struct
import zlib

import zstandard

_MAGIC = b"\x89MCAP0\r\n"


def png(width: int, height: int) -> bytes:
    """A PNG that claims any size."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = zlib.compress(b"\0" * 99)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", pixels)
        + chunk(b"IEND", b"")
    )


def mcap_bomb(unpacked: int, declared: int) -> bytes:
    """An MCAP log whose one chunk declares a size in bytes and unpacks to another, of zeros."""

    def record(opcode: int, content: bytes) -> bytes:
        return struct.pack("<BQ", opcode, len(content)) + content

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    packed = zstandard.ZstdCompressor().compress(bytes(unpacked))
    fields = struct.pack("<QQQI", 0, 10, declared, 0) + text("zstd")
    chunk = fields + struct.pack("<Q", len(packed)) + packed
    body = _MAGIC + record(1, text("") + text("by hand")) + record(6, chunk)
    body += record(15, struct.pack("<I", zlib.crc32(body)))
    return body + record(2, struct.pack("<QQI", 0, 0, 0)) + _MAGIC
