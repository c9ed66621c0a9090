"""What an ONNX file says of itself: inputs, outputs, metadata.

Read by the few fields of its protobuf schema that are asked for (onnx.proto3, by field number), so
that no further library is needed. A model is untrusted data: sizes are checked before it is read,
and nothing in it is believed that a run of the network does not show as well.
"""

from __future__ import annotations

import ast
import hashlib
import re
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

from recorders.errors import SceneTraceError
from recorders.limits import MIB

MOST_BYTES = 2048 * MIB
MOST_CLASSES = 10_000
_LONGEST_NAMES = 1 << 20
FLOAT, UINT8, INT64, FLOAT16 = 1, 2, 7, 10
_MESSAGES: dict[str, tuple[tuple[str, int, str], ...]] = {
    "Model": (("graph", 7, "Graph"), ("metadata_props", 14, "*Entry")),
    "Graph": (
        ("node", 1, "*Node"),
        ("initializer", 5, "*Tensor"),
        ("input", 11, "*Value"),
        ("output", 12, "*Value"),
    ),
    "Node": (("op_type", 4, "string"),),
    "Tensor": (("name", 8, "string"), ("data_location", 14, "int64")),
    "Value": (("name", 1, "string"), ("type", 2, "Type")),
    "Type": (("tensor_type", 1, "TensorType"),),
    "TensorType": (("elem_type", 1, "int64"), ("shape", 2, "Shape")),
    "Shape": (("dim", 1, "*Dim"),),
    "Dim": (("dim_value", 1, "int64"), ("dim_param", 2, "string")),
    "Entry": (("key", 1, "string"), ("value", 2, "string")),
}


@dataclass(frozen=True)
class Tensor:
    """An input or output as the file declares it; 0 in ``shape`` for a size left open."""

    name: str
    kind: int
    shape: tuple[int, ...]

    def __str__(self) -> str:
        sizes = "x".join(str(size) if size else "?" for size in self.shape)
        return f"{self.name} {sizes}"


@dataclass(frozen=True)
class ModelFile:
    """A model as it lies on disk.

    Attributes:
        path, data, sha256: the file.
        inputs, outputs: as declared; weights are no inputs.
        metadata: what its exporter wrote down beside the network.
    """

    path: Path
    data: bytes = field(repr=False)
    sha256: str
    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]
    metadata: dict[str, str]

    @property
    def names(self) -> list[str]:
        """Its classes' names by number, as exporters write them; empty where it has none."""
        return parse_names(self.metadata.get("names", ""))

    @property
    def image_size(self) -> tuple[int, int] | None:
        """Width and height that its metadata name, for inputs that leave them open."""
        sizes = [int(v) for v in re.findall(r"\d{1,5}", self.metadata.get("imgsz", ""))]
        return (sizes[-1], sizes[0]) if len(sizes) in (1, 2) and all(sizes) else None


def read_model(path: Path) -> ModelFile:
    """Read an ONNX file.

    Raises:
        SceneTraceError: it cannot be read, or is no whole ONNX model; one line.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise SceneTraceError(
                f"{path}: over {MOST_BYTES // MIB} MiB; ONNX files are smaller"
            )
        data = path.read_bytes()
    except OSError as error:
        raise SceneTraceError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        model = _message("Model").FromString(data)
    except DecodeError as error:
        raise SceneTraceError(
            f"{path}: not an ONNX model, or not the whole of it"
        ) from error
    graph = model.graph
    if not (graph.node and graph.output):
        raise SceneTraceError(f"{path}: not an ONNX model: it holds no network")
    if any(t.data_location == 1 for t in graph.initializer):
        raise SceneTraceError(
            f"{path}: its weights lie in another file; save the model as one file"
        )
    weights = {t.name for t in graph.initializer}
    return ModelFile(
        path,
        data,
        hashlib.sha256(data).hexdigest(),
        tuple(_tensor(v) for v in graph.input if v.name not in weights),
        tuple(_tensor(v) for v in graph.output),
        {prop.key: prop.value for prop in model.metadata_props},
    )


def parse_names(text: str) -> list[str]:
    """Class names by number from a dictionary or list in Python's or JSON's notation.

    >>> parse_names("{0: 'person', 2: 'car'}")
    ['person', 'class 1', 'car']
    >>> parse_names('["cat", "dog"]'), parse_names("no names")
    (['cat', 'dog'], [])
    """
    if not text or len(text) > _LONGEST_NAMES:
        return []
    try:
        found = ast.literal_eval(text)
        if isinstance(found, dict):
            by_number = {int(k): str(v) for k, v in found.items()}
        elif isinstance(found, list):
            by_number = {index: str(v) for index, v in enumerate(found)}
        else:
            return []
    except (
        ValueError,
        SyntaxError,
        MemoryError,
        RecursionError,
        TypeError,
        OverflowError,
    ):
        return []
    if not by_number or min(by_number) < 0 or max(by_number) >= MOST_CLASSES:
        return []
    return [by_number.get(index) or f"class {index}" for index in range(max(by_number) + 1)]


def _tensor(value: Any) -> Tensor:
    kind = value.type.tensor_type
    shape = tuple(max(0, int(d.dim_value)) for d in kind.shape.dim)
    return Tensor(value.name, int(kind.elem_type), shape)


@cache
def _message(name: str) -> Any:
    """The message class of a name of `_MESSAGES`."""
    file = descriptor_pb2.FileDescriptorProto(
        name="scenetrace/onnx.proto", package="scenetrace.onnx", syntax="proto2"
    )
    field_type = descriptor_pb2.FieldDescriptorProto
    plain = {"string": field_type.TYPE_STRING, "int64": field_type.TYPE_INT64}
    for message, fields in _MESSAGES.items():
        made = file.message_type.add(name=message)
        for field_name, number, kind in fields:
            one = made.field.add(name=field_name, number=number)
            one.label = (
                field_type.LABEL_REPEATED
                if kind.startswith("*")
                else field_type.LABEL_OPTIONAL
            )
            kind = kind.lstrip("*")  # noqa: PLW2901
            one.type = plain.get(kind, field_type.TYPE_MESSAGE)
            if kind not in plain:
                one.type_name = f".scenetrace.onnx.{kind}"
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(
        pool.FindMessageTypeByName(f"scenetrace.onnx.{name}")
    )
