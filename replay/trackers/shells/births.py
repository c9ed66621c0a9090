"""What nobody explains: free detections, the first guess of a new object's area, and objects that
come back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.messages import NO_BLOB, Box, Notice
from replay.trackers.life import NANOS, TENTATIVE, Life
from replay.trackers.shells.colours import colours_in, distance
from replay.trackers.shells.foreground import Foreground
from replay.trackers.shells.objects import Bodies, Body
from replay.trackers.shells.parameters import ShellsParameters
from replay.trackers.shells.resolve import Resolver
from replay.trackers.tracker import Frame

Floats = NDArray[np.float64]


_DRIFT, _DRIFT_RATE = 0.5, 0.5
"""How far a lost object may be off its path at once, sizes, and its growth, sizes per second."""


@dataclass(frozen=True)
class Free:
    """What may be associated with objects that have not been found, or start new ones.

    Attributes:
        boxes: (N, 4) x, y, w, h in pixels.
        blobs: (N,) labels of the blobs.
        whole: (N,) bool, the box is that of a blob that is nobody else's.
        scores: (N,) how likely each is somebody, in [0, 1].
    """

    boxes: Floats
    blobs: NDArray[np.int64]
    whole: NDArray[np.bool_]
    scores: Floats


def boxes_alone(frame: Frame, likely: Floats) -> Free:
    """Without masks every detection is a blob of its own, fused ones have those of the masks; how
    ``likely`` each is somebody (N,).
    """
    count = len(frame.boxes)
    blobs = np.arange(1, count + 1)
    if frame.detections.fused:
        blobs = np.array(frame.detections.blobs, np.int64)
    return Free(frame.boxes, blobs, np.zeros(count, bool), likely)


def unexplained(frame: Frame, resolver: Resolver, parameters: ShellsParameters) -> Free:
    """The detections most of whose foreground belongs to no object that was found.

    A blob that holds one detection and no object stands for itself, whatever box was drawn into it.
    """
    fg, boxes = resolver.foreground, frame.boxes
    count = len(boxes)
    blobs = np.array(frame.detections.blobs or [NO_BLOB] * count, np.int64)
    if not count:
        return Free(boxes, blobs, np.zeros(0, bool), np.zeros(0))
    taken = np.zeros(len(fg.boxes) + 1, bool)
    placed: list[Box] = []
    for at in resolver.found.values():
        taken[max(0, at.blob)] = True
        if not at.alone:
            placed.append(at.box)
    only = np.bincount(np.clip(blobs, 0, len(fg.boxes)), minlength=len(fg.boxes) + 1)
    # A blob that is wholly somebody's own explains itself; only blobs that were shared or misfit
    # are looked into.
    own = {at.blob for at in resolver.found.values() if at.alone}
    keep: list[int] = []
    whole = np.zeros(count, bool)
    out = boxes.copy()
    for k in range(count):
        blob = int(blobs[k])
        if blob in own:
            continue
        if blob > 0 and not taken[blob] and only[blob] == 1 and resolver.free[blob - 1]:
            out[k] = fg.boxes[blob - 1]
            whole[k] = True
            keep.append(k)
        elif _rest(fg, boxes[k], placed) >= parameters.min_unexplained:
            keep.append(k)
    return Free(out[keep], blobs[keep], whole[keep], np.ones(len(keep)))


def _rest(fg: Foreground, box: Floats, placed: list[Box]) -> float:
    """Share of a box's foreground outside of all placed objects and their immediate surroundings."""
    height, width = fg.mask.shape
    x, y, w, h = box.tolist()
    x1, y1, x2, y2 = (
        max(0, round(x)),
        max(0, round(y)),
        min(width, round(x + w)),
        min(height, round(y + h)),
    )
    part = fg.mask[y1 : max(y1, y2), x1 : max(x1, x2)] > 0
    total = int(np.count_nonzero(part))
    if not total:
        return 0.0
    part = part.copy()
    for u, v, pw, ph in placed:
        a, b = max(0, round(u - 0.1 * pw) - x1), max(0, round(v - 0.05 * ph) - y1)
        c, d = max(0, round(u + 1.1 * pw) - x1), max(0, round(v + 1.05 * ph) - y1)
        part[b:d, a:c] = False
    return int(np.count_nonzero(part)) / total


def area_of(box: Box, blob: int, frame: Frame) -> float:
    """A new object's number of pixels: its blob's, but not more than its box holds."""
    parts = [] if frame.detections.fused else frame.detections.components
    full = max(1.0, box[2] * box[3])
    if 0 < blob <= len(parts):
        b = parts[blob - 1]
        if b.area <= full:
            return float(b.area)
    return 0.6 * full


