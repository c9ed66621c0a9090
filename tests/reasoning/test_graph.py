"""The graph over time: one edge per interval, both papers' views, messages only on change."""

from __future__ import annotations

import json
from pathlib import Path

import networkx as nx
import pytest

from reasoning.graph import over_time, to_networkx
from reasoning.reasoner import Reasoner, SceneAnnotation
from recorders.messages import Target, Targets

STORY = [
    (100, 200),
    (100, 150),
    (100, 130),
    (110, 125),
    (110, 125),
    (110, 140),
    (110, 300),
    (110, 300),
]


def person(i: int, x: int, blob: int) -> Target:
    return Target(i, (float(x), 100.0, 20.0, 50.0), blob=blob)


@pytest.fixture
def annotated() -> list[SceneAnnotation]:
    reasoner = Reasoner({}, 640, 240)
    answer = []
    for k, (a, b) in enumerate(STORY):
        blobs = (7, 7) if k in (3, 4) else (1, 2)
        answer.append(
            reasoner.step(
                k,
                k * 10,
                Targets(k, [person(1, a, blobs[0]), person(2, b, blobs[1])]),
                None,
            )
        )
    return answer


def test_a_message_is_written_only_on_change(annotated: list[SceneAnnotation]) -> None:
    written = [k for k, a in enumerate(annotated) if a.graph is not None]
    assert written == [0, 1, 2, 3, 5, 6]


def test_both_views_stand_side_by_side(annotated: list[SceneAnnotation]) -> None:
    edges = [
        (e["source"], e["target"], e["view"], e["state"], e["since_frame"])
        for e in annotated[3].graph.edges
    ]
    assert edges == [
        ("group:1", "target:1", "EVENTS", "member", 3),
        ("group:1", "target:2", "EVENTS", "member", 3),
        ("target:1", "target:2", "EVENTS", "grouping", 2),
        ("target:1", "target:2", "EVENTS", "grouped", 3),
        ("target:1", "target:2", "SHELLS", "INTERACTION", 1),
        ("target:1", "target:2", "SHELLS", "JOINT", 3),
    ]
    ends = [e.get("end_frame") for e in annotated[3].graph.edges]
    assert ends == [None, None, 3, None, 3, None]


def test_nodes_carry_their_states(annotated: list[SceneAnnotation]) -> None:
    nodes = {n["id"]: n for n in annotated[3].graph.nodes}
    assert list(nodes) == ["group:1", "target:1", "target:2"]
    assert nodes["target:1"]["grouped"]
    assert nodes["target:1"]["group"] == 1
    assert nodes["target:1"]["scene"] == "inside"
    assert nodes["group:1"]["members"] == [1, 2]
    assert nodes["group:1"]["observed"]


def words(node: dict[str, str | int | list[int] | None]) -> dict[str, str | int]:
    """A node as every writer of networkx takes it."""
    return {
        k: json.dumps(v, separators=(",", ":")) if isinstance(v, list) else v
        for k, v in node.items()
        if v is not None
    }


def test_messages_are_what_networkx_writes(annotated: list[SceneAnnotation]) -> None:
    for a in annotated:
        if a.graph is not None:
            graph = to_networkx(a.graph)
            assert isinstance(graph, nx.MultiGraph)
            data = nx.node_link_data(graph, edges="edges")
            assert data["nodes"] == [words(n) for n in a.graph.nodes]
            by_key = {(e["source"], e["target"], e["key"]): e for e in a.graph.edges}
            again = {
                (*sorted((e["source"], e["target"])), e["key"]): e for e in data["edges"]
            }
            assert {k: {**v, "source": 0, "target": 0} for k, v in again.items()} == {
                (*sorted(k[:2]), k[2]): {**v, "source": 0, "target": 0}
                for k, v in by_key.items()
            }


def test_over_time_one_edge_per_interval(annotated: list[SceneAnnotation]) -> None:
    graph = over_time(a.graph for a in annotated if a.graph is not None)
    edges = {
        k: d
        for u, v, k, d in graph.edges(keys=True, data=True)
        if {u, v} == {"target:1", "target:2"}
    }
    spans = {k: (d["since_frame"], d.get("end_frame")) for k, d in edges.items()}
    assert spans == {
        "grouping@2": (2, 3),
        "grouped@3": (3, 5),
        "splitting@5": (5, 6),
        "INTERACTION@1": (1, 3),
        "JOINT@3": (3, 5),
        "INTERACTION@5": (5, 6),
    }
    assert graph.nodes["target:1"]["first_frame"] == 0
    assert graph.nodes["group:1"]["first_frame"] == 3


def test_over_time_says_how_long_a_node_was_there_and_in_which_state_last() -> None:
    reasoner = Reasoner({}, 640, 240)
    both, one = [person(1, 100, 1), person(2, 110, 2)], [person(1, 100, 1)]
    messages = []
    for frame, people in enumerate((both, both, one, one, both)):
        answer = reasoner.step(frame, frame * 10, Targets(frame, people), None)
        messages += [] if answer.graph is None else [answer.graph]
    left = over_time(messages[:-1], 3)
    assert [left.nodes[n]["last_frame"] for n in ("target:1", "target:2")] == [3, 1]
    assert left.nodes["target:2"]["gone"]
    back = over_time(messages, 4, recording="yard")
    assert back.graph == {"recording": "yard"}
    assert back.nodes["target:2"]["first_frame"] == 0
    assert back.nodes["target:2"]["last_frame"] == 4
    assert "gone" not in back.nodes["target:2"]


def test_every_graph_can_be_written(
    annotated: list[SceneAnnotation], tmp_path: Path
) -> None:
    messages = [a.graph for a in annotated if a.graph is not None]
    for k, graph in enumerate([*map(to_networkx, messages), over_time(messages)]):
        nx.write_graphml(graph, tmp_path / f"{k}.graphml")
        again = nx.read_graphml(tmp_path / f"{k}.graphml", force_multigraph=True)
        assert {k: again.graph[k] for k in graph.graph} == graph.graph
        assert dict(again.nodes(data=True)) == dict(graph.nodes(data=True))
        assert edges_of(again) == edges_of(graph)


def edges_of(
    graph: nx.MultiGraph,
) -> dict[tuple[frozenset[str], str], dict[str, int | str]]:
    return {(frozenset((a, b)), k): d for a, b, k, d in graph.edges(keys=True, data=True)}


def test_a_node_that_is_gone_ends_its_edges() -> None:
    reasoner = Reasoner({}, 640, 240)
    reasoner.step(0, 0, Targets(0, [person(1, 100, 1), person(2, 110, 2)]), None)
    graph = reasoner.step(1, 10, Targets(1, [person(1, 100, 1)]), None).graph
    assert {"id": "target:2", "kind": "target", "gone": True} in graph.nodes
    assert [(e["key"], e["end_frame"]) for e in graph.edges] == [("INTERACTION@0", 1)]
