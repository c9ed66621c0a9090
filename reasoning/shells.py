"""Virtual shells (SHELLS 2.2): the region around an object within which it can meet others.

The shell S_i is the disc around the object's centre with radius ``r_i = r_min,i + k |v_i|``: r_min,i is the smallest
that encloses the object, so fast objects have large shells and a shell shrinks as its object slows. Speeds are in
pixels per second here, so k is a time.

Deviation: the paper lets a shell be any closed curve; a disc around the box's centre is what its Figure 1 draws and
what an annotated track (box and shell radius) gives back without a further field.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from reasoning.geometry import Floats, centres, circle_around_ellipse, half_diagonals
from recorders.messages import Target
from recorders.parameters import Parameters, param


@dataclasses.dataclass(frozen=True)
class ShellParameters(Parameters):
    """Size of a shell (SHELLS 2.2)."""

    k_s: float = param(
        0.2,
        "shell growth with speed: radius = smallest enclosing radius + k * speed",
        unit="s",
        low=0.0,
        high=10.0,
        source="SHELLS 2.2 (value ours)",
    )
    outline: str = param(
        "smallest",
        "what the smallest shell encloses: the box, the ellipse, or whichever of them needs the smaller disc",
        choices=("smallest", "box", "ellipse"),
        source="SHELLS 2.2",
    )


@dataclasses.dataclass(frozen=True)
class Shells:
    """Shells of a frame's targets: ``centres`` (N, 2) and ``radii`` (N,), float64 pixels."""

    centres: Floats
    radii: Floats


def shells(targets: Sequence[Target], parameters: ShellParameters) -> Shells:
    """The targets' shells; a target that brings a ``shell_radius`` keeps it.

    Args:
        targets: N targets, velocities in pixels per second.
        parameters: k and what to enclose. A target without an ellipse is enclosed by its box.
    """
    boxes = np.array([t.box for t in targets], np.float64).reshape(-1, 4)
    middle = centres(boxes)
    smallest = half_diagonals(boxes)
    if parameters.outline != "box":
        for i, t in enumerate(targets):
            if t.ellipse is not None:
                radius = circle_around_ellipse(t.ellipse, (float(middle[i, 0]), float(middle[i, 1])))
                smallest[i] = radius if parameters.outline == "ellipse" else min(radius, smallest[i])
    v = np.array([t.velocity for t in targets], np.float64).reshape(-1, 2)
    radii = smallest + parameters.k_s * np.sqrt(v[:, 0] * v[:, 0] + v[:, 1] * v[:, 1])
    for i, t in enumerate(targets):
        if t.shell_radius is not None:
            radii[i] = t.shell_radius
    return Shells(middle, radii)
