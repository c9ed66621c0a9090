"""Who is missing is more likely back than somebody new is there (PARTS 3: until the target is
tracked again or lost).

A newcomer that has had enough support to become a target is compared, part by part, with the
targets that are missing within its reach. What it looks like counts for less there than in
matching from frame to frame, as the only other explanation is that one person vanished and
another appeared beside him; but colours that are all different are another person's. Where targets
are started by hand, who is followed aside is compared until `keep_s` after his birth, as the
missing one's first likeness may be a poor one. (Ours: the paper follows targets that were started
by hand, where nobody can be born.)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from replay.trackers.life import TENTATIVE, Life
from replay.trackers.parts.matching import Matching
from replay.trackers.parts.parameters import PartsParameters
from replay.trackers.parts.scoring import FULL
from replay.trackers.parts.targets import BYSTANDERS, PartsTargets

Rows = NDArray[np.intp]


def returned(
    matching: Matching, targets: PartsTargets, life: Life, p: PartsParameters, now_ns: int
) -> None:
    """Give the places of ripe newcomers to the missing targets that they are; the newcomers are
    forgotten.
    """
    items = targets.items
    missing = np.array(
        [k for k, t in enumerate(items) if t.id != TENTATIVE and not t.observed], np.intp
    )
    ripe = [k for k, t in enumerate(items) if life.is_ripe(t, now_ns)]
    # Nothing was told of who is followed aside: he may turn out to be one of them for longer.
    aside = [
        k
        for k, t in enumerate(items)
        if t.id >= BYSTANDERS and t.observed and (now_ns - t.born_ns) * 1e-9 <= p.keep_s
    ]
    gone: list[int] = []
    for row in ripe + aside:
        if not len(missing):
            break
        near, away = _within_reach(matching, targets, missing, row, now_ns, p.occlusion)
        if not len(near):
            continue
        box = np.repeat(targets.boxes[row][None], len(near), axis=0)
        scores = matching.likeness_anywhere(near, box)
        value = np.where(
            scores >= round(p.weak * p.match_score * FULL), scores * (1.0 - away), -1.0
        )
        best = int(np.argmax(value))
        if value[best] < 0:
            continue
        matching.place(int(near[best]), row, int(scores[best]))
        missing = missing[missing != near[best]]
        gone.append(row)
    targets.keep([k for k in range(len(items)) if k not in gone])


def _within_reach(
    matching: Matching,
    targets: PartsTargets,
    missing: Rows,
    row: int,
    now_ns: int,
    occlusion: float,
) -> tuple[Rows, NDArray[np.float64]]:
    """Missing targets of a newcomer's size (PARTS 3.1) that may have come to where it is, and how
    much of their reach that takes, (M,) in [0, 1].
    """
    boxes = targets.boxes
    middle = boxes[:, :2] + boxes[:, 2:] / 2
    away = np.abs(middle[missing] - middle[row]).max(axis=1)
    # Who was seen beside the other is somebody else.
    born = targets.items[row].born_ns
    apart = np.array([targets.items[k].seen_ns < born for k in missing.tolist()], bool)
    unseen = np.array([targets.items[k].unseen_s(now_ns) for k in missing.tolist()])
    share = away / np.maximum(targets.reach(missing, matching.dt, unseen), 1.0)
    change = boxes[row, 2:] / np.maximum(boxes[missing, 2:], 1.0)
    sized = (np.abs(change - 1.0) <= occlusion).all(axis=1)
    near = apart & sized & (share <= 1.0)
    return missing[near], share[near]
