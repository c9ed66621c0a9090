"""GraphML: the interaction graph over time, for Gephi, yEd, Cytoscape or networkx."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import networkx as nx

from replay.export.output import whole
from replay.export.tables import Spool

INTERVAL = ("start_frame", "end_frame", "start_t", "end_t")


def interaction_graph(spool: Spool) -> Any:
    """A networkx MultiGraph with one edge per interval.

    Nodes: tracks (``7``) and groups (``group 2``), with ``kind`` and when they were there. Edges:
    ``relation`` (with its ``state``), ``member`` of a group, ``encounter`` (with its ``activity``
    and ``confidence``). Both ends of an interval are included; t in seconds from the recording's
    start. Everything is inserted in a fixed order.
    """
    graph = nx.MultiGraph()
    for row in _rows(spool, "recordings"):
        graph.graph.update(
            {
                k: v
                for k, v in row.items()
                if k in ("recording", "camera", "tracker", "output_digest")
            }
        )
    lives: dict[int, dict[str, Any]] = {}
    for row in _rows(spool, "presence"):
        life = lives.setdefault(row["track"], {k: row[k] for k in INTERVAL})
        for k, choose in zip(INTERVAL, (min, max, min, max), strict=True):
            life[k] = choose(life[k], row[k])
    related = _edges(spool)
    # Whoever is related without ever having been present is a node as well.
    for track in sorted(
        {*lives, *(end for edge in related for end in edge[:2] if isinstance(end, int))}
    ):
        graph.add_node(str(track), kind="track", track=track, **lives.get(track, {}))
    for row in sorted(
        _rows(spool, "groups"), key=lambda g: (g["group_id"], g["start_frame"])
    ):
        graph.add_node(
            f"group {row['group_id']}",
            kind="group",
            group=row["group_id"],
            **{k: row[k] for k in INTERVAL},
        )
    for a, b, facts in related:
        graph.add_edge(str(a), str(b), **facts)
    return graph


def _rows(spool: Spool, table: str) -> list[dict[str, Any]]:
    return [msgspec.json.decode(line) for line in spool.lines(table)]


def _edges(spool: Spool) -> list[tuple[int, int | str, dict[str, Any]]]:
    edges: list[tuple[int, int | str, dict[str, Any]]] = []
    for row in _rows(spool, "relations"):
        edges.append(
            (
                row["a"],
                row["b"],
                {
                    "kind": "relation",
                    "state": row["state"],
                    **{k: row[k] for k in INTERVAL},
                },
            )
        )
    for row in _rows(spool, "groups"):
        for member in sorted(row["members"]):
            edges.append(
                (
                    member,
                    f"group {row['group_id']}",
                    {"kind": "member", **{k: row[k] for k in INTERVAL}},
                )
            )
    for row in _rows(spool, "encounters"):
        facts = {
            "kind": "encounter",
            "activity": row["kind"],
            "confidence": row["confidence"],
        }
        edges.append((row["a"], row["b"], {**facts, **{k: row[k] for k in INTERVAL}}))
    return sorted(
        edges,
        key=lambda e: (
            e[2]["start_frame"],
            e[0],
            str(e[1]),
            e[2]["kind"],
            e[2].get("state", ""),
        ),
    )


def write_graphml(
    log: str | Path, out: str | Path, *, camera: str | None = None, force: bool = False
) -> tuple[int, int]:
    """Write the interaction graph over time; returns how many nodes and edges it has.

    Raises:
        OutputExistsError: ``out`` exists and ``force`` is not set.
        RecordingError: ``log`` is no annotated log, or damaged.
    """
    with whole(out, force=force) as file:
        with Spool(log, camera) as spool:
            graph = interaction_graph(spool)
        # Not write_graphml: it takes lxml where that is installed, and other bytes.
        for line in nx.generate_graphml(graph):
            file.write(f"{line}\n".encode())
        return graph.number_of_nodes(), graph.number_of_edges()
