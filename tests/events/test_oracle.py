"""The events of every generated scene against a second account of the rules of SHELLS 2.3 and
EVENTS 3: sets and loops.

The oracle keeps two dictionaries (pair to relation, pair to bit) and a list of groups, and asks
every pair anew in every frame. It shares no code with the reasoning but the messages.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import combinations
from math import hypot, sqrt

import pytest

from fixtures.scenes import SCRIPTS, GeneratedScene
from reasoning.reasoner import Reasoner
from recorders import messages
from recorders.messages import Box, Regions, Target

TOLD = (
    "interaction_started",
    "joined",
    "separated",
    "interaction_ended",
    "grouping",
    "grouped",
    "splitting",
    "single",
)
GROUPS = ("group_formed", "group_changed", "group_ended", "group_entered_scene")
SCENE = (
    "entering",
    "entered",
    "exiting",
    "returned",
    "exited",
    "zone_entered",
    "zone_left",
)
Pair = tuple[int, int]
Group = frozenset[int]
Told = tuple[str, Sequence[int]]
Targets = dict[int, Target]
Ints = dict[int, int]
Flags = dict[int, bool]
Play = tuple[GeneratedScene, list[messages.Targets]]


def centre(t: Target) -> tuple[float, float]:
    return t.box[0] + t.box[2] / 2, t.box[1] + t.box[3] / 2


def shells_meet(a: Target, b: Target) -> bool:
    """SHELLS 2.2: the smallest disc around the box, and 0.2 s of way."""
    (ax, ay), (bx, by) = centre(a), centre(b)
    reach = sum(hypot(t.box[2], t.box[3]) / 2 + 0.2 * hypot(*t.velocity) for t in (a, b))
    return hypot(ax - bx, ay - by) <= reach


def safety(a: Target, b: Target) -> float:
    """EVENTS 3.1: ellipses in the boxes, grown by a quarter of the square root of the area."""
    (ax, ay), (bx, by) = centre(a), centre(b)
    grown = [
        (
            t.box[2] / 2 + sqrt(t.box[2] * t.box[3]) / 4,
            t.box[3] / 2 + sqrt(t.box[2] * t.box[3]) / 4,
        )
        for t in (a, b)
    ]
    return hypot(
        (ax - bx) / (grown[0][0] + grown[1][0]), (ay - by) / (grown[0][1] + grown[1][1])
    )


class Oracle:
    def __init__(self, regions: Regions) -> None:
        self.relation: dict[Pair, str] = {}
        self.bit: dict[Pair, str] = {}
        self.groups: list[Group] = []
        self.thinned: list[Group] = []
        self.last: dict[int, Target] = {}
        self.ghosts: set[int] = set()
        self.scene: dict[int, str] = {}
        self.been_in: set[int] = set()
        self.zones: dict[int, set[str]] = {}
        self.roi, self.border = [self.rect(p[0]) for p in (regions.roi, regions.border)]
        self.named = {z.name: z.polygon for z in regions.zones}

    @staticmethod
    def rect(polygon: list[tuple[float, float]]) -> Box:
        xs, ys = [x for x, _ in polygon], [y for _, y in polygon]
        return min(xs), min(ys), max(xs), max(ys)

    def step(self, k: int, targets: list[Target]) -> list[tuple[int, str, tuple[int, ...]]]:
        out: list[Told] = []
        given = {t.id: t for t in targets}
        gone = [i for i in self.last if i not in given and i not in self.ghosts]
        self.ghosts = {
            i
            for i in gone
            if any(i in p and r == "JOINT" for p, r in self.relation.items())
            or any(i in p and b == "grouped" for p, b in self.bit.items())
        }
        here = dict(given)
        here.update({i: self.last[i] for i in self.ghosts})
        new = {i for i in here if i not in self.last and i not in self.ghosts}
        blob = {i: -1 if i in self.ghosts else t.blob for i, t in here.items()}
        seen = {i: t.observed and i not in self.ghosts for i, t in here.items()}
        out += self.scenes(given, gone)
        out += self.relations(here, blob, seen)
        out += self.interactions(here, blob, seen, new)
        self.last = here
        return [(k, kind, tuple(who)) for kind, who in out]

    def scenes(self, given: Targets, gone: list[int]) -> list[Told]:
        out: list[Told] = []
        for i in gone:
            out += [("zone_left", [i])] * len(self.zones.pop(i, ()))
            out += [("exited", [i])] if self.scene.pop(i) == "exiting" else []
        for i, t in given.items():
            x0, y0 = t.box[:2]
            x1, y1 = x0 + t.box[2], y0 + t.box[3]

            def within(
                r: Box, x0: float = x0, y0: float = y0, x1: float = x1, y1: float = y1
            ) -> bool:
                return x0 >= r[0] and y0 >= r[1] and x1 <= r[2] and y1 <= r[3]

            if i not in self.scene:
                self.scene[i] = "entering"
                self.been_in.discard(i)
                out.append(("entering", [i]))
            elif self.scene[i] == "entering" and within(self.roi):
                self.scene[i] = "inside"
                out.append(("entered", [i]))
            elif self.scene[i] == "exiting" and within(self.roi):
                self.scene[i] = "returned"
                out.append(("returned", [i]))
            elif (
                self.scene[i] != "exiting" and i in self.been_in and not within(self.border)
            ):
                self.scene[i] = "exiting"
                out.append(("exiting", [i]))
            if within(self.border):
                self.been_in.add(i)
            foot = (t.box[0] + t.box[2] / 2, y1)
            before = self.zones.get(i, set())
            edge = 0.1 * math.hypot(t.box[2], t.box[3])
            now = {
                z
                for z, polygon in self.named.items()
                if inside(foot, polygon) or (z in before and off(foot, polygon) <= edge)
            }
            out += [("zone_left", [i])] * len(before - now) + [("zone_entered", [i])] * len(
                now - before
            )
            self.zones[i] = now
        return out

    def relations(self, here: Targets, blob: Ints, seen: Flags) -> list[Told]:
        out: list[Told] = []
        for pair in [p for p in self.relation if not set(p) <= set(here)]:
            del self.relation[pair]
            out.append(("interaction_ended", pair))
        for a, b in combinations(sorted(here), 2):
            before = self.relation.get((a, b))
            meets = shells_meet(here[a], here[b])
            same = blob[a] == blob[b] != -1
            shows = self.shows(here, seen, a, b)
            if not (seen[a] and seen[b]):
                same = before == "JOINT" and shows and not {a, b} & self.ghosts
            if before is None and meets and seen[a] and seen[b]:
                self.relation[a, b] = "INTERACTION"
                out.append(("interaction_started", (a, b)))
            elif before == "INTERACTION" and meets and same:
                self.relation[a, b] = "JOINT"
                out.append(("joined", (a, b)))
            elif before == "JOINT" and not (meets and same):
                self.relation[a, b] = "INTERACTION"
                out.append(("separated", (a, b)))
            elif before == "INTERACTION" and not meets:
                del self.relation[a, b]
                out.append(("interaction_ended", (a, b)))
        return out

    def shows(self, here: Targets, seen: Flags, a: int, b: int) -> bool:
        """Both are seen, or the one lies with its middle in the box of the other, who is."""
        if seen[a] == seen[b]:
            return seen[a]
        front, behind = (a, b) if seen[a] else (b, a)
        return self.hides(here[front].box, here[behind].box)

    @staticmethod
    def hides(front: Box, behind: Box) -> bool:
        middle = [behind[k] + behind[k + 2] / 2 for k in (0, 1)]
        return all(front[k] <= middle[k] <= front[k] + front[k + 2] for k in (0, 1))

    def interactions(
        self, here: Targets, blob: Ints, seen: Flags, new: set[int]
    ) -> list[Told]:
        out: list[Told] = []
        busy = {i for p in self.bit for i in p}
        before = {p: b for p, b in self.bit.items() if set(p) <= set(here)}
        collide = {
            p for p in combinations(sorted(here), 2) if safety(here[p[0]], here[p[1]]) <= 1
        }
        region = self.observed_regions(here, blob, seen, new, before, collide)
        clusters = components(
            {p for p in collide if region.get(p[0], -1) == region.get(p[1], -2)}
        )
        self.bit = {}
        for p in sorted(collide | set(before)):
            was, over = before.get(p), any(set(p) <= c for c in clusters)
            if p not in collide:
                now = "splitting" if was == "grouped" else None
            elif was in ("grouped", "splitting") and not over:
                now = "splitting"
            elif was is None and (set(p) & new or not all(seen[i] for i in p)):
                now = None
            else:
                now = "grouped" if over else "grouping"
            if now is not None:
                self.bit[p] = now
            out += [(now, p)] if now not in (was, None) else []
        out += [
            ("single", [i])
            for i in sorted(busy & set(here))
            if not any(i in p for p in self.bit)
        ]
        return out + self.follow_groups(clusters)

    def observed_regions(
        self,
        here: Targets,
        blob: Ints,
        seen: Flags,
        new: set[int],
        before: dict[Pair, str],
        collide: set[Pair],
    ) -> Ints:
        region = {
            i: blob[i]
            for i in here
            if blob[i] >= 0 and seen[i] and i not in new and i not in self.ghosts
        }
        for i in here:
            if seen[i] or i in new or i in self.ghosts:
                continue
            mates = [
                a + b - i
                for (a, b), bit in before.items()
                if bit == "grouped" and i in (a, b)
            ]
            near = [
                (safety(here[i], here[j]), j)
                for j in mates
                if blob[j] >= 0
                and seen[j]
                and self.hides(here[j].box, here[i].box)
                and (min(i, j), max(i, j)) in collide
            ]
            if near:
                region[i] = blob[min(near)[1]]
        return region

    def follow_groups(self, clusters: list[Group]) -> list[Told]:
        out: list[Told] = []
        kept = [g for g in self.groups if g in clusters and g not in self.thinned]
        begun = [c for c in clusters if c not in kept]
        replaced = [g for g in self.groups if g not in kept and any(g & c for c in begun)]
        for c in begun:
            old = [g for g in replaced if g & c]
            out.append(("group_changed" if old else "group_formed", sorted(c.union(*old))))
        waiting = [g for g in self.groups if g not in kept and g not in replaced]
        for g in list(waiting):
            if not any(set(p) <= g and b == "splitting" for p, b in self.bit.items()):
                waiting.remove(g)
                out.append(("group_ended", sorted(g)))
        waiting, left = self.without_those_who_left(waiting)
        self.groups = kept + begun + waiting
        self.thinned = [g for g in self.thinned if g in waiting]
        return out + left

    def without_those_who_left(
        self, waiting: list[Group]
    ) -> tuple[list[Group], list[Told]]:
        """Who splits from no other member is none any more; the label stays."""
        still, left = list[Group](), list[Told]()
        for g in waiting:
            inner = {
                i
                for p, b in self.bit.items()
                if b == "splitting" and set(p) <= g
                for i in p
            }
            still.append(frozenset(inner))
            if inner != set(g):
                self.thinned.append(still[-1])
                left.append(("group_changed", sorted(g)))
        return still, left


def inside(point: tuple[float, float], polygon: list[tuple[float, float]]) -> bool:
    """Even and odd crossings; the scenes' feet never lie exactly on a side."""
    x, y = point
    sides = zip(polygon, [*polygon[1:], polygon[0]], strict=True)
    crossed = sum(
        (ay > y) != (by > y) and ax + (y - ay) * (bx - ax) / (by - ay) < x
        for (ax, ay), (bx, by) in sides
    )
    return crossed % 2 == 1