@dataclass(frozen=True)
class Known:
    """A lost object that is back.

    Attributes:
        row: its row.
        cost: distance of colours, or from its path where colours are not known.
        unseen_s: for how long it was unseen.
        limit: what the cost must not exceed.
        by_colours: which of the two costs it is.
    """

    row: int
    cost: float
    unseen_s: float
    limit: float
    by_colours: bool


def returned(
    body: Body,
    row: int,
    bodies: Bodies,
    radii: Floats,
    frame: Frame,
    parameters: ShellsParameters,
) -> Known | None:
    """The lost object that a new one is: near enough for the time that it was away, and of like
    colours.

    One that was hidden by another may come back anywhere within that one's shell (SHELLS 2.3,
    case III).

    Returns:
        the best of them, None if it is a stranger.
    """
    lost = [
        index
        for index, item in enumerate(bodies.items)
        if item.id != TENTATIVE and item.lost
    ]
    if not lost:
        return None
    seen = colours_in(bodies.box(row), frame.evenly_lit, frame.mask)
    by_id = {item.id: k for k, item in enumerate(bodies.items) if item.id != TENTATIVE}
    here = bodies.bank.value[row]
    best: Known | None = None
    for k in lost:
        other = bodies.items[k]
        away = (body.born_ns - other.seen_ns) * 1e-9
        ratio = abs(
            float(
                np.log(
                    here[2] * here[3] / (bodies.bank.value[k, 2] * bodies.bank.value[k, 3])
                )
            )
        )
        if ratio > 1.0 or away <= 0:
            continue
        by_colours = seen is not None and other.colours is not None
        if seen is None or other.colours is None:
            cost = (
                _off_path(bodies, k, row, (frame.time_ns - other.seen_ns) * 1e-9)
                + 0.5 * ratio
            )
            limit = parameters.recover_path
        else:
            there = bodies.bank.value[by_id.get(other.front, k)]
            reach = float(
                radii[by_id.get(other.front, k)]
            ) + away * parameters.speed * float(bodies.sizes[k])
            dx, dy = float(here[0] - there[0]), float(here[1] - there[1])
            if dx * dx + dy * dy > reach * reach:
                continue
            cost, limit = distance(seen, other.colours), parameters.recover
        if cost <= limit and (best is None or cost < best.cost):
            best = Known(k, cost, away, limit, by_colours)
    return best


def _off_path(bodies: Bodies, lost: int, new: int, gap: float) -> float:
    """Half the squared miss of a lost object's path, in standard deviations: straight on,
    stopped, or in between.
    """
    bank, size = bodies.bank, float(bodies.sizes[lost])
    # Unseen it was moved straight on, so that where it was last seen lies back in time.
    back = bank.rate[lost, :2] * gap * np.array([[0.0], [0.5], [1.0]])
    miss = bank.value[lost, :2] - back - bank.value[new, :2]
    sigma = size * (_DRIFT + _DRIFT_RATE * gap)
    return 0.5 * float((miss * miss).sum(axis=1).min()) / (sigma * sigma)


def confirm(
    bodies: Bodies, life: Life, radii: Floats, frame: Frame, parameters: ShellsParameters
) -> list[Notice]:
    """New objects with enough support get an identity, their own or that of one who was lost."""
    notices: list[Notice] = []
    for row, body in enumerate(bodies.items):
        if not life.is_ripe(body, frame.time_ns):
            continue
        known = returned(body, row, bodies, radii, frame, parameters)
        if known is not None:
            notices.append(_take_back(body, row, bodies, known, parameters))
        elif life.may_confirm(bodies.box(row)):
            notices.append(life.confirm(body, frame.time_ns))
            if body.area <= 0:
                body.area = area_of(bodies.box(row), body.blob, frame)
    return notices


def _take_back(
    body: Body, row: int, bodies: Bodies, known: Known, parameters: ShellsParameters
) -> Notice:
    """One that was lost takes the new one's place; the new one is dropped."""
    old = bodies.items[known.row]
    bodies.exchange(known.row, row)
    old.lost, old.mode, old.hits = False, "motion", old.hits + body.hits
    # The place that it was lost at is of no more use.
    body.observed, body.seen_ns = (
        False,
        body.seen_ns - round(60 * parameters.keep_s * NANOS),
    )
    what = "colour_distance" if known.by_colours else "path_cost"
    evidence = {
        what: known.cost,
        f"{what}_at_most": known.limit,
        "unseen_s": known.unseen_s,
    }
    told = "of its own colours" if known.by_colours else "on its own path"
    rule = f"SHELLS 2.3, ours: reappears within reach, {told}"
    return Notice("track_recovered", [old.id], rule, evidence)
