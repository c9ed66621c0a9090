"""Which fragments are one life: a global assignment of ends to later beginnings, by motion and
appearance.

A join's cost is a sum of recorded terms: how far the straight paths out of the gap's two sides
miss one another (in standard deviations that grow with the gap), how much the sizes differ, how
much the colours differ (Hellinger distance), and the gap's length. Joining must cost less than
leaving both ends loose (`join_cost`). While nobody could be seen (`blind`), a gap costs nothing,
and where the view changed meanwhile nothing is known of the way. Ties follow
`scipy.optimize.linear_sum_assignment` on costs quantised to 2**-20, fragments in the order of their
ids.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from reasoning.geometry import share_inside
from replay.hindsight.blind import Blind, blind_within, seen_until
from replay.hindsight.fragments import ENDS_S, End, Fragment, end_of
from replay.hindsight.parameters import HindsightParameters
from replay.trackers.appearance import BRIGHTNESS, SIGNATURE

_QUANTUM = 2.0**-20
_NEVER = 2.0**20
HANDED_OVER_S = 1.0
"""A fragment may begin so long before the one that it follows ends: a detector's second box on
somebody may start a track of its own, which goes on where the first ends.
"""
AT_ONE_PLACE = 0.6
"""Then so much of the smaller of the two boxes lies within the other, on the mean."""
UNKNOWN = 0.4
"""Colours that are not known differ as strangers' do: nothing is won by that."""
UNPLACED = 0.3
"""Nor is a place, while nobody could be seen."""


@dataclass(frozen=True, slots=True)
class Join:
    """Fragment ``later`` goes on where ``earlier`` ended; costs by term; ``unwatched_s`` of the gap
    nobody could be seen.
    """

    earlier: int
    later: int
    gap_s: float
    cost: float
    motion: float
    size: float
    appearance: float | None
    unwatched_s: float = 0.0


def hellinger(a: Sequence[float], b: Sequence[float]) -> float:
    """Distance of two histograms of any total, in [0, 1]: sqrt(1 - sum sqrt(a b)); of
    brightness and chroma by the brightness alone, where the camera showed one of them no colours.
    """
    if len(a) == SIGNATURE and any(a[BRIGHTNESS:]) != any(b[BRIGHTNESS:]):
        a, b = a[:BRIGHTNESS], b[:BRIGHTNESS]
    total = math.sqrt(math.fsum(a) * math.fsum(b))
    if total <= 0:
        return 1.0
    shared = math.fsum(math.sqrt(u * v) for u, v in zip(a, b, strict=True)) / total
    return math.sqrt(max(0.0, 1.0 - shared))


def price(
    a: Fragment,
    b: Fragment,
    ends: tuple[End, End],
    p: HindsightParameters,
    blind: Sequence[Blind] = (),
) -> Join | None:
    """What it costs to let b follow a; None outside the gates, and where a life that is told
    would begin before it.
    """
    out, into = ends
    gap = (into.time_ns - out.time_ns) * 1e-9
    unwatched, moved = blind_within(blind, out.time_ns, into.time_ns)
    watched = max(gap, 0.0) - unwatched
    if (
        watched > p.join_s
        or (b.told and not a.told)
        or (gap <= 0 and not handed_over(a, b))
    ):
        return None
    # Who was there until nothing could be seen was not seen to leave.
    if a.left and not (unwatched and watched <= ENDS_S):
        return None
    if moved and gap <= p.fill_s:
        return None  # a path would be drawn from one view into the other
    size = (out.size + into.size) / 2
    sigma = size * (p.drift + p.drift_rate * max(gap, 0.0))
    # Each side alone, straight or standing still, and both sides meeting in the middle: people
    # stop and turn behind an occluder, so the best of these explanations counts.
    misses = [
        math.hypot(
            out.x + u * gap * out.vx - (into.x - v * gap * into.vx),
            out.y + u * gap * out.vy - (into.y - v * gap * into.vy),
        )
        for u, v in (
            ((0.5, 0.5), (1.0, 0.0), (0.0, 1.0), (0.0, 0.0)) if gap > 0 else ((0.0, 1.0),)
        )
    ]
    # People come nearer and go farther off: sizes are compared as far as they were watched.
    blindly = unwatched / gap if unwatched else 0.0
    motion = UNPLACED * blindly + (0.0 if moved else 0.5 * (min(misses) / sigma) ** 2)
    ratio = abs(math.log(out.h / into.h)) + abs(math.log(out.w / into.w))
    colours = hellinger(a.signature, b.signature) if a.signatures and b.signatures else None
    cost = (
        motion
        + 0.5 * ratio * (1.0 - blindly)
        + p.gap_weight * watched
        + p.appearance_weight * (UNKNOWN if colours is None else colours)
    )
    made = Join(a.id, b.id, max(gap, 0.0), cost, motion, ratio, colours, unwatched)
    return made if cost < p.join_cost else None


