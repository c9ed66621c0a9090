"""MOTChallenge text: ``frame,id,x,y,w,h,conf,-1,-1,-1``, frames from 1, only tracks held to be
present.
"""

from __future__ import annotations

from pathlib import Path

from recorders.annotated.reader import AnnotatedLog
from recorders.messages import Track
from replay.export.output import whole_file

DECIMALS = 3


def write_mot(log: AnnotatedLog, out: str | Path, *, force: bool = False) -> int:
    """Write the present tracks of every frame, by frame and id; returns the number of rows.

    Places and sizes have three decimals at most, in the recording's pixels.

    Raises:
        OutputExistsError: ``out`` exists and ``force`` is not set.
    """
    rows = 0
    with whole_file(out, force=force) as file:
        for frame in log.frames(("tracks",)):
            lines = [
                mot_row(frame.index, track)
                for track in sorted(frame.tracks, key=lambda t: t.id)
                if track.present
            ]
            rows += len(lines)
            file.write("".join(lines).encode())
    return rows


def mot_row(frame: int, track: Track) -> str:
    """One line; ``frame`` counts from 0.

    >>> from recorders.messages import Track
    >>> format_number(-0.0004), format_number(12.5), format_number(7.0)
    ('0', '12.5', '7')
    """
    values = ",".join(format_number(v) for v in (*track.box, track.confidence))
    return f"{frame + 1},{track.id},{values},-1,-1,-1\n"


def format_number(value: float) -> str:
    """A number with three decimals at most, without trailing zeros and without a minus before
    zero.
    """
    text = f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
