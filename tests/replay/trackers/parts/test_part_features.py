"""Regions, features, scores, heads, templates of the part model, each against what can be counted
by hand.
"""

from __future__ import annotations

import numpy as np
import pytest

from fixtures.scenes import generate
from fixtures.truth import PARTS as TRUE_PARTS
from recorders.errors import ConfigError
from recorders.vision import cv2
from replay.trackers.parts.beginning import parse_init
from replay.trackers.parts.features import (
    FURTHEST,
    MASS,
    ONE,
    Measured,
    PartsModel,
    Pixels,
    differences,
    measure,
)
from replay.trackers.parts.heads import (
    CLEAR_PX,
    HEAD,
    ColourShapeHeads,
    HeadColours,
    colour_table,
    likelihood,
)
from replay.trackers.parts.regions import PARTS, alpha_of, beta_of, covered, hung, parts_of
from replay.trackers.parts.scoring import FULL, PartFeatures, Scorer, density, tabulated
from replay.trackers.parts.template import SIDE, distances, patches, refine
from replay.trackers.parts.typical import Typical

BOX = np.array([[40.0, 20.0, 28.0, 70.0]])


def body(width: int = 120, height: int = 110) -> tuple[np.ndarray, np.ndarray]:
    """A picture and mask with a body of five colours in `BOX`."""
    image = np.full((height, width, 3), 120, np.uint8)
    mask = np.zeros((height, width), np.uint8)
    colours = ((20, 20, 20), (200, 40, 40), (40, 200, 40), (40, 40, 200), (200, 200, 40))
    for (x, y, w, h), colour in zip(
        parts_of(BOX, np.array([0.5]), np.array([0.4]))[0], colours, strict=True
    ):
        image[round(y) : round(y + h), round(x) : round(x + w)] = colour
        mask[round(y) : round(y + h), round(x) : round(x + w)] = 255
    return image, mask


def moved(dx: float, dy: float) -> np.ndarray:
    return BOX + np.array([[dx, dy, 0.0, 0.0]])


def measured(
    image: np.ndarray | None,
    mask: np.ndarray | None,
    boxes: np.ndarray,
    size: tuple[int, int] = (120, 110),
    *,
    grey: bool = False,
) -> Measured:
    half = np.full(len(boxes), 0.5), np.full(len(boxes), 0.4)
    parts, own = parts_of(boxes, *half), parts_of(np.repeat(BOX, len(boxes), 0), *half)
    pixels = Pixels(image, mask, size)
    pixels.grey = grey
    return measure(pixels, parts, own, own, np.full(len(boxes), 20.0))


def learnt(m: Measured) -> PartsModel:
    model = PartsModel.empty(1)
    row = np.zeros(1, np.intp)
    model.learn(row, m, row, np.full((1, 5, 6), ONE, np.int64))
    return model


def test_the_parts_are_those_of_the_truth_and_fill_the_box() -> None:
    assert PARTS == TRUE_PARTS
    parts = parts_of(BOX, np.array([0.5]), np.array([0.4]))[0]
    assert (parts[:, 2] * parts[:, 3]).sum() == pytest.approx(28 * 70)
    assert parts[0].tolist() == pytest.approx([40, 20, 28, 10])
    assert parts[1].tolist() == pytest.approx([40, 30, 14, 24])


def test_alpha_and_beta_give_the_centroid_back() -> None:
    x_c, y_c = np.array([52.0]), np.array([55.0])
    alpha, beta = alpha_of(BOX, x_c), beta_of(BOX, y_c)
    parts = parts_of(BOX, alpha, beta)[0]
    assert parts[1, 0] + parts[1, 2] == pytest.approx(52.0)
    assert parts[1, 1] + parts[1, 3] == pytest.approx(55.0)
    assert hung(np.array([[52.0, 20.0]]), BOX[:, 2:], alpha)[0].tolist() == pytest.approx(
        BOX[0].tolist()
    )


