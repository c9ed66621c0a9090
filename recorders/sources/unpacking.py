"""Files of logs that are packed as a whole with zstd, unpacked into a temporary folder."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import zstandard

from recorders.errors import LimitError, SourceError
from recorders.limits import DEFAULT_LIMITS, Limits

PACKED = (".zstd", ".zst")
_STEP = 1 << 20
_MAGIC = b"\x28\xb5\x2f\xfd"


class Unpacker:
    """Unpacks files; `close` removes what was unpacked.

    Args:
        limits: how much one may unpack to, and a message.
    """

    def __init__(self, limits: Limits = DEFAULT_LIMITS) -> None:
        self._limits = limits
        self._folders: list[str] = []

    def file(self, path: Path, number: int) -> Path:
        """The file itself, or where it was unpacked to.

        Raises:
            SourceError: it cannot be unpacked.
            LimitError: it unpacks to too much.
        """
        if path.suffix.lower() not in PACKED:
            return path
        if not self._folders:
            self._folders.append(tempfile.mkdtemp(prefix="scenetrace-"))
        out = Path(self._folders[0]) / f"{number}-{path.with_suffix('').name}"
        limit, size = self._limits.max_unpacked_bytes, 0
        try:
            with path.open("rb") as source, out.open("wb") as target:
                unpacker = zstandard.ZstdDecompressor().stream_reader(
                    source, read_across_frames=True
                )
                while piece := unpacker.read(_STEP):
                    size += len(piece)
                    if size > limit:
                        raise LimitError(
                            f"unpacks to over {limit} bytes (max_unpacked_bytes)", path
                        )
                    target.write(piece)
        except zstandard.ZstdError as error:
            raise SourceError(f"zstd cannot unpack it: {error}", path) from error
        except OSError as error:
            raise SourceError(f"cannot be unpacked: {error.strerror}", path) from error
        return out

    def close(self) -> None:
        """Remove what was unpacked."""
        for folder in self._folders:
            shutil.rmtree(folder, ignore_errors=True)


def is_packed(data: bytes) -> bool:
    """Whether a ROS message was compressed by itself: CDR begins with a 0, zstd does not.

    >>> is_packed(bytes([0, 1, 0, 0])), is_packed(bytes([0x28, 0xB5, 0x2F, 0xFD]))
    (False, True)
    """
    return data.startswith(_MAGIC)


def unpacked_message(
    data: bytes, topic: str, time_ns: int, path: Path, limits: Limits
) -> bytes:
    """A message that was compressed by itself.

    Raises:
        SourceError: it is no zstd.
        LimitError: it unpacks to too much.
    """
    limit = limits.max_message_bytes
    try:
        found = zstandard.ZstdDecompressor().stream_reader(data).read(limit + 1)
    except zstandard.ZstdError as error:
        raise SourceError(
            f"the message at {time_ns} ns on {topic} is no zstd: {error}", path
        ) from error
    if len(found) > limit:
        raise LimitError(
            f"the message at {time_ns} ns unpacks to over {limit} bytes (max_message_bytes)",
            path,
            record=topic,
        )
    return bytes(found)
