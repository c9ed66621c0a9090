"""The plugin in a user's own project, by the documentation alone; and trackers that are not
deterministic.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import textwrap
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate

ROOT = Path(__file__).resolve().parents[2]
DOC = ROOT / "docs" / "golden.md"


def run_pytest(folder: Path, *words: str, hash_seed: str = "5") -> tuple[int, str]:
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:randomly",
            "-p",
            "no:cacheprovider",
            *words,
        ],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        # What follows the hash seed is caught by chance only; here the chance is the same every
        # time.
        env={**os.environ, "PYTHONHASHSEED": hash_seed},
    )
    return done.returncode, done.stdout + done.stderr


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project of the documentation: its code blocks, as files of the names in their first
    lines.
    """
    folder = tmp_path_factory.mktemp("project")
    blocks = re.findall(
        r"```python\n# (\S+)\n(.*?)```", DOC.read_text(encoding="utf-8"), re.DOTALL
    )
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
    # Other processes have been tried; what follows is about the file.
    test = project / "test_nearest.py"
    call = "tracker=Nearest"
    assert test.read_text().count(call) == 1
    test.write_text(test.read_text().replace(call, f"{call}, other_process=False"))
    code, said = run_pytest(project, "--scenetrace-update", "test_crosing")
    assert "1 passed" in said
    assert golden.read_bytes() == before
    assert code == 4, "a name that no test has must not pass for done"
    assert (
        "--scenetrace-update test_crosing: no test that ran has a golden file of that name"
        in said
    )

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
        [
            "in one process, each with a fresh instance",
            "state that instances share",
            "Planted.next_id was 1, then",
        ],
    ),
    "the clock": (
        """
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            return self.n * 1000 + time.perf_counter_ns() % 1000
        """,
        [
            "It looks like the clock",
            "planted_K.py:",
            "time.perf_counter_ns()",
            "frame.time_ns",
        ],
    ),
    "chance": (
        """
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            return self.n * 100000 + random.randrange(100000)
        """,
        [
            "It looks like chance",
            "planted_K.py:",
            "calls random.getrandbits()",
            "a seed from its parameters",
        ],
    ),
    "chance by the plainest name": (
        """
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            return self.n * 100000 + int(random.random() * 100000)
        """,
        ["It looks like chance", "planted_K.py:", "calls random.random()"],
    ),
    "a calendar": (
        """
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            return self.n * 100 + datetime.date.today().day
        """,
        [
            "asks the clock while it replays scene.mcap",
            "planted_K.py:",
            "calls datetime.date.today()",
            "frame.time_ns",
        ],
    ),
    "a set": (
        """
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            words = {f"target {k}" for k in range(20)}
            return self.n * 100 + int(next(iter(words)).split()[1])
        """,
        [
            "a replay of scene.mcap in another process differs",
            "hash seed",
            "a loop over a set",
            "sorted(...)",
        ],
    ),
    "numpy's global chance": (
        """
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            return self.n * 100000 + int(np.random.randint(100000))
        """,
        [
            "It looks like chance",
            "numpy's global random state was used",
            "a seed from its parameters",
        ],
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
        [
            "starts from state() in the middle",
            "frame 16, targets, targets[id 1].box[2]: 27.0",
            "restore()",
        ],
    ),
}
TRACKER = """
import datetime
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


ALSO = ("chance by the plainest name", "numpy's global chance", "an order by id()")
"""Kinds of which another plant shows as much."""
PlantedRun = Callable[[str], str]


@pytest.fixture(scope="module")
def planted_run(tmp_path_factory: pytest.TempPathFactory) -> PlantedRun:
    """What was said of a planted tracker: one pytest run goes over all, another over `ALSO`."""

    @cache
    def run(also: bool) -> dict[str, str]:
        folder = tmp_path_factory.mktemp("planted")
        write_scene_log(
            generate("pass_by", size=(96, 72), frames=30),
            folder / "scene.mcap",
            pictures="none",
        )
        numbers = [k for k, plant in enumerate(PLANTED) if (plant in ALSO) is also]
        for k in numbers:
            plant = list(PLANTED.values())[k][0]
            body = textwrap.indent(textwrap.dedent(plant), "    ")
            # The plant's own step, where it has one, comes last and so is the one that counts.
            (folder / f"planted_{k}.py").write_text(
                TRACKER.replace("PLANT", body if "def step" not in plant else "")
                + (body if "def step" in plant else "")
            )
            (folder / f"test_planted_{k}.py").write_text(
                f"from planted_{k} import Planted\n\n\n"
                f"def test_planted_{k}(golden_scene):\n"
                "    golden_scene('scene.mcap', tracker=Planted)\n"
            )
        code, said = run_pytest(folder)
        assert code == 1
        assert f"{len(numbers)} failed" in said
        parts = re.split(r"^_+ test_planted_\d+ _+$", said, flags=re.MULTILINE)[1:]
        return {list(PLANTED)[k]: part for k, part in zip(numbers, parts, strict=True)}

    return lambda plant: run(plant in ALSO)[plant]


@pytest.mark.parametrize(
    "plant",
    [pytest.param(p, marks=pytest.mark.long if p in ALSO else []) for p in PLANTED],
)
def test_planted_nondeterminism_is_caught_with_its_kind(
    planted_run: PlantedRun, plant: str
) -> None:
    said, k = planted_run(plant), list(PLANTED).index(plant)
    heads = (
        "Planted is not deterministic",
        "Planted: a replay that starts from state()",
        "Planted asks the clock",
    )
    assert any(head in said for head in heads)
    for words in PLANTED[plant][1]:
        assert words.replace("_K", f"_{k}") in said, said
    assert "no golden file" not in said, "what is not deterministic must not become golden"


def user_project(
    folder: Path, body: str, test: str = "golden_scene('scene.mcap', tracker=Planted)"
) -> Path:
    """A folder with a scene, a tracker of the user's own and a test of it."""
    write_scene_log(
        generate("pass_by", size=(96, 72), frames=12),
        folder / "scene.mcap",
        pictures="none",
    )
    plant = textwrap.indent(textwrap.dedent(body), "    ")
    (folder / "planted.py").write_text(TRACKER.replace("PLANT", plant))
    (folder / "test_planted.py").write_text(
        f"from planted import Planted\n\n\ndef test_planted(golden_scene):\n    {test}\n"
    )
    return folder


