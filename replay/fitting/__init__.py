"""Fitting the part features' models and weights to annotated recordings (PARTS 2.2 and 4.1)."""

from __future__ import annotations

from replay.fitting.fit import Fitted, fit
from replay.fitting.samples import FeatureSamples, collect

__all__ = ["FeatureSamples", "Fitted", "collect", "fit"]
