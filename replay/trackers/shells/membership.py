"""Pixel membership (SHELLS 2.4): who owns each foreground pixel within the shells of objects that
meet.

Equations 6 to 8: the owner of a pixel is argmax over the object and those it is related to of
P(p|c) P(c), with the colour histogram's likelihood and the shell's Epanechnikov kernel as the
prior, which is 0 outside c's own shell. Ties go to the object that was born first. Everything is
done over all pixels of an object's shell at once.

Beyond the paper, each with a parameter of its own: the object's last mask as a further cue
(``shape``), shares of pixels in place of whole ones (``soft``), and pixels that belong to nobody
because two objects claim them alike (``disputed``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from replay.trackers.shells.colours import Bins
from replay.trackers.shells.foreground import Bools, Cut
from replay.trackers.shells.objects import GRID
from replay.trackers.shells.parameters import ShellsParameters
from replay.trackers.tracker import Image

Floats = NDArray[np.float64]
Places = NDArray[np.intp]
_NEVER = -1e9
_TAIL = 0.05
"""Share of pixels outside of the last mask."""


@dataclass(frozen=True)
class Claimants:
    """N objects that claim pixels: boxes (N, 4) and shell radii (N,) in pixels, tables (BINS,)
    and masks, or None.
    """

    boxes: Floats
    radii: Floats
    tells: Sequence[Floats | None]
    masks: Sequence[Image | None]


@dataclass(frozen=True)
class Members:
    """The answer.

    Attributes:
        owner: (H, W) uint16, 0 for nobody, k + 1 for claimant k.
        counts: (N,) owned pixels, or with ``soft`` sums of shares. The owners are the hard rule's
            in either case.
        means: (N, 2) E[P_k] in the picture, pixel centres at integers + 0.5; nan without pixels.
    """

    owner: NDArray[np.uint16]
    counts: Floats
    means: Floats


def log_mask(mask: Image | None) -> Floats:
    """Log share of own pixels by cell of the box, (GRID, GRID); an ellipse where no mask is
    known.
    """
    share = _ELLIPSE if mask is None else mask.astype(np.float64) / 255.0
    return np.asarray(np.log(_TAIL + (1 - _TAIL) * share))


def _ellipse() -> Floats:
    u = ((np.arange(GRID) + 0.5) / GRID * 2 - 1) ** 2
    return np.asarray(np.clip(2.0 * (1.0 - (u[:, None] + u[None, :])), 0.0, 0.95))


_ELLIPSE = _ellipse()


def cells(start: float, size: float, first: int, last: int) -> NDArray[np.intp]:
    """Cells of a box's side (start, size) in which the pixels first to last - 1 lie, out of range
    outside of it.
    """
    centre = np.arange(first, last) + 0.5
    return np.asarray(np.floor((centre - start) * (GRID / max(size, 1.0))), np.intp)


def score(
    k: int, who: Claimants, cut: Cut, bins: Bins | None, parameters: ShellsParameters
) -> tuple[Floats, Places]:
    """Score log P(p|c) P(c) of claimant k for the pixels of the cut within its shell, and which
    they are (flat).
    """
    x, y, w, h = who.boxes[k].tolist()
    r = float(who.radii[k])
    cx, cy = x + w / 2 - cut.left, y + h / 2 - cut.top
    height, width = cut.own.shape
    y1, y2 = min(height, max(0, int(cy - r))), min(height, max(0, int(cy + r) + 1))
    x1, x2 = min(width, max(0, int(cx - r))), min(width, max(0, int(cx + r) + 1))
    y2, x2 = max(y1, y2), max(x1, x2)
    dy, dx = np.arange(y1, y2) + 0.5 - cy, np.arange(x1, x2) + 0.5 - cx
    far = (dy * dy)[:, None] + dx * dx
    square = max(r * r, 1.0)
    within = np.flatnonzero((far < square) & cut.own[y1:y2, x1:x2])
    i = within // max(1, x2 - x1)
    j = within - i * (x2 - x1)
    at = (i + y1) * width + (j + x1)
    total = parameters.prior * np.log(np.maximum(1.0 - far.take(within) / square, 1e-3))
    table = who.tells[k]
    if table is not None and bins is not None:
        total += parameters.colour * table[bins.ravel()[at]]
    if parameters.shape > 0:
        rows = np.minimum(np.maximum(cells(y - cut.top, h, y1, y2), -1), GRID) + 1
        columns = np.minimum(np.maximum(cells(x - cut.left, w, x1, x2), -1), GRID) + 1
        total += (
            parameters.shape
            * _shape(who.masks[k]).ravel()[rows[i] * (GRID + 2) + columns[j]]
        )
    return total, at


def _shape(mask: Image | None) -> Floats:
    """Log shares of the last mask with what lies around the box, (GRID + 2, GRID + 2)."""
    table = np.full((GRID + 2, GRID + 2), np.log(_TAIL))
    table[1:-1, 1:-1] = log_mask(mask)
    return table


def assign_pixels(
    who: Claimants, cut: Cut, bins: Bins | None, parameters: ShellsParameters
) -> Members:
    """Decide every pixel of a cut.

    Args:
        who: the objects, in the order of their birth.
        cut: the pixels.
        bins: (H, W) colour bins of the cut, None without pictures.
        parameters: weights of the cues.
    """
    count = len(who.boxes)
    best = np.full(cut.own.size, _NEVER)
    second = np.full(cut.own.size, _NEVER)
    owner = np.zeros(cut.own.size, np.uint16)
    scores: list[tuple[Floats, Places]] = []
    for k in range(count):
        mine, at = score(k, who, cut, bins, parameters)
        top = best[at]
        wins = mine > top
        if parameters.disputed > 0:
            second[at] = np.maximum(second[at], np.where(wins, top, mine))
        owner[at[wins]] = k + 1
        best[at] = np.maximum(top, mine)
        if parameters.soft:
            scores.append((mine, at))
    if parameters.disputed > 0:
        owner[(best - second < parameters.disputed) & (second > _NEVER / 2)] = 0
    image = owner.reshape(cut.own.shape)
    if parameters.soft:
        return _soft(image, best, scores, cut)
    counts, means = moments(image, count, cut)
    return Members(image, counts, means)


def moments(owner: NDArray[np.uint16], n: int, cut: Cut) -> tuple[Floats, Floats]:
    """Pixels (n,) and means (n, 2) of owners 1 to n."""
    at = np.flatnonzero(owner)
    ys = at // owner.shape[1]
    xs = at - ys * owner.shape[1]
    who = owner.take(at)
    counts = np.bincount(who, minlength=n + 1)[1:].astype(np.float64)
    total = np.stack([np.bincount(who, v, minlength=n + 1)[1:] for v in (xs, ys)], axis=1)
    with np.errstate(invalid="ignore"):
        means = total / np.where(counts > 0, counts, np.nan)[:, None] + np.array(
            [cut.left + 0.5, cut.top + 0.5]
        )
    return counts, np.asarray(means)


def _soft(
    owner: NDArray[np.uint16], best: Floats, scores: list[tuple[Floats, Places]], cut: Cut
) -> Members:
    """Counts and means from shares P(c|p) in place of whole pixels."""
    total = np.zeros(best.shape)
    shares = [np.exp(mine - best[at]) for mine, at in scores]
    for share, (_, at) in zip(shares, scores, strict=True):
        total[at] += share
    counts, means = np.zeros(len(scores)), np.full((len(scores), 2), np.nan)
    width = cut.own.shape[1]
    for index, (share, (_, at)) in enumerate(zip(shares, scores, strict=True)):
        part = share / np.maximum(total[at], 1e-12)
        counts[index] = part.sum()
        if counts[index] > 0:
            x = (part * (at % width + cut.left + 0.5)).sum()
            y = (part * (at // width + cut.top + 0.5)).sum()
            means[index] = x / counts[index], y / counts[index]
    return Members(owner, counts, means)


def extent(own: Bools, cut: Cut) -> tuple[float, float, float, float] | None:
    """The box of a mask's pixels in the cut, without the outermost 2 % on each side; None for an
    empty one.
    """
    count = int(np.count_nonzero(own))
    if not count:
        return None
    skip = 0.02 * count
    x1, x2 = _span(own.sum(axis=0), skip)
    y1, y2 = _span(own.sum(axis=1), skip)
    return (float(cut.left + x1), float(cut.top + y1), float(x2 - x1), float(y2 - y1))


def _span(profile: NDArray[np.int64], skip: float) -> tuple[int, int]:
    below = np.cumsum(profile)
    first = int(np.searchsorted(below, skip, side="right"))
    last = int(np.searchsorted(below, below[-1] - skip, side="left"))
    return first, max(first, last) + 1
