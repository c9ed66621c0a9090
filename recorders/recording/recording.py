"""Recording: a source of frames into a scene log.

Frames are read and decoded in one thread, segmented in the caller's, encoded in a third, and
written in order: the log is the same as if one did it all.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

from recorders.clock import Gaps
from recorders.detectors import Detector
from recorders.errors import OutputExistsError, SceneTraceError, UsageError
from recorders.fusion import FusedFrames, FusionParameters, masks_hold
from recorders.messages import Detections
from recorders.pictures import Image
from recorders.quality import QUALITY, QualityMeasure, quality_text
from recorders.recording.finding import Finder
from recorders.recording.methods import methods_of, open_detector
from recorders.recording.options import RecordOptions, with_defaults
from recorders.recording.passed_on import Others
from recorders.recording.scene_writer import RecordSummary
from recorders.recording.segments import Logs
from recorders.recording.stages import Encoded, encoded
from recorders.segmentation import (
    SEGMENTERS,
    SegmentationParameters,
    Segmenter,
    SegmenterInTwoLooks,
)
from recorders.segmentation.motion import MotionSegmenter
from recorders.segmentation.quality import (
    FOREGROUND,
    of_detector,
    of_gaps,
    overall,
    worst,
)
from recorders.segmentation.usual import MOMENT_S
from recorders.sources import LiveSource, Source, read_regions
from recorders.sources.source import NANOS, GivenDetections, pairs_of
from recorders.vision import opencv_threads

FIRST_READING_PICTURES = 120
FIRST_READING_PAIRS = 60

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

    The log appears whole; with ``segment_ns`` there are several, see `Logs`. Where the recording
    ends early after its first frame, ``<out>.part`` stays, from which `scenetrace recover` makes a
    log.

    Raises:
        UsageError: the options do not fit the source.
        OutputExistsError: the log exists and ``force`` is off.
        InterruptedRecordingError: the source, or the user, ended the recording early.
        SourceError, LimitError: the source cannot be read at all.
        RecordingError: the log cannot be written.
    """
    options = options or RecordOptions()
    return record_scenes({options.camera: source}, out, options, progress)[0]


def record_scenes(
    sources: Mapping[str, Source],
    out: str | Path,
    options: RecordOptions | None = None,
    progress: Progress | None = None,
) -> list[RecordSummary]:
    """Record several cameras into one log, frames in the order of their times.

    ``sources`` holds a source for each camera's name; the options' own camera is not used. What the
    first source passes on of its log goes into this one.

    Raises:
        As `record`.
    """
    options = options or RecordOptions()
    out = Path(out)
    settled = {
        name: with_defaults(source, replace(options, camera=name))
        for name, source in sources.items()
    }
    if out.exists() and not options.force:
        raise OutputExistsError(out)
    for source in sources.values():
        if out.exists() and source.path.exists() and out.samefile(source.path):
            raise UsageError(f"{out}: is the source itself; record into another file")
    report = progress or _silent
    live = any(isinstance(source, LiveSource) for source in sources.values())
    scenes = {
        name: _Scene(source, settled[name], report) for name, source in sources.items()
    }
    logs = Logs(out, scenes, options, live=live)
    first = next(iter(scenes.values())).source
    others = Others(logs.log, first, list(sources))
    expected = [source.frame_count for source in sources.values()]
    total = None if None in expected else sum(n or 0 for n in expected)
    done = 0
    try:
        # Reading, segmenting and encoding run side by side; OpenCV's own threads would only take
        # turns with them.
        with opencv_threads(1), ExitStack() as stack:
            streams = [
                stack.enter_context(closing(scene.frames())) for scene in scenes.values()
            ]
            for time_ns, number, frame in _by_time(streams, list(scenes.values())):
                others.write_until(time_ns)
                logs.write(number, frame)
                done += 1
                report("recording", done, total)
            others.write_rest()
            first.losses.extend(others.losses())
        for scene in scenes.values():
            scene.conclude()
        summaries = logs.finish()
    except BaseException as error:
        _end_early(error, logs, done)
        raise
    finally:
        others.close()
    return summaries


