"""Who is seen through leaves over much of the picture."""

from __future__ import annotations

import numpy as np

from recorders.pictures import Image
from recorders.segmentation.blobs import numbered
from recorders.segmentation.waving import Waving


def leafy(left: int, right: int) -> Waving:
    """The ground waves between two columns of a picture of 200 x 300 px."""
    return Waving(np.full((200, right - left), 255, np.uint8), left, 0, 4, (200, 300))


def pieces(top: int, left: int) -> Image:
    """Nine pieces of one body, gaps of 10 px between them, and a leaf far off."""
    mask = np.zeros((200, 300), np.uint8)
    for y in range(top, top + 66, 22):
        for x in range(left, left + 66, 22):
            mask[y : y + 12, x : x + 12] = 255
    mask[10:14, 280:286] = 255
    return mask


def test_pieces_seen_through_leaves_are_one_body_and_a_lone_leaf_is_none() -> None:
    found = leafy(0, 300).seen_through(pieces(100, 100))
    (body,) = numbered(found)[3].tolist()
    assert body == [100, 100, 56, 56, 56 * 56]


def test_at_the_edge_of_the_picture_bodies_end_there() -> None:
    found = leafy(0, 300).seen_through(pieces(144, 0))
    (body,) = numbered(found)[3].tolist()
    assert body == [0, 144, 56, 56, 56 * 56]


def test_beside_the_leaves_everything_stays() -> None:
    mask = pieces(100, 20)
    found = leafy(150, 270).seen_through(mask)
    np.testing.assert_array_equal(found, mask)


def test_a_small_tree_changes_nothing() -> None:
    mask = pieces(100, 100)
    assert leafy(90, 170).seen_through(mask) is mask
