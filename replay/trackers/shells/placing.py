"""Where objects are that share their foreground: each at the place where its last mask explains
most of it.

The prior of equation 8 stands or falls with the shell's centre, and in a JOINT the mean of the
owned pixels is that of the visible ones alone. So before pixels are assigned, each object's last
mask is moved over the foreground around its prediction to where it explains, by its colours, most
of what nobody else explains better, and little background. The objects are moved by turns, those
that were seen best first. (Ours; the paper stays with the prediction.)

The search itself is done in whole numbers of `_UNIT`s of log likelihood: 8 bits hold what a cell
can gain, saturating subtraction is the maximum with 0, and sums of whole numbers are the same on
every machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.vision import cv2
from replay.trackers.shells.colours import Bins
from replay.trackers.shells.foreground import Cut
from replay.trackers.shells.membership import Claimants, log_mask
from replay.trackers.shells.objects import GRID
from replay.trackers.shells.parameters import ShellsParameters

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]

_UNIT = 1 / 48
_UNEXPLAINED = -2.2
"""Log score from which on a foreground pixel is explained."""
_ACROSS = 12
"""Cells across the smallest object's size: the search's resolution."""
SWEEPS = 2
_AT_ONCE = 4 << 20
"""Cells of windows held at a time, as far as one row of places allows: memory must not grow with
the search.
"""


@dataclass(slots=True)
class _Piece:
    """An object on the search's grid: what its colours tell, log mask, what is needed to explain
    a cell and what background below it costs in units, place of its top left cell.
    """

    tells: Floats | None
    log: Floats
    need: Bytes
    gap: Bytes
    top: int
    left: int
    home: tuple[int, int]
    worth: float


def place(
    who: Claimants,
    reach: Floats,
    order: Sequence[int],
    cut: Cut,
    bins: Bins | None,
    parameters: ShellsParameters,
) -> Floats:
    """Boxes (N, 4) of the objects at the places that explain the foreground best.

    Args:
        who: the objects, boxes predicted.
        reach: (N,) standard deviations of the predicted places, pixels.
        order: the rows in the order in which they choose.
        cut: the foreground that they share, with a margin of at least one object's size around
            their boxes.
        bins: (H, W) colour bins, None without pictures.
        parameters: the parameters.
    """
    size = float(np.sqrt(np.maximum(who.boxes[:, 2] * who.boxes[:, 3], 1.0)).min())
    step = max(1, int(size / _ACROSS))
    own = cut.own[::step, ::step]
    empty = np.where(cut.empty[::step, ::step], np.uint8(255), np.uint8(0))
    coarse = None if bins is None else bins[::step, ::step]
    pieces = [_piece(who, row, cut, step) for row in range(len(who.boxes))]
    floor = np.where(own, _UNEXPLAINED, 0.0)
    for sweep in range(SWEEPS):
        for k in order:
            reached, stride = _span(who, k, reach, step, sweep)
            area = _within(pieces[k], reached, own.shape)
            if area is None:
                continue
            others = floor[area].copy()
            for index, piece in enumerate(pieces):
                if index != k:
                    _explain(others, (area[0].start, area[1].start), piece, coarse)
            gained = np.where(
                own[area], _units(_gain(pieces[k], coarse, area) - others), np.uint8(0)
            )
            _move(
                pieces[k],
                gained,
                empty[area],
                (area[0].start, area[1].start),
                stride,
                reach[k] / step,
                parameters,
            )
    out = who.boxes.copy()
    for k, piece in enumerate(pieces):
        out[k, 0] += (piece.left - piece.home[1]) * step
        out[k, 1] += (piece.top - piece.home[0]) * step
    return out


def _gain(piece: _Piece, bins: Bins | None, area: tuple[slice, slice]) -> Floats:
    """Log likelihood ratio of every cell's colour within an area."""
    if piece.tells is None or bins is None:
        return np.zeros((area[0].stop - area[0].start, area[1].stop - area[1].start))
    return np.asarray(piece.tells[bins[area]])


def _piece(who: Claimants, k: int, cut: Cut, step: int) -> _Piece:
    x, y, w, h = who.boxes[k].tolist()
    rows, columns = max(2, round(h / step)), max(2, round(w / step))
    i = np.arange(rows) * GRID // rows
    j = np.arange(columns) * GRID // columns
    log = log_mask(who.masks[k])[i[:, None], j]
    gap = -np.log(np.maximum(1.0 - np.exp(log), 0.03))
    top, left = round((y - cut.top) / step), round((x - cut.left) / step)
    worth = float((log - _UNEXPLAINED)[log > _UNEXPLAINED].sum())
    return _Piece(
        tells=who.tells[k],
        log=log,
        need=_units(-log),
        gap=_units(gap),
        top=top,
        left=left,
        home=(top, left),
        worth=max(worth, 1.0),
    )


