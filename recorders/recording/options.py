"""How to record, and what is decided where an option is left open."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, get_args

from recorders import channels
from recorders.detectors import ModelOptions
from recorders.errors import UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.parameters import Config, configure
from recorders.recording.methods import NO_DETECTION, methods_of
from recorders.recording.sections import SECTIONS
from recorders.sources import LiveSource, Source
from recorders.sources.source import LoggedSource

Codec = Literal["jpeg", "png", "h264", "none"]
CODECS: tuple[str, ...] = get_args(Codec)


@dataclass(frozen=True)
class RecordOptions:
    """How to record.

    Attributes:
        camera: the camera's name, the first part of every topic.
        start_ns: the first frame's log time in ns; None: as the source says, 0 where it does not.
        codec: how pictures are stored; None keeps JPEG and PNG bytes as they are and stores video
            as JPEG. Pictures that are in the wanted format already are stored byte for byte.
        detect: the words of ``--detect`` with commas, see `recorders.recording.methods`; None:
            ``motion`` where there are pictures without detections.
        model: the network of the method ``onnx``.
        regions: a file of regions, see `recorders.sources.regions`.
        config: the parameters of `SECTIONS`.
        force: replace an existing output.
        limits: what the source may make us allocate.
        segment_ns: a new log every so much time; None: one log.
    """

    camera: str = channels.DEFAULT_CAMERA
    start_ns: int | None = None
    codec: str | None = None
    detect: str | None = None
    model: ModelOptions | None = None
    regions: str | Path | None = None
    config: Config = field(default_factory=lambda: configure(SECTIONS))
    force: bool = False
    limits: Limits = DEFAULT_LIMITS
    segment_ns: int | None = None


def with_defaults(source: Source, options: RecordOptions) -> RecordOptions:
    """The options with nothing left open.

    Raises:
        UsageError: they do not fit the source.
    """
    channels.check_camera(options.camera)
    _check_segments(source, options.segment_ns)
    if options.start_ns is None:
        start_ns = source.start_ns if isinstance(source, LoggedSource | LiveSource) else 0
        options = replace(options, start_ns=start_ns)
    elif isinstance(source, LoggedSource):
        raise UsageError(f"--start: {source.path} is a log and has times of its own")
    detect, codec = options.detect, options.codec
    if detect is None and options.model is not None:
        raise UsageError(f"--model {options.model.path} goes with --detect onnx")
    if detect is not None:
        methods = methods_of(detect, options.model)
        detect = str(methods)
        if methods.detect is not None and source.has_detections:
            raise UsageError(
                f"--detect {methods.detect}: {source.path} comes with detections; a detector"
                " of its own or those, not both"
            )
    if codec is not None and codec not in CODECS:
        raise UsageError(f"--codec {codec}: must be one of {', '.join(CODECS)}")
    if not source.has_images:
        if detect not in (None, NO_DETECTION):
            raise UsageError(
                f"--detect {detect} needs pictures; {source.path} ({source.name}) has none"
            )
        if codec not in (None, "none"):
            raise UsageError(
                f"--codec {codec} needs pictures; {source.path} ({source.name}) has none"
            )
        return replace(options, detect=NO_DETECTION, codec="none")
    if detect is None:
        detect = NO_DETECTION if source.has_detections else "motion"
    return replace(options, detect=detect)


def _check_segments(source: Source, segment_ns: int | None) -> None:
    if segment_ns is None:
        return
    if segment_ns < 1:
        raise UsageError("--segment: must be over 0")
    if isinstance(source, LoggedSource):
        raise UsageError(
            f"--segment: {source.path} is a log; `scenetrace cut` makes pieces of logs"
        )
