"""Virtual shells (SHELLS 2.2): the region around an object within which it can meet others.

The shell S_i is the disc around the object's centre with radius ``r_i = r_min,i + k |v_i|``:
r_min,i is the smallest that encloses the object, so fast objects have large shells and a shell
shrinks as its object slows. Speeds are in pixels per second here, so k is a time.

Deviation: the paper lets a shell be any closed curve; a disc around the box's centre is what its
Figure 1 draws and what an annotated track (box and shell radius) gives back without a further
field.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from reasoning.geometry import circle_around_ellipse
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
        "what the smallest shell encloses: the box, the ellipse, or whichever of them needs"
        " the smaller disc",
        choices=("smallest", "box", "ellipse"),
        source="SHELLS 2.2",
    )


@dataclasses.dataclass(frozen=True)
class Shells:
    """Shells of a frame's N targets: ``centres`` (x, y) and ``radii``, pixels."""

    centres: list[tuple[float, float]]
    radii: list[float]


def shells(targets: Sequence[Target], parameters: ShellParameters) -> Shells:
    """The targets' shells; a target that brings a ``shell_radius`` keeps it.

    Args:
        targets: N targets, velocities in pixels per second.
        parameters: k and what to enclose. A target without an ellipse is enclosed by its box.
    """
    outline, k_s = parameters.outline, parameters.k_s
    middles: list[tuple[float, float]] = []
    radii: list[float] = []
    for target in targets:
        x, y, w, h = target.box
        middle = (x + 0.5 * w, y + 0.5 * h)
        middles.append(middle)
        if target.shell_radius is not None:
            radii.append(float(target.shell_radius))
            continue
        smallest = 0.5 * math.sqrt(w * w + h * h)
        if target.ellipse is not None and outline != "box":
            radius = circle_around_ellipse(target.ellipse, middle)
            smallest = radius if outline == "ellipse" else min(radius, smallest)
        vx, vy = target.velocity
        radii.append(smallest + k_s * math.sqrt(vx * vx + vy * vy))
    return Shells(middles, radii)
