"""Recording: a source of frames into a scene log.

Frames are read and decoded in one thread, segmented in the caller's, encoded in a third, and written in order: the
log is the same as if one did it all.
"""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field, replace
from fractions import Fraction
from importlib import metadata
from pathlib import Path
from typing import Literal, get_args

import msgspec
import numpy as np

from recorders import channels
from recorders.checks import check_detections
from recorders.errors import OutputExistsError, SceneTraceError, SourceError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogWriter
from recorders.machine import machine, opencv_build, python_version
from recorders.messages import NO_BLOB, Detections, Regions
from recorders.parameters import Config, Parameters, as_plain, configure
from recorders.pictures import Image, VideoEncoder, encode_jpeg, encode_mask, encode_png
from recorders.segmentation import SEGMENTERS, SegmentationParameters, Segmented, Segmenter, SegmenterInParts
from recorders.sources import Source, SourceFrame, read_regions
from recorders.sources.ahead import read_ahead
from recorders.sources.source import NANOS
from recorders.vision import cv2, opencv_threads

Codec = Literal["jpeg", "png", "h264", "none"]
CODECS: tuple[str, ...] = get_args(Codec)
NO_DETECTION = "none"
SECTIONS: dict[str, type[Parameters]] = {"segmentation": SegmentationParameters}

METADATA = "scenetrace"
METADATA_AT_START = "scenetrace.started"
FORMAT_VERSION = "1"
DIGESTS_ATTACHMENT = "source.sha256"

FIRST_READING_PICTURES = 120
_DEPTH = 4
_DEPTH_WITHOUT_PICTURES = 256
_PACKAGES = ("av", "numpy", "opencv-python-headless", "scenetrace")

Progress = Callable[[str, int, "int | None"], None]
"""Called with the stage (``looking``, ``recording``), frames done, and frames expected, if known."""


@dataclass(frozen=True)
class RecordOptions:
    """How to record.

    Attributes:
        camera: the camera's name, the first part of every topic.
        start_ns: the first frame's log time in ns; 0 where the capture's time is not known.
        codec: how pictures are stored; None keeps JPEG and PNG bytes as they are and stores video as JPEG. Pictures
            that are in the wanted format already are stored byte for byte.
        detect: a name of `SEGMENTERS` or ``none``; None: ``motion`` where there are pictures without detections.
        regions: a file of regions, see `recorders.sources.regions`.
        config: the parameters of `SECTIONS`.
        force: replace an existing output.
        limits: what the source may make us allocate.
    """

    camera: str = channels.DEFAULT_CAMERA
    start_ns: int = 0
    codec: str | None = None
    detect: str | None = None
    regions: str | Path | None = None
    config: Config = field(default_factory=lambda: configure(SECTIONS))
    force: bool = False
    limits: Limits = DEFAULT_LIMITS


@dataclass(frozen=True)
class RecordSummary:
    """What was recorded.

    Attributes:
        path: the log.
        frames, detections: how many.
        width, height: of the pictures, in pixels.
        duration_ns: from the first frame to the last.
        detect, codec: as decided, ``none`` where there is nothing.
        source_digest: SHA-256 of the source's file, or of its files' list of digests.
        notes: what had to be assumed.
        losses: what had to be left out; a caller should not pass over it.
    """

    path: Path
    frames: int
    detections: int
    width: int
    height: int
    duration_ns: int
    detect: str
    codec: str
    source_digest: str
    notes: tuple[str, ...]
    losses: tuple[str, ...]


class InterruptedRecordingError(SceneTraceError):
    """A recording ended early; what was written until then is in the part file."""

    def __init__(self, reason: str, part: Path, frames: int) -> None:
        recovered = part.with_name("recovered-" + part.name.removesuffix(".part"))
        super().__init__(f"{reason} after {frames} frames; keep them with: scenetrace recover {part} -o {recovered}")
        self.part = part
        self.frames = frames