def test_a_nearer_box_hides_the_half_that_it_covers() -> None:
    parts = parts_of(BOX, np.array([0.5]), np.array([0.4]))
    left = np.array([[40.0, 20.0, 14.0, 70.0]])
    assert covered(parts, left, np.array([[True]]))[0].tolist() == pytest.approx(
        [0.5, 1, 0, 1, 0]
    )
    assert not covered(parts, left, np.array([[False]])).any()


def test_features_of_a_body_counted_by_hand() -> None:
    m = measured(*body(), BOX)
    assert (m.area[0] == ONE).all()
    assert m.overlap[0].tolist() == [ONE] * 5
    assert not m.displacement.any()
    assert (m.colours[0].sum(axis=2) == MASS).all()
    # The contour of the head: its top and both sides, the bottom belongs to the torso.
    assert m.perimeter[0, 0] == (28 + 2 * 9) * ONE // (2 * (28 + 10))


def test_a_target_matches_itself_best_and_a_shifted_or_recoloured_one_less() -> None:
    image, mask = body()
    boxes = np.concatenate([BOX, moved(7, 0), moved(0, 14), moved(-28, 0)])
    model = learnt(measured(image, mask, BOX))
    m = measured(image, mask, boxes)
    d = differences(model, np.zeros(4, np.intp), m)
    assert not d[0].any()
    assert (d[3, :, 2] == FURTHEST).all(), (
        "colours of a place without foreground differ entirely"
    )
    scorer = Scorer(PartFeatures())
    whole = scorer.whole(
        scorer.parts(scorer.features(d), m.known), np.zeros((4, 5), bool), 0
    )
    assert whole[0] >= 995
    assert (whole[1:] < 0.8 * whole[0]).all()
    other = differences(
        model, np.zeros(1, np.intp), measured(image[:, :, ::-1].copy(), mask, BOX)
    )
    assert other[0, 1, 2] > 0.3 * ONE


def test_without_pixels_place_and_overlap_are_left_and_carry_all_the_weight() -> None:
    m = measured(None, None, BOX)
    assert m.known.tolist() == [False] * 4 + [True] * 2
    scorer = Scorer(PartFeatures())
    apart = scorer.features(differences(learnt(m), np.zeros(1, np.intp), m))
    assert scorer.parts(apart, m.known).min() >= 995


def test_unmatched_parts_keep_their_models() -> None:
    image, mask = body()
    model = learnt(measured(image, mask, BOX))
    before = model.take(np.arange(1))
    m = measured(image[:, :, ::-1].copy(), mask, moved(5, 0))
    weight = np.zeros((1, 5, 6), np.int64)
    weight[0, 1] = 128
    model.learn(np.zeros(1, np.intp), m, np.zeros(1, np.intp), weight)
    for name in ("area", "perimeter", "overlap", "colours"):
        now, was = getattr(model, name)[0], getattr(before, name)[0]
        assert (now[[0, 2, 3, 4]] == was[[0, 2, 3, 4]]).all()
    assert (model.colours[0, 1] != before.colours[0, 1]).any()


