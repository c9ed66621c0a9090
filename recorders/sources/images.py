"""Folders of pictures, in the order of their numbers or times; the bytes of upright JPEG and PNG
pictures of eight bits are recorded as they are.
"""

from __future__ import annotations

import configparser
import hashlib
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from functools import partial
from pathlib import Path

from recorders.clock import nominal_ns
from recorders.errors import LimitError, RecordingError, SourceError
from recorders.left_out import LeftOut
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.pictures import Image, check_size, is_whole
from recorders.sources.picture_names import ordered
from recorders.sources.source import (
    PictureError,
    Rate,
    SourceFrame,
    fitted,
    rate_or_assumed,
    spread,
)
from recorders.stills import (
    SUFFIXES,
    StillHeader,
    bits_used,
    decode_still,
    still_header,
    stored_values,
)

_DEEP_SAMPLES = 16
_MOT_FOLDER = "img1"
_MOT_FILES = ("det/det.txt", "gt/gt.txt")


def picture_names(folder: Path) -> list[str]:
    """The pictures in a folder, hidden files and folders left alone.

    Raises:
        SourceError: the folder cannot be read.
    """
    try:
        return sorted(
            p.name
            for p in folder.iterdir()
            if p.suffix.lower() in SUFFIXES and not p.name.startswith(".") and p.is_file()
        )
    except OSError as error:
        raise SourceError(f"cannot be read: {error.strerror}", folder) from error


def holds_pictures(folder: Path) -> bool:
    """Whether there are pictures in a folder, or in its ``img1`` as MOTChallenge has them."""
    if picture_names(folder):
        return True
    return (folder / _MOT_FOLDER).is_dir() and bool(picture_names(folder / _MOT_FOLDER))


