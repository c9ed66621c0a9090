"""How good a recording is: what was measured when it was made, as its log tells it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from recorders.errors import RecordingError
from recorders.format_version import RECORDS

QUALITY = "quality"
"""The fact in a log's metadata: a list of name, value, verdict."""
PIECES = "pieces_per_body"
GOOD, FAIR, POOR = "good", "fair", "poor"


@dataclass(frozen=True)
class QualityMeasure:
    """One thing that was measured.

    Attributes:
        name: what.
        value: the figure.
        verdict: ``good``; or ``fair`` or ``poor``, a colon, what is wrong and what to do.
    """

    name: str
    value: float
    verdict: str = GOOD

    @property
    def grade(self) -> str:
        """``good``, ``fair`` or ``poor``, which is what a verdict without a grade is."""
        if self.verdict == GOOD:
            return GOOD
        return FAIR if self.verdict.startswith(f"{FAIR}:") else POOR

    @property
    def bad(self) -> bool:
        """Something is wrong."""
        return self.verdict != GOOD


def graded(value: float, fair: float, poor: float, text: str) -> str:
    """The verdict on a value: good under ``fair``, poor from ``poor`` on.

    >>> graded(0.2, 0.1, 0.3, "it flickers")
    'fair: it flickers'
    """
    if value < fair:
        return GOOD
    return f"{POOR if value >= poor else FAIR}: {text}"


def quality_text(measured: Sequence[QualityMeasure]) -> str:
    """The measures as the metadata holds them."""
    return msgspec.json.encode([[m.name, m.value, m.verdict] for m in measured]).decode()


def recorded_quality(
    metadata: Iterable[tuple[str, Mapping[str, str]]], path: str | Path
) -> dict[str, list[QualityMeasure]]:
    """The measures of each camera that has some, of a scene log or of an annotated log that
    carries its recording's metadata.

    Args:
        metadata: name and values of each record, in the file's order.
        path: the log, for errors.

    Raises:
        RecordingError: a record holds something else under that name.
    """
    found: dict[str, list[QualityMeasure]] = {}
    for name, values in metadata:
        # What a recording says at its end holds more than what it says at its start.
        camera = values.get("camera", "")
        if name in RECORDS and QUALITY in values:
            found[camera] = _measures(values[QUALITY], path, name)
    return found


def _measures(text: str, path: str | Path, record: str) -> list[QualityMeasure]:
    try:
        rows = msgspec.json.decode(text.encode(), type=list[tuple[str, float, str]])
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        raise RecordingError(
            f"the metadata's {QUALITY} is no list of name, value and verdict ({error}):"
            " altered, or written by another program",
            path,
            record=record,
        ) from error
    return [QualityMeasure(*row) for row in rows]
