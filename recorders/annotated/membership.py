"""The membership channel: whose pixel is whose, a one-channel PNG per frame (SHELLS, Figure 3).

A pixel holds 0 for nobody, else the track's identity: 8 bits where all identities of the frame
fit, else 16 bits; beyond 65535 identities wrap around to 1. A pixel's value is always an id of
the same frame's ``tracks`` message: before hindsight a frame is held as `Patches`, and painted
once the tracks have their final identities. `rename_labels` does the same for a tracker that gives
payloads alone.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from recorders import channels
from recorders.errors import RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.pictures import check_size, is_whole, read_header
from recorders.vision import cv2

Labels = NDArray[np.uint16]
AnyLabels = NDArray[np.uint8] | NDArray[np.uint16]
_MOST = 65535
_SMALL = 256
PATCHES = "membership_patches"
"""Name of `Patches.packed` among what a tracker gives before hindsight; no channel of a log."""
# Label images are long runs: no filter and run lengths alone take a fifth of the time and no more
# bytes.
_OPTIONS = [
    cv2.IMWRITE_PNG_COMPRESSION, 1,
    cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE,
    cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE,
]  # fmt: skip


def value_of(identity: int) -> int:
    """A track's value in a label image; identities count from 1, 0 becomes `_MOST` like every
    multiple of it.
    """
    return (identity - 1) % _MOST + 1


class LabelImage:
    """A label image being painted: of 8 bits where the largest identity in it allows, else of 16."""

    def __init__(self, width: int, height: int, largest: int) -> None:
        shape = (height, width)
        self.pixels: AnyLabels = (
            np.zeros(shape, np.uint8) if largest < _SMALL else np.zeros(shape, np.uint16)
        )

    def put(
        self, identity: int | None, own: NDArray[np.bool_], left: int, top: int
    ) -> None:
        """Give a track, or nobody, the pixels of a mask (h, w) placed at (left, top); it may
        reach outside.
        """
        height, width = self.pixels.shape
        a, b = max(0, left), max(0, top)
        c, d = min(width, left + own.shape[1]), min(height, top + own.shape[0])
        if c > a and d > b:
            part = own[b - top : d - top, a - left : c - left]
            self.pixels[b:d, a:c][part] = 0 if identity is None else value_of(identity)

    def payload(self, time_ns: int, camera: str = channels.DEFAULT_CAMERA) -> bytes:
        """The channel's payload."""
        return channels.compressed_image(_encoded(self.pixels), "png", time_ns, camera)


class Patch(Struct, frozen=True, array_like=True):
    """A track's own pixels: the mask's place and size, its rows' bits packed one after the other."""

    identity: int
    left: int
    top: int
    width: int
    height: int
    bits: bytes


class Patches(Struct, frozen=True, array_like=True):
    """A frame's label image before it is painted: a thousandth of its pixels' size, and quick to
    make and to rename.

    Where patches overlap, later ones cover earlier ones.
    """

    width: int
    height: int
    time_ns: int
    patches: list[Patch]

    @staticmethod
    def patch(identity: int, own: NDArray[np.bool_], left: int, top: int) -> Patch:
        """A track's patch from its mask (h, w)."""
        return Patch(
            identity, left, top, own.shape[1], own.shape[0], np.packbits(own).tobytes()
        )

    def packed(self) -> bytes:
        """As bytes, for `unpacked`."""
        return _PACKER.encode(self)

    @staticmethod
    def unpacked(data: bytes) -> Patches:
        """From `packed`."""
        return _UNPACKER.decode(data)

    def payload(
        self, names: Mapping[int, int] | None = None, present: Collection[int] = ()
    ) -> bytes:
        """The channel's payload, painted.

        Args:
            names: forward to final identities; what is not named belongs to nobody any more.
                None: as they are.
            present: all forward identities of the frame.
        """
        largest = max((patch.identity for patch in self.patches), default=0)
        final: dict[int, int] | None = None
        if names is not None and any(names.get(i) != i for i in present):
            final = {i: names[i] for i in sorted(present) if i in names}
            largest = max([largest, *final.values()])
        image = LabelImage(self.width, self.height, largest)
        for patch in self.patches:
            own = np.unpackbits(
                np.frombuffer(patch.bits, np.uint8), count=patch.width * patch.height
            ).reshape(patch.height, patch.width)
            identity = patch.identity if final is None else final.get(patch.identity)
            image.put(identity, own.view(np.bool_), patch.left, patch.top)
        return image.payload(self.time_ns)


_PACKER = msgspec.msgpack.Encoder()
_UNPACKER = msgspec.msgpack.Decoder(Patches)


def _encoded(labels: AnyLabels) -> bytes:
    done, data = cv2.imencode(".png", labels, _OPTIONS)
    assert done, "OpenCV cannot encode PNG"
    return bytes(data)


def decode_labels(
    data: bytes, path: str | Path = "", limits: Limits = DEFAULT_LIMITS
) -> Labels:
    """A label image (H, W) uint16 from its PNG; raises what `_decoded` does."""
    return np.asarray(_decoded(data, path, limits), np.uint16)


def _decoded(data: bytes, path: str | Path, limits: Limits) -> AnyLabels:
    """A label image (H, W) as it is in its PNG, uint8 or uint16.

    Raises:
        LimitError: the header claims too many pixels.
        RecordingError: it is no one-channel PNG, or damaged.
    """
    header = read_header(data, path)
    check_size(header.width, header.height, path, limits)
    if header.format != "png" or header.channels != 1 or not is_whole(data, "png"):
        raise RecordingError(
            "a label image that is not a whole one-channel PNG", path, record="membership"
        )
    try:
        found: Any = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise RecordingError(
            f"a damaged label image: {error.err}", path, record="membership"
        ) from error
    if found is None or found.ndim != 2 or found.shape != (header.height, header.width):
        raise RecordingError("a damaged label image", path, record="membership")
    labels: AnyLabels = found
    return labels


def rename_labels(
    payload: bytes, names: Mapping[int, int], present: Collection[int]
) -> bytes:
    """The payload with other identities.

    Args:
        payload: of the membership channel.
        names: forward to final identities; what is not named belongs to nobody any more.
        present: the forward identities that may be in the image.
    """
    if all(names.get(i) == i for i in present):
        return payload
    message = channels.decode("membership", payload)
    labels = _decoded(message.data, "", DEFAULT_LIMITS)
    table = np.zeros(256 if labels.dtype == np.uint8 else _MOST + 1, np.uint16)
    for identity in sorted(present):
        table[value_of(identity)] = value_of(names[identity]) if identity in names else 0
    if labels.dtype == np.uint8 and int(table.max()) < _SMALL:
        fresh: AnyLabels = np.asarray(cv2.LUT(labels, table.astype(np.uint8)), np.uint8)
    else:
        fresh = table[labels]
    message.data = _encoded(fresh)
    return channels.encode("membership", message)