class ImageFolderSource:
    """A folder of pictures: frame k is the k-th by number (``2.jpg`` before ``10.jpg``), at a
    constant rate; or by the times that their names are.

    Other files in the folder are left alone. A picture of another size than the first is scaled to
    it; one that is damaged is left out. Both are told.

    Args:
        path: the folder.
        fps: the rate; None: the times in the names, or the folder's ``seqinfo.ini``, or 25.
        limits: what a picture may ask for.
        names: these pictures alone.

    Attributes:
        numbers: of each picture from 1, where some between them are missing.
        names: of the pictures' files.

    Raises:
        SourceError: no such folder, no picture in it, or none that can be read.
        UsageError: several series of pictures.
        LimitError: a picture claims more pixels than the limits allow.
    """

    name = "images"
    has_images = True
    has_detections = False

    def __init__(
        self,
        path: Path,
        fps: Fraction | None = None,
        limits: Limits = DEFAULT_LIMITS,
        names: Sequence[str] | None = None,
    ) -> None:
        self.path = path
        self.notes: list[str] = []
        self.losses: list[str] = []
        self._limits = limits
        self._digests: list[tuple[str, str]] = []
        self._left_out = LeftOut()
        found = list(names) if names is not None else self._found()
        self._ordered = ordered(found, self.path)
        self._names = self._ordered.names
        self.names = list(self._names)
        self._doubled = self._ordered.doubled
        header = self._first_header()
        self.width, self.height = header.width, header.height
        self.stills = header.as_is
        self._bits = self._bits_used(header)
        self.frame_count: int | None = len(self._names)
        self.numbers: list[int] | None = None
        self._rate: Rate | None = None
        self._set_times(fps)
        self._note_gaps()
        self._said = list(self.notes)

    def _found(self) -> list[str]:
        names = picture_names(self.path)
        inner = self.path / _MOT_FOLDER
        if not names and inner.is_dir() and picture_names(inner):
            self.path = inner
            return picture_names(inner)
        if not names:
            inside = sorted(p.name for p in self.path.iterdir() if p.is_dir())
            hint = f"; it holds the folders {', '.join(inside[:5])}" if inside else ""
            there = [one for one in _MOT_FILES if (self.path / one).is_file()]
            if there:
                hint += f"; its boxes alone: {self.path / there[0]}"
            raise SourceError(
                f"no JPEG or PNG pictures in this folder (nor TIFF, WebP, AVIF, BMP){hint}",
                self.path,
            )
        return names

    def _set_times(self, fps: Fraction | None) -> None:
        times = self._ordered.times_ns
        if fps is None and times is not None:
            self._times: list[int] | None = [t - times[0] for t in times]
            self.frame_ns = nominal_ns(times) or 1
            self.notes.append("times are those in the pictures' names")
            return
        self._times = None
        if fps is None:
            fps = self._sequence_rate()
        self._rate = rate_or_assumed(fps, self.notes)
        self.frame_ns = self._rate.frame_ns

    def _sequence_rate(self) -> Fraction | None:
        """What MOTChallenge's ``seqinfo.ini`` beside the folder says."""
        for folder in (self.path, self.path.parent):
            file = folder / "seqinfo.ini"
            if not file.is_file() or file.stat().st_size > 1 << 16:
                continue
            parser = configparser.ConfigParser()
            try:
                parser.read(file, encoding="utf-8")
                rate = Fraction(parser.get("Sequence", "frameRate"))
            except (configparser.Error, ValueError, ZeroDivisionError, UnicodeDecodeError):
                continue
            if 0 < rate <= 1000:
                self.notes.append(f"{float(rate):g} frames per second, as {file.name} says")
                return rate
        return None

    def _note_gaps(self) -> None:
        numbers = self._ordered.numbers
        if numbers is None or len(set(numbers)) != len(numbers):
            return
        missing = numbers[-1] - numbers[0] + 1 - len(numbers)
        if missing > 0:
            self.notes.append(
                f"the pictures' numbers run from {numbers[0]} to {numbers[-1]} with {missing}"
                " missing: frames are counted by position, without gaps"
            )
            if numbers[0] in (0, 1) and missing < len(numbers):
                self.numbers = [number + 1 - numbers[0] for number in numbers]

    def time_ns(self, index: int) -> int:
        """See `recorders.sources.source.NumberedSource`."""
        assert self._rate is not None
        return self._rate.time_ns(index)

    # Single pictures.

    def _first_header(self) -> StillHeader:
        """Of the first picture that can be read."""
        first: SourceError | None = None
        for name in self._names:
            try:
                return self._read(name)[1]
            except LimitError:
                raise
            except SourceError as error:
                first = first or error
        assert first is not None
        raise first

    def _bits_used(self, header: StillHeader) -> int:
        """How many bits the values of pictures of more than eight fill, by a sample of them."""
        if header.bits <= 8:
            return 16
        bits = 8
        for index, name in enumerate(self._names):
            if spread(index, _DEEP_SAMPLES, len(self._names)):
                try:
                    data, one = self._read(name)
                    bits = max(bits, bits_used(stored_values(data, one, self.path / name)))
                except (SourceError, RecordingError):
                    continue
        self.notes.append(
            f"pictures of {header.bits} bits whose values fill {bits}: the upper 8 of those are kept"
        )
        return bits

    def _read(self, name: str) -> tuple[bytes, StillHeader]:
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
            raise SourceError("the file is empty: neither a JPEG nor a PNG picture", path)
        try:
            header = still_header(data, path)
        except RecordingError as error:
            raise SourceError(error.reason, path) from error
        check_size(header.width, header.height, path, self._limits)
        if header.format in ("jpeg", "png") and not is_whole(data, header.format):
            raise SourceError(f"a {header.format} picture that is cut off", path)
        return data, header

    def _load(self, name: str, data: bytes, header: StillHeader) -> Image:
        path = self.path / name
        try:
            return decode_still(
                data, header, bits=self._bits, path=path, limits=self._limits
            )
        except LimitError:
            raise
        except RecordingError as error:
            raise PictureError(error.reason, path, name) from error

    def frames(self) -> Iterator[SourceFrame]:
        """All pictures in order."""
        self._digests.clear()
        self.losses.clear()
        self._left_out.clear()
        scaled = 0
        first = ""
        for index, name in enumerate(self._names):
            try:
                data, header = self._read(name)
            except LimitError:
                raise
            except SourceError as error:
                self._left_out.note(error.reason, name)
                continue
            self._digests.append((name, hashlib.sha256(data).hexdigest()))
            now = self._rate.time_ns(index) if self._rate else self._time(index)
            load: Callable[[], Image] = partial(self._load, name, data, header)
            if (header.width, header.height) != (self.width, self.height):
                scaled += 1
                first = first or f"{name} of {header.width}x{header.height}"
                yield SourceFrame(index, now, partial(self._fitted, load))
            elif header.as_is:
                yield SourceFrame(index, now, load, data, header.format)
            else:
                yield SourceFrame(index, now, load)
        self._sum_up(scaled, first)

    def _time(self, index: int) -> int:
        assert self._times is not None
        return self._times[index]

    def _fitted(self, load: Callable[[], Image]) -> Image:
        return fitted(load(), self.width, self.height)

    def _sum_up(self, scaled: int, first: str) -> None:
        self.losses += self._left_out.lines()
        if scaled:
            self.losses.append(
                f"{scaled} pictures of another size were scaled to"
                f" {self.width}x{self.height}, the first is {first}"
            )
        if self._doubled:
            self.losses.append(
                f"{len(self._doubled)} pictures have the name of another but for the format,"
                f" the first is {self._doubled[0]}"
            )

    def sample(self, count: int) -> Iterator[Image]:
        """``count`` pictures spread evenly over the folder."""
        for index, name in enumerate(self._names):
            if spread(index, count, len(self._names)):
                image = self._picture(name)
                if image is not None:
                    yield image

    def pairs(self, count: int, apart: int) -> Iterator[tuple[Image, Image]]:
        """``count`` pictures spread evenly over the folder, each with the one ``apart`` later."""
        among = len(self._names) - apart
        for index in range(max(0, among)):
            if spread(index, count, among):
                first = self._picture(self._names[index])
                second = self._picture(self._names[index + apart])
                if first is not None and second is not None:
                    yield first, second

    def _picture(self, name: str) -> Image | None:
        """A picture in the recording's size, None where it cannot be read."""
        try:
            data, header = self._read(name)
            image = self._load(name, data, header)
        except LimitError:
            raise
        except SourceError:
            return None
        return fitted(image, self.width, self.height)

    def digests(self) -> list[tuple[str, str]]:
        """Each picture's SHA-256."""
        return list(self._digests)
