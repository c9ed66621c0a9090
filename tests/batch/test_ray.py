"""On a Ray cluster: the same files, and a node that is lost is no loss."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from replay.cli import main
from tests.batch.conftest import WORDS
from tests.batch.files import digests

ray: Any = pytest.importorskip("ray", reason="Ray is not installed")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore"),
]


@pytest.fixture
def cluster() -> Iterator[tuple[Any, list[Any]]]:
    """Two nodes of a processor each, beside a head without any."""
    from ray.cluster_utils import Cluster

    made: Any = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
    nodes = [made.add_node(num_cpus=1, memory=8 << 30) for _ in range(2)]
    made.wait_for_nodes()
    yield made, nodes
    ray.shutdown()
    made.shutdown()


def test_two_nodes_one_of_which_is_killed(
    cluster: tuple[Any, list[Any]], sources: Path, tmp_path: Path
) -> None:
    made, nodes = cluster
    pattern = str(sources / "*" / "*.txt")
    assert main(["batch", pattern, "-o", str(tmp_path / "local"), *WORDS]) == 0
    case = tmp_path / "fleet"

    def kill() -> None:
        end = time.monotonic() + 120
        while time.monotonic() < end and not list(case.rglob("*.json")):
            time.sleep(0.05)
        made.remove_node(nodes[0], allow_graceful=False)

    killer = threading.Thread(target=kill)
    killer.start()
    words = ["--engine", "ray", "--address", str(made.address), *WORDS]
    assert main(["batch", pattern, "-o", str(case), *words]) == 0
    killer.join()
    assert digests(case) == digests(tmp_path / "local")
