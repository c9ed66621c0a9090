"""Folders of JPEG and PNG pictures, in the order of their numbers; their bytes are recorded as
they are.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

from recorders.errors import LimitError, RecordingError, SourceError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.pictures import (
    PictureHeader,
    check_size,
    decode_picture,
    is_whole,
    read_header,
)
from recorders.sources.source import Image, SourceFrame, rate_or_assumed, spread

_SUFFIXES = frozenset({".jpg", ".jpeg", ".png"})
_HEADER_BYTES = 1 << 20
_DIGITS = re.compile(r"(\d+)")


class _CutOffError(SourceError):
    """A picture without its end."""


class ImageFolderSource:
    """A folder of pictures: frame k is the k-th by number (``2.jpg`` before ``10.jpg``), at a
    constant rate.

    Other files in the folder are left alone. All pictures must be of one size. A last picture
    that is cut off is left out, any other one that is damaged ends the reading.

    Raises:
        SourceError: no such folder, no picture in it, or one that is not a JPEG or PNG.
        LimitError: a picture claims more pixels than the limits allow.
    """

    name = "images"
    has_images = True
    stills = True
    has_detections = False

    def __init__(
        self, path: Path, fps: Fraction | None = None, limits: Limits = DEFAULT_LIMITS
    ) -> None:
        self.path = path
        self.notes: list[str] = []
        self.losses: list[str] = []
        self._limits = limits
        self._digests: list[tuple[str, str]] = []
        try:
            names = [
                p.name
                for p in path.iterdir()
                if p.suffix.lower() in _SUFFIXES and not p.name.startswith(".")
            ]
        except OSError as error:
            raise SourceError(f"cannot be read: {error.strerror}", path) from error
        if not names:
            inside = sorted(p.name for p in path.iterdir() if p.is_dir())
            hint = f"; it holds the folders {', '.join(inside[:5])}" if inside else ""
            raise SourceError(f"no JPEG or PNG pictures in this folder{hint}", path)
        self._names = sorted(names, key=by_number)
        header = self._header(self._names[0])
        self.width, self.height = header.width, header.height
        self.frame_count: int | None = len(self._names)
        self._rate = rate_or_assumed(fps, self.notes)
        self.frame_ns = self._rate.frame_ns
        self._note_gaps()

    def _note_gaps(self) -> None:
        numbers = [_number(name) for name in self._names]
        known = [number for number in numbers if number is not None]
        missing = known[-1] - known[0] + 1 - len(known) if known else 0
        if len(known) == len(numbers) and missing > 0:
            self.notes.append(
                f"the pictures' numbers run from {known[0]} to {known[-1]} with {missing} missing: "
                "frames are counted by position, without gaps"
            )

    def _header(self, name: str) -> PictureHeader:
        path = self.path / name
        try:
            with path.open("rb") as file:
                header = read_header(file.read(_HEADER_BYTES), path)
        except OSError as error:
            raise SourceError(f"cannot be read: {error.strerror}", path) from error
        except RecordingError as error:
            raise SourceError(error.reason, path) from error
        check_size(header.width, header.height, path, self._limits)
        return header

    def _read(self, name: str) -> tuple[bytes, PictureHeader]:
        path = self.path / name
        try:
            size = path.stat().st_size
            if size > self._limits.max_message_bytes:
                limit = self._limits.max_message_bytes
                raise LimitError(
                    f"a picture of {size} bytes, over the limit of {limit} (max_message_bytes)",
                    path,
                )
            data = path.read_bytes()
        except OSError as error:
            raise SourceError(f"cannot be read: {error.strerror}", path) from error
        if not data:
            raise SourceError("the file is empty", path)
        try:
            header = read_header(data, path)
        except RecordingError as error:
            raise SourceError(error.reason, path) from error
        check_size(header.width, header.height, path, self._limits)
        if (header.width, header.height) != (self.width, self.height):
            first = f"{self._names[0]} is {self.width} x {self.height}"
            raise SourceError(
                f"is {header.width} x {header.height}, but {first}: one size is wanted",
                path,
            )
        if not is_whole(data, header.format):
            raise _CutOffError(f"a {header.format} picture that is cut off", path)
        return data, header

    def _loader(self, name: str, data: bytes) -> Callable[[], Image]:
        def load() -> Image:
            try:
                return decode_picture(data, path=self.path / name, limits=self._limits)
            except LimitError:
                raise
            except RecordingError as error:
                raise SourceError(error.reason, error.path) from error

        return load

    def frames(self) -> Iterator[SourceFrame]:
        """All pictures in order."""
        self._digests.clear()
        self.losses.clear()
        for index, name in enumerate(self._names):
            try:
                data, header = self._read(name)
            except _CutOffError as error:
                if index == 0 or index < len(self._names) - 1:
                    raise
                # What an interrupted capture or copy leaves: the last picture, cut off.
                self.losses.append(f"{name}, the last picture: {error.reason}")
                return
            self._digests.append((name, hashlib.sha256(data).hexdigest()))
            yield SourceFrame(
                index,
                self._rate.time_ns(index),
                self._loader(name, data),
                data,
                header.format,
            )

    def sample(self, count: int) -> Iterator[Image]:
        """``count`` pictures spread evenly over the folder."""
        for index, name in enumerate(self._names):
            if spread(index, count, len(self._names)):
                try:
                    data, _ = self._read(name)
                except _CutOffError:
                    return
                yield self._loader(name, data)()

    def digests(self) -> list[tuple[str, str]]:
        """Each picture's SHA-256."""
        return list(self._digests)


def by_number(name: str) -> tuple[list[tuple[int, str]], str]:
    """A key that orders names by the numbers in them."""
    parts = _DIGITS.split(Path(name).stem)
    return [
        (int(part), "") if index % 2 else (0, part) for index, part in enumerate(parts)
    ], name


def _number(name: str) -> int | None:
    digits = _DIGITS.findall(Path(name).stem)
    return int(digits[-1]) if digits else None
