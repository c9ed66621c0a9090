"""Running a network: by OpenCV, or where that cannot by onnxruntime, if it is there."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from recorders.detectors.model_file import ModelFile, read_model
from recorders.errors import SceneTraceError
from recorders.vision import cv2

Array = NDArray[np.generic]
LONGEST_S = 120
WELL = "runs"
_CHILD = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]);"
    " from recorders.detectors.network import try_here;"
    " try_here(sys.argv[2:], sys.stdin.buffer.read())"
)
EXTRA = "pip install 'scenetrace[onnx]'"


class Network(Protocol):
    """A network that is ready to run.

    Attributes:
        engine: what runs it, with its version.
    """

    engine: str

    def run(self, inputs: Mapping[str, Array]) -> list[tuple[str, Array]]:
        """Name and value of every output."""
        ...


class OpenCVNetwork:
    """Run by `cv2.dnn`.

    Raises:
        SceneTraceError: OpenCV cannot read it.
    """

    def __init__(self, model: ModelFile) -> None:
        self.engine = f"opencv {cv2.__version__}"
        self._names = [output.name for output in model.outputs]
        with _silent():
            self._net = _attempt(
                cv2.dnn.readNetFromONNX, np.frombuffer(model.data, np.uint8)
            )
        found = list(self._net.getUnconnectedOutLayersNames())
        if sorted(found) == sorted(self._names):
            self._names = found
        self._layers = found

    def run(self, inputs: Mapping[str, Array]) -> list[tuple[str, Array]]:
        """As `Network.run`."""
        with _silent():
            for name, value in inputs.items():
                _attempt(self._net.setInput, value, name)
            values = _attempt(self._net.forward, self._layers)
        names = self._names if len(self._names) == len(values) else self._layers
        return list(zip(names, map(np.asarray, values), strict=True))


class OnnxRuntimeNetwork:
    """Run by onnxruntime, an extra.

    Raises:
        SceneTraceError: it cannot read the model.
    """

    def __init__(self, model: ModelFile) -> None:
        import onnxruntime

        self.engine = f"onnxruntime {onnxruntime.__version__}"
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 4
        self._names = [output.name for output in model.outputs]
        self._session: Any = _attempt(
            onnxruntime.InferenceSession,
            model.data,
            options,
            ["CPUExecutionProvider"],
        )

    def run(self, inputs: Mapping[str, Array]) -> list[tuple[str, Array]]:
        """As `Network.run`."""
        values: Sequence[Array] = _attempt(self._session.run, self._names, dict(inputs))
        return list(zip(self._names, map(np.asarray, values), strict=True))


ENGINES: dict[str, Callable[[ModelFile], Network]] = {
    "OpenCV": OpenCVNetwork,
    "onnxruntime": OnnxRuntimeNetwork,
}


def open_network(
    model: ModelFile, inputs: Mapping[str, Array]
) -> tuple[Network, list[tuple[str, Array]]]:
    """The network, and what it puts out for some inputs: what has run once runs.

    A damaged or hostile model can bring a library down, so it is first tried in a process of its
    own.

    Raises:
        SceneTraceError: nothing that is there can run it; one line, with what to do.
    """
    engines = [e for e in ENGINES if e != "onnxruntime" or find_spec(e) is not None]
    refused: list[str] = []
    for name in engines:
        reason = _tried(name, model, inputs)
        if reason is None:
            network = ENGINES[name](model)
            return network, network.run(inputs)
        refused.append(f"{name}: {reason}")
    advice = "" if "onnxruntime" in engines else f"; onnxruntime may ({EXTRA})"
    raise SceneTraceError(
        f"{model.path}: the network cannot be run ({'; '.join(refused)}){advice}"
    )


def _tried(engine: str, model: ModelFile, inputs: Mapping[str, Array]) -> str | None:
    """Why an engine cannot run a model; None if it can."""
    given = io.BytesIO()
    arrays: dict[str, Any] = {f"_{name}": value for name, value in inputs.items()}
    np.savez(given, **arrays)
    words = [sys.executable, "-c", _CHILD, json.dumps(sys.path), engine, str(model.path)]
    try:
        child = subprocess.run(
            words,
            input=given.getvalue(),
            capture_output=True,
            timeout=LONGEST_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"one picture takes it over {LONGEST_S} s"
    if child.returncode < 0:
        return f"it brings the library down (signal {-child.returncode})"
    told = child.stdout.decode(errors="replace").strip().splitlines()
    if child.returncode == 0 and told[-1:] == [WELL]:
        return None
    return told[-1] if told else f"it brings the library down (exit {child.returncode})"


def try_here(words: Sequence[str], given: bytes) -> None:
    """What the process of `_tried` does: run a model once, and say how that went."""
    engine, path = words
    with np.load(io.BytesIO(given), allow_pickle=False) as arrays:
        inputs = {name.removeprefix("_"): arrays[name] for name in arrays.files}
    try:
        ENGINES[engine](read_model(Path(path))).run(inputs)
    except SceneTraceError as error:
        sys.stdout.write(f"{error}\n")
    else:
        sys.stdout.write(f"{WELL}\n")


def _attempt(call: Any, *args: Any) -> Any:
    """Call a library; whatever it raises over a model becomes one line."""
    try:
        return call(*args)
    except Exception as error:
        raise SceneTraceError(_line(error)) from error


def _line(error: Exception) -> str:
    """The part of a library's message that says what is wrong."""
    text = " ".join(str(error).split())
    found = text.rpartition("error: ")[2] or text
    return found[:200] or type(error).__name__


class _silent:  # noqa: N801
    """OpenCV says on stderr what it then raises."""

    def __enter__(self) -> None:
        self._before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)

    def __exit__(self, *_: object) -> None:
        cv2.utils.logging.setLogLevel(self._before)