def record(
    source: Source, out: str | Path, options: RecordOptions | None = None, progress: Progress | None = None
) -> RecordSummary:
    """Record a source into a scene log.

    The log appears whole. Where the recording ends early after its first frame, ``<out>.part`` stays, from which
    `scenetrace recover` makes a log.

    Raises:
        UsageError: the options do not fit the source.
        OutputExistsError: the log exists and ``force`` is off.
        InterruptedRecordingError: the source, or the user, ended the recording early.
        SourceError, LimitError: the source cannot be read at all.
        RecordingError: the log cannot be written.
    """
    options = options or RecordOptions()
    out = Path(out)
    decided = _decide(source, options)
    if out.exists() and not options.force:
        raise OutputExistsError(out)
    if out.exists() and source.path.exists() and out.samefile(source.path):
        raise UsageError(f"{out}: is the source itself; record into another file")
    regions = None if options.regions is None else read_regions(options.regions, source.width, source.height)
    report = progress or _silent
    segmenter = _segmenter(source, decided, report)
    pictures = [channels.topic(options.camera, name) for name in channels.PICTURES]
    log = LogWriter(out, force=options.force, keep_part=True, picture_topics=pictures, limits=options.limits)
    writer = _Writer(log, source, decided, regions)
    try:
        # Reading, segmenting and encoding run side by side; OpenCV's own threads would only take turns with them.
        with opencv_threads(1), closing(_encoded(source, segmenter, decided)) as frames:
            for encoded in frames:
                writer.write(encoded)
                report("recording", writer.frames, source.frame_count)
        summary = writer.finish(out)
        log.close()
    except BaseException as e:
        _end_early(e, log, out, writer.frames)
        raise
    return summary


def _silent(stage: str, done: int, total: int | None) -> None:
    """No progress is wanted."""


def _end_early(error: BaseException, log: LogWriter, out: Path, frames: int) -> None:
    """Leave a part file where there is something to recover, nothing where there is not."""
    log.abort()
    part = out.with_name(out.name + ".part")
    if not frames:
        part.unlink(missing_ok=True)
    elif isinstance(error, KeyboardInterrupt):
        raise InterruptedRecordingError("interrupted", part, frames) from error
    elif isinstance(error, SceneTraceError):
        raise InterruptedRecordingError(str(error), part, frames) from error


def _decide(source: Source, options: RecordOptions) -> RecordOptions:
    """The options with nothing left open.

    Raises:
        UsageError: they do not fit the source.
    """
    channels.topic(options.camera, "image")
    detect, codec = options.detect, options.codec
    names = [*SEGMENTERS, NO_DETECTION]
    if detect is not None and detect not in names:
        raise UsageError(f"--detect {detect}: must be one of {', '.join(names)}")
    if codec is not None and codec not in CODECS:
        raise UsageError(f"--codec {codec}: must be one of {', '.join(CODECS)}")
    if not source.has_images:
        if detect not in (None, NO_DETECTION):
            raise UsageError(f"--detect {detect} needs pictures; {source.path} ({source.name}) has none")
        if codec not in (None, "none"):
            raise UsageError(f"--codec {codec} needs pictures; {source.path} ({source.name}) has none")
        return replace(options, detect=NO_DETECTION, codec="none")
    if detect is None:
        detect = NO_DETECTION if source.has_detections else "motion"
    return replace(options, detect=detect)


def _segmenter(source: Source, options: RecordOptions, report: Progress) -> Segmenter | None:
    """The segmenter, having read the source once to know its background in hindsight."""
    if options.detect == NO_DETECTION or options.detect is None:
        return None
    parameters = options.config["segmentation"]
    assert isinstance(parameters, SegmentationParameters)
    segmenter = SEGMENTERS[options.detect](parameters, source.width, source.height, NANOS / source.frame_ns)

    def sampled() -> Iterator[Image]:
        for k, image in enumerate(source.sample(FIRST_READING_PICTURES)):
            report("looking", k, FIRST_READING_PICTURES)
            yield image

    segmenter.prepare(sampled())
    return segmenter


@dataclass(frozen=True, slots=True)
class _Encoded:
    """One frame as it will be written."""

    index: int
    time_ns: int
    picture: tuple[bytes, str] | None
    mask: bytes | None
    detections: Detections


