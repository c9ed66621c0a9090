"""Parameters that every tracker has, declared once: name, words, unit and range. A tracker's own
section gives the default.
"""

from __future__ import annotations

from typing import Any

from recorders.parameters import param


def hindsight(default: bool) -> Any:
    """Whether the tracks are mended after the forward pass."""
    return param(default, "join, fill and smooth the tracks after the forward pass")


def body_spread(default: float) -> Any:
    """How much bodies differ from the size model."""
    return param(
        default,
        "standard deviation of bodies' sizes around the learnt size model",
        unit="heights",
        low=0.001,
        high=10.0,
    )


def confirm_s(default: float, but: str = "") -> Any:
    """Least age of a target that is confirmed; ``but`` says what else holds."""
    words = "a new target is confirmed after this time"
    return param(default, words + but, unit="s", low=0.0, high=60.0)


def confirm_hits(default: int) -> Any:
    """And its least number of observations."""
    return param(
        default,
        "a new target is confirmed after this many observations",
        unit="frames",
        low=1,
        high=1000,
    )


def tentative_s(default: float) -> Any:
    """How long a tentative target may be unseen."""
    words = "a new target unseen for longer is dropped"
    return param(default, words, unit="s", low=0.0, high=60.0)


def coast_s(default: float) -> Any:
    """How long an unseen target is present."""
    words = "an unseen target is held present for this time"
    return param(default, words, unit="s", low=0.0, high=60.0)


def keep_s(default: float) -> Any:
    """How long a lost target is remembered."""
    words = "an unseen target may come back within this time"
    return param(default, words, unit="s", low=0.0, high=3600.0)


def hidden_patience(default: float) -> Any:
    """How much longer those behind others are held."""
    words = "targets behind others are held so many times longer"
    return param(default, words, low=1.0, high=100.0)
