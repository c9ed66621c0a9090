"""Random scenes through the reasoning: every invariant of both papers at every frame, over 10,000
frames a run.

`Check` holds an independent account of what must be true: it sees the targets that went in and
the annotation that came out, nothing of the inside but the counter of forbidden transitions.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from reasoning.reasoner import SECTIONS, Reasoner, SceneAnnotation
from reasoning.regions import STATUS_EVENTS
from recorders.messages import (
    Box,
    Event,
    Graph,
    Group,
    GroupTrack,
    Regions,
    Relation,
    Target,
    Targets,
    Track,
    Zone,
)
from recorders.parameters import configure
from tests.examples import examples

WIDTH, HEIGHT, FRAME_NS = 320, 200, 40_000_000
BITS = ("grouping", "grouped", "splitting")
Pair = tuple[int, int]
QUIET = settings(deadline=None, database=None, suppress_health_check=list(HealthCheck))


class Check:
    """What must hold between one frame's annotation and the next one's."""

    def __init__(self, damped: bool = False) -> None:
        self.damped = damped
        self.tracks: dict[int, Track] = {}
        self.relations: dict[Pair, Relation] = {}
        self.bonds: dict[Pair, str] = {}
        self.groups: dict[int, Group] = {}
        self.ended: set[int] = set()
        self.next_event = 1
        self.graph: Graph | None = None
        self.told_relations: dict[Pair, str] = {}
        self.told_bits: dict[Pair, str] = {}
        self.told_groups: dict[int, list[int]] = {}
        self.ghosts: set[int] = set()
        self.since: dict[Pair, int] = {}

    def frame(self, k: int, targets: Targets, answer: SceneAnnotation) -> None:
        tracks = {t.id: t for t in answer.tracks.tracks}
        relations = {(r.a, r.b): r for r in answer.relations.relations}
        given = {t.id for t in targets.targets}
        self.check_tracks(tracks, given, answer)
        self.check_relations(k, tracks, relations, answer)
        self.check_bits(k, tracks, relations)
        self.check_groups(k, tracks, answer)
        self.check_events(k, tracks, relations, answer)
        self.check_graph(k, tracks, relations, answer)
        self.tracks, self.relations = tracks, relations

    def check_tracks(
        self, tracks: dict[int, Track], given: set[int], answer: SceneAnnotation
    ) -> None:
        assert list(tracks) == sorted(tracks)
        assert len(tracks) == len(answer.tracks.tracks)
        ghosts = set(tracks) - given
        assert not ghosts & self.ghosts, "who is gone stays for one frame at most"
        for i in ghosts:
            joint = any(i in p and r.state == "JOINT" for p, r in self.relations.items())
            assert joint or self.tracks[i].grouped
            assert (tracks[i].present, tracks[i].observed, tracks[i].mode) == (
                False,
                False,
                "predicted",
            )
            assert not tracks[i].grouped
        self.ghosts = ghosts

    def check_relations(
        self,
        k: int,
        tracks: dict[int, Track],
        relations: dict[Pair, Relation],
        answer: SceneAnnotation,
    ) -> None:
        assert list(relations) == sorted(relations)
        assert len(relations) == len(answer.relations.relations)
        for pair, r in relations.items():
            assert pair[0] < pair[1]
            before = self.relations.get(pair)
            same = before is not None and before.state == r.state
            assert r.since_frame == (before.since_frame if same else k)
            assert r.since_ns == r.since_frame * FRAME_NS
            assert r.met_frame == (before.met_frame if before is not None else k)
            assert r.met_ns == r.met_frame * FRAME_NS
            assert 0 <= r.shell_overlap <= 1
        ids = list(tracks)
        for n, a in enumerate(ids):
            for b in ids[n + 1 :]:
                was = (
                    self.relations[a, b].state
                    if (a, b) in self.relations
                    else "INDEPENDENT"
                )
                now = relations[a, b].state if (a, b) in relations else "INDEPENDENT"
                assert {was, now} != {"INDEPENDENT", "JOINT"}
                assert self.damped or now == self.expected(was, tracks[a], tracks[b])

    def expected(self, was: str | None, a: Track, b: Track) -> str | None:
        """SHELLS 2.3 told anew, from what the annotation itself says of both."""
        ax, ay = a.box[0] + a.box[2] / 2, a.box[1] + a.box[3] / 2
        bx, by = b.box[0] + b.box[2] / 2, b.box[1] + b.box[3] / 2
        meets = (
            math.sqrt((ax - bx) ** 2 + (ay - by) ** 2) <= a.shell_radius + b.shell_radius
        )
        one = a.blob >= 0 and a.blob == b.blob
        shows = a.observed and b.observed
        if a.observed != b.observed:
            front, behind = (a.box, b.box) if a.observed else (b.box, a.box)
            middle = [behind[k] + behind[k + 2] / 2 for k in (0, 1)]
            shows = all(front[k] <= middle[k] <= front[k] + front[k + 2] for k in (0, 1))
        if not (a.observed and b.observed):
            one = was == "JOINT" and shows and not self.ghosts & {a.id, b.id}
        if was == "INDEPENDENT":
            begins = meets and a.observed and b.observed and a.present and b.present
            return "INTERACTION" if begins else was
        if was == "INTERACTION":
            return ("JOINT" if one else was) if meets else "INDEPENDENT"
        return "JOINT" if meets and one else "INTERACTION"

    def check_bits(
        self, k: int, tracks: dict[int, Track], relations: dict[Pair, Relation]
    ) -> None:
        was, self.bonds = self.bonds, {}
        for t in tracks.values():
            for bit in BITS:
                partners = getattr(t, f"{bit}_partners")
                assert getattr(t, bit) == bool(partners)
                assert partners == sorted(set(partners))
                for p in partners:
                    assert t.id in getattr(tracks[p], f"{bit}_partners"), (
                        "partners are symmetric"
                    )
                    pair = (min(t.id, p), max(t.id, p))
                    assert self.bonds.setdefault(pair, bit) == bit, "one bit for a pair"
            before = self.tracks.get(t.id)
            if before is not None and before.grouped:
                assert t.grouped or t.splitting, "grouped never goes straight to single"
        self.since = {
            p: self.since[p] if was.get(p) == bit else k for p, bit in self.bonds.items()
        }
        for pair, r in relations.items():
            assert r.partners_since_frame == self.since.get(pair)
            assert r.partners_since_ns == (
                None if pair not in self.since else self.since[pair] * FRAME_NS
            )
            assert [r.grouping, r.grouped, r.splitting] == [
                self.bonds.get(pair) == bit for bit in BITS
            ]

    def check_groups(
        self, k: int, tracks: dict[int, Track], answer: SceneAnnotation
    ) -> None:
        groups = {g.label: g for g in answer.groups.groups}
        assert list(groups) == sorted(groups)
        members = [i for g in groups.values() for i in g.members]
        assert len(members) == len(set(members)), "a target is in one group at most"
        for label, g in groups.items():
            assert label not in self.ended, "labels are never used again"
            assert len(g.members) >= 2
            before = self.groups.get(label)
            assert g.since_frame == (before.since_frame if before is not None else k)
            if before is not None:
                assert set(g.members) <= set(before.members), "nobody joins a group"
                assert g.members == before.members or not g.observed, (
                    "who leaves, leaves a group that is not observed"
                )
            else:
                assert all(f in self.groups and f not in groups for f in g.formed_from)
                assert g.former_members == [self.groups[f].members for f in g.formed_from]
                assert not (g.entered_as_one and g.observed)
        self.ended |= set(self.groups) - set(groups)
        label_of = {i: g.label for g in groups.values() for i in g.members}
        for t in tracks.values():
            assert t.group is None or (
                t.group == label_of[t.id] and (t.grouped or t.splitting)
            )
            for p in t.grouped_partners:
                assert t.group == tracks[p].group is not None
                assert t.group is not None
                assert groups[t.group].observed
        self.groups = groups

    def check_events(
        self,
        k: int,
        tracks: dict[int, Track],
        relations: dict[Pair, Relation],
        answer: SceneAnnotation,
    ) -> None:
        singles = set()
        for e in answer.events:
            assert e.id == self.next_event
            self.next_event += 1
            assert (e.frame, e.time_ns) == (k, k * FRAME_NS)
            assert e.rule
            assert e.text
            assert e.kind != "anomaly" or "transition" not in e.rule
            self.follow(e)
            if e.kind == "single":
                singles.add(e.subjects[0])
        assert self.told_relations == {p: r.state for p, r in relations.items()}, (
            "events alone tell the relations"
        )
        assert self.told_groups == {g.label: g.members for g in answer.groups.groups}
        self.told_bits = {p: b for p, b in self.told_bits.items() if p in self.bonds}
        assert self.told_bits == self.bonds
        busy = {i for i, t in self.tracks.items() if t.grouping or t.grouped or t.splitting}
        free = {
            i for i, t in tracks.items() if not (t.grouping or t.grouped or t.splitting)
        }
        assert singles == busy & free
        told = {
            (e.subjects[0], e.kind)
            for e in answer.events
            if e.kind in set(STATUS_EVENTS.values())
        }
        for t in tracks.values():
            was = self.tracks[t.id].scene if t.id in self.tracks else None
            if was is not None and was != t.scene:
                assert (t.id, STATUS_EVENTS[was, t.scene]) in told

    def follow(self, e: Event) -> None:
        pair: Any = tuple(e.subjects)
        if e.kind in ("interaction_started", "separated"):
            self.told_relations[pair] = "INTERACTION"
        elif e.kind == "joined":
            self.told_relations[pair] = "JOINT"
        elif e.kind == "interaction_ended":
            del self.told_relations[pair]
        elif e.kind in BITS:
            self.told_bits[pair] = e.kind
        elif e.kind == "group_ended":
            del self.told_groups[e.groups[0]]
        elif e.kind.startswith("group_"):
            for label in e.groups[:-1]:
                self.told_groups.pop(label, None)
            self.told_groups[e.groups[-1]] = e.evidence["members"]

    def check_graph(
        self,
        k: int,
        tracks: dict[int, Track],
        relations: dict[Pair, Relation],
        answer: SceneAnnotation,
    ) -> None:
        edges = {
            (f"target:{a}", f"target:{b}", r.state, r.since_frame)
            for (a, b), r in relations.items()
        }
        nodes = {f"target:{i}" for i in tracks} | {
            f"group:{label}" for label in self.groups
        }
        if answer.graph is not None:
            assert answer.graph.frame == k
            before = (
                []
                if self.graph is None
                else [name_of(e) for e in self.graph.edges if "end_frame" not in e]
            )
            self.graph = answer.graph
            now = {name_of(e): e.get("end_frame") for e in self.graph.edges}
            assert all(now[e] in (None, k) for e in before), (
                "an interval goes on or is said to end"
            )
            assert all(end is None or e in before for e, end in now.items()), (
                "only what was open ends"
            )
        open_edges = [e for e in self.graph.edges if "end_frame" not in e]
        shells = {
            (e["source"], e["target"], e["state"], e["since_frame"])
            for e in open_edges
            if e["view"] == "SHELLS"
        }
        assert shells == edges
        bits = {
            (e["source"], e["target"]): e["state"] for e in open_edges if e["state"] in BITS
        }
        assert bits == {
            (f"target:{a}", f"target:{b}"): bit for (a, b), bit in self.bonds.items()
        }
        assert {n["id"] for n in self.graph.nodes if not n.get("gone")} == nodes


def name_of(edge: dict[str, Any]) -> tuple[Any, ...]:
    return edge["source"], edge["target"], edge["key"]


class World:
    """People of several sizes who wander, merge into blobs, hide, vanish, jump and are born."""

    def __init__(self, seed: int, people: int, own_groups: bool, crowd: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.own_groups, self.crowd = own_groups, crowd
        self.next_id, self.people = 1, dict[int, list[float]]()
        self.fresh, self.split = set[int](), set[int]()
        self.hidden, self.absent = set[int](), set[int]()
        for _ in range(people):
            self.birth()

    def birth(self, near: int | None = None) -> None:
        w = self.rng.uniform(8, 30)
        x, y = self.rng.uniform([-10, -10], [WIDTH - 20, HEIGHT - 40])
        if near is not None:
            x, y = self.people[near][0] + self.rng.uniform(-15, 15), self.people[near][1]
        vx, vy = self.rng.normal(0, 4, 2)
        self.people[self.next_id] = [x, y, w, w * self.rng.uniform(0.8, 2.6), vx, vy]
        self.fresh.add(self.next_id)
        if near is not None:
            self.split.add(self.next_id)
        self.next_id += 1

    def move(self) -> None:
        for p in self.people.values():
            p[4:] = 0.9 * np.array(p[4:]) + self.rng.normal(0, 1.5, 2)
            p[0], p[1] = p[0] + p[4], p[1] + p[5]
            if not -40 < p[0] < WIDTH + 10:
                p[4] = -p[4]
            if not -60 < p[1] < HEIGHT + 10:
                p[5] = -p[5]

    def chance(self) -> None:
        """Something other than walking happens now and then."""
        roll, ids = self.rng.random(), list(self.people)
        if (roll < 0.03 and len(ids) < self.crowd) or not ids:
            self.birth()
        elif roll < 0.05 and len(ids) < self.crowd:
            self.birth(near=int(self.rng.choice(ids)))
        elif roll < 0.08:
            del self.people[int(self.rng.choice(ids))]
        elif roll < 0.10:
            self.people[int(self.rng.choice(ids))][0] = self.rng.uniform(0, WIDTH)
        elif roll < 0.20:
            self.hidden ^= {int(self.rng.choice(ids))}
        elif roll < 0.25:
            self.absent ^= {int(self.rng.choice(ids))}

    def targets(self, k: int) -> Targets:
        boxes: dict[int, Box] = {
            i: (float(p[0]), float(p[1]), float(p[2]), float(p[3]))
            for i, p in self.people.items()
        }
        unseen = (self.hidden | self.absent) & set(boxes)
        blobs = blob_ids({i: b for i, b in boxes.items() if i not in unseen})
        made = [
            Target(
                i,
                boxes[i],
                (float(p[4]) * 25, float(p[5]) * 25),
                mode="predicted" if i in unseen else "motion",
                present=i not in self.absent,
                observed=i not in unseen,
                blob=blobs.get(i, -1),
                newborn=i in self.fresh,
                born_of_split=i in self.split,
            )
            for i, p in self.people.items()
        ]
        tracks = None
        if self.own_groups:
            shared = sorted(
                {b for b in blobs.values() if list(blobs.values()).count(b) > 1}
            )
            spans = [[boxes[i] for i in blobs if blobs[i] == b] for b in shared]
            tracks = [
                GroupTrack(b, around(s), observed=bool(self.rng.random() < 0.9))
                for b, s in zip(shared, spans, strict=True)
            ]
        self.fresh, self.split = set(), set()
        return Targets(k, made, tracks)


def around(boxes: Sequence[Sequence[float]]) -> Box:
    x, y = min(b[0] for b in boxes), min(b[1] for b in boxes)
    return (x, y, max(b[0] + b[2] for b in boxes) - x, max(b[1] + b[3] for b in boxes) - y)


def blob_ids(boxes: dict[int, Any]) -> dict[int, int]:
    """Overlapping boxes are one blob, numbered by their lowest member."""
    root = {i: i for i in boxes}
    for i, a in boxes.items():
        for j, b in boxes.items():
            if (
                i < j
                and abs(2 * a[0] + a[2] - 2 * b[0] - b[2]) < a[2] + b[2]
                and (abs(2 * a[1] + a[3] - 2 * b[1] - b[3]) < a[3] + b[3])
            ):
                low, high = sorted((root[i], root[j]))
                root = {k: low if v == high else v for k, v in root.items()}
    return root


SQUARE = [(80.0, 40.0), (240.0, 40.0), (240.0, 160.0), (80.0, 160.0)]
ROUND = [(160.0, 10.0), (300.0, 100.0), (160.0, 190.0), (20.0, 100.0)]
DAMPING = [
    "relations.enter_margin=0.1",
    "relations.leave_margin=0.2",
    "relations.enter_duration_s=0.08",
    "relations.leave_duration_s=0.12",
    "relations.blob_duration_s=0.08",
    "interactions.leave_margin=0.15",
]
REGIONS = Regions(WIDTH, HEIGHT, [SQUARE], [ROUND], [Zone("middle", SQUARE[:3])])


@settings(QUIET, max_examples=examples(50))
@given(
    seed=st.integers(0, 2**32 - 1),
    people=st.integers(0, 8),
    own_groups=st.booleans(),
    regions=st.sampled_from([None, REGIONS]),
    damped=st.booleans(),
    cut=st.integers(1, 199),
)
def test_random_scenes_keep_every_invariant(
    seed: int,
    people: int,
    own_groups: bool,
    regions: Regions | None,
    damped: bool,
    cut: int,
) -> None:
    """200 frames an example; a twin restored at a random frame gives the same bytes to the end."""
    world, check = World(seed, people, own_groups, crowd=9), Check(damped)
    config = configure(SECTIONS, assignments=DAMPING if damped else [])
    reasoner, twin = Reasoner(config, WIDTH, HEIGHT), None
    for k in range(200):
        world.move()
        world.chance()
        targets = world.targets(k)
        answer = reasoner.step(k, k * FRAME_NS, targets, regions)
        check.frame(k, targets, answer)
        if twin is not None:
            assert msgspec.json.encode(
                twin.step(k, k * FRAME_NS, targets, regions)
            ) == msgspec.json.encode(answer)
        if k == cut:
            twin = Reasoner(config, WIDTH, HEIGHT)
            twin.restore(json.loads(json.dumps(reasoner.state())))
    assert reasoner.counter.forbidden == 0
    assert twin.state() == reasoner.state()


class Scene(RuleBasedStateMachine):
    """The same world, driven rule by rule, so that a failure shrinks to a short story."""

    @initialize(seed=st.integers(0, 999), own_groups=st.booleans())
    def begin(self, seed: int, own_groups: bool) -> None:
        self.world, self.check, self.k = World(seed, 2, own_groups, crowd=6), Check(), 0
        self.reasoner = Reasoner({}, WIDTH, HEIGHT)

    def step(self) -> None:
        targets = self.world.targets(self.k)
        answer = self.reasoner.step(self.k, self.k * FRAME_NS, targets, None)
        self.check.frame(self.k, targets, answer)
        assert self.reasoner.counter.forbidden == 0
        self.k += 1

    @rule(frames=st.integers(1, 4))
    def walk(self, frames: int) -> None:
        for _ in range(frames):
            self.world.move()
            self.step()

    @precondition(lambda self: len(self.world.people) < 6)
    @rule(split=st.booleans())
    def birth(self, split: bool) -> None:
        near = next(iter(self.world.people), None) if split else None
        self.world.birth(near)
        self.step()

    @precondition(lambda self: self.world.people)
    @rule(data=st.data())
    def death(self, data: st.DataObject) -> None:
        del self.world.people[data.draw(st.sampled_from(sorted(self.world.people)))]
        self.step()

    @precondition(lambda self: len(self.world.people) > 1)
    @rule(data=st.data(), distance=st.sampled_from([0.0, 5.0, 12.0, 25.0, 60.0]))
    def jump_beside(self, data: st.DataObject, distance: float) -> None:
        ids = sorted(self.world.people)
        a, b = data.draw(st.permutations(ids).map(lambda p: p[:2]))
        self.world.people[a][0] = self.world.people[b][0] + distance
        self.world.people[a][1] = self.world.people[b][1]
        self.step()

    @precondition(lambda self: self.world.people)
    @rule(data=st.data(), whole=st.booleans())
    def hide_or_show(self, data: st.DataObject, whole: bool) -> None:
        i = data.draw(st.sampled_from(sorted(self.world.people)))
        if whole:
            self.world.absent ^= {i}
        else:
            self.world.hidden ^= {i}
        self.step()

    @rule()
    def restore(self) -> None:
        twin = Reasoner({}, WIDTH, HEIGHT)
        twin.restore(json.loads(json.dumps(self.reasoner.state())))
        assert twin.state() == self.reasoner.state()
        self.reasoner = twin


Scene.TestCase.settings = settings(QUIET, max_examples=examples(40), stateful_step_count=30)
TestScene = Scene.TestCase
