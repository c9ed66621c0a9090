"""Identity scores: Ristani et al., Performance Measures and a Data Set for Multi-Target
Multi-Camera Tracking, 2016.

Every true identity is given to at most one result identity, so that the frames in which both
agree are as many as can be.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from replay.evaluate.overlap import Overlap
from replay.evaluate.truth import IntArray


@dataclass(frozen=True, eq=False)
class Identity:
    """IDF1, IDP, IDR in percent, their counts, and the assignment of identities.

    ``pairs`` is (K, 2) int64: positions of the true and the result identity, only where they
    agree in a frame at least.
    """

    idf1: float
    idp: float
    idr: float
    idtp: int
    idfp: int
    idfn: int
    pairs: IntArray


def identity(both: Overlap, iou: float) -> Identity:
    """Score identities over the whole recording; a pair of boxes agrees where they overlap by
    ``iou``.
    """
    agree = both.per_identity(np.flatnonzero(both.iou >= iou))
    # The cost of Ristani's assignment is (truth + result - 2 x agreement), unassigned ones cost
    # their own rows: its minimum is where the agreement is largest.
    r, c = linear_sum_assignment(agree, maximize=True)
    keep = agree[r, c] > 0
    pairs = np.stack([r[keep], c[keep]], axis=1).astype(np.int64)
    idtp = int(agree[pairs[:, 0], pairs[:, 1]].sum())
    truth, result = len(both.truth), len(both.result)
    return Identity(
        idf1=100 * idtp / max(1.0, 0.5 * (truth + result)),
        idp=100 * idtp / max(1, result),
        idr=100 * idtp / max(1, truth),
        idtp=idtp,
        idfp=result - idtp,
        idfn=truth - idtp,
        pairs=pairs,
    )
