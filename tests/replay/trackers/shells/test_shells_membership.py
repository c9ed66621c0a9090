"""Equations 6 to 9 and the label images, on pixels that are known."""

from __future__ import annotations

import numpy as np
import pytest

from recorders import channels
from recorders.annotated.membership import (
    LabelImage,
    Patches,
    decode_labels,
    rename_labels,
    value_of,
)
from recorders.errors import RecordingError
from replay.trackers.life import TENTATIVE
from replay.trackers.shells import ShellsParameters
from replay.trackers.shells.colours import BINS, bins_of, distance, histogram, tell
from replay.trackers.shells.foreground import Cut
from replay.trackers.shells.membership import Claimants, assign_pixels
from replay.trackers.shells.objects import Bodies, Body

PAPER = ShellsParameters(shape=0.0)


def cut_of(own: np.ndarray) -> Cut:
    return Cut(own, ~own, own.astype(np.uint16), 0, 0)


def one_colour(bgr: tuple[int, int, int]) -> np.ndarray:
    image = np.full((4, 4, 3), bgr, np.uint8)
    return histogram(bins_of(image), np.ones((4, 4), bool))


def test_colours_decide_where_shells_overlap_and_a_shell_ends_where_it_ends() -> None:
    image = np.zeros((40, 80, 3), np.uint8)
    image[:, :40], image[:, 40:] = (40, 40, 200), (200, 60, 40)
    red, blue = one_colour((40, 40, 200)), one_colour((200, 60, 40))
    boxes = np.array([[10.0, 10, 30, 20], [30.0, 10, 30, 20]])
    radii = np.array([30.0, 30.0])
    who = Claimants(boxes, radii, tell([red, blue]), [None, None])
    members = assign_pixels(who, cut_of(np.ones((40, 80), bool)), bins_of(image), PAPER)
    ys, xs = np.mgrid[:40, :80] + 0.5
    in_red = (xs - 25) ** 2 + (ys - 20) ** 2 < 30**2
    in_blue = (xs - 45) ** 2 + (ys - 20) ** 2 < 30**2
    both, left = in_red & in_blue, xs < 40
    assert (members.owner[both & left] == 1).all()
    assert (members.owner[both & ~left] == 2).all()
    assert (
        members.owner[in_red & ~in_blue] == 1
    ).all()  # nobody else may vote there, whatever the colour
    assert (members.owner[~in_red & ~in_blue] == 0).all()
    own = members.owner == 1
    assert members.means[0] == pytest.approx([xs[own].mean(), ys[own].mean()])
    assert members.counts.tolist() == [own.sum(), (members.owner == 2).sum()]


def test_without_colours_the_kernel_decides() -> None:
    boxes = np.array([[10.0, 10, 20, 20], [30.0, 10, 20, 20]])
    who = Claimants(boxes, np.array([40.0, 40.0]), [None, None], [None, None])
    members = assign_pixels(who, cut_of(np.ones((40, 60), bool)), None, PAPER)
    row = members.owner[20]
    assert (row[:30] == 1).all()
    assert (row[30:] == 2).all()


def test_more_objects_than_fit_into_a_byte_may_share_a_blob() -> None:
    boxes = np.array([[4.0 * k, 10, 6, 20] for k in range(300)])
    who = Claimants(boxes, np.full(300, 15.0), [None] * 300, [None] * 300)
    members = assign_pixels(who, cut_of(np.ones((40, 1210), bool)), None, PAPER)
    assert int(members.owner.max()) == 300
    assert (members.counts > 0).all()
    assert members.means[:, 0] == pytest.approx(boxes[:, 0] + 3, abs=12)


def test_disputed_pixels_belong_to_nobody_and_soft_shares_add_up() -> None:
    boxes = np.array([[10.0, 10, 20, 20], [30.0, 10, 20, 20]])
    who = Claimants(boxes, np.array([40.0, 40.0]), [None, None], [None, None])
    cut = cut_of(np.ones((40, 60), bool))
    disputed = assign_pixels(who, cut, None, ShellsParameters(shape=0.0, disputed=0.3))
    assert disputed.owner[20, 30] == 0
    assert disputed.owner[20, 5] == 1
    soft = assign_pixels(who, cut, None, ShellsParameters(shape=0.0, soft=True))
    ys, xs = np.mgrid[:40, :60] + 0.5
    claimed = ((xs - 20) ** 2 + (ys - 20) ** 2 < 1600) | (
        (xs - 40) ** 2 + (ys - 20) ** 2 < 1600
    )
    assert soft.counts.sum() == pytest.approx(claimed.sum())
    hard = assign_pixels(who, cut, None, PAPER)
    assert soft.means[0, 0] > hard.means[0, 0]  # shares of the other's side pull towards it


