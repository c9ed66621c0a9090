"""One body is one target: as large as what comes in, whoever once was taken for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from recorders.messages import Box, Detections, Target
from recorders.segmentation.blobs import components
from replay.configuration import replay_config
from replay.protocol import make_tracker
from replay.trackers.choice import choose
from replay.trackers.shells.colours import bins_of, histogram
from replay.trackers.shells.foreground import Foreground
from replay.trackers.shells.objects import Bodies, Body
from replay.trackers.shells.parameters import ShellsParameters
from replay.trackers.shells.resolve import Resolver, SeenFrame
from replay.trackers.tracker import Frame, SceneInfo

WIDTH, HEIGHT, FPS = 320, 240, 25
Rectangle = tuple[int, int, int, int]
Picture = NDArray[np.uint8]
LIGHT, DARK = (60, 80, 200), (40, 120, 30)


def follow(
    tracker: str,
    scene: Callable[[int], Sequence[tuple[Rectangle, tuple[int, int, int]]]],
    frames: int,
) -> list[list[Target]]:
    """Who is present in each frame, forward, where rectangles (x1, y1, x2, y2) of a colour each
    are seen; no size of bodies is known.
    """
    choice = choose(tracker)
    config: Any = replay_config(choice)
    info = SceneInfo(WIDTH, HEIGHT, round(1e9 / FPS), has_images=True, has_masks=True)
    playing = make_tracker(choice, info, config)
    said = []
    for k in range(frames):
        image = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
        mask = np.zeros((HEIGHT, WIDTH), np.uint8)
        for (x1, y1, x2, y2), colour in scene(k):
            image[max(0, y1) : y2, max(0, x1) : x2] = colour
            mask[max(0, y1) : y2, max(0, x1) : x2] = 255
        blobs = components(mask, 0.0)[2]
        boxes: list[Box] = [b.box for b in blobs]
        detections = Detections(
            k, WIDTH, HEIGHT, boxes, [1.0] * len(boxes), [""] * len(boxes),
            [b.ellipse for b in blobs], [b.id for b in blobs], blobs,
        )  # fmt: skip
        time_ns = k * round(1e9 / FPS)
        frame = Frame(
            k,
            time_ns,
            detections,
            None,
            partial(np.asarray, image),
            partial(np.asarray, mask),
        )
        said.append([t for t in playing.step(frame).targets if t.present])
    return said


def wide(k: int) -> list[tuple[Rectangle, tuple[int, int, int]]]:
    """A wide body comes in from the left at 4 px a frame."""
    return [((4 * k - 90, 60, 4 * k, 180), LIGHT)]


def test_who_comes_in_is_as_large_as_what_is_seen_of_him() -> None:
    said = follow("shells", wide, 60)
    for k in range(12, 60):
        (one,) = said[k]
        x, _, w, _ = one.box
        true = min(90, 4 * k)
        assert abs(w - true) < 0.25 * true
        assert abs(x + w - 4 * k) < 0.15 * true


def opens(k: int) -> list[tuple[Rectangle, tuple[int, int, int]]]:
    """Of a body only the middle is seen at first: the rest looks like the wall."""
    w = 20 if k < 40 else 45
    x = 100 + k
    return [((x - w, 60, x + w, 180), LIGHT)]


def test_a_blob_that_a_target_has_long_had_to_itself_is_its_size() -> None:
    said = follow("shells", opens, 90)
    for k in range(70, 90):
        (one,) = said[k]
        assert one.id == said[30][0].id
        assert abs(one.box[2] - 90) < 10


@pytest.mark.parametrize(("wide", "hidden"), [(40, {1}), (70, set())])
def test_of_two_over_a_blob_of_one_body_the_one_with_other_colours_is_behind(
    wide: int, hidden: set[int]
) -> None:
    image = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    image[60:180, 100 : 100 + wide], mask[60:180, 100 : 100 + wide] = LIGHT, 255
    clean, labels, blobs = components(mask, 0.0)
    bodies = Bodies(ShellsParameters())
    for identity, (x, colour) in enumerate(((98.0, LIGHT), (104.0, DARK)), 1):
        body = Body(identity, 0, 0, 0, area=4800.0)
        body.learn_colours(
            histogram(bins_of(np.full((9, 9, 3), colour, np.uint8)), np.ones((9, 9), bool))
        )
        bodies.start((x, 60.0, 40.0, 120.0), body)
    seen = SeenFrame(
        Foreground(clean, labels.astype(np.uint16), blobs),
        np.array([blobs[0].box]),
        np.array([1]),
        lambda: image,
    )
    resolver = Resolver(
        seen, bodies, np.arange(2), bodies.radii(0.0), lambda *_: True, ShellsParameters()
    )
    resolver.resolve()
    assert resolver.behind == hidden
    # It is hidden once that has lasted, and whose body it is has the blob to itself.
    bodies.items[1].twin_s = 2.0
    again = Resolver(
        seen, bodies, np.arange(2), bodies.radii(0.0), lambda *_: True, ShellsParameters()
    )
    again.resolve()
    assert again.found[0].alone == bool(hidden)
