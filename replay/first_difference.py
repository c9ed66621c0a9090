"""Where two values or payloads differ first, and both sides of it, shortened for a line."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest
from typing import Any

import msgspec
from google.protobuf.json_format import MessageToDict

from recorders import channels
from recorders.errors import SceneTraceError

# Protobuf messages whose fields say more than their bytes: no pictures.
_SMALL = ("annotations", "log")


def difference_in(name: str, then: bytes | None, now: bytes | None) -> tuple[str, str, str]:
    """Where two payloads of a channel differ first: place in the message, both values, shortened."""
    if then is None or now is None:
        return "message", shorten(then), shorten(now)
    found = None
    try:
        if name in channels.JSON_CHANNELS:
            found = first_unequal(*(msgspec.json.decode(data) for data in (then, now)))
        elif name in _SMALL:
            found = first_unequal(
                *(MessageToDict(channels.decode(name, data)) for data in (then, now))
            )
    except (msgspec.MsgspecError, RecursionError, SceneTraceError):
        pass
    return found or _unequal_bytes(then, now)


def _unequal_bytes(then: bytes, now: bytes) -> tuple[str, str, str]:
    """Where the bytes of two payloads part that nothing else tells apart."""
    at = next(
        (index for index, (a, b) in enumerate(zip(then, now, strict=False)) if a != b),
        min(len(then), len(now)),
    )
    old, new = (data[at : at + 16].hex() or "the end" for data in (then, now))
    return f"byte {at} of the message", old, new


def first_unequal(a: Any, b: Any, place: str = "") -> tuple[str, str, str] | None:
    """Where two plain values differ first, in the order of their fields; rows with an id are
    named by it.
    """
    return next(_unequal(a, b, place), None)


def _unequal(a: Any, b: Any, place: str) -> Iterator[tuple[str, str, str]]:
    if isinstance(a, dict) and isinstance(b, dict):
        for key in [*a, *(k for k in b if k not in a)]:
            yield from _unequal(
                a.get(key), b.get(key), f"{place}.{key}" if place else str(key)
            )
    elif isinstance(a, list) and isinstance(b, list):
        for index, (x, y) in enumerate(zip_longest(a, b)):
            yield from _unequal(x, y, f"{place}[{_row_name(x, y, index)}]")
    elif type(a) is not type(b):
        yield place, shorten(a), shorten(b)
    elif hasattr(a, "tobytes"):
        if (a.dtype, a.shape, a.tobytes()) != (b.dtype, b.shape, b.tobytes()):
            yield place, shorten(a.tolist()), shorten(b.tolist())
    elif a != b:
        yield place, shorten(a), shorten(b)


def _row_name(x: Any, y: Any, k: int) -> str:
    row = x if isinstance(x, dict) else y
    if isinstance(row, dict) and "id" in row:
        return f"id {row['id']}"
    return str(k)


def shorten_apart(a: Any, b: Any) -> tuple[str, str]:
    """Two unequal values for a line: numbers with as many digits as it takes to tell them apart,
    at least six.
    """
    if isinstance(a, float) and isinstance(b, float):
        for digits in range(6, 18):
            x, y = f"{a:.{digits}g}", f"{b:.{digits}g}"
            if x != y:
                return x, y
    if (
        isinstance(a, list | tuple)
        and isinstance(b, list | tuple)
        and len(a) == len(b)
        and len(a) <= 8
    ):
        pairs = [
            shorten_apart(x, y) if x != y else (shorten(x),) * 2
            for x, y in zip(a, b, strict=True)
        ]
        return shorten_text(f"({', '.join(pair[0] for pair in pairs)})"), shorten_text(
            f"({', '.join(pair[1] for pair in pairs)})"
        )
    return shorten(a), shorten(b)


def shorten(value: Any) -> str:
    """A value in at most 60 characters."""
    return shorten_text("nothing" if value is None else repr(value))


def shorten_text(text: str) -> str:
    """A text cut to 60 characters."""
    return text if len(text) <= 60 else text[:57] + "..."