def handed_over(a: Fragment, b: Fragment) -> bool:
    """Whether b, which begins before a ends, is on the body that a was on, and goes on with it."""
    overlap = a.last.time_ns - b.first.time_ns
    if overlap > HANDED_OVER_S * a.second * 1e9 or b.last.time_ns <= a.last.time_ns:
        return False
    mine = {s.at: s.box for s in a.tail}
    shares = [
        max(share_inside(s.box, mine[s.at]), share_inside(mine[s.at], s.box))
        for s in b.head
        if s.at in mine
    ]
    return bool(shares) and math.fsum(shares) >= AT_ONE_PLACE * len(shares)


def join(
    fragments: dict[int, Fragment],
    p: HindsightParameters,
    apart: Sequence[tuple[int, int]] = (),
    blind: Sequence[Blind] = (),
) -> list[Join]:
    """The cheapest set of joins over all fragments, each end and each beginning used once, by
    later fragment.

    Where two that are ``apart`` would be of one life, the dearest join between them is forbidden
    and all is joined anew, until they are not.
    """
    items = sorted(
        fragments.values(), key=lambda fragment: (fragment.first.time_ns, fragment.id)
    )
    outs = [end_of(list(item.tail), False) for item in items]
    intos = [end_of(list(item.head), True) for item in items]
    starts = [item.first.time_ns for item in items]
    prices: dict[tuple[int, int], Join] = {}
    for i, a in enumerate(items):
        ended = a.last.time_ns
        since = max(
            i + 1, bisect_right(starts, ended - int(HANDED_OVER_S * a.second * 1e9))
        )
        latest = seen_until(blind, ended, p.join_s)
        for j in range(since, bisect_right(starts, latest)):
            found = price(a, items[j], (outs[i], intos[j]), p, blind)
            if found is not None:
                prices[i, j] = found
    joins = _joined(prices, p.join_cost)
    while (wrong := _between(joins, apart)) is not None:
        prices = {k: v for k, v in prices.items() if v is not wrong}
        joins = _joined(prices, p.join_cost)
    return joins


def _joined(prices: dict[tuple[int, int], Join], loose: float) -> list[Join]:
    joins: list[Join] = []
    for pairs in _components(sorted(prices)):
        joins += _solve({pair: prices[pair] for pair in pairs}, loose)
    return sorted(joins, key=lambda found: found.later)


def _between(joins: Sequence[Join], apart: Sequence[tuple[int, int]]) -> Join | None:
    """The dearest join of a life that holds two who are apart, between them; of equals the
    earliest of them. None where there is no such life.
    """
    before = {j.later: j for j in joins}
    for pair in apart:
        for a, b in (pair, pair[::-1]):
            path: list[Join] = []
            at = b
            while at in before and at != a:
                path.append(before[at])
                at = before[at].earlier
            if at == a and path:
                return max(reversed(path), key=lambda j: j.cost)
    return None


def _components(pairs: list[tuple[int, int]]) -> list[list[tuple[int, int]]]:
    """Split possible joins into sets that share neither an end nor a beginning, so that long
    recordings stay cheap.
    """
    parent: dict[tuple[str, int], tuple[str, int]] = {}

    def root(node: tuple[str, int]) -> tuple[str, int]:
        while parent.setdefault(node, node) != node:
            node = parent[node]
        return node

    for i, j in pairs:
        a, b = root(("end", i)), root(("start", j))
        parent[max(a, b)] = min(a, b)
    sets: dict[tuple[str, int], list[tuple[int, int]]] = {}
    for i, j in pairs:
        sets.setdefault(root(("end", i)), []).append((i, j))
    return list(sets.values())


def _solve(prices: dict[tuple[int, int], Join], loose: float) -> list[Join]:
    from replay.assignment import linear_sum_assignment

    rows, columns = sorted({i for i, _ in prices}), sorted({j for _, j in prices})
    cost = np.full((len(rows), len(columns) + len(rows)), _NEVER)
    for (i, j), found in prices.items():
        cost[rows.index(i), columns.index(j)] = round(found.cost / _QUANTUM) * _QUANTUM
    for k in range(len(rows)):
        cost[k, len(columns) + k] = loose
    r, c = linear_sum_assignment(cost)
    return [
        prices[rows[i], columns[j]]
        for i, j in zip(r.tolist(), c.tolist(), strict=True)
        if j < len(columns)
    ]
