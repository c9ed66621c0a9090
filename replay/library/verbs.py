"""The commands as functions: record, replay, evaluate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from recorders.errors import SceneTraceError
from recorders.parameters import Config, Parameters, as_plain, configure
from replay.trackers.choice import DEFAULT_TRACKER, AnyTracker, choose

if TYPE_CHECKING:
    from recorders.recording import RecordSummary
    from recorders.sources import Source
    from replay.annotated_writer import ReplaySummary
    from replay.evaluate import Scores

Chosen = str | Path | Mapping[str, Any] | None
"""Parameters: a TOML file, or section to parameters (plain, or a `Parameters`)."""


def record(
    source: str | Path | Source,
    out: str | Path,
    *,
    detections: str | Path | None = None,
    fps: float | str | None = None,
    size: tuple[int, int] | None = None,
    config: Chosen = None,
    progress: Callable[[str, int, int | None], None] | None = None,
    **options: Any,
) -> RecordSummary:
    """Record a source into a scene log: what ``scenetrace record`` does.

    Args:
        source: a video, a folder of pictures, detections in a file, or a `Source`.
        out: the scene log; complete or absent.
        detections: detections beside the pictures.
        fps: frames per second, where the source does not say or says wrong.
        size: (width, height) that the detections were made for.
        config: parameters; the others have their defaults.
        progress: called with the stage, the frames done, and the frames expected.
        options: further fields of `recorders.recording.RecordOptions`: ``detect``, ``camera``,
            ``codec``, ``regions``, ``start_ns``, ``force``.

    Raises:
        UsageError, SourceError, OutputExistsError, RecordingError: each says what and where.
    """
    from recorders.recording import SECTIONS, RecordOptions
    from recorders.recording import record as record_source
    from recorders.sources import open_source

    if isinstance(source, str | Path):
        source = open_source(source, detections=detections, fps=fps, size=size)
    chosen = RecordOptions(**options, config=_configured(SECTIONS, config))
    return record_source(source, out, chosen, progress)


def replay(
    scene: str | Path,
    out: str | Path,
    tracker: AnyTracker = DEFAULT_TRACKER,
    *,
    config: Chosen = None,
    progress: Callable[[str, int], None] | None = None,
    **options: Any,
) -> ReplaySummary:
    """Replay a scene log into an annotated log: what ``scenetrace replay`` does.

    Args:
        scene: the scene log.
        out: the annotated log; complete or absent.
        tracker: a name as after ``--tracker``, or a class of the caller's own.
        config: parameters; the others have their defaults.
        progress: called with the stage and the frame's number.
        options: further fields of `replay.run.ReplayOptions`: ``from_ns``, ``to_ns``,
            ``annotations_only``, ``checkpoint_ns``, ``checkpoints``, ``camera``, ``corrections``,
            ``force``.

    Raises:
        UsageError, OutputExistsError, RecordingError: each says what and where.
    """
    from replay.annotated_writer import replay as replay_scene
    from replay.configuration import all_sections, sections
    from replay.run import ReplayOptions

    choice = choose(tracker)
    chosen = _configured(sections(choice), config, all_sections())
    given = ReplayOptions(choice, chosen)
    return replay_scene(scene, out, replace(given, **options), progress)


def _configured(
    sections: Mapping[str, type[Parameters]],
    given: Chosen,
    others: Mapping[str, Any] | None = None,
) -> Config:
    if given is None or isinstance(given, str | Path):
        return configure(sections, given, others=others or {})
    plain = {
        name: as_plain({name: part})[name] if isinstance(part, Parameters) else part
        for name, part in given.items()
    }
    return configure(sections, values=plain)


def evaluate(
    annotated: str | Path,
    truth: str | Path,
    *,
    truth_size: tuple[int, int] | None = None,
    iou: float = 0.5,
    camera: str | None = None,
) -> Scores:
    """Score an annotated log against a labelled truth: what ``scenetrace eval`` does.

    Args:
        annotated: the log.
        truth: MOTChallenge text (rows with confidence 0 do not count) or CAVIAR XML. What it says
            of frames that the log does not have is left out.
        truth_size: (width, height) of the picture that the truth was labelled in.
        iou: overlap from which boxes match.
        camera: which one, where there are several.

    Raises:
        RecordingError, SceneTraceError: a file cannot be read, or nothing is left to score.
    """
    from recorders.annotated.reader import AnnotatedLog
    from replay.evaluate import evaluate as score
    from replay.evaluate import fit_truth, read_truth
    from replay.evaluate.track_table import read_tracks

    with AnnotatedLog(annotated, camera) as log:
        found = read_tracks(log)
    true = read_truth(truth)
    if found.size is not None:
        true = fit_truth(true, found.size, truth_size)
    true = true.select(np.isin(true.frames, found.frames))
    if not len(true):
        raise SceneTraceError(f"{truth}: no truth in the frames of {annotated}")
    return score(true, found.table, iou)