def test_position_update_is_equation_nine_and_shells_grow_with_speed() -> None:
    bodies = Bodies(ShellsParameters())
    bodies.start((0.0, 0.0, 30.0, 40.0), Body(TENTATIVE, 0, 0, 0))
    assert bodies.radii(0.2).tolist() == [25.0]
    bodies.bank.rate[0, :2] = 30.0, 40.0
    assert bodies.radii(0.2).tolist() == pytest.approx([25.0 + 0.2 * 50.0])
    bodies.predict(0.1)
    predicted = bodies.bank.value[0, :2].copy()
    bodies.move(0, (40.0, 10.0), 0.7)
    assert bodies.bank.value[0, :2] == pytest.approx(
        0.7 * np.array([40.0, 10.0]) + 0.3 * predicted
    )


def test_histograms_tell_and_forget() -> None:
    red, blue = one_colour((40, 40, 200)), one_colour((200, 60, 40))
    assert distance(red, red) == 0.0
    assert distance(red, blue) == pytest.approx(1.0)
    assert tell([red, None]) == [None, None]  # alone, a colour tells nothing
    body = Body(1, 0, 0, 0)
    for _ in range(3):
        body.learn_colours(red)
    for _ in range(200):
        body.learn_colours(blue)
    assert body.colours is not None
    assert body.colours.shape == (BINS,)
    assert distance(body.colours, blue) < 0.05


@pytest.mark.parametrize("largest", [7, 300])
def test_label_images_keep_their_identities(largest: int) -> None:
    image = LabelImage(20, 10, largest)
    image.put(3, np.ones((4, 4), bool), -2, -2)
    image.put(largest, np.ones((3, 3), bool), 10, 5)
    image.put(5, np.ones((2, 2), bool), 40, 40)
    payload = image.payload(17)
    labels = decode_labels(channels.decode("membership", payload).data)
    assert labels.dtype == np.uint16
    assert np.bincount(labels.ravel())[[3, largest]].tolist() == [4, 9]
    assert rename_labels(payload, {3: 3, largest: largest}, [3, largest]) == payload
    final = decode_labels(
        channels.decode("membership", rename_labels(payload, {3: 400}, [3, largest])).data
    )
    assert sorted(np.unique(final).tolist()) == [0, 400]
    assert (final == 400).sum() == 4
    assert value_of(65536) == 1


@pytest.mark.parametrize(
    "names", [{1: 1, 2: 2, 3: 3}, {1: 2, 2: 1, 3: 3}, {1: 300, 3: 1}, {}]
)
def test_patches_are_painted_as_label_images_are_renamed(names: dict[int, int]) -> None:
    rng = np.random.default_rng(5)
    shapes = [
        (1, rng.random((5, 7)) < 0.5, 2, 3),
        (2, rng.random((9, 4)) < 0.5, 17, 6),
        (3, rng.random((6, 6)) < 0.5, 4, -2),
    ]
    image = LabelImage(20, 12, 3)
    for shape in shapes:
        image.put(*shape)
    patches = Patches.unpacked(
        Patches(20, 12, 17, [Patches.patch(*s) for s in shapes]).packed()
    )
    assert patches.payload() == image.payload(17)
    assert patches.payload(names, [1, 2, 3]) == rename_labels(
        image.payload(17), names, [1, 2, 3]
    )


def test_what_is_no_label_image_is_refused() -> None:
    with pytest.raises(RecordingError, match="neither a JPEG nor a PNG"):
        decode_labels(b"nothing")
    payload = channels.decode("membership", LabelImage(8, 8, 1).payload(0)).data
    with pytest.raises(RecordingError, match="label image"):
        decode_labels(payload[:-10])
