"""Running a network: by OpenCV, or where that cannot by onnxruntime, if it is there."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from recorders.detectors.model_file import ModelFile
from recorders.errors import SceneTraceError
from recorders.vision import cv2

Array = NDArray[np.generic]
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
        self._names = [t.name for t in model.outputs]
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
        self._names = [t.name for t in model.outputs]
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


def open_network(
    model: ModelFile, inputs: Mapping[str, Array]
) -> tuple[Network, list[tuple[str, Array]]]:
    """The network, and what it puts out for some inputs: what has run once runs.

    Raises:
        SceneTraceError: nothing that is there can run it; one line, with what to do.
    """
    refused: list[str] = []
    engines: list[tuple[str, Any]] = [("OpenCV", OpenCVNetwork)]
    if importlib.util.find_spec("onnxruntime") is not None:
        engines.append(("onnxruntime", OnnxRuntimeNetwork))
    for name, engine in engines:
        try:
            network: Network = engine(model)
            return network, network.run(inputs)
        except SceneTraceError as e:
            refused.append(f"{name}: {e}")
    advice = "" if len(engines) > 1 else f"; onnxruntime may ({EXTRA})"
    raise SceneTraceError(
        f"{model.path}: the network cannot be run ({'; '.join(refused)}){advice}"
    )


def _attempt(call: Any, *args: Any) -> Any:
    """Call a library; whatever it raises over a model becomes one line."""
    try:
        return call(*args)
    except Exception as e:
        raise SceneTraceError(_line(e)) from e


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