def _units(values: Floats) -> Bytes:
    """Whole units of log likelihood, what is negative as 0."""
    units = np.asarray(values * (1 / _UNIT))
    np.maximum(units, 0.0, out=units)
    np.minimum(units, 255.0, out=units)
    return np.rint(units, out=units).astype(np.uint8)


def _span(who: Claimants, k: int, reach: Floats, step: int, sweep: int) -> tuple[int, int]:
    """How far (cells) the search goes, and its stride: widely first, then closely around what was
    found.
    """
    size = float(np.sqrt(max(1.0, who.boxes[k, 2] * who.boxes[k, 3])))
    # Of an object far larger than the smallest, places as far apart as its own size warrants.
    stride = max(2, int(size / step / _ACROSS))
    if sweep:
        return stride, max(1, stride // 2)
    span = min(
        max(2.0 * float(reach[k]), 0.25 * size), max(0.7 * size, 1.5 * float(reach[k]))
    )
    return max(stride, stride * round(span / step / stride)), stride


def _within(
    piece: _Piece, reach: int, shape: tuple[int, ...]
) -> tuple[slice, slice] | None:
    """The cells that a piece may cover at any place within the search's reach, None where there
    is no place for it.
    """
    rows, columns = piece.need.shape
    height, width = shape
    top = min(max(piece.top - reach, 0), max(0, height - rows))
    left = min(max(piece.left - reach, 0), max(0, width - columns))
    bottom = min(max(piece.top + reach, top), height - rows)
    right = min(max(piece.left + reach, left), width - columns)
    if bottom < top or right < left:
        return None
    return slice(top, bottom + rows), slice(left, right + columns)


def _explain(
    others: Floats, corner: tuple[int, int], piece: _Piece, bins: Bins | None
) -> None:
    """Raise the explanation of an area's cells under a piece to its own; ``corner``: the area's
    top left cell.
    """
    (height, width), (top, left) = others.shape, corner
    rows, columns = piece.log.shape
    a, b = max(top, piece.top), max(left, piece.left)
    c, d = min(top + height, piece.top + rows), min(left + width, piece.left + columns)
    if c > a and d > b:
        part = others[a - top : c - top, b - left : d - left]
        mine = piece.log[a - piece.top : c - piece.top, b - piece.left : d - piece.left]
        np.maximum(part, mine + _gain(piece, bins, (slice(a, c), slice(b, d))), out=part)


def _move(
    piece: _Piece,
    free: Bytes,
    empty: Bytes,
    corner: tuple[int, int],
    stride: int,
    doubt: float,
    parameters: ShellsParameters,
) -> None:
    """Move a piece to the best place within an area; of equals the one nearest to the top left."""
    (rows, columns), (top, left) = piece.need.shape, corner
    frees, empties = (_windows(cells, (rows, columns), stride) for cells in (free, empty))
    many = max(1, _AT_ONCE // (frees.shape[1] * rows * columns))
    total = np.concatenate(
        [
            _explained(frees[i : i + many], piece)
            - parameters.gap_cost * _emptied(empties[i : i + many], piece)
            for i in range(0, len(frees), many)
        ]
    )
    y = top + np.arange(total.shape[0]) * stride - piece.home[0]
    x = left + np.arange(total.shape[1]) * stride - piece.home[1]
    scale = max(0.1 * float(np.sqrt(rows * columns)), doubt)
    total = total / piece.worth - parameters.prior_cost * (
        y[:, None] * y[:, None] + x * x
    ) / (scale * scale)
    i, j = divmod(int(np.argmax(total)), total.shape[1])
    piece.top, piece.left = top + i * stride, left + j * stride


def _explained(windows: Bytes, piece: _Piece) -> Floats:
    """What a piece would explain at each place, from the windows (I, J, h, w) of what nobody
    explains.
    """
    # In C order, as `_sums` wants them: the windows' own order in memory is another.
    gained = np.maximum(windows, piece.need, order="C")
    return _sums(np.subtract(gained, piece.need, out=gained))


def _emptied(windows: Bytes, piece: _Piece) -> Floats:
    """What the background below a piece would cost at each place, from the windows of what is
    background.
    """
    return _sums(np.bitwise_and(windows, piece.gap, order="C"))


def _windows(cells: Bytes, shape: tuple[int, int], stride: int) -> Bytes:
    """All windows of a shape at every ``stride``-th place, (I, J, h, w), a view."""
    height, width = cells.shape
    count = ((height - shape[0]) // stride + 1, (width - shape[1]) // stride + 1)
    cells = np.ascontiguousarray(cells)
    down, right = cells.strides
    return np.ndarray(
        (*count, *shape), np.uint8, cells, 0, (down * stride, right * stride, down, right)
    )


def _sums(windows: Bytes) -> Floats:
    """Sums over windows (I, J, h, w) of whole units, (I, J), in log likelihoods."""
    i, j, h, w = windows.shape
    total = cv2.reduce(windows.reshape(i * j, h * w), 1, cv2.REDUCE_SUM, dtype=cv2.CV_32S)
    return np.asarray(total, np.float64).reshape(i, j) * _UNIT
