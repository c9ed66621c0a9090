"""The parameters of `--detect onnx`."""

from __future__ import annotations

from dataclasses import dataclass

from recorders.parameters import Parameters, param


@dataclass(frozen=True)
class DetectorParameters(Parameters):
    """What is taken of a network's answers."""

    min_score: float = param(0.25, "smallest score that is recorded", low=0.001, high=1)
    suppress_overlap: float = param(
        0.5,
        "of two boxes of one class that overlap by this, the better one stays (networks that"
        " do this themselves are left alone)",
        unit="intersection over union",
        low=0.05,
        high=1,
    )
    input_side: int = param(
        0,
        "side of the network's input where the model leaves it open; 0: as its metadata say,"
        " else 640",
        unit="px",
        low=0,
        high=4096,
    )
