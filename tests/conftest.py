"""Fixtures that every test may use."""

from __future__ import annotations

import gc
import os
import pickle
import shutil
import signal
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from fixtures.scenes import GeneratedScene, generate
from fixtures.targets import truth_targets
from recorders.messages import Targets
from tests.examples import examples

# A test may take longer on a busy machine without being wrong: no property test is timed.
settings.register_profile(
    "scenetrace",
    deadline=None,
    max_examples=examples(100),
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("scenetrace")

# Tests that were started in the background ignore Ctrl-C, and so would the commands they start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parent.parent


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, Any, Any]:
    """What is collected stays to the end: looking through it for rubbish takes a quarter of the
    time.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real recordings: $SCENETRACE_DATA, or `shared/data` beside the project."""
    folder = Path(os.environ.get("SCENETRACE_DATA", ROOT.parent / "shared" / "data"))
    if not (folder / "SOURCES.md").exists():
        pytest.skip(
            f"real recordings are not at {folder}; set SCENETRACE_DATA to their folder"
        )
    return folder


Play = tuple[GeneratedScene, list[Targets]]
MadeOnce = Callable[[str, Callable[[Path], object]], Path]


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> MadeOnce:
    """``made_once(name, fill)``: a folder of that name, which ``fill(folder)`` fills once for all
    processes that run the tests. Nobody changes what is in it.
    """
    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent

    def make(name: str, fill: Callable[[Path], object]) -> Path:
        folder, done = base / f"once-{name}", base / f"once-{name}.done"
        with _lock(base / f"once-{name}.lock"):
            if not done.exists():
                folder.mkdir()
                try:
                    fill(folder)
                except BaseException:
                    shutil.rmtree(folder)
                    raise
                done.touch()
        return folder

    return make


@pytest.fixture(scope="session")
def play(made_once: MadeOnce) -> Callable[..., Play]:
    """``play(name, seed=0)``: a scene and the answers of a tracker without a fault; of the crowd
    the first 5 s. The same objects every time.
    """

    @cache
    def played(name: str, seed: int = 0) -> Play:
        scene = generate(name, seed, frames=125 if name == "crowd" else None)

        def fill(folder: Path) -> None:
            told = scene.truth, list(truth_targets(scene))
            (folder / "truth").write_bytes(pickle.dumps(told))

        made = made_once(f"{name}-{seed}", fill) / "truth"
        scene.truth, targets = pickle.loads(made.read_bytes())
        return scene, targets

    return played


@pytest.fixture(scope="session")
def pets(real_data: Path, made_once: MadeOnce) -> Path:
    """A folder with PETS09-S2L1, all 795 frames, by the commands: `scene.mcap` recorded from
    pixels, `annotated.mcap` replayed by `events`.
    """

    def fill(folder: Path) -> None:
        from replay.cli import main

        video, scene = real_data / "pets09-s2l1" / "video.avi", str(folder / "scene.mcap")
        assert main(["record", str(video), "--fps", "7", "-o", scene]) == 0
        out = str(folder / "annotated.mcap")
        assert main(["replay", scene, "--tracker", "events", "-o", out]) == 0

    return made_once("pets", fill)


@contextmanager
def _lock(path: Path) -> Iterator[None]:
    """Waits until no other process has it."""
    import fcntl

    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _constant_model(
    path: Path,
    outputs: dict[str, np.ndarray],
    picture: tuple[int | str, ...] = (1, 3, 64, 64),
    *,
    metadata: dict[str, str] | None = None,
    kind: int = 1,
    sizes: bool = False,
) -> Path:
    """A model with these outputs: constants, to which the picture times nothing is added."""
    onnx = pytest.importorskip("onnx")
    TensorProto, helper, numpy_helper = onnx.TensorProto, onnx.helper, onnx.numpy_helper
    inputs = [helper.make_tensor_value_info("images", kind, picture)]
    nodes = [
        helper.make_node("Cast", ["images"], ["floats"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["floats"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
    ]
    constants = [numpy_helper.from_array(np.array(0, np.float32), "zero")]
    if sizes:
        inputs.append(
            helper.make_tensor_value_info("orig_target_sizes", TensorProto.INT64, (1, 2))
        )
        nodes += [
            helper.make_node("Cast", ["orig_target_sizes"], ["f"], to=TensorProto.FLOAT),
            helper.make_node("ReduceMean", ["f"], ["m"], keepdims=0),
            helper.make_node("Mul", ["m", "zero"], ["no"]),
            helper.make_node("Add", ["nothing", "no"], ["nothing2"]),
        ]
    told = []
    for k, (name, value) in enumerate(outputs.items()):
        whole = value.dtype == np.int64
        constants.append(numpy_helper.from_array(value.astype(np.float32), f"value{k}"))
        sum_ = f"sum{k}" if whole else name
        added = "nothing2" if sizes else "nothing"
        nodes.append(helper.make_node("Add", [f"value{k}", added], [sum_]))
        if whole:
            nodes.append(helper.make_node("Cast", [sum_], [name], to=TensorProto.INT64))
        made = TensorProto.INT64 if whole else TensorProto.FLOAT
        told.append(helper.make_tensor_value_info(name, made, value.shape))
    graph = helper.make_graph(nodes, "made", inputs, told, constants)
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8
    )
    for key, text in (metadata or {}).items():
        model.metadata_props.add(key=key, value=text)
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())
    return path


@pytest.fixture(scope="session")
def constant_model() -> Callable[..., Path]:
    """What makes ONNX models of a few bytes."""
    return _constant_model
