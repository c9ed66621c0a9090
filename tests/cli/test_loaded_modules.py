"""A command imports what it uses: start-up is most of a short command's time."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from replay.cli import main

HEAVY = frozenset(
    {
        "av", "duckdb", "fsspec", "google", "matplotlib", "networkx", "onnxruntime", "pandas",
        "plotly", "pyarrow", "ray", "rich", "rosbags", "scipy",
    }
)  # fmt: skip
MAY_LOAD = {
    "record": frozenset({"google"}),
    "replay": frozenset({"google", "networkx", "scipy"}),
    "info": frozenset({"rich"}),
    "query": frozenset({"duckdb", "google"}),
}
OTHERS = (
    "recorders.detectors.onnx", "recorders.fusion.fusion", "recorders.recording.recording",
    "recorders.segmentation.motion", "replay.trackers.parts.tracker", "replay.trackers.shells.tracker",
    "scipy.optimize",
)  # fmt: skip
"""Methods of other commands and trackers, and the package around the solver."""
NO_REPLAY = (
    "importlib.metadata", "recorders.recording.sections", "replay.correcting.corrector",
    "replay.trackers.parts", "replay.trackers.shells",
)  # fmt: skip
"""And what a replay by one tracker, that nobody corrects, has no use for; versions of packages are read
from their folders.
"""
REPLAYING = frozenset(
    {"reasoning.reasoner", "replay.hindsight.rewrite", "replay.trackers.events.tracker"}
)
_RUN = """
import json, sys
from replay.cli import main
code = main(sys.argv[1:])
print(json.dumps([int(code), sorted(sys.modules)]))
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("loaded")
    rows = [f"{n},-1,{50 + 4 * n},200,40,100,1,-1,-1,-1" for n in range(1, 21)]
    (folder / "det.txt").write_text("\n".join(rows) + "\n")
    size = ["--fps", "25", "--size", "640x480"]
    scene = str(folder / "scene.mcap")
    assert main(["record", str(folder / "det.txt"), "-o", scene, *size]) == 0
    assert main(["replay", scene, "-o", str(folder / "annotated.mcap")]) == 0
    return folder


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("record", ["det.txt", "-o", "again.mcap", "--fps", "25", "--size", "640x480"]),
        ("replay", ["scene.mcap", "-o", "new.mcap"]),
        ("info", ["annotated.mcap"]),
        ("query", ["annotated.mcap", "SELECT 1"]),
    ],
)
def test_a_command_loads_what_it_uses(log: Path, command: str, words: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _RUN, command, *words],
        cwd=log,
        capture_output=True,
        text=True,
        check=True,
    )
    code, loaded = json.loads(done.stdout.splitlines()[-1])
    assert code == 0
    assert HEAVY & {name.partition(".")[0] for name in loaded} <= MAY_LOAD[command]
    assert command == "record" or not set(OTHERS) & set(loaded)
    assert command != "replay" or not set(NO_REPLAY) & set(loaded)
    assert (command == "replay") == (set(loaded) >= REPLAYING)
    assert command == "replay" or not REPLAYING & set(loaded)