@pytest.mark.parametrize(
    "hash_seed", ["0", *(pytest.param(s, marks=pytest.mark.long) for s in ("3", "4"))]
)
def test_the_order_of_a_set_of_two_is_caught_from_wherever_one_starts(
    tmp_path: Path, hash_seed: str
) -> None:
    """Half of all seeds have one order, half the other: one other process is a coin that falls
    the wrong way.
    """
    folder = user_project(
        tmp_path,
        """
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            for side in {"left", "right"}:
                return self.n * 10 + len(side)
        """,
    )
    code, said = run_pytest(folder, hash_seed=hash_seed)
    assert code == 1
    assert "It follows the hash seed (PYTHONHASHSEED)" in said, said
    assert "no golden file" not in said


def test_what_the_process_has_left_behind_is_not_taken_for_a_hash_seed(
    tmp_path: Path,
) -> None:
    folder = user_project(
        tmp_path,
        """
        offset = 0
        def begin(self): self.n = 0
        def name(self):
            self.n += 1
            return self.n * 10 + Planted.offset
        """,
        "Planted.offset = 3\n    golden_scene('scene.mcap', tracker=Planted)",
    )
    code, said = run_pytest(folder)
    assert code == 1
    assert "Other processes agree with one another whatever the hash seed" in said, said


def test_a_clock_and_chance_without_an_effect_are_no_fault(tmp_path: Path) -> None:
    """Speed that is measured, lines that are logged, a generator with a seed: the answers are the
    same.
    """
    folder = user_project(
        tmp_path,
        """
        def begin(self):
            self.n = 0
            self.generator = random.Random(7)
        def name(self):
            import logging
            start = time.perf_counter()
            logging.getLogger("planted").warning("begin")
            self.n += 1
            logging.getLogger("planted").warning("took %s s", time.perf_counter() - start)
            return self.n * 1000 + int(self.generator.random() * 1000)
        """,
        "golden_scene('scene.mcap', tracker=Planted, checkpoint=False)",
    )
    test = folder / "test_planted.py"
    whole = test.read_text()
    test.write_text(
        whole.replace("checkpoint=False", "checkpoint=False, other_process=False")
    )
    code, said = run_pytest(folder)
    assert "there was no golden file, so it was written" in said, said
    test.write_text(whole)
    code, said = run_pytest(folder)
    assert code == 0, said


def test_two_tests_of_one_name_are_told(tmp_path: Path) -> None:
    write_scene_log(
        generate("pass_by", size=(96, 72), frames=12),
        tmp_path / "scene.mcap",
        pictures="none",
    )
    plain = "golden_scene('scene.mcap', other_process=False, checkpoint=False)\n"
    named = plain.replace(")", ", name='a')")
    method = f"    def test_crossing(self, golden_scene):\n        {plain}\n\n"
    (tmp_path / "test_one.py").write_text(f"class TestX:\n{method}class TestY:\n{method}")
    functions = [("test_crossing", plain), ("test_named", named), ("test_named_too", named)]
    (tmp_path / "test_other.py").write_text(
        "".join(f"def {test}(golden_scene):\n    {call}\n\n" for test, call in functions)
    )
    code, said = run_pytest(tmp_path)
    assert code == 1
    # A line's start: where CI is set, pytest's summary repeats the whole message behind each
    # FAILED.
    assert (
        len(
            re.findall(
                r"^two tests have one golden file, test_crossing\.mcap", said, re.MULTILINE
            )
        )
        == 3
    ), said
    for words in (
        "test_one.py::TestX::test_crossing",
        "test_one.py::TestY::test_crossing",
        "golden_scene(..., name=",
    ):
        assert words in said
    assert re.search(
        r"one golden file,"
        r" a\.mcap:\n\s*test_other\.py::test_named\n\s*test_other\.py::test_named_too",
        said,
    )
    assert not (tmp_path / "test_crossing.mcap").exists()
    assert (tmp_path / "a.mcap").exists()
    code, said = run_pytest(tmp_path, "test_one.py::TestX")
    assert "there was no golden file, so it was written" in said, (
        "alone it has its name for itself"
    )
