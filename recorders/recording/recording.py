"""Recording: a source of frames into a scene log.

Frames are read and decoded in one thread, segmented in the caller's, encoded in a third, and
written in order: the log is the same as if one did it all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

from recorders import channels
from recorders.detectors import Detector
from recorders.errors import OutputExistsError, SceneTraceError, UsageError
from recorders.log import LogWriter
from recorders.pictures import Image
from recorders.recording.finding import Finder
from recorders.recording.methods import Methods, methods_of, open_detector
from recorders.recording.options import RecordOptions, decided
from recorders.recording.scene_writer import RecordSummary, SceneWriter
from recorders.recording.stages import encoded
from recorders.segmentation import SEGMENTERS, SegmentationParameters, Segmenter
from recorders.sources import Source, read_regions
from recorders.sources.source import NANOS
from recorders.vision import opencv_threads

FIRST_READING_PICTURES = 120

Progress = Callable[[str, int, "int | None"], None]
"""Called with the stage (``looking``, ``recording``), frames done, and frames expected, if known.
"""


class InterruptedRecordingError(SceneTraceError):
    """A recording ended early; what was written until then is in the part file."""

    def __init__(self, reason: str, part: Path, frames: int) -> None:
        recovered = part.with_name("recovered-" + part.name.removesuffix(".part"))
        super().__init__(
            f"{reason} after {frames} frames; keep them with: scenetrace recover {part} -o"
            f" {recovered}"
        )
        self.part = part
        self.frames = frames


def record(
    source: Source,
    out: str | Path,
    options: RecordOptions | None = None,
    progress: Progress | None = None,
) -> RecordSummary:
    """Record a source into a scene log.

    The log appears whole. Where the recording ends early after its first frame, ``<out>.part``
    stays, from which `scenetrace recover` makes a log.

    Raises:
        UsageError: the options do not fit the source.
        OutputExistsError: the log exists and ``force`` is off.
        InterruptedRecordingError: the source, or the user, ended the recording early.
        SourceError, LimitError: the source cannot be read at all.
        RecordingError: the log cannot be written.
    """
    options = options or RecordOptions()
    out = Path(out)
    settled = decided(source, options)
    if out.exists() and not options.force:
        raise OutputExistsError(out)
    if out.exists() and source.path.exists() and out.samefile(source.path):
        raise UsageError(f"{out}: is the source itself; record into another file")
    regions = (
        None
        if options.regions is None
        else read_regions(options.regions, source.width, source.height)
    )
    report = progress or _silent
    finder, facts = _finder(source, settled, report)
    pictures = [channels.topic(options.camera, name) for name in channels.PICTURES]
    log = LogWriter(
        out,
        force=options.force,
        keep_part=True,
        picture_topics=pictures,
        limits=options.limits,
    )
    writer = SceneWriter(log, source, settled, regions, facts)
    try:
        # Reading, segmenting and encoding run side by side; OpenCV's own threads would only take
        # turns with them.
        with opencv_threads(1), closing(encoded(source, finder, settled.codec)) as frames:
            for frame in frames:
                writer.write(frame)
                report("recording", writer.frames, source.frame_count)
        summary = writer.finish(out)
        log.close()
    except BaseException as error:
        _end_early(error, log, out, writer.frames)
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


def _finder(
    source: Source, options: RecordOptions, report: Progress
) -> tuple[Finder, dict[str, str]]:
    """What looks through the frames, and what the log says of its detector."""
    assert options.detect is not None
    methods = methods_of(options.detect, options.model)
    detector: Detector | None = None
    facts: dict[str, str] = {}
    if methods.detect is not None:
        detector, facts = open_detector(methods.detect, options.model, options.config)
    segmenter = _segmenter(methods, source, options, report)
    return Finder(source, segmenter, detector, methods.detect or ""), facts


def _segmenter(
    methods: Methods, source: Source, options: RecordOptions, report: Progress
) -> Segmenter | None:
    """The segmenter, having read the source once to know its background in hindsight."""
    if methods.segment is None:
        return None
    parameters = options.config["segmentation"]
    assert isinstance(parameters, SegmentationParameters)
    segmenter = SEGMENTERS[methods.segment](
        parameters, source.width, source.height, NANOS / source.frame_ns
    )

    def sampled() -> Iterator[Image]:
        for index, image in enumerate(source.sample(FIRST_READING_PICTURES)):
            report("looking", index, FIRST_READING_PICTURES)
            yield image

    segmenter.prepare(sampled())
    return segmenter
