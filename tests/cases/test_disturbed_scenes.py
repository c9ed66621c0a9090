"""What fixed cameras live through: two people cross, whatever becomes of the picture meanwhile."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import scenetrace
from replay.evaluate import Scores, evaluate, read_truth
from tests.cases.conftest import Case

WIDTH, FRAMES, FPS = 320, 300, 25
PEOPLE = ((-30, 100, 30, 20, 56), (340, 120, -28, 22, 60))
"""Of each: x and y at the start, px, px a second to the right, width and height."""
LEAST_SEEN = 0.25
"""Of a person who is cut off at the picture's edge this share must be in it."""


@dataclass(frozen=True)
class Outcome:
    scores: Scores
    told: set[str]


def truth(kind: str) -> list[str]:
    """Rows of MOTChallenge text."""
    rows = []
    for frame in range(FRAMES):
        t = frame / FPS
        panned = round(float(np.clip((t - 5) / 2, 0, 1)) * 100) if kind == "ptz" else 0
        for number, (x, y, speed, w, h) in enumerate(PEOPLE, 1):
            left = round(x + speed * t) - panned
            seen = max(left, 0), min(left + w, WIDTH)
            if seen[1] - seen[0] >= LEAST_SEEN * w:
                rows.append(f"{frame + 1},{number},{seen[0]},{y},{seen[1] - seen[0]},{h},1")
    return rows


def outcome(case: Case, kind: str, folder: Path) -> Outcome:
    video = case("video/s_scene", kind, suffix=".mp4")
    log, annotated, found, true = (
        folder / name for name in ("scene.mcap", "annotated.mcap", "found.txt", "true.txt")
    )
    for words in (
        ("record", video, "-o", log),
        ("replay", log, "-o", annotated),
        ("export", annotated, "--to", "mot", "-o", found),
    ):
        assert scenetrace.main([str(word) for word in words]) == 0
    true.write_text("".join(f"{row}\n" for row in truth(kind)), "utf-8")
    with scenetrace.open(annotated) as opened:
        rows = opened.sql("SELECT evidence FROM events WHERE kind = 'scene_changed'")
        told = {json.loads(evidence)["kind"] for (evidence,) in rows}
    return Outcome(evaluate(read_truth(true), read_truth(found)), told)


@pytest.mark.parametrize(
    ("kind", "least", "told"),
    [
        ("shake", 0.9, set()),
        ("noise", 0.9, set()),
        ("ptz", 0.9, {"panned"}),
        ("jumpcut", 0.9, {"panned"}),
        ("light", 0.9, {"light"}),
        ("exposure", 0.9, {"light"}),
    ],
)
def test_two_people_are_found_and_stay_themselves(
    case: Case, tmp_path: Path, kind: str, least: float, told: set[str]
) -> None:
    found = outcome(case, kind, tmp_path)
    assert found.scores.clear.mota >= least
    assert found.scores.identity.idf1 >= least
    assert found.told == told
