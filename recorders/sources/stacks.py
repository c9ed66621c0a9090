"""A stack of pictures in one TIFF, as microscopes and scientific cameras write them."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from functools import partial
from pathlib import Path

from recorders.errors import LimitError, RecordingError, SourceError
from recorders.files import existing_file, open_to_read, sha256
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.pictures import Image, check_size
from recorders.sources.source import (
    PictureError,
    SourceFrame,
    fitted,
    rate_or_assumed,
    spread,
)
from recorders.stills import bits_used, still_header, stored_page, to_bgr

_DEEP_SAMPLES = 16


class TiffStackSource:
    """The pages of a TIFF as frames, at a constant rate.

    Values of more than eight bits are scaled by what a sample of the pages fills, which is told.

    Raises:
        SourceError: no TIFF, or it holds one page alone.
        LimitError: larger than a record may be, or too many pixels.
    """

    name = "TIFF stack"
    has_images = True
    stills = False
    has_detections = False

    def __init__(
        self, path: Path, fps: Fraction | None = None, limits: Limits = DEFAULT_LIMITS
    ) -> None:
        self.path = existing_file(path)
        self.notes: list[str] = []
        self.losses: list[str] = []
        with open_to_read(path) as file:
            self._data = file.read(limits.max_record_bytes + 1)
        if len(self._data) > limits.max_record_bytes:
            raise LimitError(
                f"a TIFF of over {limits.max_record_bytes} bytes; --limit"
                f" max_record_bytes={8 * limits.max_record_bytes} allows more",
                path,
            )
        try:
            self._header = still_header(self._data, path)
        except RecordingError as error:
            raise SourceError(error.reason, path) from error
        if self._header.pages < 2:
            raise SourceError(
                "one picture is not a recording: give the folder that it lies in", path
            )
        self.width, self.height = self._header.width, self._header.height
        check_size(self.width, self.height, path, limits)
        self.frame_count: int | None = self._header.pages
        self._rate = rate_or_assumed(fps, self.notes)
        self.frame_ns = self._rate.frame_ns
        self._bits = 16 if self._header.bits <= 8 else self._bits_used()

    def _bits_used(self) -> int:
        bits = 8
        for page in range(self._header.pages):
            if spread(page, _DEEP_SAMPLES, self._header.pages):
                try:
                    values = stored_page(self._data, self._header, page, self.path)
                except RecordingError:
                    continue
                bits = max(bits, bits_used(values))
        self.notes.append(
            f"pages of {self._header.bits} bits whose values fill {bits}: the upper 8 of those"
            " are kept"
        )
        return bits

    def _load(self, page: int) -> Image:
        try:
            values = stored_page(self._data, self._header, page, self.path)
        except RecordingError as error:
            raise PictureError(error.reason, self.path, f"page {page + 1}") from error
        return fitted(to_bgr(values, bits=self._bits), self.width, self.height)

    def frames(self) -> Iterator[SourceFrame]:
        """All pages in order."""
        self.losses.clear()
        for page in range(self._header.pages):
            yield SourceFrame(page, self._rate.time_ns(page), partial(self._load, page))

    def sample(self, count: int) -> Iterator[Image]:
        """``count`` pages spread evenly."""
        for page in range(self._header.pages):
            if spread(page, count, self._header.pages):
                try:
                    yield self._load(page)
                except PictureError:
                    continue

    def digests(self) -> list[tuple[str, str]]:
        """The file's SHA-256."""
        return [(self.path.name, sha256(self.path))]
