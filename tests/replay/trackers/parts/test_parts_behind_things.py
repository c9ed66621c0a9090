"""Somebody who stands behind a sign: what is seen beside it keeps them alive, in their place,
under their id.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from recorders.messages import Target
from recorders.segmentation.motion import MotionSegmenter
from recorders.segmentation.parameters import SegmentationParameters
from replay.configuration import replay_config
from replay.trackers.association import iou
from replay.trackers.parts import PartsTracker
from replay.trackers.parts.parameters import PartsParameters
from replay.trackers.parts.pieces import held_by_pieces
from replay.trackers.tracker import Frame, SceneInfo

WIDTH, HEIGHT, FPS = 320, 240, 10
SIGN = (150, 96, 24, 40)
BODY = (20, 64)
FRAMES = 130
STANDS = range(48, 98)
Picture = NDArray[np.uint8]


def place(k: int) -> tuple[int, int, int, int]:
    """The body comes from the left, slows down, stands behind the sign for five seconds, and
    walks on.
    """
    walked = 4 * min(k, 24) + min(max(0, k - 24), 24) + 4 * max(0, k - STANDS.stop)
    return 32 + walked, 84, *BODY


def picture(k: int | None) -> Picture:
    out = np.full((HEIGHT, WIDTH, 3), (120, 130, 125), np.uint8)
    if k is not None:
        x, y, w, h = place(k)
        out[y : y + h // 7, x + 6 : x + w - 6] = (60, 80, 190)
        out[y + h // 7 : y + h // 2, x : x + w] = (40, 40, 60)
        out[y + h // 2 : y + h, x + 2 : x + w - 2] = (150, 60, 30)
    x, y, w, h = SIGN
    out[y : y + h, x : x + w] = (200, 190, 60)
    return out


def follow(*assignments: str) -> list[list[Target]]:
    """The answers to frames that are segmented as a recording is."""
    config: Any = replay_config("parts", assignments=assignments)
    pictures = [picture(k) for k in range(FRAMES)]
    segmenter = MotionSegmenter(SegmentationParameters(), WIDTH, HEIGHT, FPS)
    segmenter.prepare(iter([*[picture(None)] * 150, *pictures]))
    info = SceneInfo(WIDTH, HEIGHT, round(1e9 / FPS), has_images=True, has_masks=True)
    tracker = PartsTracker(info, config["parts"], config["part_features"])
    said = []
    for k, image in enumerate(pictures):
        found = segmenter.segment(k, image)
        frame = Frame(
            k,
            k * round(1e9 / FPS),
            found.detections,
            None,
            partial(np.asarray, image),
            partial(np.asarray, found.mask),
        )
        said.append(list(tracker.step(frame).targets))
    return said


def test_who_stands_behind_a_sign_is_observed_there_under_one_id() -> None:
    followed = follow()
    assert {t.id for targets in followed for t in targets} == {1}
    for k in range(10, FRAMES):
        (target,) = followed[k]
        assert target.present, k
        assert iou(np.array([target.box]), np.array([place(k)], float))[0, 0] > 0.5, k
    behind = [followed[k][0] for k in STANDS][5:]
    assert sum(t.observed for t in behind) > 0.9 * len(behind)
    assert sum("left_torso" in t.hidden_parts for t in behind) > 0.8 * len(behind)


def test_pieces_hold_nobody_for_ever() -> None:
    seen = [
        any(t.id == 1 and t.observed for t in targets)
        for targets in follow("parts.pieces_s=2")
    ]
    hidden_from = 44
    assert all(seen[hidden_from : hidden_from + 2 * FPS - 4])
    assert not any(seen[hidden_from + 2 * FPS + 4 : STANDS.stop])


BOX = np.array([100.0, 100.0, 20.0, 60.0])
NOBODY = np.zeros((0, 4))


@pytest.mark.parametrize(
    ("pieces", "pixels", "taken", "left", "top"),
    [
        ([[105, 100, 8, 8]], [50], NOBODY, 100.0, 100.0),
        ([[105, 100, 8, 8], [117, 150, 8, 12]], [50, 60], NOBODY, 105.0, 102.0),
        ([[96, 95, 6, 8]], [40], NOBODY, 96.0, 95.0),
    ],
    ids=["within", "the box moves just so far that it holds them", "up and to the left"],
)
def test_pieces_hold_a_box(
    pieces: list[list[float]],
    pixels: list[float],
    taken: NDArray[np.float64],
    left: float,
    top: float,
) -> None:
    found = held_by_pieces(
        BOX, np.array(pieces, float), np.array(pixels, float), taken, PartsParameters()
    )
    assert found is not None
    assert found[0].tolist() == [left, top, 20.0, 60.0]
    assert found[1] == int(np.argmax(pixels))


@pytest.mark.parametrize(
    ("pieces", "pixels", "taken"),
    [
        ([[105, 100, 4, 4]], [16], NOBODY),
        ([[100, 100, 20, 60]], [900], NOBODY),
        ([[140, 100, 8, 8]], [60], NOBODY),
        ([[105, 100, 8, 8]], [60], np.array([[104.0, 98.0, 20.0, 60.0]])),
    ],
    ids=["too little", "a whole body", "too far", "somebody else's"],
)
def test_what_is_no_piece_holds_nothing(
    pieces: list[list[float]], pixels: list[float], taken: NDArray[np.float64]
) -> None:
    assert (
        held_by_pieces(
            BOX, np.array(pieces, float), np.array(pixels, float), taken, PartsParameters()
        )
        is None
    )
