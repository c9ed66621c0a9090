"""The matching case's models by maximum likelihood, weights by cross-validated search (PARTS 2.2,
eq. 12, 13).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from replay.fitting.samples import FeatureSamples
from replay.trackers.parts.features import FEATURES, ONE
from replay.trackers.parts.regions import PARTS
from replay.trackers.parts.scoring import FULL, PartFeatures, tabulated

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BUCKETS = 32
"""Of the histogram that is asked for its modes."""
PROMINENCE = 0.08
"""A second peak this high over the valley before it, of the highest peak, is a second mode."""
GRID = tuple(index / 10 for index in range(11))
"""Weights that are tried: the interval [0, 1] in tenths."""
PASSES = 4
_EM_STEPS = 60
_LEAST_SIGMA = 1.5 / ONE


@dataclass(frozen=True)
class Fitted:
    """What was fitted.

    Attributes:
        features: the section ``part_features``.
        accuracy: share of targets and frames, in parts of the recordings that neither the models
            were fitted on nor the weights chosen on, in which the true candidate scores highest;
            None where nothing could be held out.
        before: the same with equal weights.
        chance: the same of a candidate taken blindly.
        groups: how many targets and frames there are.
    """

    features: PartFeatures
    accuracy: float | None
    before: float | None
    chance: float
    groups: int


def half_normal(d: Floats) -> str:
    """The half-normal model of most likelihood: sigma is the root of the mean square."""
    return f"half-normal {max(math.sqrt(float((d * d).mean())), _LEAST_SIGMA):.4f}"


def mixture(d: Floats) -> str:
    """Two Gaussians by expectation maximisation, started at the quartiles; the same data, the
    same model.
    """
    means = np.array([float(np.quantile(d, 0.25)), float(np.quantile(d, 0.75))])
    sigmas = np.full(2, max(float(d.std()) / 2, _LEAST_SIGMA))
    weights = np.full(2, 0.5)
    for _ in range(_EM_STEPS):
        away = (d[:, None] - means) / sigmas
        p = weights / sigmas * np.exp(-0.5 * away * away) + 1e-300
        p /= p.sum(axis=1, keepdims=True)
        total = p.sum(axis=0) + 1e-9
        weights, means = total / total.sum(), (p * d[:, None]).sum(axis=0) / total
        sigmas = np.sqrt((p * (d[:, None] - means) ** 2).sum(axis=0) / total).clip(
            _LEAST_SIGMA
        )
    return "mixture " + " ".join(
        f"{weight:.4f} {mean:.4f} {sigma:.4f}"
        for weight, mean, sigma in zip(weights, means, sigmas, strict=True)
    )


def unimodal(d: Floats) -> bool:
    """Whether the histogram of differences has one peak, as far as can be seen."""
    counts = np.histogram(d, bins=BUCKETS, range=(0.0, 1.0))[0].astype(np.float64)
    smooth = np.convolve(
        np.concatenate([counts[1::-1], counts, [0.0]]), [0.25, 0.5, 0.25], "same"
    )[2:-1]
    peak = int(np.argmax(smooth))
    rest, valley = smooth[peak:], np.minimum.accumulate(smooth[peak:])
    return bool(peak <= 2 and (rest - valley).max() <= PROMINENCE * smooth[peak])


def model_of(d: Floats) -> str:
    """The model of one feature of one part."""
    return half_normal(d) if unimodal(d) else mixture(d)


def models(differences: Ints) -> dict[str, str]:
    """Every feature's models by part, from the steps' differences (N, 5, 6)."""
    d = differences / ONE
    return {
        f: "; ".join(model_of(d[:, j, index]) for j in range(len(PARTS)))
        for index, f in enumerate(FEATURES)
    }


def fit(samples: FeatureSamples) -> Fitted:
    """Fit models and weights.

    The weights are those of the highest accuracy over the parts that the models were not fitted
    on: each fold's candidates are scored by the models of the other folds. How good the fit is,
    is judged apart: fold by fold, with models and weights of the other folds alone.
    """
    scores = np.empty(samples.differences.shape, np.float64)
    folds = np.unique(samples.folds).tolist()
    theirs: dict[int, dict[str, str]] = {}
    for fold in folds:
        here = samples.folds == fold
        theirs[fold] = models(
            samples.steps[samples.step_folds != fold] if len(folds) > 1 else samples.steps
        )
        scores[here] = _tabulated(samples.differences[here], theirs[fold])
    firsts = _firsts(samples.groups)
    omega, gamma = _weights(scores, firsts)
    right = _held_out(samples, theirs, scores) if len(folds) > 1 else None
    values: dict[str, Any] = dict(models(samples.steps))
    values |= {
        f"omega_{f}": round(float(v / omega.sum()), 4)
        for f, v in zip(FEATURES, omega, strict=True)
    }
    values |= {
        f"gamma_{j}": round(float(v / gamma.sum()), 4)
        for j, v in zip(PARTS, gamma, strict=True)
    }
    values["fitted_on"] = "; ".join(samples.names)
    chance = float((1.0 / np.diff(np.append(firsts, len(samples.groups)))).mean())
    accuracy, before = (None, None) if right is None else right
    return Fitted(PartFeatures(**values), accuracy, before, chance, len(firsts))


def _held_out(
    samples: FeatureSamples, theirs: dict[int, dict[str, str]], scores: Floats
) -> tuple[float, float]:
    """Accuracy over all folds, each with the models and weights of the others, and the same with
    equal weights.

    Args:
        samples: the samples.
        theirs: for each fold the models of the others.
        scores: (N, 5, 6) every candidate's under the models of the folds that it is not in.
    """
    right = equally = 0.0
    for fold, words in theirs.items():
        here, others = samples.folds == fold, samples.folds != fold
        omega, gamma = _weights(
            _tabulated(samples.differences[others], words), _firsts(samples.groups[others])
        )
        firsts = _firsts(samples.groups[here])
        right += len(firsts) * _accuracy(scores[here], omega, gamma, firsts)[0]
        equally += (
            len(firsts)
            * _accuracy(scores[here], np.ones(len(FEATURES)), np.ones(len(PARTS)), firsts)[
                0
            ]
        )
    total = len(_firsts(samples.groups))
    return right / total, equally / total


def _firsts(groups: Ints) -> NDArray[np.intp]:
    """Rows at which a group begins: its match."""
    return np.flatnonzero(np.diff(groups, prepend=-1))


def _weights(scores: Floats, firsts: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """Weights of the features (6,) and of the parts (5,) with the highest accuracy.

    They are found one at a time, each tried in tenths while the others stay, features first, then
    parts, until nothing improves.
    """
    omega, gamma = np.full(len(FEATURES), 0.5), np.full(len(PARTS), 0.5)
    for _ in range(PASSES):
        old = (omega.copy(), gamma.copy())
        for weights in (omega, gamma):
            _climb(scores, omega, gamma, weights, firsts)
        if (omega == old[0]).all() and (gamma == old[1]).all():
            break
    return omega, gamma


def _tabulated(differences: Ints, words: dict[str, str]) -> Floats:
    """p(d | theta) over its highest value, (N, 5, 6)."""
    at = np.arange(ONE) / ONE
    out = np.empty(differences.shape, np.float64)
    for index, f in enumerate(FEATURES):
        for j, model in enumerate(words[f].split("; ")):
            out[:, j, index] = tabulated(model, at)[differences[:, j, index]] / FULL
    return out


def _climb(
    scores: Floats, omega: Floats, gamma: Floats, weights: Floats, firsts: NDArray[np.intp]
) -> None:
    """Improve one set of weights, one weight at a time; ``weights`` is ``omega`` or ``gamma``
    itself.
    """
    for index in range(len(weights)):
        now = float(weights[index])
        best = (*_accuracy(scores, omega, gamma, firsts), now)
        for value in GRID:
            weights[index] = value
            if weights.sum() > 0:
                found = (*_accuracy(scores, omega, gamma, firsts), value)
                # Of equals the one that was there, then the lowest.
                best = max(best, found, key=lambda t: t[:2])
        weights[index] = best[2]


def _accuracy(
    scores: Floats, omega: Floats, gamma: Floats, firsts: NDArray[np.intp]
) -> tuple[float, float]:
    """Share of groups whose match scores highest, and the mean margin over the best other, which
    decides ties.
    """
    parts = (scores * (omega / omega.sum())).sum(axis=2)
    whole = (parts * (gamma / gamma.sum())).sum(axis=1)
    match = whole[firsts]
    others = whole.copy()
    others[firsts] = -1.0
    best = np.maximum.reduceat(others, firsts)
    return float((match > best).mean()), round(
        float(np.minimum(match - best, 0.3).mean()), 6
    )
