"""Components and ellipses against what is drawn, and against OpenCV's own labels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from recorders.masks import has_few_labels, label_blobs
from recorders.segmentation import blobs as module
from recorders.segmentation.blobs import components, ellipse_of, numbered
from recorders.vision import cv2
from tests.examples import examples


def filled_ellipse(
    cx: float, cy: float, h: float, w: float, theta: float, size: int = 200
) -> np.ndarray:
    y, x = np.mgrid[0:size, 0:size] + 0.5
    along = (x - cx) * math.cos(theta) + (y - cy) * math.sin(theta)
    across = -(x - cx) * math.sin(theta) + (y - cy) * math.cos(theta)
    return (((along / (h / 2)) ** 2 + (across / (w / 2)) ** 2) <= 1).astype(
        np.uint8
    ) * np.uint8(255)


@pytest.mark.parametrize("theta", [-1.2, -0.7, 0.0, 0.4, 1.0, math.pi / 2])
def test_the_ellipse_of_a_drawn_ellipse_is_that_ellipse(theta: float) -> None:
    e = ellipse_of(filled_ellipse(97.3, 104.8, 80.0, 36.0, theta))
    assert (e.x, e.y) == pytest.approx((97.3, 104.8), abs=0.15)
    assert (e.h, e.w) == pytest.approx((80.0, 36.0), rel=0.01)
    assert math.cos(2 * (e.theta - theta)) == pytest.approx(1.0, abs=1e-3)
    assert -math.pi / 2 < e.theta <= math.pi / 2


def test_the_ellipse_follows_the_formulas_to_the_letter() -> None:
    mask = np.random.default_rng(5).integers(0, 2, (13, 29), dtype=np.uint8)
    y, x = np.nonzero(mask)
    sxx, syy = x.var(), y.var()
    sxy = ((x - x.mean()) * (y - y.mean())).mean()
    small, large = np.linalg.eigvalsh([[sxx, sxy], [sxy, syy]])
    e = ellipse_of(mask, left=10, top=20)
    assert (e.x, e.y) == pytest.approx((x.mean() + 10.5, y.mean() + 20.5))
    assert (e.h, e.w) == pytest.approx((4 * math.sqrt(large), 4 * math.sqrt(small)))
    assert e.theta == pytest.approx(math.atan2(2 * sxy, sxx - syy) / 2)


def test_an_upright_line_has_the_angle_pi_half_and_no_width() -> None:
    e = ellipse_of(np.full((9, 1), 255, np.uint8))
    assert e.theta == pytest.approx(math.pi / 2)
    assert e.w == 0.0


@settings(max_examples=examples(60), deadline=None)
@given(
    seed=st.integers(0, 10_000),
    shape=st.tuples(st.integers(1, 70), st.integers(1, 90)),
    blur=st.integers(0, 3),
    least=st.integers(0, 30),
)
def test_blob_ids_are_the_labels_of_the_mask_that_is_kept(
    seed: int, shape: tuple[int, int], blur: int, least: int
) -> None:
    noise = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    level = 128
    if blur:
        width = 2 * blur + 1
        noise = np.asarray(cv2.GaussianBlur(noise, (width, width), 0), np.uint8)
        level = 134
    mask = (noise > level).astype(np.uint8) * np.uint8(255)
    kept, labels, found = components(mask, least)
    count, expected = cv2.connectedComponents(kept, connectivity=8)
    assert [b.id for b in found] == list(range(1, count))
    assert np.array_equal(labels, expected)
    assert np.array_equal(kept > 0, expected > 0)
    for b in found:
        own = expected == b.id
        assert b.area == own.sum() >= least
        y, x = np.nonzero(own)
        assert b.box == (x.min(), y.min(), x.max() - x.min() + 1, y.max() - y.min() + 1)


def test_the_size_filter_drops_the_small_and_keeps_the_rest_untouched() -> None:
    mask = np.zeros((40, 60), np.uint8)
    mask[3:6, 3:6] = 255
    mask[10:30, 20:30] = 255
    kept, labels, found = components(mask, 10)
    assert [b.area for b in found] == [200]
    assert kept[4, 4] == 0
    assert labels[4, 4] == 0
    assert np.array_equal(kept[10:30, 20:30], mask[10:30, 20:30])


def test_small_pieces_stay_where_most_of_them_was_foreground_before() -> None:
    mask, before = np.zeros((40, 80), np.uint8), np.zeros((40, 80), np.uint8)
    mask[5:9, 5:9] = mask[5:9, 25:29] = mask[5:9, 45:49] = 255
    mask[5:6, 65:67] = 255
    before[4:20, 4:20] = before[4:20, 28:40] = before[4:20, 60:70] = 255
    # The first lay in foreground, the second by a quarter, the third not at all; the last is too
    # small for a piece.
    _, _, found = components(mask, 40, before)
    assert [b.box for b in found] == [(5, 5, 4, 4)]
    assert components(mask, 40)[2] == []
    before[:] = 255
    assert [b.area for b in components(mask, 40, before)[2]] == [16, 16, 16]


def test_nothing_gives_nothing() -> None:
    kept, labels, found = components(np.zeros((5, 7), np.uint8), 1)
    assert not kept.any()
    assert not labels.any()
    assert found == []


def test_of_very_many_components_the_largest_are_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "MOST_BLOBS", 3)
    mask = np.zeros((10, 60), np.uint8)
    for k, size in enumerate([1, 4, 2, 5, 3, 1]):
        mask[2 : 2 + size, 8 * k] = 255
    _, _, found = components(mask, 0)
    assert [b.area for b in found] == [4, 5, 3]


def _bodies(height: int, width: int) -> NDArray[np.uint8]:
    """A picture with large, holed bodies: more pixels than 16 bits count, few pieces."""
    rng = np.random.default_rng(height)
    mask = np.zeros((height, width), np.uint8)
    for x, y in rng.integers(0, (width, height), (12, 2)).tolist():
        cv2.ellipse(mask, (x, y), (60, 150), float(x % 90), 0, 360, 255, -1)
    mask[rng.random(mask.shape) < 0.05] = 0
    return mask


def _dots(every: int) -> NDArray[np.uint8]:
    mask = np.zeros((1080, 1920), np.uint8)
    mask[::every, ::every] = 255
    return mask


@pytest.mark.parametrize(
    ("mask", "few"),
    [
        (_bodies(1080, 1920), True),
        (_bodies(600, 1500), True),
        (_dots(8), True),
        (_dots(4), False),
        (_dots(2), False),
        (np.full((1080, 1920), 255, np.uint8), True),
    ],
    ids=[
        "bodies",
        "holes",
        "dots",
        "more dots than 16 bits",
        "as many as there are",
        "all",
    ],
)
def test_large_masks_are_labelled_as_in_32_bits(mask: NDArray[np.uint8], few: bool) -> None:
    assert has_few_labels(mask) == few
    count, labels, stats, _ = cv2.connectedComponentsWithStatsWithAlgorithm(
        mask, 8, cv2.CV_32S, cv2.CCL_BBDT
    )
    found, left, top, rows = numbered(mask)
    inside = labels[top : top + found.shape[0], left : left + found.shape[1]]
    np.testing.assert_array_equal(found, inside)
    np.testing.assert_array_equal(rows, stats[1:])
    blobs, painted = label_blobs(mask)
    if count < 1 << 16:
        assert blobs == count - 1
        np.testing.assert_array_equal(painted, labels)
