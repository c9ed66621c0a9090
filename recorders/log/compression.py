"""Chunk compression, bounded: what a chunk unpacks to never takes more memory than it declares."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import IO, cast

import lz4.frame
import zstandard

from recorders.log.wire import WireError

ZSTD_LEVEL = 3
KNOWN = ("", "lz4", "zstd")
_STEP = 1 << 20
_MAX_WINDOW_BYTES = 1 << 27


class TooLargeError(Exception):
    """The data unpacks to more than was declared: (declared size)."""


def compress(compression: str, data: bytes | bytearray) -> bytes | bytearray:
    """Pack ``data``; the same bytes and the same library version give the same result; ``data``
    itself without.
    """
    if compression == "zstd":
        return zstandard.ZstdCompressor(level=ZSTD_LEVEL).compress(data)
    if compression == "lz4":
        return bytes(lz4.frame.compress(bytes(data)))
    return data


def decompress(compression: str, data: bytes, declared: int) -> bytes:
    """Unpack ``data``, which says of itself that it gives ``declared`` bytes.

    Raises:
        WireError: the data is damaged, gives less than declared, or the compression is unknown.
        TooLargeError: it gives more than declared; unpacking stopped there.
    """
    if compression == "":
        result = data
    elif compression == "zstd":
        result = _zstd(data, declared)
    elif compression == "lz4":
        result = _lz4(data, declared)
    else:
        raise WireError(
            f"compression {compression!r} is unknown; known are none, lz4 and zstd"
        )
    if len(result) > declared:
        raise TooLargeError(declared)
    if len(result) < declared:
        raise WireError(f"it declares {declared} bytes and unpacks to {len(result)}")
    return result


def unpacked(compression: str, packed: Iterator[bytes]) -> Iterator[bytes]:
    """The unpacked data, piece by piece, of packed data that come in pieces.

    Raises:
        WireError: the data is damaged, or the compression is unknown.
    """
    if compression == "":
        yield from packed
    elif compression == "zstd":
        yield from _zstd_pieces(packed)
    elif compression == "lz4":
        yield from _lz4_pieces(packed)
    else:
        raise WireError(f"compression {compression!r} is unknown")


def _zstd_pieces(packed: Iterator[bytes]) -> Iterator[bytes]:
    reader = zstandard.ZstdDecompressor(max_window_size=_MAX_WINDOW_BYTES).stream_reader(
        cast(IO[bytes], _Joined(packed)), read_across_frames=True
    )
    try:
        while piece := reader.read(_STEP):
            yield piece
    except zstandard.ZstdError as error:
        raise WireError(f"zstd cannot unpack it: {error}") from error


def _lz4_pieces(packed: Iterator[bytes]) -> Iterator[bytes]:
    frame = lz4.frame.LZ4FrameDecompressor()
    try:
        for data in packed:
            rest = data
            while True:
                piece = frame.decompress(rest, max_length=_STEP)
                rest = b""
                if piece:
                    yield piece
                if frame.eof:
                    rest = frame.unused_data or b""
                    frame = lz4.frame.LZ4FrameDecompressor()
                    if not rest:
                        break
                elif not piece or frame.needs_input:
                    break
    except RuntimeError as error:
        raise WireError(f"lz4 cannot unpack it: {error}") from error


class _Joined(io.RawIOBase):
    """Pieces as a file to read."""

    def __init__(self, pieces: Iterator[bytes]) -> None:
        self._pieces = pieces
        self._rest = b""

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        if not self._rest:
            self._rest = next(self._pieces, b"")
        size = len(self._rest) if size < 0 else size
        found, self._rest = self._rest[:size], self._rest[size:]
        return found


def _zstd(data: bytes, declared: int) -> bytes:
    try:
        frame = zstandard.get_frame_parameters(data)
        if frame.content_size == declared:
            try:
                return zstandard.ZstdDecompressor().decompress(data, allow_extra_data=False)
            except zstandard.ZstdError:
                pass  # several frames in a row, or damage: the stream below tells which
        reader = zstandard.ZstdDecompressor(
            max_window_size=_MAX_WINDOW_BYTES
        ).stream_reader(data, read_across_frames=True)
        return _gather(reader.read, declared)
    except zstandard.ZstdError as error:
        raise WireError(f"zstd cannot unpack it: {error}") from error


def _lz4(data: bytes, declared: int) -> bytes:
    result = bytearray()
    try:
        while data:
            frame = lz4.frame.LZ4FrameDecompressor()
            piece = frame.decompress(data, max_length=declared + 1 - len(result))
            while piece:
                result += piece
                if len(result) > declared:
                    raise TooLargeError(declared)
                if frame.eof:
                    break
                piece = frame.decompress(b"", max_length=declared + 1 - len(result))
            if not frame.eof:
                raise WireError("lz4 cannot unpack it: the frame is not complete")
            data = frame.unused_data or b""
    except RuntimeError as error:
        raise WireError(f"lz4 cannot unpack it: {error}") from error
    return bytes(result)


def _gather(read: object, declared: int) -> bytes:
    assert callable(read)
    result = bytearray()
    while piece := read(min(_STEP, declared + 1 - len(result))):
        result += piece
        if len(result) > declared:
            raise TooLargeError(declared)
    return bytes(result)
