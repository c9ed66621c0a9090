"""Opening a source by what it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

from recorders.errors import SourceError, UsageError
from recorders.files import existing_file
from recorders.formats.folders import boxes_below
from recorders.formats.opening import OTHERS, TEXT, BoxOptions
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.sources.bags import METADATA, BagFiles, bag_files, is_bag, missing_files
from recorders.sources.boxes import BoxSource
from recorders.sources.caviar import CaviarSource
from recorders.sources.images import ImageFolderSource, holds_pictures
from recorders.sources.joined import JoinedVideos
from recorders.sources.live import LiveSource, is_live
from recorders.sources.log_files import (
    LogFiles,
    McapFiles,
    SeveralLogs,
    is_mcap,
    mcap_files,
)
from recorders.sources.log_source import LogOptions, LogSource
from recorders.sources.plugin_source import plugin_source
from recorders.sources.source import Source, parse_fps
from recorders.sources.stacks import TiffStackSource
from recorders.sources.video import VideoSource
from recorders.sources.with_detections import WithDetections
from recorders.stills import SUFFIXES

_PICTURES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".webp", ".avif"})
Paths = str | Path | Sequence[str | Path]


def open_source(
    path: Paths,
    *,
    detections: str | Path | None = None,
    fps: float | Fraction | str | None = None,
    size: tuple[int, int] | None = None,
    log: LogOptions | None = None,
    boxes: BoxOptions | None = None,
    stream: int | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> Source:
    """Open a source of frames by what it is: a folder of images, ``.txt`` (MOTChallenge),
    ``.xml`` (CAVIAR), a video, a log of others; ``NAME:WHERE`` is a plug-in's
    (`plugin_source`), whose frames have the times that it gives; ``rtsp://...``, ``/dev/video0`` and
    ``-`` are live.

    Args:
        path: the folder or file; several files of one recording: logs,
            videos one after the other, pictures.
        detections: a file of boxes (MOTChallenge, COCO, YOLO ...) whose detections go beside the
            pictures, its first frame with the first.
        fps: a constant frame rate; None takes a video's own presentation times, CAVIAR's 25, and
            else assumes 25 with a note.
        size: the picture size (width, height) that the boxes were made for. Beside pictures the
            boxes are scaled from it; without pictures it is the recording's size (None: as far as
            the boxes reach, with a note).
        log: which topics of a log are read, and how.
        boxes: what a file of boxes does not say of itself.
        stream: which of a video's streams of pictures, from 0; None: the first.
        limits: what the source may make us allocate.

    Raises:
        SourceError: it cannot be read; names the file, the place and the reason.
        LimitError: it asks for more than the limits allow.
        UsageError: the arguments do not fit the source or one another.
    """
    words = [path] if isinstance(path, str | Path) else path
    foreign = plugin_source(words[0]) if len(words) == 1 else None
    if foreign is not None:
        return _beside_pictures(foreign, detections, size, boxes or BoxOptions(), limits)
    rate = None if fps is None else parse_fps(fps)
    if is_live(words[0]):
        return _open_live(words, detections, rate, size, stream, limits)
    paths = _paths(path)
    if size is not None and min(size) < 1:
        raise UsageError(f"--size {size[0]}x{size[1]}: width and height must be over 0")
    files = open_log(paths, limits)
    if files is not None:
        if detections is not None:
            raise UsageError(
                f"--detections goes with pictures in files; {paths[0]} is a log: choose its"
                " detections with --detections-topic"
            )
        return LogSource(files, log, rate, size, limits)
    if log is not None and log != LogOptions():
        raise UsageError(
            f"{paths[0]} is no log: --image-topic, --detections-topic, --time, --tolerance,"
            " --topics and --exclude go with logs"
        )
    if len(paths) > 1 or (paths[0].suffix.lower() in _PICTURES and "*" in str(path)):
        several = _open_several(paths, rate, stream, limits)
        return _beside_pictures(several, detections, size, boxes or BoxOptions(), limits)
    given = boxes or BoxOptions()
    boxes = replace(given, fps=float(rate or given.fps))
    if not paths[0].is_dir() and not _holds_boxes(paths[0]) and not _is_picture(paths[0]):
        video = VideoSource(paths[0], rate, limits, stream)
        return _beside_pictures(video, detections, size, boxes, limits)
    if stream is not None:
        raise UsageError(f"--stream goes with videos; {paths[0]} is none")
    return _open_file(paths[0], detections, rate, size, boxes, limits)


def _open_live(
    words: Sequence[str | Path],
    detections: str | Path | None,
    rate: Fraction | None,
    size: tuple[int, int] | None,
    stream: int | None,
    limits: Limits,
) -> Source:
    """A camera over the network, a device, a pipe."""
    if len(words) > 1:
        raise UsageError(f"{words[0]} is live: record it by itself")
    if detections is not None or size is not None:
        raise UsageError(
            "--detections and --size go with recordings; a live stream's pictures are looked"
            " through by --detect"
        )
    return LiveSource(str(words[0]), rate, limits, stream)


def _open_several(
    paths: Sequence[Path], rate: Fraction | None, stream: int | None, limits: Limits
) -> Source:
    """Pictures of one folder, or videos one after the other."""
    if all(map(_is_picture, paths)) and len({p.parent for p in paths}) == 1:
        return ImageFolderSource(paths[0].parent, rate, limits, [p.name for p in paths])
    for path in paths:
        if path.is_dir() or _is_picture(path) or _holds_boxes(path):
            raise UsageError(
                f"{len(paths)} sources: several files are read as one where they are logs,"
                f" videos, or pictures in one folder; {path} is not"
            )
    return JoinedVideos([VideoSource(path, rate, limits, stream) for path in paths])


def _is_picture(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES and path.is_file()


def open_cameras(
    path: Paths,
    cameras: Mapping[str, str],
    *,
    detections: Mapping[str, str] | None = None,
    fps: float | Fraction | str | None = None,
    size: tuple[int, int] | None = None,
    log: LogOptions | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> dict[str, Source]:
    """Several cameras of one log: a source for each name, of the topic that belongs to it.

    Detections are those of the topic that is named, else of one in the same namespace, where there
    is one; only the first camera's source passes anything on.

    Args:
        path: the log.
        cameras: topics of pictures by the cameras' names.
        detections: topics of detections by the cameras' names.
        fps: as `open_source`.
        size: as `open_source`.
        log: as `open_source`.
        limits: as `open_source`.

    Raises:
        As `open_source`; UsageError: it is no log.
    """
    paths = _paths(path)
    options = log or LogOptions()
    found: dict[str, Source] = {}
    for name, topic in cameras.items():
        files = open_log(paths, limits)
        if files is None:
            raise UsageError(
                f"--camera {name}={topic}: {paths[0]} is no log; --camera NAME names the camera"
            )
        near = _beside(files, topic)
        named = (detections or {}).get(name, options.detections_topic)
        taken = named or (near[0] if len(near) == 1 else None)
        chosen = replace(
            options,
            image_topic=topic,
            detections_topic=taken or "none",
            exclude=[*options.exclude, *cameras.values(), *(detections or {}).values()],
        )
        rate = None if fps is None else parse_fps(fps)
        source = found[name] = LogSource(files, chosen, rate, size, limits)
        if taken is None and (others := _of_detections(files)):
            source.notes.append(
                f"{name}: no detections are taken for {topic}: --detections-topic"
                f" {name}=TOPIC takes one of {', '.join(others[:6])}"
            )
    return found


def _of_detections(files: LogFiles) -> list[str]:
    """The topics of detections."""
    from recorders.payloads import DETECTIONS, payload_kind

    return [c.topic for c in files.channels if payload_kind(c) in DETECTIONS]


def _beside(files: LogFiles, topic: str) -> list[str]:
    """The topics of detections that share a topic's namespace."""
    space = topic.rsplit("/", 1)[0] + "/"
    return [t for t in _of_detections(files) if t.startswith(space) and space != "/"]


