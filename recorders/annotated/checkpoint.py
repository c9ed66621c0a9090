"""Checkpoints: a replay's whole state after a frame as canonical bytes; no pickle, versioned.

The encoding is MessagePack with sorted keys; an array is an extension of dtype, shape and C-order
bytes, so the same state always gives the same bytes and reading one never runs code.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta, Struct

from recorders.errors import RecordingError

FORMAT = 1
PREFIX = "checkpoint"
MEDIA_TYPE = "application/x-scenetrace-checkpoint"
_ARRAY = 1
_MAX_DIMENSIONS = 32
_MAX_SIDE = 1 << 40
_DTYPES = ("|b1", "|u1", "|i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f4", "<f8")


class Checkpoint(Struct, frozen=True, forbid_unknown_fields=True):
    """Everything that the next frame's result depends on.

    Attributes:
        version: format of this encoding.
        frame: the last frame that is in the state, from 0.
        time_ns: its log time.
        recorded: its recorded messages' digest, to tell the same recording again.
        input_link: the input chain's link after it.
        link: the output chain's link after it.
        tracker: the tracker's name.
        fingerprint: of configuration and package versions; another one cannot continue it.
        tracker_state, reasoner_state: as `state` gave them; the tracker's is None where it has
            run further already.
    """

    version: int
    frame: Annotated[int, Meta(ge=0)]
    time_ns: int
    recorded: str
    input_link: str
    link: str
    tracker: str
    fingerprint: str
    tracker_state: Any
    reasoner_state: Any


def _hook(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        array = np.asarray(value, order="C")
        dtype = (
            array.dtype.newbyteorder("<").str
            if array.dtype.itemsize > 1
            else array.dtype.str
        )
        if dtype not in _DTYPES:
            raise TypeError(f"a state cannot hold an array of {array.dtype}")
        header = msgspec.msgpack.encode([dtype, list(array.shape)])
        return msgspec.msgpack.Ext(
            _ARRAY,
            bytes([len(header)]) + header + array.astype(dtype, copy=False).tobytes(),
        )
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"a state cannot hold {type(value).__name__}")


def _ext(code: int, data: memoryview) -> Any:
    if code != _ARRAY or len(data) < 1:
        raise ValueError(f"unknown extension {code}")
    size = data[0]
    dtype, shape = msgspec.msgpack.decode(data[1 : 1 + size], type=tuple[str, list[int]])
    if (
        dtype not in _DTYPES
        or len(shape) > _MAX_DIMENSIONS
        or any(not 0 <= n < _MAX_SIDE for n in shape)
    ):
        raise ValueError(f"array of {dtype} {shape}")
    if len(data) - 1 - size != math.prod(shape) * np.dtype(dtype).itemsize:
        raise ValueError(f"array of {dtype} {shape} with {len(data) - 1 - size} bytes")
    return np.frombuffer(data[1 + size :], dtype).reshape(shape).copy()


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_hook, order="deterministic")
_DECODER = msgspec.msgpack.Decoder(Checkpoint, ext_hook=_ext)


def encode_state(state: Any) -> bytes:
    """Canonical bytes of plain data with arrays.

    Raises:
        TypeError: the state holds something that is not plain data; names the type.
    """
    return _ENCODER.encode(state)


def decode_state(data: bytes) -> Any:
    """Plain data with arrays from `encode_state`'s bytes.

    Raises:
        ValueError: these are no such bytes.
    """
    try:
        return msgspec.msgpack.decode(data, ext_hook=_ext)
    except (msgspec.MsgspecError, TypeError, RecursionError) as error:
        raise ValueError(f"not a state: {error}") from error


def encode(checkpoint: Checkpoint) -> bytes:
    """A checkpoint as bytes."""
    return _ENCODER.encode(checkpoint)


def decode(data: bytes, path: str) -> Checkpoint:
    """A checkpoint from bytes.

    Raises:
        RecordingError: it is none, or one of another format.
    """
    try:
        found: Checkpoint = _DECODER.decode(data)
    except (msgspec.MsgspecError, ValueError, TypeError, RecursionError) as error:
        raise RecordingError(
            f"not a checkpoint: {error}", path, record="Attachment"
        ) from error
    if found.version != FORMAT:
        raise RecordingError(
            f"checkpoint of format {found.version}, this scenetrace reads {FORMAT}; replay"
            " without --checkpoints",
            path,
        )
    return found


def name(frame: int) -> str:
    """The attachment's name for the state after a frame."""
    return f"{PREFIX}/{frame:09d}"
