"""From differences to scores: p(d | theta) per feature and part, part scores, the global score
(PARTS 2.2 and 4.1).

The matching case's models come from the section ``part_features`` of the configuration, which
`scenetrace fit` writes. Each is tabulated once over all differences, over its own highest value,
so that features of different spread weigh what their weights say; scores are integers of which
`FULL` is 1.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
SHIPPED = Path(__file__).with_name("features.toml")
"""The fit that is shipped: what `tests/benchmarks/fit_features.py` makes, byte for byte."""
_DEFAULTS: dict[str, Any] = tomllib.loads(SHIPPED.read_text(encoding="utf-8"))[
    "part_features"
]
_SHAPES = {"half-normal": 1, "mixture": 3}


def _fitted(name: str, about: str, source: str) -> Any:
    """A parameter of which the default is the shipped fit's."""
    low, high = (0.0, 1.0) if name.startswith(("omega", "gamma")) else (None, None)
    return param(_DEFAULTS[name], about, low=low, high=high, source=f"{source}, fitted")


@dataclass(frozen=True)
class PartFeatures(Parameters):
    """The matching case's features: models by part, weights omega and gamma, and what they were
    fitted on.

    A model is ``half-normal SIGMA`` or ``mixture WEIGHT MEAN SIGMA ...``, differences in units of
    the feature; parts in the order head, left torso, right torso, left legs, right legs, parted
    by ';'. One model alone is everybody's.
    """

    area: str = _fitted("area", "area: foreground over the part's area", "PARTS 2.2")
    perimeter: str = _fitted("perimeter", "contour over the part's perimeter", "PARTS 2.2")
    hsv: str = _fitted("hsv", "HSV histograms, share that differs", "PARTS 2.2")
    xyz: str = _fitted("xyz", "XYZ histograms, share that differs", "PARTS 2.2")
    displacement: str = _fitted(
        "displacement", "way of the part's centroid, in half gates", "PARTS 2.2"
    )
    overlap: str = _fitted("overlap", "overlap with the part's last place", "PARTS 2.2")
    omega_area: float = _fitted("omega_area", "weight of a feature", "PARTS eq. 12")
    omega_perimeter: float = _fitted(
        "omega_perimeter", "weight of a feature", "PARTS eq. 12"
    )
    omega_hsv: float = _fitted("omega_hsv", "weight of a feature", "PARTS eq. 12")
    omega_xyz: float = _fitted("omega_xyz", "weight of a feature", "PARTS eq. 12")
    omega_displacement: float = _fitted(
        "omega_displacement", "weight of a feature", "PARTS eq. 12"
    )
    omega_overlap: float = _fitted("omega_overlap", "weight of a feature", "PARTS eq. 12")
    gamma_head: float = _fitted("gamma_head", "weight of a part", "PARTS eq. 13")
    gamma_left_torso: float = _fitted(
        "gamma_left_torso", "weight of a part", "PARTS eq. 13"
    )
    gamma_right_torso: float = _fitted(
        "gamma_right_torso", "weight of a part", "PARTS eq. 13"
    )
    gamma_left_legs: float = _fitted("gamma_left_legs", "weight of a part", "PARTS eq. 13")
    gamma_right_legs: float = _fitted(
        "gamma_right_legs", "weight of a part", "PARTS eq. 13"
    )
    fitted_on: str = param(
        _DEFAULTS["fitted_on"], "what the models and weights were fitted on"
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
        self.usual: Ints = np.array(
            [
                [
                    round(float((density(w, at) * at).sum() / density(w, at).sum()) * ONE)
                    for w in split_models(getattr(p, feature), feature)
                ]
                for feature in FEATURES
            ],
            np.int64,
        ).T.copy()
        self._by_part = np.ascontiguousarray(self.tables.transpose(1, 0, 2)).ravel()
        self.omega = _weights([getattr(p, f"omega_{f}") for f in FEATURES], "omega")
        self.gamma = _weights([getattr(p, f"gamma_{j}") for j in PARTS], "gamma")

    def features(self, differences: Ints) -> Ints:
        """p(d_ij | theta_ij) of N candidates' differences, (N, 5, 6) in [0, `FULL`]."""
        return np.asarray(self._by_part.take(differences + _TABLES))

    def parts(self, features: Ints, known: NDArray[np.bool_]) -> Ints:
        """Part scores p_j = sum_i omega_i p(d_ij | theta_ij), eq. 12, of N candidates, (N, 5) in
        [0, `FULL`].

        Args:
            features: (N, 5, 6) as `features` gives them.
            known: (6,), or (N, 6), features that were measured; the others' weights fall to these.
        """
        omega = (self.omega * known).reshape(-1, 1, len(FEATURES))
        return np.asarray(
            (features * omega).sum(axis=2) // np.maximum(omega.sum(axis=2), 1)
        )

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
