"""The interaction graph over time: both papers' views of a scene in one networkx MultiGraph.

Nodes are targets (``target:3``) and groups (``group:1``) with their states. Edges are intervals:
a relation (``view`` SHELLS: INTERACTION, JOINT), what two partners do (``view`` EVENTS: grouping,
grouped, splitting), and membership in a group (``view`` EVENTS: member). An edge's key names what
it is and the frame it began in, so that one interval is one edge. A `Graph` message holds the
intervals open in its frame and those that ended with it, and is written only when something
discrete changed; `over_time` puts a recording's messages together again.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

from reasoning.groups import HeldGroup
from reasoning.interactions import Bond
from reasoning.relations import Edge
from reasoning.transitions import GROUPED, GROUPING, SPLITTING
from recorders.messages import Graph, Track

if TYPE_CHECKING:
    import networkx as nx

_BITS = {GROUPING: "grouping", GROUPED: "grouped", SPLITTING: "splitting"}

Interval = tuple[str, str, str, str, int, int, str]
"""source, target, view, state, since_frame, since_ns, rule: an edge before it ends."""


def target_node(i: int) -> str:
    """Name of a target's node."""
    return f"target:{i}"


def group_node(label: int) -> str:
    """Name of a group's node."""
    return f"group:{label}"


def node_order(name: str) -> tuple[str, int]:
    """Sorts nodes: groups first, then targets, each by number."""
    kind, _, number = name.partition(":")
    return kind, int(number)


def _edge_order(e: dict[str, Any]) -> tuple[Any, ...]:
    return (
        node_order(e["source"]),
        node_order(e["target"]),
        e["view"],
        e["since_frame"],
        e["key"],
    )


@dataclasses.dataclass(frozen=True)
class GraphScene:
    """What the graph is made of in a frame: tracks by id, groups by label, relations and bonds by
    (a, b).
    """

    tracks: Sequence[Track]
    groups: Sequence[HeldGroup]
    relations: Sequence[Edge]
    bonds: Sequence[tuple[int, int, Bond]]


