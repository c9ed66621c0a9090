"""Plots of a result against its truth: SHELLS, Figure 5, and PARTS, Figures 8 to 10.

Needs matplotlib (extra ``plot``), which is imported when a plot is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from recorders.errors import SceneTraceError
from replay.evaluate.clear import Matches, match
from replay.evaluate.identity import identity
from replay.evaluate.overlap import Overlap, overlap
from replay.evaluate.trajectories import centre_distance
from replay.evaluate.truth import FloatArray, IntArray, MotTable

MOST_TRAJECTORIES = 12
MOST_LABELS = 6
COLOURS = 10
_PAPER = {
    "savefig.dpi": 130,
    "font.size": 9,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.axisbelow": True,
}

_BESIDE: dict[str, Any] = {
    "fontsize": 7,
    "loc": "upper left",
    "bbox_to_anchor": (1.0, 1.0),
    "borderaxespad": 0.4,
}
"""Legends stand beside the curves, never over them."""
_DASHES = ("--", "-.", ":", (0, (6, 1, 1, 1, 1, 1)))
"""One after the other for the tracks of one result that follow one true identity."""


def _colour(side: int) -> str:
    """A result's colour, the same in every panel."""
    return f"C{side % COLOURS}"


def _matplotlib() -> Any:
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise SceneTraceError(
            "--plot needs matplotlib, which is not installed: pip install"
            " 'scenetrace[plot]', or matplotlib alone"
        ) from error
    return mpl


def mota_over_time(both: Overlap, matches: Matches) -> FloatArray:
    """MOTA in percent over all frames up to each of ``both.frames``, (F,); nan before the first
    true box.
    """
    true = np.diff(both.true_start)
    result = np.diff(both.result_start)
    frame_of = np.searchsorted(both.frames, both.truth.frames[both.true_row[matches.pairs]])
    hits = np.bincount(frame_of, minlength=len(both.frames))
    switches = np.bincount(frame_of[matches.switched], minlength=len(both.frames))
    good = np.cumsum(hits - (result - hits) - switches)
    total = np.cumsum(true)
    return np.where(total > 0, 100 * good / np.maximum(total, 1), np.nan)


def own_pairs(both: Overlap, iou: float = 0.5) -> IntArray:
    """Pairs (indices) of every true identity with the track that has its identity, wherever that
    track is.

    The track is the one that IDF1 gives to the identity. Once it follows somebody else it is
    still the same track: that it is far off then is what an error of identity looks like.
    """
    n, m = both.shape
    track = np.full(n, m)
    given = identity(both, iou).pairs
    track[given[:, 0]] = given[:, 1]
    return np.flatnonzero(
        track[both.true_ids[both.true_row]] == both.result_ids[both.result_row]
    )


@dataclass(frozen=True, eq=False)
class _Side:
    """A result held against the truth."""

    name: str
    both: Overlap
    matches: Matches
    own: IntArray


