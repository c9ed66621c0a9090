"""The motion segmenter on generated scenes with exact truth, and on a real one."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fixtures.scenes import GeneratedScene, generate
from fixtures.surroundings import surrounded
from recorders.messages import Box, to_json
from recorders.pictures import Image
from recorders.segmentation import SEGMENTERS, SegmentationParameters, Segmenter
from recorders.segmentation.change.scenery import Scenery
from recorders.segmentation.segmenter import as_image
from recorders.sources import open_source
from recorders.vision import cv2

Walkers = tuple[GeneratedScene, list[Image]]


def make(scene_or_size: Any, kind: str = "motion", **values: Any) -> Segmenter:
    if isinstance(scene_or_size, tuple):
        width, height, fps = scene_or_size
    else:
        width, height, fps = scene_or_size.width, scene_or_size.height, scene_or_size.fps
    return SEGMENTERS[kind](SegmentationParameters(**values), width, height, fps)


def pictures(scene: GeneratedScene) -> list[Image]:
    return [image for _, _, image in scene.frames()]


def iou(a: Box, b: Box) -> float:
    ax, ay, aw, ah = a
    bx, by, bw, bh = b
    w = min(ax + aw, bx + bw) - max(ax, bx)
    h = min(ay + ah, by + bh) - max(ay, by)
    return w * h / (aw * ah + bw * bh - w * h) if w > 0 and h > 0 else 0.0


def matched(found: Sequence[Box], truth: Sequence[Box], least: float = 0.5) -> int:
    """How many of two lists of boxes can be paired, greedily from the best pair on."""
    pairs = sorted(
        ((iou(f, t), i, j) for i, f in enumerate(found) for j, t in enumerate(truth)),
        reverse=True,
    )
    left, right = set[int](), set[int]()
    for value, i, j in pairs:
        if value >= least and i not in left and j not in right:
            left.add(i)
            right.add(j)
    return len(left)


def digest(segmenter: Segmenter, images: Iterable[Image]) -> list[tuple[bytes, bytes]]:
    return [
        (s.mask.tobytes(), to_json(s.detections))
        for s in map(segmenter.segment, itertools.count(), images)
    ]


@pytest.fixture(scope="module")
def walkers() -> tuple[GeneratedScene, list[Image]]:
    scene = generate("pass_by", frames=90)
    return scene, pictures(scene)


@pytest.mark.parametrize("kind", sorted(SEGMENTERS))
def test_every_segmenter_answers_in_the_same_shape(kind: str, walkers: Walkers) -> None:
    scene, images = walkers
    segmenter = make(scene, kind)
    assert isinstance(segmenter, Segmenter)
    for index, image in enumerate(images[60:66]):
        got = segmenter.segment(index, image)
        d = got.detections
        assert got.mask.shape == (scene.height, scene.width)
        assert set(np.unique(got.mask)) <= {0, 255}
        assert (d.frame, d.width, d.height) == (index, scene.width, scene.height)
        assert (
            len(d.boxes)
            == len(d.scores)
            == len(d.labels)
            == len(d.ellipses)
            == len(d.blobs)
        )
        assert all(0 <= s <= 1 for s in d.scores)
        assert all(
            x >= 0 and y >= 0 and x + w <= d.width and y + h <= d.height
            for x, y, w, h in d.boxes
        )
        count, labels = cv2.connectedComponents(got.mask, connectivity=8)
        assert [c.id for c in d.components] == list(range(1, count))
        assert [c.area for c in d.components] == np.bincount(labels.ravel())[1:].tolist()
        assert set(d.blobs) <= set(range(-1, count)) - {0}


@pytest.mark.parametrize("kind", sorted(SEGMENTERS))
@pytest.mark.parametrize("prepared", [True, False])
def test_the_answers_do_not_depend_on_threads_or_run(
    kind: str, prepared: bool, walkers: Walkers
) -> None:
    scene, images = walkers
    results = []
    before = cv2.getNumThreads()
    try:
        for threads in (1, 4):
            cv2.setNumThreads(threads)
            segmenter = make(scene, kind)
            if prepared:
                segmenter.prepare(iter(images[::3]))
            results.append(digest(segmenter, images[40:70:3]))
    finally:
        cv2.setNumThreads(before)
    assert results[0] == results[1]


@pytest.mark.parametrize("script", ["pass_by", "full_occlusion", "fight"])
def test_people_are_found_without_their_shadows(script: str) -> None:
    scene = generate(script, frames=200)
    images = pictures(scene)
    segmenter = make(scene)
    segmenter.prepare(iter(images))
    hits = found = wanted = 0
    for index in range(0, 200, 4):
        boxes = segmenter.segment(index, images[index]).detections.boxes
        truth = [a.box for a in scene.truth.frames[index].actors if a.visibility > 0.5]
        hits += matched(boxes, truth)
        found += len(boxes)
        wanted += len(truth)
    assert hits / found >= 0.9
    assert hits / wanted >= 0.85


def test_touching_fish_are_told_apart_by_their_area() -> None:
    scene = generate("three_fish", frames=200)
    images = pictures(scene)
    segmenter = make(scene)
    segmenter.prepare(iter(images))
    hits = wanted = merged = 0
    for index in range(0, 200, 3):
        d = segmenter.segment(index, images[index]).detections
        truth = [a.box for a in scene.truth.frames[index].actors if a.visibility > 0.5]
        hits += matched(d.boxes, truth, 0.3)
        wanted += len(truth)
        merged += len(d.boxes) > len(d.components)
        assert d.size_model == []
    assert merged > 0
    assert hits / wanted >= 0.9


def still_life(
    frames: int,
    person: tuple[int, int, int, int] = (30, 20, 60, 40),
    until: int | None = None,
    shadow: bool = True,
) -> Iterator[Image]:
    """A textured ground where something stands until it is gone; shape (top, left, bottom,
    right).
    """
    rng = np.random.default_rng(4)
    ground = cv2.GaussianBlur(
        rng.integers(90, 170, (120, 160, 3), dtype=np.uint8), (5, 5), 0
    )
    for k in range(frames):
        image = ground.copy()
        if until is None or k < until:
            top, left, bottom, right = person
            if shadow:
                image[bottom - 4 : bottom + 6, right : right + 30] = (
                    ground[bottom - 4 : bottom + 6, right : right + 30] * 0.7
                )
            image[top:bottom, left:right] = (30, 40, 200)
        noise = rng.integers(0, 3, image.shape, dtype=np.uint8)
        yield np.asarray(cv2.add(image, np.asarray(noise)), np.uint8)


def test_hindsight_finds_who_stands_still_from_the_first_frame_and_leaves_no_ghost() -> (
    None
):
    images = list(still_life(60, until=25))
    segmenter = make((160, 120, 10.0))
    segmenter.prepare(iter(images))
    masks = [segmenter.segment(k, image).mask for k, image in enumerate(images)]
    assert masks[0][32:58, 22:38].all()
    assert masks[24][32:58, 22:38].all()
    assert not masks[25].any()


def test_shadows_are_removed_unless_they_are_wanted() -> None:
    images = list(still_life(60, until=25))
    shadow = np.s_[58:64, 45:65]
    with_shadow = make((160, 120, 10.0), shadow_darkest=1.0)
    without = make((160, 120, 10.0))
    for segmenter in (with_shadow, without):
        segmenter.prepare(iter(images))
    assert with_shadow.segment(0, images[0]).mask[shadow].mean() > 200
    assert not without.segment(0, images[0]).mask[shadow].any()


def test_without_a_first_reading_movement_is_found_from_the_second_sight_on() -> None:
    scene = generate("pass_by", frames=150)
    images = pictures(scene)
    segmenter = make(scene)
    results = [segmenter.segment(k, image).detections for k, image in enumerate(images)]
    assert results[0].boxes == []
    truth = [a.box for a in scene.truth.frames[80].actors]
    assert matched(results[80].boxes, truth, 0.4) >= len(truth) - 1


def test_the_size_filter_is_relative_to_the_picture() -> None:
    images = list(still_life(30, until=10, shadow=False))
    area = 30 * 20 / (160 * 120)
    for share, expected in ((0.5 * area, 1), (1.5 * area, 0)):
        segmenter = make((160, 120, 10.0), min_area=share)
        segmenter.prepare(iter(images))
        assert len(segmenter.segment(0, images[0]).detections.components) == expected


@pytest.mark.parametrize("kind", sorted(SEGMENTERS))
@pytest.mark.parametrize("size", [(1, 1), (3, 2), (16, 9), (31, 64)])
def test_tiny_pictures_are_no_trouble(kind: str, size: tuple[int, int]) -> None:
    width, height = size
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (height, width, 3), dtype=np.uint8) for _ in range(12)]
    for prepared in (True, False):
        segmenter = make((width, height, 25.0), kind)
        if prepared:
            segmenter.prepare(iter(images))
        for k, image in enumerate(images):
            assert segmenter.segment(k, image).mask.shape == (height, width)


@pytest.mark.parametrize("kind", sorted(SEGMENTERS))
def test_a_first_reading_of_nothing_or_of_one_frame_is_as_good_as_none(kind: str) -> None:
    images = list(still_life(3, until=1))
    for readings in ([], images[:1]):
        segmenter = make((160, 120, 10.0), kind)
        segmenter.prepare(iter(readings))
        assert segmenter.segment(0, images[0]).detections.frame == 0
        assert segmenter.segment(1, images[1]).mask.shape == (120, 160)


def test_an_empty_scene_is_empty() -> None:
    scene = generate("empty_scene", frames=30)
    images = pictures(scene)
    segmenter = make(scene)
    segmenter.prepare(iter(images))
    for k, image in enumerate(images):
        got = segmenter.segment(k, image)
        assert not got.mask.any()
        assert got.detections.boxes == []


def test_an_unknown_frame_rate_is_no_trouble() -> None:
    images = list(still_life(5))
    segmenter = make((160, 120, 0.0))
    for k, image in enumerate(images):
        segmenter.segment(k, image)


@pytest.mark.parametrize("prepared", [True, False])
def test_densities_find_what_motion_finds(prepared: bool) -> None:
    scene = generate("pass_by", frames=150)
    images = pictures(scene)
    segmenter = make(scene, "density")
    if prepared:
        segmenter.prepare(iter(images))
    hits = wanted = 0
    for index, image in enumerate(images):
        boxes = segmenter.segment(index, image).detections.boxes
        if index >= 60:
            truth = [a.box for a in scene.truth.frames[index].actors if a.visibility > 0.5]
            hits += matched(boxes, truth, 0.4)
            wanted += len(truth)
    assert hits / wanted >= 0.85


@pytest.mark.real
def test_people_of_the_pets_recording_are_found(real_data: Path) -> None:
    folder = real_data / "pets09-s2l1"
    truth: dict[int, list[Box]] = {}
    for line in (folder / "gt.txt").read_text().splitlines():
        v = [float(x) for x in line.split(",")]
        if v[6] != 0:
            x, y, w, h = (0.625 * u for u in v[2:6])
            truth.setdefault(int(v[0]) - 1, []).append((x, y, w, h))
    images = [
        np.asarray(frame.image)
        for frame in itertools.islice(
            open_source(folder / "video.avi", fps=7).frames(), 300
        )
    ]
    segmenter = make((480, 360, 7.0))
    segmenter.prepare(iter(images))
    hits = close = found = wanted = 0
    for index, image in enumerate(images):
        boxes = segmenter.segment(index, image).detections.boxes
        hits += matched(boxes, truth[index])
        close += matched(boxes, truth[index], 0.3)
        found += len(boxes)
        wanted += len(truth[index])
    assert hits / found >= 0.74
    assert hits / wanted >= 0.85
    assert close / wanted >= 0.90


def found_share(scene: GeneratedScene, images: Any) -> tuple[float, float]:
    """The share of the true boxes that a segmenter finds, and of what it finds that is true."""
    segmenter = make(scene)
    segmenter.prepare(images)
    right = wanted = found = 0
    for index, (image, true) in enumerate(zip(images, scene.truth.frames, strict=True)):
        boxes = segmenter.segment(index, image).detections.boxes
        truth = [a.box for a in true.actors if a.visibility > 0.5]
        right, wanted, found = (
            right + matched(boxes, truth),
            wanted + len(truth),
            found + len(boxes),
        )
    return right / wanted, right / found


def test_light_is_told_without_the_grain() -> None:
    """Medians over single noisy pixels make a curve of light where there is none."""
    scene = surrounded("dark_windows", seed=1, size=(240, 180))
    noise = np.random.default_rng(0)
    stack = []
    for k in range(0, scene.frame_count, 6):
        noisy = scene.image(k) + noise.normal(0, 9, (180, 240, 3))
        image = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        stack.append(as_image(cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb)))
    scenery = Scenery(SegmentationParameters(), scene.fps)
    assert scenery.learn(stack)
    assert scenery.grainy
    view = scenery.of_sample(0)
    assert view is not None
    assert np.median(view.background.level) < 40


def test_people_are_found_in_noise_and_without_colours(walkers: Walkers) -> None:
    scene, images = walkers
    clean, _ = found_share(scene, images)
    noise = [
        np.random.default_rng(k).normal(0, 7, image.shape) for k, image in enumerate(images)
    ]
    noisy = [
        np.clip(np.rint(i + n), 0, 255).astype(np.uint8)
        for i, n in zip(images, noise, strict=True)
    ]
    grey = [
        cv2.cvtColor(cv2.cvtColor(i, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
        for i in images
    ]
    for altered in (noisy, grey):
        recall, precision = found_share(scene, altered)
        assert recall >= clean - 0.1
        assert precision >= 0.9
