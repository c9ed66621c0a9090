"""JSON as others write it: NaN and Infinity, which Python writes and JSON does not know."""

from __future__ import annotations

import json
from typing import Any

import msgspec


def decode_loose(data: bytes) -> Any:
    """The document; numbers may be NaN, Infinity and -Infinity.

    Raises:
        msgspec.DecodeError: it is not JSON, apart from such numbers.
        UnicodeDecodeError: its text is not UTF-8.
    """
    try:
        return msgspec.json.decode(data)
    except msgspec.DecodeError as error:
        if b"NaN" not in data and b"Infinity" not in data:
            raise
        try:
            return json.loads(data)
        except (ValueError, RecursionError):
            raise error from None
