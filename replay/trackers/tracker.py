"""What a tracker is: a frame in, its targets out. A plug-in is a class with this shape and a line in a dict."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Detections, Regions, Targets
from recorders.parameters import Config

Image = NDArray[np.uint8]
State = Mapping[str, Any]


@dataclass(frozen=True)
class SceneInfo:
    """What is known of a recording before its first frame.

    Attributes:
        width, height: the picture's size in pixels.
        frame_ns: the nominal (median) time between frames in ns.
        has_images: every frame has a picture; without, a tracker works on boxes alone.
        has_masks: every frame has a foreground mask.
    """

    width: int
    height: int
    frame_ns: int
    has_images: bool
    has_masks: bool


class Frame:
    """One recorded frame. Picture and mask are decoded when first asked for, once.

    Attributes:
        index: from 0.
        time_ns: log time.
        detections: the recorded detections.
        regions: the latest recorded regions, or None.
    """

    def __init__(
        self,
        index: int,
        time_ns: int,
        detections: Detections,
        regions: Regions | None = None,
        load_image: Callable[[], Image] | None = None,
        load_mask: Callable[[], Image] | None = None,
    ) -> None:
        self.index = index
        self.time_ns = time_ns
        self.detections = detections
        self.regions = regions
        self._load_image = load_image
        self._load_mask = load_mask

    @cached_property
    def image(self) -> Image | None:
        """The picture, (height, width, 3) uint8 BGR, or None. Never write into it."""
        return None if self._load_image is None else self._load_image()

    @cached_property
    def mask(self) -> Image | None:
        """The foreground mask, (height, width) uint8, 0 or 255, or None. Never write into it."""
        return None if self._load_mask is None else self._load_mask()

    @cached_property
    def boxes(self) -> NDArray[np.float64]:
        """The detections' boxes, (N, 4) float64: x, y, w, h in pixels."""
        return np.array(self.detections.boxes, np.float64).reshape(-1, 4)


@runtime_checkable
class Tracker(Protocol):
    """A multi-object tracker. Its answers are a function of the frames so far and its configuration, alone.

    Ids come from a counter of the instance. No clock, no randomness, no iteration over sets; the instance keeps its
    whole state in itself, so that `state` and `restore` make it continue exactly where it was.
    """

    def step(self, frame: Frame) -> Targets:
        """Take the next frame, answer with all targets, by id."""
        ...

    def state(self) -> State:
        """The whole state after the last frame as plain data: dict, list, str, int, float, bool, None, bytes, ndarray.

        Dict keys are strings. A canonical encoding of it is the checkpoint.
        """
        ...

    def restore(self, state: State) -> None:
        """Continue from what `state` gave, on a fresh instance of the same scene and configuration."""
        ...


TrackerFactory = Callable[[SceneInfo, Config], Tracker]