def _encoded(source: Source, segmenter: Segmenter | None, options: RecordOptions) -> Generator[_Encoded]:
    """The source's frames, segmented and encoded, in order."""
    encoder = _PictureEncoder(source, options.codec)
    waiting: deque[Future[_Encoded]] = deque()
    decode = segmenter is not None or encoder.decodes
    depth = _DEPTH if source.has_images else _DEPTH_WITHOUT_PICTURES
    failures: list[SceneTraceError] = []
    ahead = _until_failure(read_ahead(source.frames(), depth, decode), failures)
    # One worker each: what detects and what encodes take the frames in their order.
    detecting, encoding = ThreadPoolExecutor(1, "scenetrace-detect"), ThreadPoolExecutor(1, "scenetrace-encode")
    try:
        with closing(ahead) as frames:
            for frame in frames:
                mask, detect = _segment(frame, segmenter, source)
                found = detect if segmenter is None else detecting.submit(detect).result
                waiting.append(encoding.submit(encoder.encode, frame, mask, found))
                if len(waiting) > _DEPTH:
                    yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        detecting.shutdown(cancel_futures=True)
        encoding.shutdown(cancel_futures=True)
    if failures:
        raise failures[0]


def _until_failure(frames: Generator[SourceFrame], failures: list[SceneTraceError]) -> Generator[SourceFrame]:
    """The frames up to where the source breaks, so that those before it are still recorded."""
    with closing(frames):
        try:
            yield from frames
        except SceneTraceError as e:
            failures.append(e)


def _segment(
    frame: SourceFrame, segmenter: Segmenter | None, source: Source
) -> tuple[Image | None, Callable[[], Detections]]:
    """The frame's mask, and what gives its detections."""
    given = frame.detections
    if segmenter is None:
        return None, lambda: given or Detections(frame.index, source.width, source.height)
    assert frame.image is not None
    if isinstance(segmenter, SegmenterInParts):
        mask, detect = segmenter.begin(frame.index, frame.image)
    else:
        whole = segmenter.segment(frame.index, frame.image)
        mask, detect = whole.mask, lambda: whole.detections
    return mask, detect if given is None else lambda: with_blobs(given, Segmented(mask, detect()))


def with_blobs(given: Detections, found: Segmented) -> Detections:
    """Given detections with the blobs of a segmented frame: each has the blob that fills most of its box.

    Equal shares: the blob with the smaller id. `NO_BLOB` where no foreground lies in the box.
    """
    count, labels = cv2.connectedComponents(found.mask, connectivity=8)
    height, width = labels.shape
    blobs = []
    for x, y, w, h in given.boxes:
        left, top = max(0, round(x)), max(0, round(y))
        right, bottom = max(left, min(width, round(x + w))), max(top, min(height, round(y + h)))
        areas = np.bincount(labels[top:bottom, left:right].ravel(), minlength=count + 1)
        areas[0] = 0
        best = int(areas.argmax())
        blobs.append(best if areas[best] else NO_BLOB)
    return msgspec.structs.replace(given, blobs=blobs, components=found.detections.components)


class _PictureEncoder:
    """Pictures and masks to bytes, one after the other (H.264 builds on the picture before)."""

    def __init__(self, source: Source, codec: str | None) -> None:
        self._codec = codec
        self.decodes = codec == "h264" or (codec != "none" and source.has_images and not source.stills)
        self._video = None
        if codec == "h264":
            self._video = VideoEncoder(source.width, source.height, Fraction(NANOS, source.frame_ns))

    def encode(self, frame: SourceFrame, mask: Image | None, found: Callable[[], Detections]) -> _Encoded:
        """One frame's bytes."""
        bits = None if mask is None else encode_mask(mask)
        return _Encoded(frame.index, frame.time_ns, self._picture(frame), bits, found())

    def _picture(self, frame: SourceFrame) -> tuple[bytes, str] | None:
        if self._codec == "none":
            return None
        if frame.encoded is not None and frame.format is not None and self._codec in (None, frame.format):
            return frame.encoded, frame.format
        image = frame.image
        assert image is not None
        if self._video is not None:
            return self._video.encode(image), "h264"
        return (encode_png(image), "png") if self._codec == "png" else (encode_jpeg(image), "jpeg")