def _paths(path: Paths) -> list[Path]:
    paths = [Path(path)] if isinstance(path, str | Path) else [Path(p) for p in path]
    if not paths:
        raise UsageError("no source is named")
    if len(paths) == 1 and not paths[0].exists() and "*" in paths[0].name:
        paths = sorted(paths[0].parent.glob(paths[0].name))
        if not paths:
            raise SourceError("no file has such a name", Path(str(path)))
    for one in paths:
        if not one.exists():
            raise SourceError("no such file or folder", one)
    return paths


def open_log(paths: Sequence[Path], limits: Limits) -> LogFiles | None:
    """The paths as one log: MCAP files, bags, folders of them; None where the first is none.

    Raises:
        UsageError: a log beside something else.
        SourceError: a bag of which no file is there.
    """
    found = [_log_files(path) for path in paths]
    if not found[0]:
        return None
    for path, inside in zip(paths, found, strict=True):
        if not inside:
            raise UsageError(f"{path} is no log, {paths[0]} is one: record each by itself")
    files = list(dict.fromkeys(file for inside in found for file in inside))
    mcap = [file for file in files if not is_bag(file)]
    bags = [file for file in files if is_bag(file)]
    parts: list[LogFiles] = []
    if mcap:
        parts.append(McapFiles(paths[0], mcap, limits))
    if bags:
        parts.append(BagFiles(paths[0], bags, limits))
    log = parts[0] if len(parts) == 1 else SeveralLogs(parts)
    log.losses += [loss for path in paths for loss in missing_files(path)]
    return log