def plot(
    truth: MotTable,
    result: MotTable,
    path: str | Path,
    *,
    iou: float = 0.5,
    frame_s: float = 0.0,
    name: str = "",
    also: Sequence[tuple[str, MotTable]] = (),
) -> None:
    """Write one picture: distances over time, MOTA over time, and the paths of truth and result.

    Args:
        truth: what is true, in the result's pixels.
        result: what a tracker said.
        path: .png, .pdf or .svg.
        iou: overlap of a match.
        frame_s: seconds between frames, 0: the time axes count frames.
        name: the result's, where others are drawn as well.
        also: other results of the same truth, and their names.

    Raises:
        SceneTraceError: matplotlib is missing, or cannot write this kind of file.
    """
    mpl = _matplotlib()
    from matplotlib.figure import Figure

    sides = []
    for label, table in ((name, result), *also):
        both = overlap(truth, table)
        sides.append(_Side(label, both, match(both, iou), own_pairs(both, iou)))
    both = sides[0].both
    longest = np.argsort(
        -np.bincount(both.true_ids, minlength=both.shape[0]), kind="stable"
    )[:MOST_TRAJECTORIES]
    shown = np.sort(longest).tolist()
    rows, above = -(-len(shown) // 3), len(sides)
    with mpl.rc_context(_PAPER):
        figure = Figure(figsize=(11, 3.6 + 2.4 * (above + rows)), layout="constrained")
        ratios = [*[1.3] * above, 0.9, *[1.1] * rows]
        grid = figure.add_gridspec(above + 1 + rows, 3, height_ratios=ratios)
        step, unit = (frame_s, "s") if frame_s > 0 else (1.0, "frame")
        for index, side in enumerate(sides):
            _distances(figure.add_subplot(grid[index, :]), side, shown, step, unit)
        _mota(figure.add_subplot(grid[above, :]), sides, step, unit)
        for index, i in enumerate(shown):
            _path(figure.add_subplot(grid[above + 1 + index // 3, index % 3]), sides, i)
        try:
            figure.savefig(path, metadata=_metadata(path))
        except (ValueError, OSError) as error:
            raise SceneTraceError(f"{path}: the plot cannot be written: {error}") from error


def _metadata(path: str | Path) -> dict[str, Any]:
    """Keep the day out of the file: same figures, same picture."""
    kinds: dict[str, dict[str, Any]] = {
        ".pdf": {"CreationDate": None},
        ".svg": {"Date": None},
        ".png": {"Software": None},
    }
    return kinds.get(Path(path).suffix.lower(), {})


def _distances(axes: Any, side: _Side, shown: list[int], step: float, unit: str) -> None:
    """Every true identity's distance to its own track; crosses where another track took over what
    is matched.
    """
    both, true_row = side.both, side.both.true_row[side.own]
    distance = centre_distance(both, side.own)
    switched = side.matches.pairs[side.matches.switched]
    for index, i in enumerate(shown):
        mine = both.true_ids[true_row] == i
        frames = both.truth.frames[true_row[mine]]
        x, y = _broken(frames, frames * step, distance[mine])
        if len(x):
            (line,) = axes.plot(
                x,
                y,
                "-" if index < COLOURS else ":",
                lw=1,
                label=str(int(both.true_names[i])),
            )
            at = both.truth.frames[
                both.true_row[switched[both.true_ids[both.true_row[switched]] == i]]
            ]
            there = np.isin(frames, at)
            axes.plot(
                frames[there] * step,
                distance[mine][there],
                "x",
                ms=5,
                color=line.get_color(),
            )
    of = f": {side.name}" if side.name else ""
    axes.set(
        title=f"Distance of each identity's own track to the truth{of} (x: switch)",
        xlabel=unit,
        ylabel="px",
    )
    if len(axes.lines):
        axes.legend(ncols=2, title="truth", **_BESIDE)


def _mota(axes: Any, sides: Sequence[_Side], step: float, unit: str) -> None:
    for index, side in enumerate(sides):
        both, matches = side.both, side.matches
        label = side.name or "MOTA so far"
        axes.plot(
            both.frames * step,
            mota_over_time(both, matches),
            lw=1.4,
            color=_colour(index),
            label=label,
        )
    both, matches = sides[0].both, sides[0].matches
    at = both.truth.frames[both.true_row[matches.pairs[matches.switched]]] * step
    of = f" of {sides[0].name}" if sides[0].name else ""
    for index, x in enumerate(at.tolist()):
        axes.axvline(
            x,
            color="0.3",
            ls=":",
            lw=0.8,
            label=f"identity switch{of}" if index == 0 else None,
        )
    axes.set(title="MOTA over all frames so far", xlabel=unit, ylabel="%", ylim=(None, 102))
    axes.legend(**_BESIDE)


def _broken(
    frames: IntArray, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A line over frames, broken where frames are missing."""
    gaps = np.flatnonzero(np.diff(frames) > 1) + 1
    return np.insert(x.astype(np.float64), gaps, np.nan), np.insert(y, gaps, np.nan)


def _path(axes: Any, sides: Sequence[_Side], i: int) -> None:
    both, matches = sides[0].both, sides[0].matches
    mine = matches.pairs[both.true_ids[both.true_row[matches.pairs]] == i]
    own = both.true_ids == i
    truth = both.truth.centres[own]
    x, y = _broken(both.truth.frames[own], truth[:, 0], truth[:, 1])
    axes.plot(x, y, color="black", lw=2.2, alpha=0.35, label="truth")
    rows = both.result_row[mine]
    by = both.result_ids[rows]
    for index, fromkey in enumerate(dict.fromkeys(by.tolist())):
        part = rows[by == fromkey]
        centres = both.result.centres[part]
        x, y = _broken(both.result.frames[part], centres[:, 0], centres[:, 1])
        label = (
            f"{sides[0].name} {int(both.result_names[fromkey])}"
            if sides[0].name
            else f"track {int(both.result_names[fromkey])}"
        )
        axes.plot(
            x, y, ls=_DASHES[index % len(_DASHES)], lw=1.1, color=_colour(0), label=label
        )
    for index, side in enumerate(sides[1:], 1):
        theirs = side.both.result_row[
            side.own[side.both.true_ids[side.both.true_row[side.own]] == i]
        ]
        centres = side.both.result.centres[theirs]
        x, y = _broken(side.both.result.frames[theirs], centres[:, 0], centres[:, 1])
        axes.plot(x, y, "-", lw=0.9, color=_colour(index), label=side.name)
    axes.set_title(
        f"Truth {int(both.true_names[i])}: {100 * len(mine) / max(1, len(truth)):.0f} %"
        " tracked",
        fontsize=8,
    )
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    axes.set_xlabel("x, px", fontsize=7)
    axes.set_ylabel("y, px", fontsize=7)
    axes.tick_params(labelsize=6)
    handles, labels = axes.get_legend_handles_labels()
    if len(labels) > MOST_LABELS:
        labels = [*labels[: MOST_LABELS - 1], f"and {len(labels) - MOST_LABELS + 1} more"]
    axes.legend(handles[: len(labels)], labels, fontsize=6, framealpha=0.5)
