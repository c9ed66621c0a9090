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
from typing import Any

import msgspec

from reasoning import events as tell
from reasoning.answers import Books, group_of, relations_of, tracks_of
from reasoning.classes import ClassBook
from reasoning.company import Company, group_of_pair
from reasoning.disputes import Disputes
from reasoning.geometry import circles_overlap_share
from reasoning.graph import GraphBook, GraphScene
from reasoning.groups import GroupBook
from reasoning.inferred_splits import infer_splits
from reasoning.interactions import (
    InteractionBook,
    InteractionParameters,
    PairChange,
    TargetRows,
)
from reasoning.lives import Before, tell_life
from reasoning.pauses import Pauses
from reasoning.regions import RegionParameters, SceneBook, SceneRegions, default_regions
from reasoning.relations import Objects, RelationBook, RelationChange, RelationParameters
from reasoning.shells import ShellParameters, Shells, shells
from reasoning.target_columns import TargetColumns, ghost
from reasoning.transitions import GROUPED, TransitionCounter
from recorders.messages import (
    Detections,
    Event,
    Graph,
    Groups,
    Notice,
    Regions,
    Relations,
    SceneChange,
    Target,
    Targets,
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
        self._books = Books(
            self._book, self._interactions, self._groups, self._scene, self._classes
        )
        self._disputes = Disputes(self._books, self._interaction.leave_margin)
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
        self._company = Company(self._interactions, self._groups)
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
        if self._interaction.infer_splits:
            infer_splits(rows, self._known, self._regions)
        told = {
            (notice.kind, subject)
            for notice in targets.notices
            for subject in notice.subjects
        }
        before = Before(self._last, self._known, removed, self._leaving)
        tell_life(self._log, rows, before, told)
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
        self._disputes.step(self._log, rows)
        self._tell_anomalies(changes, pairs, wrong)
        self._last = given
        self._known.update(rows.ids)
        tracks = tracks_of(self._books, rows, shell.radii, labels or {})
        return SceneAnnotation(
            tracks=Tracks(frame_index, tracks),
            relations=Relations(frame_index, relations_of(self._books)),
            groups=Groups(frame_index, [group_of(group) for group in self._groups.groups]),
            events=self._log.events,
            graph=self._graph.step(
                frame_index,
                time_ns,
                GraphScene(
                    tracks, self._groups.groups, self._book.edges, self._books.bonds()
                ),
            ),
        )

    def _use(self, regions: Regions | None) -> None:
        if regions is None:
            self._regions = self._default
        elif regions is not self._regions.message and regions != self._regions.message:
            self._regions = SceneRegions(regions, self._region)

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
        groups = self._company.step(frame, ns, rows, clusters)
        for change in changes:
            if change.after:
                tell.pair(
                    self._log,
                    change,
                    group_of_pair(self._groups, change, groups),
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

    def _tell_anomalies(
        self,
        changes: Sequence[RelationChange],
        pairs: Sequence[PairChange],
        wrong: Sequence[Wrong],
    ) -> None:
        for change in changes:
            if change.anomaly and {change.a, change.b}.isdisjoint(self._leaving):
                tell.torn(self._log, change)
        for pair in pairs:
            if pair.jumped:
                tell.jumped(self._log, pair, self._interaction)
        for i, before, after in wrong:
            tell.forbidden(self._log, i, before, after)

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
            "disputes": self._disputes.state(),
            "company": self._company.state(),
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
        self._disputes.restore(state["disputes"])
        self._company.restore(state["company"])


def _once(notices: Sequence[Notice]) -> list[Notice]:
    """What a tracker tells of the same targets twice in a frame is told once, as it came first."""
    first: dict[tuple[str, tuple[int, ...]], Notice] = {}
    for notice in notices:
        first.setdefault((notice.kind, tuple(notice.subjects)), notice)
    return list(first.values())


def _as(kind: type[Any], value: object) -> Any:
    if not isinstance(value, kind):
        raise TypeError(f"{kind.__name__} expected, not {type(value).__name__}")
    return value
