"""The reasoning as one step per frame: targets in; tracks, relations, groups, events and graph
out. Pure.

It composes the books of this room: shells and relations (SHELLS 2.2, 2.3), interactions and
groups (EVENTS 3.1), scene status (EVENTS 3.2), the graph, and writes down where the two papers'
views of a pair disagree.

What the reasoning adds to the papers for targets that are not plainly seen, and for what a
tracker tells itself:

- ``mode`` predicted and ``present``: the person behind the pillar still is there, in his zone and
  in the relations that he had; what is only predicted begins none, and is JOINT only with
  somebody who is seen and hides him, in whose blob the tracker says that he is.
- not ``present``: keeps what relations and partners it has while geometry allows, starts nothing
  new, and keeps its scene status unless its place lies wholly outside.
- what the tracker tells of a target in its notices is not told a second time.
- gone from the targets: its relations end with an event that says so. One that was JOINT or
  grouped stays for one frame more as an absent, unobserved track at its last place, in which
  JOINT becomes INTERACTION and grouped becomes splitting, so that neither paper's order of states
  is broken by a disappearance.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET

from reasoning import events as tell
from reasoning.classes import ClassBook
from reasoning.geometry import WHOLLY, boxes_touch, circles_overlap_share
from reasoning.graph import GraphBook, GraphScene
from reasoning.groups import GroupBook, GroupChange, HeldGroup
from reasoning.interactions import (
    Bond,
    Cluster,
    InteractionBook,
    InteractionParameters,
    PairChange,
    TargetRows,
)
from reasoning.pauses import Pauses
from reasoning.regions import RegionParameters, SceneBook, SceneRegions, default_regions
from reasoning.relations import Objects, RelationBook, RelationChange, RelationParameters
from reasoning.shells import ShellParameters, Shells, shells
from reasoning.target_columns import TargetColumns, ghost, merge_overlapping
from reasoning.transitions import GROUPED, GROUPING, SPLITTING, TransitionCounter
from recorders.messages import (
    Detections,
    Event,
    Graph,
    Group,
    Groups,
    Notice,
    Regions,
    Relation,
    Relations,
    SceneChange,
    Target,
    Targets,
    Track,
    Tracks,
)
from recorders.parameters import Config, Sections

SECTIONS: Sections = {
    "shell_model": ShellParameters,
    "relations": RelationParameters,
    "interactions": InteractionParameters,
    "regions": RegionParameters,
}
"""The parameter sections that a `Reasoner` reads from a configuration; missing ones have their
defaults.
"""


Wrong = tuple[int, int, int]
"""A target, its state before and after: a transition that the table forbids."""


class SceneAnnotation(msgspec.Struct, frozen=True):
    """Everything the reasoning says of one frame; ``graph`` is None where it equals the last one."""

    tracks: Tracks
    relations: Relations
    groups: Groups
    events: list[Event]
    graph: Graph | None


class Reasoner:
    """Reasons over a scene frame by frame; the same frames give the same answers, also after
    `restore`.
    """

    def __init__(self, config: Config | None, width: int, height: int) -> None:
        chosen = {name: (config or {}).get(name, cls()) for name, cls in SECTIONS.items()}
        self._shell = _as(ShellParameters, chosen["shell_model"])
        self._relation = _as(RelationParameters, chosen["relations"])
        self._interaction = _as(InteractionParameters, chosen["interactions"])
        self._region = _as(RegionParameters, chosen["regions"])
        self._book = RelationBook(self._relation)
        self._interactions = InteractionBook(self._interaction)
        self._groups = GroupBook()
        self._scene = SceneBook()
        self._graph = GraphBook()
        self._classes = ClassBook()
        self._log = tell.EventLog()
        self._pauses = Pauses()
        self.counter = TransitionCounter()
        self._regions = SceneRegions(
            default_regions(width, height, self._region), self._region
        )
        self._default = self._regions
        self._last: dict[int, Target] = {}
        self._leaving: list[int] = []
        self._known: set[int] = set()
        self._disputes: dict[tuple[int, int], str] = {}
        self._company: dict[int, list[int]] = {}
        self._margins = {
            "enter_margin": self._relation.enter_margin,
            "leave_margin": self._relation.leave_margin,
            "enter_duration_s": self._relation.enter_duration_s,
            "leave_duration_s": self._relation.leave_duration_s,
            "blob_duration_s": self._relation.blob_duration_s,
        }

    @property
    def regions(self) -> Regions:
        """The regions in use: the last given, else the default of the picture's size."""
        return self._regions.message

    @property
    def known(self) -> Collection[int]:
        """The ids of all targets so far."""
        return self._known

    def step(
        self,
        frame_index: int,
        time_ns: int,
        targets: Targets,
        regions: Regions | None,
        detections: Detections | None = None,
        labels: Mapping[int, str] | None = None,
        scene_changes: Sequence[SceneChange] = (),
    ) -> SceneAnnotation:
        """Take the next frame.

        Args:
            frame_index: from 0.
            time_ns: log time.
            targets: the tracker's answer.
            regions: the recorded regions in force, None for the default.
            detections: the recorded detections, whose labels tell what the targets are.
            labels: by target, what a person says that it is; over what the detections say.
            scene_changes: how the picture changed as a whole, as it was recorded.
        """
        self._use(regions)
        if detections is not None:
            self._classes.step(targets.targets, detections)
        self._log.open(frame_index, time_ns)
        self._pauses.step(self._log, time_ns)
        for seen in scene_changes:
            tell.scene_changed(self._log, seen.kind, seen.evidence, seen.text)
        for notice in _once(targets.notices):
            tell.notice(self._log, notice)
        given = {target.id: target for target in targets.targets}
        assert len(given) == len(targets.targets), (
            f"frame {frame_index}: a tracker gave one id to two targets"
        )
        removed = [i for i in self._last if i not in given and i not in self._leaving]
        self._leaving = self._lingering(removed)
        for i in self._leaving:
            given[i] = ghost(self._last[i])
        rows = TargetColumns([given[i] for i in sorted(given)], self._last)
        self._infer_splits(rows)
        told = {
            (notice.kind, subject)
            for notice in targets.notices
            for subject in notice.subjects
        }
        self._tell_life(rows, removed, told)
        for c in self._scene.step(
            time_ns,
            self._regions,
            rows.ids,
            rows.boxes,
            rows.of_split,
            rows.present,
            self._leaving,
        ):
            if (c.kind, c.id) in told:
                continue
            box = (given if c.id in given else self._last)[c.id].box
            tell.scene(
                self._log,
                c,
                self._regions.message.source,
                box,
                self._regions.margins(box),
                self._regions.depth_in_zone(c.zone, box) if c.zone else math.nan,
            )
        changes, shell = self._relate(frame_index, time_ns, rows)
        pairs, wrong = self._interact(frame_index, time_ns, rows, targets)
        self._tell_disputes(rows)
        self._tell_anomalies(changes, pairs, wrong)
        self._last = given
        self._known.update(rows.ids)
        tracks = self._tracks(rows, shell, labels or {})
        return SceneAnnotation(
            tracks=Tracks(frame_index, tracks),
            relations=Relations(frame_index, self._relations()),
            groups=Groups(frame_index, [_group(group) for group in self._groups.groups]),
            events=self._log.events,
            graph=self._graph.step(
                frame_index,
                time_ns,
                GraphScene(tracks, self._groups.groups, self._book.edges, self._bonds()),
            ),
        )

    def _use(self, regions: Regions | None) -> None:
        if regions is None:
            self._regions = self._default
        elif regions is not self._regions.message and regions != self._regions.message:
            self._regions = SceneRegions(regions, self._region)

    def _infer_splits(self, rows: TargetColumns) -> None:
        """Who is first seen inside the region of interest and over an older target's box is born
        of a split.
        """
        new = [
            index
            for index, identity in enumerate(rows.ids)
            if rows.newborn[index]
            and identity not in self._known
            and not rows.of_split[index]
        ]
        old = [
            index
            for index in range(len(rows.ids))
            if rows.present[index] and not rows.newborn[index]
        ]
        if not (new and old and self._interaction.infer_splits):
            return
        fresh, older = ([rows.boxes[k] for k in which] for which in (new, old))
        touch = boxes_touch(np.array(fresh, np.float64), np.array(older, np.float64))
        over: list[bool] = np.asarray(touch.any(axis=1)).tolist()
        places = self._regions.places(fresh).roi
        for k, touches, place in zip(new, over, places, strict=True):
            rows.of_split[k] = touches and place == WHOLLY and rows.present[k]
            rows.inferred += [rows.ids[k]] if rows.of_split[k] else []

    def _lingering(self, removed: Sequence[int]) -> list[int]:
        """Which of the ids that disappear now were JOINT or grouped, and so stay for one frame
        more.
        """
        states = self._interactions.states
        return sorted(
            i
            for i in removed
            if states[i] & GROUPED or any(name == "JOINT" for _, name in self._book.of(i))
        )

    def _tell_life(
        self, rows: TargetColumns, removed: Sequence[int], told: set[tuple[str, int]]
    ) -> None:
        """Events of the tracks' own life that the tracker has not told itself."""
        for target in rows.targets:
            if target.id in self._leaving:
                continue
            before = self._last.get(target.id)
            if before is None:
                kind = "track_recovered" if target.id in self._known else "track_confirmed"
                if (kind, target.id) not in told:
                    text = (
                        f"Target {target.id} is tracked again."
                        if target.id in self._known
                        else f"Target {target.id} is confirmed."
                    )
                    tell.life(
                        self._log,
                        kind,
                        target,
                        {"born_of_split": target.born_of_split},
                        text,
                    )
                continue
            if target.present != before.present:
                kind, words = (
                    ("track_recovered", "is found again")
                    if target.present
                    else ("track_lost", "is lost")
                )
                if (kind, target.id) not in told:
                    tell.life(
                        self._log,
                        kind,
                        target,
                        {"blob": target.blob},
                        f"Target {target.id} {words}.",
                    )
            if target.mode != before.mode and ("mode_changed", target.id) not in told:
                text = f"Target {target.id} is tracked by {tell.BY[target.mode]}."
                tell.life(
                    self._log, "mode_changed", target, {"mode_before": before.mode}, text
                )
        for i in sorted(removed):
            if ("track_removed", i) not in told:
                tell.life(
                    self._log,
                    "track_removed",
                    self._last[i],
                    {},
                    f"Target {i} is not tracked any more.",
                )

    def _relate(
        self, frame: int, ns: int, rows: TargetColumns
    ) -> tuple[list[RelationChange], Shells]:
        shell = shells(rows.targets, self._shell)
        objects = Objects(
            ids=rows.ids,
            centres=shell.centres,
            radii=shell.radii,
            blobs=rows.blobs,
            seen=rows.seen,
            starts=rows.present,
            leaving=self._leaving,
            boxes=rows.boxes,
        )
        changes = self._book.step(frame, ns, objects)
        for change in changes:
            tell.relation(
                self._log,
                change,
                circles_overlap_share(change.distance, change.radius_a, change.radius_b),
                self._margins,
            )
        return changes, shell

    def _interact(
        self, frame: int, ns: int, rows: TargetColumns, targets: Targets
    ) -> tuple[list[PairChange], list[Wrong]]:
        book = self._interactions
        states_before = dict(book.states)
        members = TargetRows(
            rows.ids,
            boxes=rows.boxes,
            blobs=rows.blobs,
            seen=rows.seen,
            present=rows.present,
            newborn=rows.newborn,
            of_split=rows.of_split,
            leaving=self._leaving,
        )
        changes, clusters = book.step(frame, ns, members, targets.group_tracks)
        groups = self._group(frame, ns, rows, clusters)
        for change in changes:
            if change.after:
                tell.pair(
                    self._log,
                    change,
                    self._group_of_pair(change, groups),
                    self._interaction,
                    rows.inferred,
                )
        born = {i for change in changes if change.of_split for i in (change.a, change.b)}
        wrong: list[Wrong] = []
        for i, after in book.states.items():
            if i not in states_before:
                self.counter.begin(after)
                continue
            before = states_before[i]
            if not self.counter.move(before, after, i in born):
                wrong.append((i, before, after))
            if before and not after:
                tell.single(
                    self._log,
                    i,
                    before,
                    [
                        change
                        for change in changes
                        if not change.after and i in (change.a, change.b)
                    ],
                    self._interaction,
                )
        for group in groups:
            tell.group(self._log, group)
        return changes, wrong

    def _group(
        self, frame: int, ns: int, rows: TargetColumns, clusters: Sequence[Cluster]
    ) -> list[GroupChange]:
        splitting = [
            pair for pair, bond in self._interactions.bonds.items() if bond.bit == SPLITTING
        ]
        entered: list[list[int]] = []
        if any(rows.of_split):
            born = [
                identity
                for identity, split in zip(rows.ids, rows.of_split, strict=True)
                if split
            ]
            entered = [[i, *self._interactions.partners(i, SPLITTING)] for i in born]
            entered = [name for name in entered if not self._may_be_known(name, rows)]
        self._keep_company(clusters, rows)
        return self._groups.step(
            frame, ns, clusters, merge_overlapping(entered), splitting, rows.row
        )

    def _keep_company(self, clusters: Sequence[Cluster], rows: TargetColumns) -> None:
        """Remember who was in one region with whom, as long as he is there."""
        for c in clusters:
            for i in c.members:
                known = self._company.setdefault(i, [])
                known += [
                    member for member in c.members if member != i and member not in known
                ]
        self._company = {
            i: cluster for i, cluster in self._company.items() if i in rows.row
        }

    def _may_be_known(self, born: Sequence[int], rows: TargetColumns) -> bool:
        """Whether one who is born of a split may be somebody who came by himself: one with whom
        they shared a region has vanished since.
        """
        there = {target.id for target in rows.targets if target.present}
        return any(j not in there for i in born for j in self._company.get(i, ()))

    def _group_of_pair(
        self, pair_change: PairChange, changes: Sequence[GroupChange]
    ) -> int | None:
        """The group that both are in; where they split and it ended for others, the one that had
        them both.
        """
        label = self._groups.of(pair_change.a)
        if label is not None and label == self._groups.of(pair_change.b):
            return label
        ended = (
            [group for change in changes for group in change.before]
            if pair_change.after == SPLITTING
            else []
        )
        return next(
            (
                group.label
                for group in ended
                if pair_change.a in group.members and pair_change.b in group.members
            ),
            None,
        )

    def _bonds(self) -> list[tuple[int, int, Bond]]:
        return [
            (a, b, self._interactions.bonds[a, b])
            for a, b in sorted(self._interactions.bonds)
        ]

    def _tell_disputes(self, rows: TargetColumns) -> None:
        """One event per episode in which a pair's two views contradict one another in one way."""
        disputes: dict[tuple[int, int], str] = {}
        for a, b, bond in [*self._bonds(), *self._unbound(rows)]:
            state = self._book.state_of(a, b)
            if state == ("INTERACTION" if bond.bit in (GROUPING, SPLITTING) else "JOINT"):
                continue
            disputes[a, b] = f"{bond.bit} {state}"
            if disputes[a, b] != self._disputes.get((a, b)):
                edge = self._book.get(a, b)
                measured: dict[str, Any] = {
                    **tell.safety(bond.distance, self._interaction.leave_margin),
                    "blobs": [rows.blobs[rows.row[a]], rows.blobs[rows.row[b]]],
                    "interaction_since_frame": bond.since_frame,
                }
                if edge is not None:
                    measured |= {
                        "shell_gap_px": edge.gap,
                        "relation_since_frame": edge.since_frame,
                    }
                tell.disagreement(self._log, a, b, bond.bit, state, measured)
        self._disputes = disputes

    def _unbound(self, rows: TargetColumns) -> list[tuple[int, int, Bond]]:
        """Members of one observed group that are no partners, as their safety areas do not meet:
        others connect them.
        """
        found: list[tuple[int, int, Bond]] = []
        for group in self._groups.groups:
            for a, b in combinations(group.members, 2) if group.observed else ():
                if not self._interactions.bit_of(a, b) and a in rows.row and b in rows.row:
                    distance = self._interactions.safety_distance(
                        rows.boxes[rows.row[a]], rows.boxes[rows.row[b]]
                    )
                    found.append(
                        (a, b, Bond(0, group.since_frame, group.since_ns, distance))
                    )
        return found

    def _tell_anomalies(
        self,
        changes: Sequence[RelationChange],
        pairs: Sequence[PairChange],
        wrong: Sequence[Wrong],
    ) -> None:
        for change in changes:
            if (
                change.anomaly
                and change.a not in self._leaving
                and change.b not in self._leaving
            ):
                tell.torn(self._log, change)
        for pair in pairs:
            if pair.jumped:
                tell.jumped(self._log, pair, self._interaction)
        for i, before, after in wrong:
            tell.forbidden(self._log, i, before, after)

    def _tracks(
        self, rows: TargetColumns, shell: Shells, labels: Mapping[int, str]
    ) -> list[Track]:
        states, partners = self._interactions.states, self._interactions.partners
        presences = self._scene.targets
        answer: list[Track] = []
        for target, radius in zip(rows.targets, shell.radii, strict=True):
            i = target.id
            state, presence = states[i], presences[i]
            bits: tuple[bool, bool, bool] = (False, False, False)
            lists: tuple[list[int], list[int], list[int]] = ([], [], [])
            group = None
            if state:
                bits = (
                    bool(state & GROUPING),
                    bool(state & GROUPED),
                    bool(state & SPLITTING),
                )
                lists = partners(i, GROUPING), partners(i, GROUPED), partners(i, SPLITTING)
                group = self._groups.of(i) if state & (GROUPED | SPLITTING) else None
            zones = sorted(presence.zones) if presence.zones else []
            # By position, in the order of the definition: twenty keywords a track cost as much as
            # all the rest of it.
            answer.append(
                Track(
                    i,
                    target.box,
                    target.ellipse,
                    target.velocity,
                    radius,
                    target.mode,
                    target.confidence,
                    target.present,
                    target.observed,
                    target.blob,
                    *bits,
                    *lists,
                    group,
                    presence.status,
                    zones,
                    target.hidden_parts,
                    target.gate,
                    target.centroid,
                    labels.get(i) or self._classes.of(i) or UNSET,
                    target.identity,
                )
            )
        return answer

    def _relations(self) -> list[Relation]:
        answer: list[Relation] = []
        for edge in self._book.edges:
            bond = self._interactions.bonds.get((edge.a, edge.b))
            bit = 0 if bond is None else bond.bit
            answer.append(
                Relation(
                    a=edge.a,
                    b=edge.b,
                    state="JOINT" if edge.state == "JOINT" else "INTERACTION",
                    since_frame=edge.since_frame,
                    since_ns=edge.since_ns,
                    grouping=bit == GROUPING,
                    grouped=bit == GROUPED,
                    splitting=bit == SPLITTING,
                    shell_overlap=circles_overlap_share(
                        edge.distance, edge.radius_a, edge.radius_b
                    ),
                    rule=edge.rule,
                    met_frame=edge.met_frame,
                    met_ns=edge.met_ns,
                    partners_since_frame=None if bond is None else bond.since_frame,
                    partners_since_ns=None if bond is None else bond.since_ns,
                )
            )
        return answer

    def state(self) -> dict[str, Any]:
        """The whole state after the last frame as plain data (dict, list, str, int, float, bool,
        None).
        """
        default = self._regions is self._default
        return {
            "relations": self._book.state(),
            "interactions": self._interactions.state(),
            "groups": self._groups.state(),
            "scene": self._scene.state(),
            "graph": self._graph.state(),
            "classes": self._classes.state(),
            "counter": self.counter.state(),
            "next_event": self._log.next_id,
            "pauses": self._pauses.state(),
            "regions": None if default else msgspec.to_builtins(self._regions.message),
            "last": [msgspec.to_builtins(target) for target in self._last.values()],
            "leaving": list(self._leaving),
            "known": sorted(self._known),
            "disputes": [[a, b, kind] for (a, b), kind in self._disputes.items()],
            "company": [[i, list(cluster)] for i, cluster in self._company.items()],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave, on a fresh instance of the same configuration and
        picture size.
        """
        self._book.restore(state["relations"])
        self._interactions.restore(state["interactions"])
        self._groups.restore(state["groups"])
        self._scene.restore(state["scene"])
        self._graph.restore(state["graph"])
        self._classes.restore(state["classes"])
        self.counter.restore(state["counter"])
        self._log.next_id = state["next_event"]
        self._pauses.restore(state["pauses"])
        self._use(
            None if state["regions"] is None else msgspec.convert(state["regions"], Regions)
        )
        self._last = {
            target.id: target for target in msgspec.convert(state["last"], list[Target])
        }
        self._leaving = list(state["leaving"])
        self._known = set(state["known"])
        self._disputes = {(a, b): kind for a, b, kind in state["disputes"]}
        self._company = {i: list(cluster) for i, cluster in state["company"]}


def _once(notices: Sequence[Notice]) -> list[Notice]:
    """What a tracker tells of the same targets twice in a frame is told once, as it came first."""
    first: dict[tuple[str, tuple[int, ...]], Notice] = {}
    for notice in notices:
        first.setdefault((notice.kind, tuple(notice.subjects)), notice)
    return list(first.values())


def _group(held_group: HeldGroup) -> Group:
    former = [list(member) for member in held_group.former_members]
    return Group(
        held_group.label,
        members=list(held_group.members),
        observed=held_group.observed,
        since_frame=held_group.since_frame,
        since_ns=held_group.since_ns,
        formed_from=list(held_group.formed_from),
        former_members=former,
        entered_as_one=held_group.entered_as_one,
    )


def _as(kind: type[Any], value: object) -> Any:
    if not isinstance(value, kind):
        raise TypeError(f"{kind.__name__} expected, not {type(value).__name__}")
    return value
