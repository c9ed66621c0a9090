"""What happens to real cameras is told once, and bodies are found through it: each disturbance of a
generated street against the same street undisturbed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import cast

import numpy as np
import pytest

from fixtures.disturbed import FPS, HEIGHT, WIDTH, dimmed, grey, picture, place, walk
from recorders.evidence import unlike
from recorders.messages import CHANGES, SceneChange
from recorders.pictures import Image
from recorders.segmentation.change.landmarks import LandmarkSight, Reference, Shift
from recorders.segmentation.change.views import CameraPlace, find, shows
from recorders.segmentation.motion import MotionSegmenter
from recorders.segmentation.parameters import SegmentationParameters

FRAMES, HALF = 120, 60


def run(
    pictures: Iterable[Image], *, prepared: bool = True
) -> tuple[list[Image], list[SceneChange]]:
    """Masks and what was told."""
    kept = list(pictures)
    segmenter = MotionSegmenter(SegmentationParameters(), WIDTH, HEIGHT, FPS)
    if prepared:
        segmenter.prepare(iter(kept[::2]))
    masks: list[Image] = []
    told: list[SceneChange] = []
    for k, image in enumerate(kept):
        masks.append(segmenter.segment(k, image).mask)
        told += segmenter.changes()
    for change in told:
        assert change.kind in CHANGES
        said = {"kind": change.kind, **change.evidence}
        assert not unlike("scene_changed", said)
        assert change.text.endswith(".")
    return masks, told


def kinds(told: list[SceneChange]) -> list[str]:
    return [change.kind for change in told]


@pytest.fixture(scope="module")
def undisturbed() -> list[Image]:
    masks, told = run(walk(FRAMES))
    assert told == []
    return masks


def overlap(a: Image, b: Image) -> float:
    either = np.count_nonzero((a > 0) | (b > 0))
    return np.count_nonzero((a > 0) & (b > 0)) / either if either else 1.0


def alike(masks: list[Image], others: list[Image], frames: Iterable[int]) -> float:
    return float(np.median([overlap(masks[k], others[k]) for k in frames]))


def test_a_bump_is_told_in_pixels_and_masks_stay_in_the_pictures_own_place(
    undisturbed: list[Image],
) -> None:
    ground = place()
    masks, told = run(
        picture(ground, k, right=-5 if k >= HALF else 0, down=3 if k >= HALF else 0)
        for k in range(FRAMES)
    )
    assert kinds(told) == ["moved"]
    evidence = told[0].evidence
    assert (evidence["right_px"], evidence["down_px"]) == (5, -3)
    assert evidence["since_frame"] == HALF
    assert "5 pixels further right and 3 pixels further up" in told[0].text
    moved = [np.roll(mask, (-3, 5), (0, 1)) for mask in undisturbed]
    assert alike(masks, moved, range(HALF, FRAMES)) > 0.8


def test_where_a_bump_is_of_whole_pixels_nothing_is_lost_by_it() -> None:
    """Thin bodies, no brighter or darker than the busy ground around them: as without the bump."""
    rng = np.random.default_rng(5)
    busy = np.repeat(np.repeat(rng.integers(60, 200, (75, 90, 3), np.uint8), 4, 0), 4, 1)

    def spokes(k: int, right: int) -> Image:
        seen = busy.copy()
        for x in range(60 + 3 * k % 200, 60 + 3 * k % 200 + 24, 6):
            seen[100:150, x : x + 3] = 130
        return np.ascontiguousarray(seen[60 : 60 + HEIGHT, 60 + right : 60 + right + WIDTH])

    still, _ = run(spokes(k, 0) for k in range(FRAMES))
    bumped, told = run(spokes(k, -4 if k >= HALF else 0) for k in range(FRAMES))
    assert kinds(told) == ["moved"]
    assert all(np.count_nonzero(still[k]) for k in range(10, 20))
    assert alike(bumped, still, range(HALF)) > 0.95


def test_a_shake_is_compensated_and_no_move(undisturbed: list[Image]) -> None:
    rng = np.random.default_rng(1)
    shakes = rng.integers(-2, 3, (FRAMES, 2)).tolist()
    ground = place()
    masks, told = run(
        picture(ground, k, right=x, down=y) for k, (x, y) in enumerate(shakes)
    )
    assert told == []
    still = [
        np.roll(mask, (y, x), (0, 1)) for mask, (x, y) in zip(masks, shakes, strict=True)
    ]
    assert alike(still, undisturbed, range(FRAMES)) > 0.75


def light_curve(image: Image) -> Image:
    table = np.rint(255 * (np.arange(256) / 255) ** 1.6).astype(np.uint8)
    return table[image]


@pytest.mark.parametrize(
    ("altered", "level"),
    [
        (lambda image: dimmed(image, 0.6), 0.6),
        (lambda image: dimmed(image, 1.25), 1.25),
        (light_curve, 0.64),
    ],
)
def test_light_that_falls_and_comes_back_is_told_twice(
    undisturbed: list[Image], altered: Callable[[Image], Image], level: float
) -> None:
    masks, told = run(
        altered(image) if HALF <= k < HALF + 30 else image
        for k, image in enumerate(walk(FRAMES))
    )
    assert kinds(told) == ["light", "light"]
    assert told[0].evidence["light"] == pytest.approx(level, abs=0.06)
    assert told[1].evidence["light"] == pytest.approx(1.0, abs=0.05)
    assert told[0].evidence["since_frame"] == HALF
    assert alike(masks, undisturbed, range(HALF, HALF + 30)) > 0.7


def test_a_passing_change_of_the_light_does_not_stay_in_the_background(
    undisturbed: list[Image],
) -> None:
    """While it lasts, a background that follows quickly takes up nothing of it."""
    kept = [
        dimmed(image, 0.6 if 15 <= k < 60 else 1) for k, image in enumerate(walk(FRAMES))
    ]
    quick = SegmentationParameters(adaptation_s=0.2)
    segmenter = MotionSegmenter(quick, WIDTH, HEIGHT, FPS)
    segmenter.prepare(iter(kept[::2]))
    masks = [segmenter.segment(k, image).mask for k, image in enumerate(kept)]
    afterwards = range(60, 75)
    assert all(np.count_nonzero(undisturbed[k]) for k in afterwards)
    assert alike(masks, undisturbed, afterwards) > 0.8


def warmer(image: Image, blue: float) -> Image:
    """Another lamp, or white balance: blue and red change by curves of their own."""
    v = np.arange(256) / 255
    curves = np.rint(255 * np.stack([v**blue, v, v ** (1 / blue)], -1))
    return np.asarray(np.stack([curves[image[..., c], c] for c in range(3)], -1), np.uint8)


@pytest.mark.parametrize(("blue", "hue"), [(1.5, "yellower"), (0.7, "bluer")])
def test_another_colour_of_the_light_is_told_and_bodies_are_found_in_it(
    undisturbed: list[Image], blue: float, hue: str
) -> None:
    masks, told = run(
        warmer(image, blue) if HALF <= k < HALF + 30 else image
        for k, image in enumerate(walk(FRAMES))
    )
    assert kinds(told) == ["light", "light"]
    assert told[0].evidence["since_frame"] == HALF
    assert hue in told[0].text
    assert hue not in told[1].text
    assert alike(masks, undisturbed, range(HALF, HALF + 30)) > 0.7
    assert alike(masks, undisturbed, range(HALF + 30, FRAMES)) > 0.8


def test_a_view_is_known_by_its_brightness_alone_under_a_curve_of_light() -> None:
    """Where none of its landmarks is seen, the light against a picture in grey is asked."""
    rng = np.random.default_rng(0)
    luma = np.repeat(np.repeat(rng.integers(10, 240, (24, 32), np.uint8), 10, 0), 10, 1)
    lit = np.rint(255 * (luma / 255.0) ** 2).astype(np.uint8)
    neutral = np.full_like(lit, 128)
    assert Reference(luma).agrees(np.stack([lit, neutral, neutral], -1))
    assert not Reference(luma).agrees(np.stack([lit[::-1].copy(), neutral, neutral], -1))


def test_windows_in_a_row_are_not_taken_for_their_neighbours() -> None:
    """Half of the landmarks look the same a few pixels aside; the other half tells."""
    rng = np.random.default_rng(2)
    luma = np.repeat(np.repeat(rng.integers(40, 220, (60, 80), np.uint8), 4, 0), 4, 1)
    bars = np.arange(320) % 8 < 3
    luma[:120] = np.where(bars, 60, 140) + 20 * (np.arange(120)[:, None] % 20 < 10)
    neutral = np.full_like(luma, 128)
    moved = np.stack([np.roll(luma, -8, 1), neutral, neutral], -1)
    seen = CameraPlace(0, Reference(luma))
    unmoved = seen.reference.sight(moved, (0, 0))
    assert shows(unmoved)
    assert unmoved.still
    shift, sight = find(moved, seen, (0, 0))
    assert shift == (-8, 0)
    assert sight.share > 0.9


class Shown:
    """A view of which a picture shows some landmarks unmoved, and others a pixel aside."""

    def __init__(self, unmoved: float, aside: float) -> None:
        self._unmoved, self._aside = unmoved, aside

    def sight(self, *_: object) -> LandmarkSight:
        return LandmarkSight(self._unmoved, 20.0, (0.0, 0.0), np.zeros(0, bool))

    def near(self, *_: object) -> tuple[Shift, LandmarkSight]:
        return (0, 1), LandmarkSight(self._aside, 21.0, (0.0, 0.0), np.zeros(0, bool))

    around = near

    def within(self, _: Shift) -> bool:
        return True


@pytest.mark.parametrize(
    ("unmoved", "aside", "shift"),
    [(0.5, 0.55, (0, 0)), (0.5, 0.7, (0, 1)), (0.2, 0.22, (0, 1))],
    ids=["bodies cover some", "clearly more there", "not seen at all here"],
)
def test_a_camera_behind_bodies_is_not_moved_by_chance(
    unmoved: float, aside: float, shift: Shift
) -> None:
    shown = cast("Reference", Shown(unmoved, aside))
    found, _ = find(place(), CameraPlace(0, shown), (0, 0))
    assert found == shift


def test_an_exposure_that_wanders_is_no_switch(undisturbed: list[Image]) -> None:
    masks, told = run(
        dimmed(image, 1 + 0.12 * np.sin(k / 15)) for k, image in enumerate(walk(FRAMES))
    )
    assert told == []
    assert alike(masks, undisturbed, range(FRAMES)) > 0.7


@pytest.mark.parametrize("frames", [60, 6])
def test_grey_is_told_and_bodies_are_found_in_it(
    undisturbed: list[Image], frames: int
) -> None:
    """In half of the recording, and where too little of it is grey for a background of its own."""
    masks, told = run(
        grey(image) if HALF <= k < HALF + frames else image
        for k, image in enumerate(walk(FRAMES))
    )
    assert kinds(told) == ["infrared", "colour"][: 1 if frames == 60 else 2]
    assert told[0].evidence["since_frame"] == HALF
    assert alike(masks, undisturbed, range(HALF, HALF + frames)) > 0.5
    assert max(np.count_nonzero(m) for m in masks[HALF:]) < 0.1 * WIDTH * HEIGHT


@pytest.mark.parametrize("colour", [(0, 0, 0), (200, 40, 20)])
def test_a_lost_signal_has_no_bodies_and_comes_back(
    undisturbed: list[Image], colour: tuple[int, int, int]
) -> None:
    slate = np.full((HEIGHT, WIDTH, 3), colour, np.uint8)
    masks, told = run(
        slate if HALF <= k < HALF + 20 else image for k, image in enumerate(walk(FRAMES))
    )
    assert kinds(told) == ["signal_lost", "signal_back"]
    assert told[1].evidence["lost_s"] == 2.0
    assert not any(mask.any() for mask in masks[HALF : HALF + 20])
    assert alike(masks, undisturbed, range(HALF + 20, FRAMES)) > 0.9


def test_a_frozen_picture_is_told() -> None:
    pictures = list(walk(FRAMES))
    pictures[HALF : HALF + 40] = [pictures[HALF]] * 40
    told = run(pictures)[1]
    assert kinds(told) == ["frozen", "signal_back"]
    assert told[1].evidence["lost_s"] == 3.9


@pytest.mark.parametrize("prepared", [True, False])
def test_a_pan_floods_nothing_and_the_new_view_is_learnt(prepared: bool) -> None:
    ground = place()
    frames = 200
    where = [min(56, max(0, k - 80) * 4) for k in range(frames)]
    masks, told = run(
        (picture(ground, k, right=-x) for k, x in enumerate(where)), prepared=prepared
    )
    assert kinds(told) == ["panned", "panned"]
    assert told[0].evidence["view"] is None
    assert told[-1].evidence["view"] not in (None, 0)
    shares = [np.count_nonzero(mask) / mask.size for mask in masks]
    assert max(shares[20:]) < 0.12
    assert np.median(shares[-60:]) > 0.005


def test_live_a_bump_and_a_grey_picture_are_told_as_well() -> None:
    ground = place()
    masks, told = run(
        (
            grey(picture(ground, k, right=-4))
            if k >= 90
            else picture(ground, k, right=-4 if k >= HALF else 0)
            for k in range(FRAMES)
        ),
        prepared=False,
    )
    assert kinds(told) == ["moved", "infrared"]
    assert max(np.count_nonzero(m) / m.size for m in masks[20:]) < 0.12


def test_something_coloured_that_passes_a_grey_view_is_no_change() -> None:
    def passed(k: int, image: Image) -> Image:
        shown = grey(image)
        if 50 <= k < 80:
            x = 4 * (k - 50)
            shown[60:120, x : x + 60] = (30, 40, 200)
        return shown

    told = run(passed(k, image) for k, image in enumerate(walk(FRAMES)))[1]
    assert [change for change in told if change.kind in ("infrared", "colour")] == []


def test_live_an_even_ground_is_a_view_and_no_lost_signal() -> None:
    def tank(k: int) -> Image:
        image = np.full((HEIGHT, WIDTH, 3), 210, np.uint8)
        x = 20 + 2 * k % 180
        image[80:100, x : x + 30] = (40, 60, 60)
        return image

    masks, told = run((tank(k) for k in range(60)), prepared=False)
    assert told == []
    assert all(mask.any() for mask in masks[20:])


def test_in_the_dark_a_picture_is_not_without_signal(undisturbed: list[Image]) -> None:
    masks, told = run(
        dimmed(image, 0.2) if HALF <= k < HALF + 30 else image
        for k, image in enumerate(walk(FRAMES))
    )
    assert kinds(told) == ["light", "light"]
    assert alike(masks, undisturbed, range(HALF, HALF + 30)) > 0.5


def lit_and_moved(pictures: Iterable[Image]) -> list[tuple[list[float], list[int]]]:
    """What each frame's detections say of the picture."""
    kept = list(pictures)
    segmenter = MotionSegmenter(SegmentationParameters(), WIDTH, HEIGHT, FPS)
    segmenter.prepare(iter(kept[::2]))
    found = [segmenter.segment(k, image).detections for k, image in enumerate(kept)]
    return [(d.light, d.moved) for d in found]


def test_detections_say_in_what_light_they_were_seen() -> None:
    said = lit_and_moved(
        dimmed(image, 0.5) if k >= HALF else image for k, image in enumerate(walk(FRAMES))
    )
    assert all(light == [] for light, _ in said[:HALF])
    assert all(abs(v - 0.5) < 0.05 for light, _ in said[HALF:] for v in light)
    assert all(len(light) == 3 for light, _ in said[HALF:])


def test_detections_say_how_far_the_picture_moved_also_while_the_camera_turns() -> None:
    ground = place()
    where = [min(56, max(0, k - 80) * 4) for k in range(160)]
    said = lit_and_moved(picture(ground, k, right=-x) for k, x in enumerate(where))
    moved = [by for _, by in said]
    turning = range(82, 94)
    assert [by for by in moved[:80] if by] == []
    assert sum(by == [-4, 0] or by == [4, 0] for by in (moved[k] for k in turning)) >= 10
    assert len({by[0] for by in moved if by}) == 1
