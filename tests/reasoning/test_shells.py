"""The virtual shell model (SHELLS 2.2)."""

from __future__ import annotations

from typing import Any

import pytest

from reasoning.shells import ShellParameters, shells
from recorders.errors import ConfigError
from recorders.messages import Ellipse, Target


def radius(target: Target, **parameters: Any) -> float:
    return shells([target], ShellParameters(**parameters)).radii[0]


def test_radius_at_rest_encloses_the_box() -> None:
    assert radius(Target(1, (0, 0, 30, 40))) == 25


def test_radius_grows_with_speed_and_shrinks_again() -> None:
    assert radius(Target(1, (0, 0, 30, 40), (30, 40)), k_s=0.5) == 50
    assert radius(Target(1, (0, 0, 30, 40), (3, 4)), k_s=0.5) == 27.5
    assert radius(Target(1, (0, 0, 30, 40), (30, 40)), k_s=0.0) == 25


@pytest.mark.parametrize(
    ("outline", "expected"), [("box", 25), ("ellipse", 20), ("smallest", 20)]
)
def test_the_smallest_enclosing_of_box_and_ellipse(outline: str, expected: int) -> None:
    target = Target(1, (0, 0, 30, 40), ellipse=Ellipse(15, 20, 40, 20, 1.5))
    assert radius(target, outline=outline) == expected


def test_an_ellipse_that_needs_more_than_the_box_does_not_enlarge_the_shell() -> None:
    target = Target(1, (0, 0, 30, 40), ellipse=Ellipse(15, 20, 90, 20, 1.5))
    assert radius(target) == 25
    assert radius(target, outline="ellipse") == 45


def test_a_target_may_bring_its_own_shell() -> None:
    assert radius(Target(1, (0, 0, 30, 40), (100, 0), shell_radius=7.5)) == 7.5


def test_shells_stand_around_the_boxes_centres() -> None:
    answer = shells(
        [Target(1, (0, 0, 30, 40)), Target(2, (100, 10, 10, 10))], ShellParameters()
    )
    assert answer.centres == [(15, 20), (105, 15)]


def test_no_targets() -> None:
    assert shells([], ShellParameters()).radii == []


def test_parameters_are_checked() -> None:
    with pytest.raises(
        ConfigError, match=r"ShellParameters.k_s = -1.0: must be in \[0.0, 10.0\]"
    ):
        ShellParameters(k_s=-1.0)
