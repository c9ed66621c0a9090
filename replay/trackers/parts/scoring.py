"""From differences to scores: p(d | theta) per feature and part, part scores, the global score
(PARTS 2.2 and 4.1).

The matching case's models come from the section ``part_features`` of the configuration, which
`scenetrace fit` writes. Each is tabulated once over all differences, over its own highest value,
so that features of different spread weigh what their weights say; scores are integers of which
`FULL` is 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.errors import ConfigError
from recorders.parameters import Parameters, param
from replay.trackers.parts.features import FEATURES, ONE
from replay.trackers.parts.regions import PARTS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FULL = 1000
"""The score of a perfect match."""
_TABLES = ONE * np.arange(len(PARTS) * len(FEATURES)).reshape(len(PARTS), len(FEATURES))
"""Where each part's and feature's table starts among all of them."""
_SHAPES = {"half-normal": 1, "mixture": 3}


@dataclass(frozen=True)
class PartFeatures(Parameters):
    """The matching case's features: models by part, weights omega and gamma, and what they were
    fitted on.

    A model is ``half-normal SIGMA`` or ``mixture WEIGHT MEAN SIGMA ...``, differences in units of
    the feature; parts in the order head, left torso, right torso, left legs, right legs, parted
    by ';'. One model alone is everybody's.
    """

    area: str = param(
        "half-normal 0.1180; half-normal 0.1707; half-normal 0.1715; half-normal 0.1344;"
        " half-normal 0.1391",
        "area: foreground over the part's area",
        source="PARTS 2.2, fitted",
    )
    perimeter: str = param(
        "half-normal 0.1589; half-normal 0.2097; half-normal 0.1737; half-normal 0.1895;"
        " half-normal 0.1791",
        "contour over the part's perimeter",
        source="PARTS 2.2, fitted",
    )
    hsv: str = param(
        "mixture 0.9274 0.2956 0.0806 0.0726 0.9961 0.0059; "
        "mixture 0.9275 0.1796 0.0791 0.0725 0.7517 0.2931; "
        "mixture 0.8839 0.2008 0.0794 0.1161 0.7777 0.2805; "
        "mixture 0.9610 0.1996 0.0543 0.0390 0.6829 0.3113; "
        "mixture 0.9645 0.2087 0.0573 0.0355 0.8785 0.2226",
        "HSV histograms, share that differs",
        source="PARTS 2.2, fitted",
    )
    xyz: str = param(
        "mixture 0.9274 0.3271 0.1109 0.0726 0.9961 0.0059; "
        "mixture 0.9257 0.2131 0.0890 0.0743 0.7811 0.2589; "
        "mixture 0.8090 0.2131 0.0820 0.1910 0.6508 0.2873; "
        "mixture 0.9560 0.2103 0.0652 0.0440 0.6719 0.2963; "
        "mixture 0.9170 0.2073 0.0599 0.0830 0.5920 0.2982",
        "XYZ histograms, share that differs",
        source="PARTS 2.2, fitted",
    )
    displacement: str = param(
        "mixture 0.6867 0.1095 0.0314 0.3133 0.1334 0.0473; "
        "mixture 0.5055 0.0817 0.0335 0.4945 0.1237 0.0452; "
        "mixture 0.4704 0.0793 0.0296 0.5296 0.1221 0.0443; "
        "half-normal 0.1061; "
        "half-normal 0.1051",
        "way of the part, in half gates",
        source="PARTS 2.2, fitted",
    )
    overlap: str = param(
        "mixture 0.5336 0.2494 0.1200 0.4664 0.2962 0.0700; "
        "mixture 0.5694 0.0965 0.0599 0.4306 0.2540 0.1267; "
        "mixture 0.9329 0.1444 0.0902 0.0671 0.3733 0.2352; "
        "half-normal 0.2000; "
        "half-normal 0.1943",
        "overlap with the part's last place",
        source="PARTS 2.2, fitted",
    )
    omega_area: float = param(
        0.1852, "weight of a feature", low=0, high=1, source="PARTS eq. 12, fitted"
    )
    omega_perimeter: float = param(
        0.0741, "weight of a feature", low=0, high=1, source="PARTS eq. 12, fitted"
    )
    omega_hsv: float = param(
        0.3704, "weight of a feature", low=0, high=1, source="PARTS eq. 12, fitted"
    )
    omega_xyz: float = param(
        0.2593, "weight of a feature", low=0, high=1, source="PARTS eq. 12, fitted"
    )
    omega_displacement: float = param(
        0.037, "weight of a feature", low=0, high=1, source="PARTS eq. 12, fitted"
    )
    omega_overlap: float = param(
        0.0741, "weight of a feature", low=0, high=1, source="PARTS eq. 12, fitted"
    )
    gamma_head: float = param(
        0.1935, "weight of a part", low=0, high=1, source="PARTS eq. 13, fitted"
    )
    gamma_left_torso: float = param(
        0.2258, "weight of a part", low=0, high=1, source="PARTS eq. 13, fitted"
    )
    gamma_right_torso: float = param(
        0.1613, "weight of a part", low=0, high=1, source="PARTS eq. 13, fitted"
    )
    gamma_left_legs: float = param(
        0.2581, "weight of a part", low=0, high=1, source="PARTS eq. 13, fitted"
    )
    gamma_right_legs: float = param(
        0.1613, "weight of a part", low=0, high=1, source="PARTS eq. 13, fitted"
    )
    fitted_on: str = param(
        "tud.mcap with gt.txt (196 pairs of frames); "
        "g_crowd_1.mcap with g_crowd_1.txt (322 pairs of frames); "
        "g_crowd_3.mcap with g_crowd_3.txt (341 pairs of frames); "
        "g_fight_1.mcap with g_fight_1.txt (201 pairs of frames)",
        "what the models and weights were fitted on",
    )


def density(words: str, at: Floats, where: str = "model") -> Floats:
    """p(d | theta) at differences ``at``, of a model in words, not normalised over the half
    line's edge.

    Raises:
        ConfigError: not a model; names ``where``.
    """
    kind, *rest = words.split()
    size = _SHAPES.get(kind)
    try:
        numbers = [float(word) for word in rest]
    except ValueError:
        numbers = []
    if (
        size is None
        or not numbers
        or len(numbers) % size
        or (size == 1 and len(numbers) > 1)
    ):
        raise ConfigError(
            f"{where} = {words!r}: must be 'half-normal SIGMA' or 'mixture WEIGHT MEAN"
            " SIGMA ...'"
        )
    if (
        not all(math.isfinite(number) for number in numbers)
        or min(numbers[size - 1 :: size]) <= 0
        or min(numbers[::size]) < 0
    ):
        raise ConfigError(
            f"{where} = {words!r}: spreads must be over 0, weights not below 0"
        )
    if kind == "half-normal":
        sigma = numbers[0]
        return np.asarray(math.sqrt(2 / math.pi) / sigma * np.exp(-0.5 * (at / sigma) ** 2))
    total = np.zeros_like(at)
    for weight, mean, sigma in zip(numbers[::3], numbers[1::3], numbers[2::3], strict=True):
        total += (
            weight
            / (sigma * math.sqrt(2 * math.pi))
            * np.exp(-0.5 * ((at - mean) / sigma) ** 2)
        )
    return total


def tabulated(words: str, at: Floats, where: str = "model") -> Ints:
    """A model's score at rising differences ``at``: p(d | theta) over its highest value, in 1 /
    `FULL`.

    Deviation: a difference below a mixture's peak scores as the peak does. Histograms of a frame
    before differ by their noise; those of a running mean, which the tracker compares with, by
    less, and that is nothing against a match.
    """
    values = density(words, at, where)
    values = np.maximum.accumulate(values[::-1])[::-1]
    return np.rint(values / max(float(values.max()), 1e-300) * FULL).astype(np.int64)


def split_models(words: str, where: str) -> list[str]:
    """One model per part.

    Raises:
        ConfigError: neither one nor as many as there are parts.
    """
    models = [m.strip() for m in words.split(";") if m.strip()]
    if len(models) not in (1, len(PARTS)):
        raise ConfigError(
            f"{where} = {words!r}: must be one model, or {len(PARTS)} parted by ';'"
        )
    return models * len(PARTS) if len(models) == 1 else models


class Scorer:
    """Scores of candidates by the shipped or fitted models.

    Raises:
        ConfigError: a model is not one, or all weights are 0.
    """

    def __init__(self, p: PartFeatures) -> None:
        at = np.arange(ONE) / ONE
        self.tables: Ints = np.empty((len(FEATURES), len(PARTS), ONE), np.int64)
        for i, feature in enumerate(FEATURES):
            where = f"part_features.{feature}"
            for j, words in enumerate(split_models(getattr(p, feature), where)):
                self.tables[i, j] = tabulated(words, at, where)
        self._by_part = np.ascontiguousarray(self.tables.transpose(1, 0, 2)).ravel()
        self.omega = _weights([getattr(p, f"omega_{f}") for f in FEATURES], "omega")
        self.gamma = _weights([getattr(p, f"gamma_{j}") for j in PARTS], "gamma")

    def parts(self, differences: Ints, known: NDArray[np.bool_]) -> Ints:
        """Part scores p_j = sum_i omega_i p(d_ij | theta_ij), eq. 12, of N candidates, (N, 5) in
        [0, `FULL`].

        Args:
            differences: (N, 5, 6) as `features.differences` gives them.
            known: (6,), or (N, 6), features that were measured; the others' weights fall to these.
        """
        scores = self._by_part.take(differences + _TABLES)
        omega = (self.omega * known).reshape(-1, 1, len(FEATURES))
        return np.asarray((scores * omega).sum(axis=2) // np.maximum(omega.sum(axis=2), 1))

    def whole(self, parts: Ints, hidden: NDArray[np.bool_], hidden_score: int) -> Ints:
        """Global scores p = sum_j gamma_j p_j, eq. 13, (N,); hidden parts (N, 5) count
        ``hidden_score``.
        """
        return np.asarray(
            (np.where(hidden, hidden_score, parts) * self.gamma).sum(axis=1)
            // int(self.gamma.sum())
        )


def _weights(values: list[float], name: str) -> Ints:
    if sum(values) <= 0:
        raise ConfigError(f"part_features.{name}_*: at least one weight must be over 0")
    return np.array([round(value * 1000 / sum(values)) for value in values], np.int64)
