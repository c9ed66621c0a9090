"""ROS messages by their own definitions: the text of ``.msg`` files as logs carry it, and payloads
in CDR (ROS 2) or ROS 1's packed form.

A definition and a payload are untrusted: every length is held against the bytes that are there
before anything is made of it.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from recorders.names import whole

Value = Any
Definitions = Mapping[str, "tuple[Field, ...]"]

_PRIMITIVES = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H",
    "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
_TIMES = frozenset({"time", "duration"})
_BUILT_IN = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
}
_SEPARATOR = re.compile(r"^={3,}\s*$", re.MULTILINE)
_FIELD = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(?P<bound><=\d+)?(?P<array>\[(?:<=)?\d*\])?\s+"
    r"(?P<name>[A-Za-z]\w*)\s*(?P<rest>.*)"
)
_MOST_FIELDS = 10_000
_DEEPEST = 16


class DefinitionError(ValueError):
    """A definition that is not one, or a payload that does not follow it."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a message: its name, its type, and how many of it.

    Attributes:
        count: None for a single value, -1 for a sequence that says its length, else a fixed number.
    """

    name: str
    kind: str
    count: int | None


def plain_name(name: str) -> str:
    """A type's name without ROS 2's middle part.

    >>> plain_name("sensor_msgs/msg/Image")
    'sensor_msgs/Image'
    """
    parts = name.split("/")
    return "/".join((parts[0], parts[-1])) if len(parts) > 1 else name


def parse_definitions(name: str, text: str) -> Definitions:
    """The types of a message definition with the definitions that it builds on, as logs carry it.

    Raises:
        DefinitionError: a line is no field.
    """
    found: dict[str, tuple[Field, ...]] = {}
    sections = _SEPARATOR.split(text)
    for index, section in enumerate(sections):
        body, current = section, plain_name(name)
        if index:
            head, _, body = section.strip().partition("\n")
            if not head.startswith("MSG:"):
                raise DefinitionError(
                    f"a part of the definition without a name: {head[:60]!r}"
                )
            current = plain_name(head[4:].strip())
        found[current] = _fields(current, body)
    for built_in, body in _BUILT_IN.items():
        found.setdefault(built_in, _fields(built_in, body))
    return found


def _fields(owner: str, text: str) -> tuple[Field, ...]:
    found = []
    for line in text.splitlines():
        stripped = line.split("#", 1)[0].strip()
        if not stripped:
            continue
        match = _FIELD.fullmatch(stripped)
        if match is None:
            raise DefinitionError(f"not a field of {owner}: {stripped[:60]!r}")
        if match["rest"].startswith("="):
            continue  # a constant
        array = match["array"]
        count = None
        if array is not None:
            inside = array[1:-1]
            found_count = whole(inside)
            count = -1 if found_count is None else found_count
        found.append(Field(match["name"], _kind(match["type"], owner), count))
        if len(found) > _MOST_FIELDS:
            raise DefinitionError(f"{owner} has over {_MOST_FIELDS} fields")
    return tuple(found)


def _kind(written: str, owner: str) -> str:
    if written in _PRIMITIVES or written in _TIMES or written in ("string", "wstring"):
        return written
    if written == "Header":
        return "std_msgs/Header"
    if "/" in written:
        return plain_name(written)
    return f"{owner.split('/', maxsplit=1)[0]}/{written}"


def decode(name: str, definitions: Definitions, data: bytes, ros1: bool = False) -> Value:
    """A payload as a dictionary of its fields; arrays of numbers as numpy arrays, of bytes as
    ``bytes``; ROS 1's times as ``{"sec": ..., "nanosec": ...}``.

    Raises:
        DefinitionError: it is too short, or does not follow the definition.
    """
    reader = _Packed(data) if ros1 else _Cdr(data)
    return _message(plain_name(name), definitions, reader, 0)


def _message(name: str, definitions: Definitions, reader: _Packed, depth: int) -> Value:
    fields = definitions.get(name)
    if fields is None:
        raise DefinitionError(f"the type {name} is not defined")
    if depth > _DEEPEST:
        raise DefinitionError(f"types are nested over {_DEEPEST} deep")
    if not fields:
        reader.nothing()
    found: dict[str, Value] = {}
    for field in fields:
        kind, count = field.kind, field.count
        if count is None:
            found[field.name] = _single(kind, definitions, reader, depth)
            continue
        if count < 0:
            count = int(reader.number("I"))
        if kind in _PRIMITIVES:
            found[field.name] = reader.numbers(kind, count)
        else:
            reader.expect(count)  # each takes a byte at least
            found[field.name] = [
                _single(kind, definitions, reader, depth) for _ in range(count)
            ]
    return found


def _single(kind: str, definitions: Definitions, reader: _Packed, depth: int) -> Value:
    if kind in _PRIMITIVES:
        return reader.number(_PRIMITIVES[kind])
    if kind == "string":
        return reader.text()
    if kind == "wstring":
        raise DefinitionError("wide strings cannot be read")
    if kind in _TIMES:
        signed = "i" if kind == "duration" else "I"
        return {"sec": reader.number(signed), "nanosec": reader.number(signed)}
    return _message(kind, definitions, reader, depth + 1)


class _Packed:
    """ROS 1's form: little-endian, nothing between the values."""

    aligned = 1
    order: Literal["<", ">"] = "<"
    terminated = 0

    def __init__(self, data: bytes, start: int = 0) -> None:
        self._data = data
        self._start = start
        self._at = start

    def expect(self, size: int) -> None:
        """Hold so many bytes against those that are left."""
        if size > len(self._data) - self._at:
            raise DefinitionError(
                f"{size} bytes are said to follow at byte {self._at},"
                f" {len(self._data) - self._at} are there"
            )

    def nothing(self) -> None:
        """A message without fields."""

    def _align(self, size: int) -> None:
        size = min(size, self.aligned)
        self._at += -(self._at - self._start) % size

    def number(self, form: str) -> Value:
        """One number."""
        size = struct.calcsize(form)
        self._align(size)
        self.expect(size)
        (value,) = struct.unpack_from(self.order + form, self._data, self._at)
        self._at += size
        return value

    def numbers(self, kind: str, count: int) -> Value:
        """An array of numbers."""
        form = _PRIMITIVES[kind]
        size = struct.calcsize(form)
        if count:
            self._align(size)
        self.expect(count * size)
        start, self._at = self._at, self._at + count * size
        if form == "B":
            return self._data[start : self._at]
        return np.frombuffer(
            self._data, np.dtype(form).newbyteorder(self.order), count, start
        )

    def text(self) -> str:
        """A string."""
        length = int(self.number("I"))
        self.expect(length)
        start, self._at = self._at, self._at + length
        end = self._at - (self.terminated if length else 0)
        return self._data[start:end].decode("utf-8", "replace")


class _Cdr(_Packed):
    """ROS 2's form (OMG CDR): values at multiples of their size, after four bytes that tell the
    byte order.
    """

    terminated = 1

    def __init__(self, data: bytes) -> None:
        if len(data) < 4 or data[0] != 0:
            raise DefinitionError("no CDR: its first four bytes do not say the byte order")
        super().__init__(data, 4)
        self.order = "<" if data[1] & 1 else ">"
        self.aligned = 4 if data[1] >= 6 else 8

    def nothing(self) -> None:
        """An empty structure takes one byte."""
        self.expect(1)
        self._at += 1
