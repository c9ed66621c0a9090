"""The plugin in a user's own project, by the documentation alone; and trackers that are not deterministic."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate

ROOT = Path(__file__).resolve().parents[2]
DOC = ROOT / "docs" / "golden.md"


def run_pytest(folder: Path, *words: str) -> tuple[int, str]:
    # The entry point registers the plugin where the project is installed; a checkout may be older than it.
    plugin = [] if _registered() else ["-p", "replay.golden.plugin"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:randomly", "-p", "no:cacheprovider", *plugin, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        # What follows the hash seed is caught by chance only; here the chance is the same every time.
        env={**os.environ, "PYTHONHASHSEED": "5"},
    )
    return done.returncode, done.stdout + done.stderr


def _registered() -> bool:
    from importlib.metadata import entry_points

    return any(e.value == "replay.golden.plugin" for e in entry_points(group="pytest11"))


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project of the documentation: its code blocks, as files of the names in their first lines."""
    folder = tmp_path_factory.mktemp("project")
    blocks = re.findall(r"```python\n# (\S+)\n(.*?)```", DOC.read_text(encoding="utf-8"), re.DOTALL)
    assert [name for name, _ in blocks] == ["nearest.py", "conftest.py", "test_nearest.py"]
    for name, code in blocks:
        (folder / name).write_text(code, encoding="utf-8")
    return folder


def test_the_documented_example_in_a_fresh_project(project: Path) -> None:
    golden = project / "test_crossing.mcap"
    code, said = run_pytest(project)
    assert (code, golden.exists()) == (1, True), said
    assert "there was no golden file, so it was written" in said
    before = golden.read_bytes()
    code, said = run_pytest(project, "--scenetrace-update", "test_crosing")
    assert "1 passed" in said
    assert golden.read_bytes() == before
    assert code == 4, "a name that no test has must not pass for done"
    assert "--scenetrace-update test_crosing: no test that ran has a golden file of that name" in said

    test = project / "test_nearest.py"
    test.write_text(test.read_text().replace('"reach": 0.8', '"reach": 0.1'))
    code, said = run_pytest(project)
    assert code == 1
    assert "Nearest no longer says of crossing.mcap what test_crossing.mcap says" in said
    assert "made with another parameter: nearest.reach = 0.1, not 0.8" in said
    assert re.search(r"track 2 .* at \d+\.\d s", said)
    assert "If that is right: pytest --scenetrace-update test_crossing" in said
    assert golden.read_bytes() == before

    code, said = run_pytest(project, "--scenetrace-update", "test_crossing")
    assert (code, golden.read_bytes() != before) == (1, True), said
    assert "the golden file was written anew" in said


PLANTED = {
    "a class variable": (
        """
        next_id = 1
        def begin(self): pass
        def name(self):
            Planted.next_id += 1
            return Planted.next_id
        """,
        ["in one process, each with a fresh instance", "state that instances share", "Planted.next_id was 1, then"],
    ),
    "the clock": (
        """
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            return self.n * 1000 + time.perf_counter_ns() % 1000
        """,
        ["It looks like the clock", "planted_K.py:", "time.perf_counter_ns()", "frame.time_ns"],
    ),
    "chance": (
        """
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            return self.n * 100000 + random.randrange(100000)
        """,
        ["It looks like chance", "planted_K.py:", "a seed from its parameters"],
    ),
    "a set": (
        """
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            words = {f"target {k}" for k in range(20)}
            return self.n * 100 + int(next(iter(words)).split()[1])
        """,
        ["a replay of scene.mcap in another process differs", "hash seed", "a loop over a set", "sorted(...)"],
    ),
    "numpy's global chance": (
        """
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            return self.n * 100000 + int(np.random.randint(100000))
        """,
        ["It looks like chance", "numpy's global random state was used", "a seed from its parameters"],
    ),
    "the order of threads": (
        """
        def begin(self): self.n = 0
        def name(self):
            import random
            done = []
            def work(k):
                time.sleep(0.001 * random.SystemRandom().random())
                done.append(k)
            threads = [threading.Thread(target=work, args=(k,)) for k in range(8)]
            for thread in threads: thread.start()
            for thread in threads: thread.join()
            self.n += 1
            return self.n * 100000000 + int("".join(map(str, done)))
        """,
        ["is not deterministic", "threads"],
    ),
    "an order by id()": (
        """
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            words = [f"{k}" * (k + 1) for k in range(7)]
            Planted.held = getattr(Planted, "held", []) + words
            return self.n * 10000000 + int("".join(word[0] for word in sorted(words, key=id)))
        """,
        ["is not deterministic"],
    ),
    "a state too small": (
        """
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            return self.n * 10
        def step(self, frame):
            self.frames = getattr(self, "frames", 0) + 1
            return Targets(frame.index, [Target(1, (2.0, 2.0, 10.0 + self.frames, 20.0))])
        """,
        ["starts from state() in the middle", "frame 16, targets, targets[id 1].box[2]: 27.0", "restore()"],
    ),
}
TRACKER = """
import random
import threading
import time

import numpy as np

from recorders.messages import Target, Targets


class Planted:
PLANT
    def __init__(self, scene, config):
        self.known = []
        self.begin()

    def step(self, frame):
        while len(self.known) < len(frame.boxes):
            self.known.append(self.name())
        rows = zip(self.known, frame.boxes.tolist())
        return Targets(frame.index, sorted((Target(i, tuple(b)) for i, b in rows), key=lambda t: t.id))

    def state(self):
        return {"known": list(self.known), "n": getattr(self, "n", 0)}

    def restore(self, state):
        self.known = list(state["known"])
        self.n = state["n"]
"""


@pytest.fixture(scope="module")
def planted_run(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What one pytest run over all planted trackers said."""
    folder = tmp_path_factory.mktemp("planted")
    write_scene_log(generate("pass_by", size=(96, 72), frames=30), folder / "scene.mcap", pictures="none")
    for k, (plant, _) in enumerate(PLANTED.values()):
        body = textwrap.indent(textwrap.dedent(plant), "    ")
        # The plant's own step, where it has one, comes last and so is the one that counts.
        (folder / f"planted_{k}.py").write_text(TRACKER.replace("PLANT", body if "def step" not in plant else "")
                                                + (body if "def step" in plant else ""))  # fmt: skip
        (folder / f"test_planted_{k}.py").write_text(
            f"from planted_{k} import Planted\n\n\ndef test_planted_{k}(golden_scene):\n"
            "    golden_scene('scene.mcap', tracker=Planted)\n"
        )
    code, said = run_pytest(folder)
    assert code == 1
    assert f"{len(PLANTED)} failed" in said
    return said


@pytest.mark.parametrize("plant", PLANTED)
def test_planted_nondeterminism_is_caught_with_its_kind(planted_run: str, plant: str) -> None:
    k = list(PLANTED).index(plant)
    said = re.split(r"^_+ test_planted_\d+ _+$", planted_run, flags=re.MULTILINE)[k + 1]
    assert "Planted is not deterministic" in said or "Planted: a replay that starts from state()" in said
    for words in PLANTED[plant][1]:
        assert words.replace("_K", f"_{k}") in said, said
    assert "no golden file" not in said, "what is not deterministic must not become golden"
