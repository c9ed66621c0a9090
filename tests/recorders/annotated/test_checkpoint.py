"""Checkpoints: canonical, versioned, no code in them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from recorders.annotated import checkpoint
from recorders.annotated.checkpoint import (
    Checkpoint,
    decode,
    decode_state,
    encode,
    encode_state,
)
from recorders.errors import RecordingError

PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False)
    | st.text()
    | st.binary(),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4)
    ),
    max_leaves=12,
)


@given(PLAIN)
def test_plain_data_comes_back(state: object) -> None:
    assert decode_state(encode_state(state)) == state


@given(
    arrays.arrays(
        st.sampled_from([np.uint8, np.int32, np.float64, np.bool_, np.float32, np.int64]),
        arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
    )
)
def test_arrays_come_back_bit_for_bit(array: np.ndarray) -> None:
    back = decode_state(encode_state({"a": array}))["a"]
    assert back.dtype == array.dtype
    assert back.shape == array.shape
    assert back.tobytes() == array.tobytes()


def test_the_same_state_gives_the_same_bytes_whatever_its_order() -> None:
    assert encode_state({"a": 1, "b": np.eye(2)}) == encode_state(
        {"b": np.eye(2, order="F"), "a": 1}
    )


def test_what_is_not_plain_is_refused_by_name() -> None:
    with pytest.raises(TypeError, match=r"hold object"):
        encode_state({"a": object()})
    with pytest.raises(TypeError, match="complex128"):
        encode_state(np.zeros(2, complex))


def made(**changes: Any) -> Checkpoint:
    fields: dict[str, Any] = {
        "version": checkpoint.FORMAT, "frame": 4, "time_ns": 9, "recorded": "r", "input_link": "i", "link": "l",
        "tracker": "events", "fingerprint": "f", "tracker_state": {"n": 1}, "reasoner_state": [],
    }  # fmt: skip
    return Checkpoint(**{**fields, **changes})


def test_a_checkpoint_round_trip() -> None:
    assert decode(encode(made()), "x") == made()


@pytest.mark.parametrize("data", [b"", b"\x00", b"nonsense", encode(made())[:-3]])
def test_damaged_checkpoints(data: bytes) -> None:
    with pytest.raises(RecordingError, match="not a checkpoint"):
        decode(data, "x.mcap")


def test_another_format_says_so() -> None:
    with pytest.raises(
        RecordingError, match="checkpoint of format 99, this scenetrace reads 1"
    ):
        decode(encode(made(version=99)), "x.mcap")
