"""One graph: the log's channel, the library, GraphML and node-link JSON hold the same."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import networkx as nx
import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from recorders.annotated.reader import AnnotatedLog
from replay.annotated_writer import replay
from replay.export import write_graphml, write_json
from replay.export.graphml import interaction_graph
from replay.run import ReplayOptions

Edges = dict[tuple[frozenset[str], str], dict[str, Any]]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("graph")
    scene = generate("three_way_group")
    recorded = write_scene_log(scene, folder / "scene.mcap", pictures="none")
    replay(recorded, folder / "annotated.mcap", ReplayOptions("events"))
    return folder / "annotated.mcap"


def edges_of(graph: nx.MultiGraph) -> Edges:
    return {
        (frozenset((a, b)), d.get("key", key)): {
            k: v for k, v in d.items() if k not in ("key", "id")
        }
        for a, b, key, d in graph.edges(keys=True, data=True)
    }


def plain(value: Any) -> Any:
    return json.dumps(value, separators=(",", ":")) if isinstance(value, list) else value


def test_all_forms_hold_the_same(log: Path, tmp_path: Path) -> None:
    with AnnotatedLog(log) as opened:
        library = interaction_graph(opened)
        messages = list(opened.graphs())
        count = opened.frame_count
    write_graphml(log, tmp_path / "g.graphml")
    write_json(log, tmp_path / "g.json")
    drawn = nx.read_graphml(tmp_path / "g.graphml", force_multigraph=True)
    document = json.loads((tmp_path / "g.json").read_text())
    linked = nx.node_link_graph(document["graph"], edges="edges")
    for other in (drawn, linked):
        assert {k: other.graph[k] for k in library.graph} == library.graph
        assert dict(other.nodes(data=True)) == dict(library.nodes(data=True))
        assert edges_of(other) == edges_of(library)
    assert library.graph["tracker"] == "events"

    # As the log has them: every interval that was ever open, with its latest attributes.
    latest = {
        (frozenset((e["source"], e["target"])), e["key"]): e
        for m in messages
        for e in m.edges
    }
    assert edges_of(library) == {
        name: {
            k: v
            for k, v in e.items()
            if k not in ("source", "target", "key") and v is not None
        }
        for name, e in latest.items()
    }
    views = [d["view"] for d in edges_of(library).values()]
    assert set(views) == {"SHELLS", "EVENTS"}
    assert all(d["rule"] for d in edges_of(library).values())
    for name, facts in library.nodes(data=True):
        seen = [
            n for m in messages for n in m.nodes if n["id"] == name and not n.get("gone")
        ]
        said = {k: plain(v) for k, v in seen[-1].items() if v is not None and k != "id"}
        assert said.items() <= facts.items()
        assert 0 <= facts["first_frame"] <= facts["last_frame"] < count


def test_ids_of_edges_in_graphml_are_their_own(log: Path, tmp_path: Path) -> None:
    nodes, edges = write_graphml(log, tmp_path / "g.graphml")
    graph = nx.read_graphml(tmp_path / "g.graphml", force_multigraph=True)
    ids = [key for _, _, key in graph.edges(keys=True)]
    assert len(set(ids)) == len(ids) == edges
    assert graph.number_of_nodes() == nodes


def test_relations_of_the_tables_are_edges_of_the_graph(log: Path, tmp_path: Path) -> None:
    write_json(log, tmp_path / "g.json")
    document = json.loads((tmp_path / "g.json").read_text())
    rows = {(r["a"], r["b"], r["state"], r["start_frame"]) for r in document["relations"]}
    shells = {
        (*sorted(int(e[s].split(":")[1]) for s in ("source", "target")), e["state"], e["since_frame"])
        for e in document["graph"]["edges"]
        if e["view"] == "SHELLS"
    }  # fmt: skip
    assert rows == shells
    assert rows