def _log_files(path: Path) -> list[Path]:
    """The files of a log: one, or those of a folder; empty where it is none."""
    if path.name == METADATA:
        path = path.parent
    if path.is_dir():
        inside = mcap_files(path) + bag_files(path)
        if not inside and (path / METADATA).is_file():
            lines = missing_files(path) or [f"{METADATA} names no file that is there"]
            raise SourceError(f"a bag without its files: {lines[0]}", path)
        return inside
    return [path] if is_bag(path) or is_mcap(path) else []


def _holds_boxes(path: Path) -> bool:
    """Whether a path is a file of boxes, or a folder that holds such files and no pictures."""
    if path.is_dir():
        return (
            not holds_pictures(path)
            and not (path / "images").is_dir()
            and boxes_below(path) is not None
        )
    return path.suffix.lower() in TEXT | OTHERS


def _is_caviar(path: Path) -> bool:
    """CAVIAR's root is a dataset; what is no XML that can be told is refused in its words."""
    if path.suffix.lower() != ".xml" or path.is_dir():
        return False
    with existing_file(path).open("rb") as file:
        return b"<annotations" not in file.read(4096)


def _open_file(
    path: Path,
    detections: str | Path | None,
    rate: Fraction | None,
    size: tuple[int, int] | None,
    boxes: BoxOptions,
    limits: Limits,
) -> Source:
    kind = path.suffix.lower()
    if _holds_boxes(path):
        if detections is not None:
            raise UsageError(
                f"--detections goes with pictures; {path} holds detections itself"
            )
        if _is_caviar(path):
            return CaviarSource(path, rate, size, limits)
        return BoxSource(path, rate, size, boxes, limits)
    if path.is_file() and kind in (".tif", ".tiff"):
        stack: Source = TiffStackSource(path, rate, limits)
        return _beside_pictures(stack, detections, size, boxes, limits)
    if path.is_file() and kind in _PICTURES:
        raise SourceError(
            "one picture is not a recording: give the folder that it lies in", path
        )
    pictures = ImageFolderSource(path, rate, limits)
    return _beside_pictures(pictures, detections, size, boxes, limits)


def _beside_pictures(
    pictures: Source,
    detections: str | Path | None,
    size: tuple[int, int] | None,
    boxes: BoxOptions,
    limits: Limits,
) -> Source:
    """The pictures, with the detections of a file where one is named."""
    if detections is not None:
        return WithDetections(pictures, Path(detections), size, boxes, limits)
    if size is not None:
        raise UsageError(
            f"--size says what size detections were made for; {pictures.path} is"
            f" {pictures.width}x{pictures.height}"
        )
    return pictures