class _Writer:
    """Writes frames and what the log says of itself."""

    def __init__(self, log: LogWriter, source: Source, options: RecordOptions, regions: Regions | None) -> None:
        self._log = log
        self._source = source
        self._options = options
        self._regions = regions
        self._channels: dict[str, int] = {}
        self.frames = 0
        self._detections = 0
        self._last_ns = 0
        self._facts = _known_at_start(source, options)

    def _put(self, name: str, data: bytes, now: int, schema: str | None = None) -> None:
        if name not in self._channels:
            topic = channels.topic(self._options.camera, name)
            kind = schema or name
            self._channels[name] = self._log.channel(topic, channels.schema(kind), channels.message_encoding(kind), {})
        self._log.write(self._channels[name], data, now)

    def _begin(self, now: int) -> None:
        # An interrupted recording has this much to say of itself.
        self._log.metadata(METADATA_AT_START, self._facts)
        if self._regions is not None:
            self._put("regions", channels.encode("regions", self._regions), now)

    def write(self, frame: _Encoded) -> None:
        """Write one frame: regions before the first, then picture, mask, detections."""
        now = self._options.start_ns + frame.time_ns
        self._check(frame.detections)
        camera = self._options.camera
        if not self.frames:
            self._begin(now)
        if frame.picture is not None:
            data, kind = frame.picture
            picture = channels.compressed_image(data, kind, now, camera)
            self._put("image", picture, now, "video" if kind == "h264" else None)
        if frame.mask is not None:
            self._put("foreground", channels.compressed_image(frame.mask, "png", now, camera), now)
        self._put("detections", channels.encode("detections", frame.detections), now)
        self.frames += 1
        self._detections += len(frame.detections.boxes)
        self._last_ns = frame.time_ns

    def _check(self, detections: Detections) -> None:
        """Never record what no replay would take."""
        try:
            check_detections(detections, self._options.limits)
        except ValueError as e:
            raise SourceError(str(e), self._source.path) from e

    def finish(self, out: Path) -> RecordSummary:
        """Write what the log says of itself."""
        source, options = self._source, self._options
        digests = source.digests()
        listing = "".join(f"{digest}  {utf8(name)}\n" for name, digest in digests)
        digest = digests[0][1] if len(digests) == 1 else hashlib.sha256(listing.encode()).hexdigest()
        facts = {
            **self._facts,
            "source_digest": f"sha256:{digest}",
            "source_files": str(len(digests)),
            "frames": str(self.frames),
            "notes": _json([utf8(note) for note in source.notes]),
            "losses": _json([utf8(loss) for loss in source.losses]),
        }
        self._log.attach(DIGESTS_ATTACHMENT, "text/plain", listing.encode(), options.start_ns)
        self._log.metadata(METADATA, facts)
        return RecordSummary(
            path=out,
            frames=self.frames,
            detections=self._detections,
            width=source.width,
            height=source.height,
            duration_ns=self._last_ns,
            detect=str(options.detect),
            codec=self._facts["codec"],
            source_digest=digest,
            notes=tuple(source.notes),
            losses=tuple(source.losses),
        )


def _known_at_start(source: Source, options: RecordOptions) -> dict[str, str]:
    codec = options.codec or ("none" if not source.has_images else "as is" if source.stills else "jpeg")
    return {
        "format_version": FORMAT_VERSION,
        "kind": "scene",
        "camera": options.camera,
        "configuration": _json(as_plain(options.config)),
        "packages": _json(_package_versions()),
        "python": python_version(),
        "machine": machine(),
        "opencv_build": opencv_build(),
        "source": utf8(source.path.name),
        "source_kind": source.name,
        "width": str(source.width),
        "height": str(source.height),
        "frame_ns": str(source.frame_ns),
        "start_ns": str(options.start_ns),
        "codec": codec,
        "detect": str(options.detect),
    }


def _json(value: object) -> str:
    return msgspec.json.encode(value, order="deterministic").decode()


def utf8(name: str) -> str:
    r"""A file's name as a log can hold it: bytes that are not UTF-8 are spelt out.

    >>> utf8("gate\udcff.avi")
    'gate\\udcff.avi'
    """
    return name.encode("utf-8", "backslashreplace").decode()


def _package_versions() -> dict[str, str]:
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "absent"
    return found
