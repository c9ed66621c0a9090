"""The exact sequence of events of every scripted scene, written down in stories.txt, from the
truth's boxes.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fixtures.scenes import SCRIPTS
from reasoning.reasoner import Reasoner

KINDS = (
    "grouping", "grouped", "splitting", "single", "group_formed", "group_changed", "group_ended",
    "group_entered_scene", "interaction_started", "joined", "separated", "interaction_ended", "entering", "entered",
    "exiting", "returned", "exited", "zone_entered", "zone_left",
)  # fmt: skip
TOLERANCE = 2
BY_THE_RULES_ALONE = {"crowd", "six_fish"}
"""Hundreds of events from parts that the seed writes: `test_oracle` holds them against the rules.
"""


def stories() -> dict[str, list[tuple[int, str, list[int], str]]]:
    """Scene to (frame, kind, subjects, zone), in order."""
    found: dict[str, list[tuple[int, str, list[int], str]]] = {}
    rows: list[tuple[int, str, list[int], str]] = []
    for line in (
        (Path(__file__).parent / "stories.txt").read_text(encoding="ascii").splitlines()
    ):
        if line.startswith("@"):
            rows = found[line[2:]] = []
        elif line and not line.startswith("#"):
            frame, kind, *rest = line.split()
            who = [int(w) for w in rest if w.isdigit()]
            rows.append((int(frame), kind, who, " ".join(rest[len(who) :])))
    return found


STORIES = stories()


def test_every_script_has_a_story() -> None:
    assert set(STORIES) | BY_THE_RULES_ALONE == set(SCRIPTS)


@pytest.mark.parametrize("name", STORIES)
def test_the_truth_tells_the_story(play: Callable[..., Any], name: str) -> None:
    scene, answers = play(name)
    reasoner = Reasoner({}, scene.width, scene.height)
    told = []
    for targets in answers:
        events = reasoner.step(
            targets.frame, scene.time_ns(targets.frame), targets, scene.truth.regions
        ).events
        told += [
            (e.frame, e.kind, e.subjects, e.evidence.get("zone", ""))
            for e in events
            if e.kind in KINDS
        ]
    story = STORIES[name]
    told.sort()
    assert [t[1:] for t in told] == [s[1:] for s in story]
    late = [
        (t, s) for t, s in zip(told, story, strict=True) if abs(t[0] - s[0]) > TOLERANCE
    ]
    assert late == []
    assert reasoner.counter.forbidden == 0


@pytest.mark.parametrize("name", STORIES)
def test_who_comes_and_goes_is_told_by_how_far(play: Callable[..., Any], name: str) -> None:
    """Into the region of interest, or beyond the border: the measure that decided, of the box
    that is told with it.
    """
    scene, answers = play(name)
    reasoner = Reasoner({}, scene.width, scene.height)
    for targets in answers:
        for e in reasoner.step(
            targets.frame, scene.time_ns(targets.frame), targets, scene.truth.regions
        ).events:
            x, y, w, h = e.evidence.get("box", (0, 0, 0, 0))
            if e.kind in ("entered", "returned"):
                (roi,) = scene.truth.regions.roi
                sides = [x - min(p[0] for p in roi), max(p[0] for p in roi) - x - w,
                         y - min(p[1] for p in roi), max(p[1] for p in roi) - y - h]  # fmt: skip
                assert e.evidence["within_roi_px"] == pytest.approx(min(sides))
                assert (
                    e.evidence["within_roi_px"] >= e.evidence["within_roi_px_at_least"] == 0
                )
            if e.kind == "exiting":
                (border,) = scene.truth.regions.border
                sides = [
                    min(p[0] for p in border) - x,
                    x + w - max(p[0] for p in border),
                    min(p[1] for p in border) - y,
                    y + h - max(p[1] for p in border),
                ]
                assert e.evidence["beyond_border_px"] == pytest.approx(max(sides))
                assert (
                    e.evidence["beyond_border_px"]
                    > e.evidence["beyond_border_px_over"]
                    == 0
                )
