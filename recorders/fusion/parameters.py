"""The parameters of the fusion of detector and masks."""

from __future__ import annotations

from dataclasses import dataclass

from recorders.parameters import Parameters, param


@dataclass(frozen=True)
class FusionParameters(Parameters):
    """How boxes of a detector and of masks become one set."""

    fuse: bool = param(
        True,
        "make one set of detections of masks and detector; else the detector's stay as they"
        " are, each with the blob that it lies in",
    )
    ahead_s: float = param(
        1.0, "how far ahead a hypothesis is followed before it is decided on", unit="s",
        low=0.0, high=30.0,
    )  # fmt: skip
    memory_s: float = param(
        4.0, "what was seen so long ago counts a third", unit="s", low=0.1, high=600.0
    )
    min_belief: float = param(
        0.5, "hypotheses believed less than this are left out", low=0.01, high=0.99
    )
