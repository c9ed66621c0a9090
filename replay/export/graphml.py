"""The log's interaction graph over time: GraphML for Gephi, yEd, Cytoscape or networkx, and
node-link JSON.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from reasoning.graph import over_time
from recorders.annotated.reader import AnnotatedLog
from recorders.limits import DEFAULT_LIMITS, Limits
from replay.export.output import whole_file

if TYPE_CHECKING:
    import networkx as nx


def interaction_graph(log: AnnotatedLog) -> nx.MultiGraph:
    """The log's graph over time: one edge per interval, see `reasoning.graph.over_time`.

    The graph's own attributes say which recording it is of.

    Raises:
        RecordingError: the log is damaged.
    """
    last = max((frame.index for frame in log.frames(("tracks",))), default=None)
    return over_time(
        log.graphs(),
        last,
        recording=log.path.stem,
        camera=log.camera,
        tracker=log.tracker,
        output_digest=log.facts.get("output_digest", ""),
    )


def node_link(graph: nx.MultiGraph) -> dict[str, Any]:
    """A graph as node-link data, which `networkx.node_link_graph(data, edges="edges")` reads."""
    import networkx as nx

    data: dict[str, Any] = nx.node_link_data(graph, edges="edges")
    return data


def write_graphml(
    log: str | Path,
    out: str | Path,
    *,
    camera: str | None = None,
    force: bool = False,
    limits: Limits = DEFAULT_LIMITS,
) -> tuple[int, int]:
    """Write the interaction graph over time; returns how many nodes and edges it has.

    An edge's id in the file is source, target and key, since GraphML wants ids that no other edge
    has; the key stands beside it.

    Raises:
        OutputExistsError: ``out`` exists and ``force`` is not set.
        RecordingError: ``log`` is no annotated log, or damaged.
    """
    import networkx as nx

    with whole_file(out, force=force) as file:
        with AnnotatedLog(log, camera, limits) as opened:
            graph = interaction_graph(opened)
        for source, target, key, facts in graph.edges(keys=True, data=True):
            facts |= {"key": key, "id": f"{source} {target} {key}"}
        # Not write_graphml: it takes lxml where that is installed, and other bytes.
        for line in nx.generate_graphml(graph, edge_id_from_attribute="id"):
            file.write(f"{line}\n".encode())
        return graph.number_of_nodes(), graph.number_of_edges()
