"""Births of a split that the tracker has not told of."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from reasoning.geometry import WHOLLY, boxes_touch
from reasoning.regions import SceneRegions
from reasoning.target_columns import TargetColumns


def infer_splits(
    rows: TargetColumns, known: Collection[int], regions: SceneRegions
) -> None:
    """Who is first seen inside the region of interest and over an older target's box is born
    of a split.
    """
    new = [
        index
        for index, identity in enumerate(rows.ids)
        if rows.newborn[index] and identity not in known and not rows.of_split[index]
    ]
    old = [
        index
        for index in range(len(rows.ids))
        if rows.present[index] and not rows.newborn[index]
    ]
    if not (new and old):
        return
    fresh, older = ([rows.boxes[k] for k in which] for which in (new, old))
    touch = boxes_touch(np.array(fresh, np.float64), np.array(older, np.float64))
    over: list[bool] = np.asarray(touch.any(axis=1)).tolist()
    places = regions.places(fresh).roi
    for k, touches, place in zip(new, over, places, strict=True):
        rows.of_split[k] = touches and place == WHOLLY and rows.present[k]
        rows.inferred += [rows.ids[k]] if rows.of_split[k] else []