def test_each_feature_is_blended_by_its_own_weight() -> None:
    """PARTS 4.2: the update weight for each feature is based on its matching probability."""
    image, mask = body()
    model = learnt(measured(image, mask, BOX))
    before = model.take(np.arange(1))
    m = measured(image[:, :, ::-1].copy(), mask, moved(5, 0))
    weight = np.zeros((1, 5, 6), np.int64)
    weight[0, :, 2] = ONE  # HSV alone
    row = np.zeros(1, np.intp)
    model.learn(row, m, row, weight)
    assert (model.colours[0, :, :3] == m.colours[0, :, :3]).all()
    assert (model.colours[0, :, 3:] == before.colours[0, :, 3:]).all()
    assert (model.area == before.area).all()
    weight[0, :, 0] = ONE // 2
    model.learn(row, m, row, weight)
    assert (abs(model.area - (before.area + m.area) // 2) <= 1).all()


def test_displacement_and_overlap_are_of_the_foregrounds_centroids() -> None:
    """PARTS 2.2: the way of the part's centroid; parts differ where their foregrounds do."""
    image, mask = body()
    half = np.full(1, 0.5), np.full(1, 0.4)
    parts = parts_of(BOX, *half)
    whole = Pixels(image, mask, (120, 110))
    known = measure(whole, parts, parts, parts, np.full(1, 20.0)).centroid
    still = measure(whole, parts, parts, parts, np.full(1, 20.0), known)
    assert not still.displacement.any()
    assert (still.overlap == ONE).all()
    # The left torso loses its outer half; nothing else changes, and no rectangle does.
    x, y, w, h = (round(v) for v in parts[0, 1].tolist())
    cut = mask.copy()
    cut[y : y + h, x : x + w // 2] = 0
    seen = Pixels(image, cut, (120, 110))
    m = measure(seen, parts, parts, parts, np.full(1, 20.0), known)
    assert m.displacement[0, 1] > 0.1 * ONE
    assert m.overlap[0, 1] < 0.9 * ONE
    assert not m.displacement[0, [0, 2, 4]].any()


def test_models_in_words() -> None:
    at = np.arange(ONE) / ONE
    assert density("half-normal 0.1", at).sum() / ONE == pytest.approx(1.0, abs=0.02)
    table = tabulated("mixture 0.5 0.2 0.05 0.5 0.4 0.05", at)
    assert table[0] == table.max() == FULL
    assert (np.diff(table) <= 0).all()
    for wrong in (
        "normal 0.1",
        "half-normal",
        "half-normal 0",
        "mixture 1 2",
        "mixture 1 0.1 nan",
        "half-normal 1 2",
    ):
        with pytest.raises(ConfigError, match=r"part_features\.area"):
            Scorer(PartFeatures(area=wrong))
    with pytest.raises(ConfigError, match="one model, or 5"):
        Scorer(PartFeatures(hsv="half-normal 0.1; half-normal 0.2"))


@pytest.mark.parametrize(
    "wrong",
    [
        "frame:0",
        "0:1,2,3,4",
        "frame:-1:1,2,3,4",
        "frame:0:1,2,3",
        "frame:0:1,2,0,4",
        "frame:²:1,2,3,4",
        "frame:٣:1,2,3,4",
    ],
)
def test_what_is_started_by_hand_is_checked(wrong: str) -> None:
    with pytest.raises(ConfigError, match="frame:N:x,y,w,h"):
        parse_init(wrong)


def test_hair_and_skin_are_told_from_grass_and_sky() -> None:
    heads = np.array([[22, 20, 22], [36, 52, 78], [148, 178, 224], [66, 94, 142]], np.uint8)
    others = np.array(
        [[60, 160, 70], [230, 160, 90], [60, 240, 240], [200, 60, 200]], np.uint8
    )
    assert likelihood(heads).min() > 0.25
    assert likelihood(others).max() < 0.1
    assert colour_table().shape == (32, 32, 32)


def test_two_heads_are_found_in_a_merged_blob() -> None:
    mask = np.zeros((120, 120), np.uint8)
    for x, y in ((30, 20), (70, 26)):
        cv2.ellipse(mask, (x, y + 6), (5, 6), 0, 0, 360, 255, -1)
        cv2.rectangle(mask, (x - 12, y + 12), (x + 12, y + 84), 255, -1)
    cv2.rectangle(mask, (30, 50), (70, 70), 255, -1)
    heads = ColourShapeHeads()(None, mask, np.array([10.0, 10.0, 90.0, 105.0]), 84.0)
    found = sorted((round(h.x), round(h.y)) for h in heads)[:2]
    assert len(heads) >= 2
    assert found[0] == pytest.approx((30, 20), abs=3)
    assert any(abs(h.x - 70) <= 3 and abs(h.y - 26) <= 3 for h in heads)


@pytest.mark.parametrize(("head_px", "count"), [(CLEAR_PX + 2, 1), (CLEAR_PX - 2, 0)])
def test_only_heads_that_are_large_enough_are_found_by_colour(
    head_px: float, count: int
) -> None:
    """A dark head before somebody who covers it all around, so that no outline shows it."""
    image, mask = (
        np.full((200, 160, 3), (60, 160, 70), np.uint8),
        np.full((200, 160), 255, np.uint8),
    )
    cv2.ellipse(
        image,
        (80, 60),
        (round(head_px * 0.42), round(head_px * 0.5)),
        0,
        0,
        360,
        (20, 20, 22),
        -1,
    )
    heads = ColourShapeHeads()(
        image, mask, np.array([0.0, 20.0, 160.0, 160.0]), head_px / HEAD
    )
    near = [h for h in heads if abs(h.x - 80) <= 4 and abs(h.y - 60 + head_px / 2) <= 5]
    assert len(near) == count


def test_heads_of_generated_people() -> None:
    scene = generate("pass_by", seed=3, size=(480, 360))
    hit = true = 0
    for index in range(60, 130, 10):
        labels = scene.labels(index)
        mask = np.where((labels > 0) & (labels < 255), np.uint8(255), np.uint8(0))
        for actor in scene.truth.frames[index].actors:
            x, y, w, h = actor.full_box
            if actor.visibility < 0.9 or x < 0 or x + w > 480:
                continue
            true += 1
            found = ColourShapeHeads()(scene.image(index), mask, np.array([x, y, w, h]), h)
            hit += any(abs(f.y - y) <= 0.08 * h for f in found)
    assert true >= 8
    assert hit == true


def test_a_head_is_found_again_by_its_image() -> None:
    image = generate("pass_by", seed=3).image(60)
    template, whole = patches(image, np.array([[100.0, 60.0]]), np.array([12.0]))
    assert whole.all()
    assert template.shape == (1, SIDE * SIDE, 3)
    assert refine(image, template[0], (104.0, 57.0), 12.0, 8.0) == ((100.0, 60.0), 0)
    assert distances(
        image, template[0], np.array([-50.0]), np.array([-50.0]), 12.0
    ).tolist() == [[255]]


def test_the_search_for_a_head_compares_every_patch() -> None:
    image = generate("pass_by", seed=3).image(60)
    (template,), _ = patches(image, np.array([[100.0, 60.0]]), np.array([13.0]))
    x, y = np.array([97.3, 98.3, 104.0]), np.array([55.5, 61.25])
    seen, whole = patches(image, np.array([(a, b) for b in y for a in x]), np.full(6, 13.0))
    assert whole.all()
    apart = np.abs(seen.astype(np.int64) - template).sum(axis=(1, 2)) // template.size
    assert distances(image, template, x, y, 13.0).tolist() == apart.reshape(2, 3).tolist()


def test_colours_that_do_not_tell_heads_from_bodies_get_no_weight() -> None:
    """PARTS 2.3, ours: mixtures that do not tell heads in this recording get no weight."""
    hair = np.full((500, 3), (40, 40, 44), np.uint8)
    blue = np.full((2000, 3), (200, 60, 20), np.uint8)
    brown = np.full((2000, 3), (50, 70, 100), np.uint8)
    good, bad, few = HeadColours(), HeadColours(), HeadColours()
    good.take(hair, blue)
    bad.take(hair, brown)
    few.take(hair[:100], brown)
    assert good.tell
    assert not bad.tell, "bodies have such colours, too"
    assert few.tell, "too little was seen to say"
    again = HeadColours()
    again.restore(good.state())
    assert again.tell


def test_scores_are_in_units_of_what_is_usual_in_the_recording() -> None:
    typical = Typical(np.full((5, 6), 20, np.int64))
    apart = np.full((1, 5, 6), 40, np.int64)
    assert (typical.scaled(apart) == 40).all()
    everything = np.ones((1000, 5, 6), bool)
    typical.take(np.full((1000, 5, 6), 40, np.int64), everything)
    assert (typical.scaled(apart) < 23).all()
    # Less than usual never makes anybody stricter than the fit.
    sharp = Typical(np.full((5, 6), 20, np.int64))
    sharp.take(np.full((1000, 5, 6), 2, np.int64), everything)
    assert (sharp.scaled(apart) == 40).all()
