"""Sources of a recording: video files, folders of images, MOTChallenge text, CAVIAR XML."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

from recorders.errors import SourceError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.sources.caviar import CaviarSource
from recorders.sources.images import ImageFolderSource
from recorders.sources.mot import MotSource
from recorders.sources.regions import read_regions
from recorders.sources.source import Source, SourceFrame, parse_fps
from recorders.sources.video import VideoSource
from recorders.sources.with_detections import WithDetections

__all__ = ["Source", "SourceFrame", "open_source", "parse_fps", "read_regions"]

_TEXT = frozenset({".txt", ".csv"})
_PICTURES = frozenset({".jpg", ".jpeg", ".png"})


def open_source(
    path: str | Path,
    *,
    detections: str | Path | None = None,
    fps: float | Fraction | str | None = None,
    size: tuple[int, int] | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> Source:
    """Open a source of frames by what it is: a folder of images, ``.txt`` (MOTChallenge),
    ``.xml`` (CAVIAR), a video.

    Args:
        path: the folder or file.
        detections: a MOTChallenge file whose detections go beside the pictures, its frame 1 with
            the first.
        fps: a constant frame rate; None takes a video's own presentation times, CAVIAR's 25, and
            else assumes 25 with a note.
        size: the picture size (width, height) that the boxes were made for. Beside pictures the
            boxes are scaled from it; without pictures it is the recording's size (None: as far as
            the boxes reach, with a note).
        limits: what the source may make us allocate.

    Raises:
        SourceError: it cannot be read; names the file, the place and the reason.
        LimitError: it asks for more than the limits allow.
        UsageError: the arguments do not fit the source or one another.
    """
    path = Path(path)
    rate = None if fps is None else parse_fps(fps)
    if size is not None and min(size) < 1:
        raise UsageError(f"--size {size[0]}x{size[1]}: width and height must be over 0")
    if not path.exists():
        raise SourceError("no such file or folder", path)
    kind = path.suffix.lower()
    if kind in _TEXT or kind == ".xml":
        if detections is not None:
            raise UsageError(
                f"--detections goes with pictures; {path} holds detections itself"
            )
        source: Source = (
            MotSource(path, rate, size, limits)
            if kind in _TEXT
            else CaviarSource(path, rate, size, limits)
        )
        return source
    if kind == ".mcap":
        raise SourceError(
            "is a log, not a source of frames: replay it, or look into it with `scenetrace"
            " info`",
            path,
        )
    if path.is_file() and kind in _PICTURES:
        raise SourceError(
            "one picture is not a recording: give the folder that it lies in", path
        )
    pictures: Source = (
        ImageFolderSource(path, rate, limits)
        if path.is_dir()
        else VideoSource(path, rate, limits)
    )
    if detections is not None:
        return WithDetections(pictures, Path(detections), size, limits)
    if size is not None:
        raise UsageError(
            f"--size says what size detections were made for; {path} is"
            f" {pictures.width}x{pictures.height}"
        )
    return pictures