class GraphBook:
    """Follows the open intervals and writes a message whenever something discrete changes."""

    def __init__(self) -> None:
        self._open: dict[str, Interval] = {}
        self._nodes: list[dict[str, Any]] = []
        # What nodes and intervals were made of; unknown, so that they are made anew, after
        # `restore`.
        self._facts: list[tuple[Any, ...]] | None = None
        self._started = False

    def step(self, frame: int, time_ns: int, scene: GraphScene) -> Graph | None:
        """The frame's graph, or None when it equals the last one."""
        facts = _facts(scene)
        if facts == self._facts:
            return None
        self._facts = facts
        nodes = [_group_node(group) for group in scene.groups] + [
            _target_node(track) for track in scene.tracks
        ]
        intervals = {_interval_id(interval): interval for interval in _intervals(scene)}
        if self._started and nodes == self._nodes and intervals.keys() == self._open.keys():
            return None
        ended = [v for key, v in self._open.items() if key not in intervals]
        known = {node["id"] for node in nodes}
        gone = sorted({node for v in ended for node in v[:2]} - known, key=node_order)
        edges = [_edge(interval) for interval in intervals.values()]
        edges += [{**_edge(v), "end_frame": frame, "end_ns": time_ns} for v in ended]
        all_nodes = nodes + [
            {"id": node, "kind": node.partition(":")[0], "gone": True} for node in gone
        ]
        self._open, self._nodes, self._started = intervals, nodes, True
        return Graph(
            frame=frame,
            directed=False,
            multigraph=True,
            graph={"frame": frame, "time_ns": time_ns},
            nodes=sorted(all_nodes, key=lambda n: node_order(n["id"])),
            edges=sorted(edges, key=_edge_order),
        )

    def state(self) -> dict[str, Any]:
        """The open intervals and the last nodes as plain data."""
        return {
            "open": [list(v) for v in self._open.values()],
            "nodes": [dict(node) for node in self._nodes],
            "started": self._started,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from what `state` gave."""
        intervals = [cast(Interval, tuple(v)) for v in state["open"]]
        self._open = {_interval_id(interval): interval for interval in intervals}
        self._nodes = [dict(node) for node in state["nodes"]]
        self._started = state["started"]
        self._facts = None


def _facts(scene: GraphScene) -> list[tuple[Any, ...]]:
    """Everything that nodes and intervals tell, as numbers and words: equal facts make an equal
    graph.
    """
    facts: list[tuple[Any, ...]] = [
        (
            track.id,
            track.grouping,
            track.grouped,
            track.splitting,
            track.group,
            track.scene,
            track.mode,
            track.present,
        )
        for track in scene.tracks
    ]
    for group in scene.groups:
        history = group.formed_from, group.former_members, group.entered_as_one
        facts.append(
            (
                group.label,
                group.members,
                group.observed,
                group.since_frame,
                group.since_ns,
                *history,
            )
        )
    facts += [
        ("SHELLS", relation.a, relation.b, relation.state, relation.since_frame)
        for relation in scene.relations
    ]
    facts += [("EVENTS", a, b, bond.bit, bond.since_frame) for a, b, bond in scene.bonds]
    return facts


def _target_node(track: Track) -> dict[str, Any]:
    return {
        "id": target_node(track.id),
        "kind": "target",
        "grouping": track.grouping,
        "grouped": track.grouped,
        "splitting": track.splitting,
        "group": track.group,
        "scene": track.scene,
        "mode": track.mode,
        "present": track.present,
    }


def _group_node(held_group: HeldGroup) -> dict[str, Any]:
    return {
        "id": group_node(held_group.label),
        "kind": "group",
        "members": list(held_group.members),
        "observed": held_group.observed,
        "since_frame": held_group.since_frame,
        "since_ns": held_group.since_ns,
        "formed_from": list(held_group.formed_from),
        "former_members": [list(member) for member in held_group.former_members],
        "entered_as_one": held_group.entered_as_one,
    }


def _intervals(scene: GraphScene) -> Iterable[Interval]:
    for relation in scene.relations:
        yield (
            target_node(relation.a),
            target_node(relation.b),
            "SHELLS",
            relation.state,
            relation.since_frame,
            relation.since_ns,
            relation.rule,
        )
    for a, b, bond in scene.bonds:
        state = _BITS[bond.bit]
        rule = f"EVENTS 3.1 {state}"
        yield (
            target_node(a),
            target_node(b),
            "EVENTS",
            state,
            bond.since_frame,
            bond.since_ns,
            rule,
        )
    for group in scene.groups:
        for member in group.members:
            yield (
                group_node(group.label),
                target_node(member),
                "EVENTS",
                "member",
                group.since_frame,
                group.since_ns,
                "EVENTS 3.1 group",
            )


def _interval_id(interval: Interval) -> str:
    return f"{interval[0]} {interval[1]} {interval[3]}@{interval[4]}"


def _edge(interval: Interval) -> dict[str, Any]:
    source, target, view, state, since_frame, since_ns, rule = interval
    return {
        "source": source,
        "target": target,
        "key": f"{state}@{since_frame}",
        "view": view,
        "state": state,
        "since_frame": since_frame,
        "since_ns": since_ns,
        "rule": rule,
    }


def to_networkx(message: Graph) -> nx.MultiGraph:
    """A message as a networkx MultiGraph, nodes and edges in their sorted order.

    An edge with ``end_frame`` ended with the message; the others hold from it on. Attributes are
    numbers and words, so that every writer of networkx takes them: lists are JSON texts, and what
    is None is left out.
    """
    graph = _empty(message.graph)
    for node in message.nodes:
        graph.add_node(node["id"], **_plain(node, ("id",)))
    for edge in message.edges:
        _add(graph, edge)
    return graph


def over_time(
    messages: Iterable[Graph], last_frame: int | None = None, **facts: str
) -> nx.MultiGraph:
    """All of a recording's graphs as one: every interval one edge, with ``end_frame`` and
    ``end_ns`` where it ended.

    Nodes carry the last state that was seen of them, ``first_frame`` and ``last_frame``.
    Attributes are as in `to_networkx`.

    Args:
        messages: in their order.
        last_frame: the recording's, where what was never seen to go was last.
        facts: of the recording, for the whole graph.
    """
    nodes: dict[str, dict[str, Any]] = {}
    edges: dict[tuple[str, str, str], dict[str, Any]] = {}
    there: set[str] = set()
    for message in messages:
        now: set[str] = set()
        for node in message.nodes:
            held = nodes.get(node["id"], {"first_frame": message.frame})
            if node.get("gone"):
                nodes[node["id"]] = {**held, **node}
                continue
            now.add(node["id"])
            nodes[node["id"]] = {"first_frame": held["first_frame"], **node}
        for name in there - now:
            nodes[name]["last_frame"] = message.frame - 1
        there = now
        for edge in message.edges:
            edges[edge["source"], edge["target"], edge["key"]] = edge
    for name in there:
        nodes[name]["last_frame"] = last_frame
    graph = _empty(facts)
    for name in sorted(nodes, key=node_order):
        graph.add_node(name, **_plain(nodes[name], ("id",)))
    for edge in sorted(edges.values(), key=_edge_order):
        _add(graph, edge)
    return graph


def _empty(facts: Mapping[str, Any]) -> nx.MultiGraph:
    import networkx as nx

    return nx.MultiGraph(**_plain(facts))


def _add(graph: nx.MultiGraph, e: dict[str, Any]) -> None:
    graph.add_edge(
        e["source"], e["target"], e["key"], **_plain(e, ("source", "target", "key"))
    )


def _plain(facts: Mapping[str, Any], without: Sequence[str] = ()) -> dict[str, Any]:
    """Attributes that GraphML can hold, too."""
    return {
        name: json.dumps(value, separators=(",", ":")) if isinstance(value, list) else value
        for name, value in facts.items()
        if value is not None and name not in without
    }