def off(point: tuple[float, float], polygon: list[tuple[float, float]]) -> float:
    """How far a point is from the sides."""
    x, y = point
    found = []
    for (ax, ay), (bx, by) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        dx, dy = bx - ax, by - ay
        along = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)
        along = min(1.0, max(0.0, along))
        found.append(math.hypot(x - ax - along * dx, y - ay - along * dy))
    return min(found)


def components(pairs: set[Pair]) -> list[Group]:
    whole: list[set[int]] = []
    for p in pairs:
        mine = set(p).union(*[w for w in whole if w & set(p)])
        whole = [w for w in whole if not w & set(p)] + [mine]
    return sorted((frozenset(w) for w in whole), key=min)


@pytest.mark.parametrize(
    ("name", "seed"), [*((n, 0) for n in SCRIPTS), ("three_way_group", 1), ("six_fish", 2)]
)
def test_the_reasoning_tells_what_the_rules_say(
    play: Callable[..., Play], name: str, seed: int
) -> None:
    scene, answers = play(name, seed)
    oracle, reasoner = Oracle(scene.truth.regions), Reasoner({}, scene.width, scene.height)
    expected, found = [], []
    for targets in answers:
        k = targets.frame
        answer = reasoner.step(k, scene.time_ns(k), targets, scene.truth.regions)
        expected += oracle.step(k, targets.targets)
        found += [
            (k, e.kind, tuple(e.subjects))
            for e in answer.events
            if e.kind in (*TOLD, *GROUPS, *SCENE)
        ]
    assert reasoner.counter.forbidden == 0
    missing, spurious = (
        Counter(expected) - Counter(found),
        Counter(found) - Counter(expected),
    )
    assert (sorted(missing), sorted(spurious)) == ([], [])