class _Scene:
    """One camera: its source, and how it is segmented and encoded."""

    def __init__(self, source: Source, options: RecordOptions, report: Progress) -> None:
        self.source = source
        self.options = options
        self.regions = (
            None
            if options.regions is None
            else read_regions(options.regions, source.width, source.height)
        )
        self._finder, self.facts = _finder(source, options, report)
        self._gaps = Gaps(source.frame_ns)

    def frames(self) -> Generator[Encoded]:
        """Its frames, encoded."""
        finder, options = self._finder, self.options
        made = encoded(self.source, finder, options.codec, options.segment_ns)
        with closing(made) as frames:
            for frame in frames:
                self._gaps.step(frame.index, frame.time_ns)
                yield frame

    def conclude(self) -> None:
        """What can be said of the recording once all of it was seen goes into its facts and the
        source's notes.
        """
        segmenter = self._finder.segmenter
        if not isinstance(segmenter, MotionSegmenter):
            return
        told = [*segmenter.measured(), of_gaps([length for _, length in self._gaps.found])]
        alone = not self._finder.boxes
        if not alone:
            told.append(of_detector(self._finder.boxes, self._finder.boxes_in_masks))
        self.facts[QUALITY] = quality_text([overall(told), *told])
        changed = segmenter.changed()
        self.source.notes += [changed] if changed else []
        _note_quality(self.source, told, alone)


def _by_time(
    streams: Sequence[Iterator[Encoded]], scenes: Sequence[_Scene]
) -> Iterator[tuple[int, int, Encoded]]:
    """Log time, camera's number and frame, in the order of their times."""

    def timed(number: int) -> Iterator[tuple[int, int, Encoded]]:
        start = scenes[number].options.start_ns or 0
        for frame in streams[number]:
            yield start + frame.time_ns, number, frame

    return heapq.merge(*map(timed, range(len(streams))), key=lambda f: f[:2])


def _silent(stage: str, done: int, total: int | None) -> None:
    """No progress is wanted."""


def _end_early(error: BaseException, logs: Logs, frames: int) -> None:
    """Leave a part file where there is something to recover, nothing where there is not."""
    logs.log.abort()
    if not frames:
        logs.part.unlink(missing_ok=True)
    elif isinstance(error, KeyboardInterrupt):
        raise InterruptedRecordingError("interrupted", logs.part, frames) from error
    elif isinstance(error, SceneTraceError):
        raise InterruptedRecordingError(str(error), logs.part, frames) from error


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
    finder = Finder(source, None, detector, methods.detect or "")
    if methods.segment is None:
        return finder, facts
    sample: list[Detections] = []

    def paired() -> Iterator[tuple[Image, Image]]:
        apart = max(1, round(MOMENT_S * NANOS / source.frame_ns))
        for k, pair in enumerate(pairs_of(source, FIRST_READING_PAIRS, apart)):
            report("looking", k, FIRST_READING_PAIRS)
            if detector is not None:
                sample.append(finder.detected(k, pair[0]))
            yield pair

    def sampled() -> Iterator[Image]:
        for index, image in enumerate(source.sample(FIRST_READING_PICTURES)):
            report("looking", index, FIRST_READING_PICTURES)
            if detector is not None:
                sample.append(finder.detected(index, image))
            yield image

    finder.segmenter = _segmenter(methods.segment, source, options)
    fusion = options.config["fusion"]
    assert isinstance(fusion, FusionParameters)
    fuse = fusion.fuse and (detector is not None or source.has_detections)
    if isinstance(finder.segmenter, SegmenterInTwoLooks):
        finder.segmenter.prepare_twice(paired())
    else:
        finder.segmenter.prepare(sampled())
    if isinstance(finder.segmenter, MotionSegmenter):
        measured = finder.segmenter.quality
        facts = {**facts, QUALITY: quality_text(measured)}
        alone = detector is None and not source.has_detections
        _note_quality(source, measured, alone)
    if fuse:
        if isinstance(source, GivenDetections):
            sample.extend(source.given(FIRST_READING_PICTURES))
        fps = NANOS / source.frame_ns
        hold = False
        if detector is not None and isinstance(finder.segmenter, MotionSegmenter):
            hold = masks_hold(finder.segmenter.sampled, sample)
        finder.fusion = FusedFrames(fusion, source.height, fps, sample, masks_hold=hold)
    return finder, facts


def _note_quality(source: Source, measured: list[QualityMeasure], alone: bool) -> None:
    """The source notes what is wrong with its segmentation; pieces that stay apart only where
    masks are all there is.
    """
    found = worst(measured)
    if found is None or not (alone or found.name == FOREGROUND):
        return
    if found.verdict not in source.notes:
        source.notes.append(found.verdict)


def _segmenter(name: str, source: Source, options: RecordOptions) -> Segmenter:
    parameters = options.config["segmentation"]
    assert isinstance(parameters, SegmentationParameters)
    return SEGMENTERS[name](
        parameters, source.width, source.height, NANOS / source.frame_ns
    )
