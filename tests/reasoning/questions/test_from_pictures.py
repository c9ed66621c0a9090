"""The ready questions on scripted scenes by the commands, from pixels, as `scenetrace demo` asks
them: what is answered by default is what the script says, to half a second.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from fixtures.logs import export_video, write_regions
from fixtures.scenes import GeneratedScene, generate
from reasoning.questions import Case
from reasoning.questions.literals import Moment
from reasoning.questions.ready_questions import DEFAULT_CERTAINTY
from recorders.segmentation.usual import ious
from replay.cli import main
from tests.conftest import MadeOnce
from tests.reasoning.questions.test_scripted_scenes import ask, present

SLACK_S = 0.5
LEFT_WITH = {"demo": {(1, 3)}, "meet_and_walk_on_together": {(1, 2)}}
"""Who goes out of the picture with whom, as the scripts have it: nobody in the others."""
PASS = {
    "demo": {(1, 5), (3, 5)},
    "full_occlusion": {(1, 2), (2, 3)},
    "pass_by": {(1, 2)},
    "three_way_group": {(2, 3)},
}
"""Who passes within a body size of whom without being together."""


@dataclass(frozen=True)
class Told:
    """A scene, its annotated log, and which actor each track is."""

    scene: GeneratedScene
    case: Case
    actor: dict[int, int]

    def pairs(self, name: str) -> list[tuple[tuple[int, int], dict]]:
        """The rows of a question to each track, by the pair of actors that they are of."""
        found = []
        for track in self.actor:
            for row in ask(self.case, name, track, certainty=DEFAULT_CERTAINTY):
                other = row["other"] if "other" in row else row["a"] + row["b"] - track
                pair = sorted((self.actor[track], self.actor[other]))
                found.append(((pair[0], pair[1]), row))
        return found


@pytest.fixture(
    scope="module",
    params=[
        "demo", "full_occlusion", "leave_and_come_back", "meet_and_walk_on_together", "pass_by", "three_way_group",
    ],
)  # fmt: skip
def told(request: pytest.FixtureRequest, made_once: MadeOnce) -> Iterator[Told]:
    name: str = request.param
    scene = generate(name)

    def fill(folder: Path) -> None:
        video, log = folder / "scene.mp4", folder / "scene.mcap"
        export_video(scene, video)
        write_regions(scene, folder / "regions.json")
        words = ["record", str(video), "-o", str(log), "--regions"]
        assert main([*words, str(folder / "regions.json")]) == 0
        assert main(["replay", str(log), "-o", str(folder / "annotated.mcap")]) == 0

    with Case([made_once(f"pictures-{name}", fill) / "annotated.mcap"]) as case:
        yield Told(scene, case, actors(scene, case))


def actors(scene: GeneratedScene, case: Case) -> dict[int, int]:
    """Whom each track lies on most of the time."""
    votes: dict[int, Counter[int]] = {}
    for frame, track, *box in case.rows(
        "SELECT frame, track, x, y, w, h FROM tracks WHERE present ORDER BY frame, track"
    ):
        there = scene.truth.frames[frame].actors
        if there:
            shared = ious(np.array([box]), np.array([a.box for a in there], float))[0]
            votes.setdefault(track, Counter())[there[int(shared.argmax())].id] += 1
    return {track: count.most_common(1)[0][0] for track, count in votes.items()}


def meant(scene: GeneratedScene) -> dict[tuple[int, int], tuple[float, float]]:
    """Who is together from when to when, as far as both can be tracked."""
    spans = {}
    for a, b in combinations([x.id for x in scene.truth.actors], 2):
        own = [t for t in scene.truth.together if (t.a, t.b) == (a, b)]
        if own:
            both = [n for n in range(scene.frame_count) if {a, b} <= present(scene, n)]
            first = max(min(t.start for t in own), both[0])
            spans[a, b] = (
                first / scene.fps,
                min(max(t.end for t in own), both[-1]) / scene.fps,
            )
    return spans


def test_together(told: Told) -> None:
    found = {pair: (row["start_t"], row["end_t"]) for pair, row in told.pairs("together")}
    wanted = meant(told.scene)
    assert found.keys() == wanted.keys()
    for pair, span in wanted.items():
        assert found[pair] == pytest.approx(span, abs=SLACK_S), pair


def test_met(told: Told) -> None:
    """Whoever is together or passes near; others only where the truth has them near, too."""
    found = {pair for pair, _ in told.pairs("met")}
    assert found >= meant(told.scene).keys() | PASS.get(told.scene.name, set())
    for a, b in found:
        assert least_way(told.scene, a, b) <= 1.0, (a, b)


def least_way(scene: GeneratedScene, a: int, b: int) -> float:
    """How near the feet of two come to one another in the picture, in body sizes."""
    ways = []
    for frame in scene.truth.frames:
        one, two = frame.actor(a), frame.actor(b)
        if one is not None and two is not None:
            size = np.hypot(*one.full_box[2:]) + np.hypot(*two.full_box[2:])
            apart = np.subtract(one.foot, two.foot)
            ways.append(float(np.hypot(*apart) / (size / 2)))
    return min(ways)


def test_who_left_with_whom(told: Told) -> None:
    found = {pair for pair, _ in told.pairs("left-with")}
    assert found == LEFT_WITH.get(told.scene.name, set())


def test_who_stays(told: Told) -> None:
    scene, last = told.scene, told.scene.frame_count - 1
    wanted = present(scene, last) - present(scene, 0)
    rows = ask(told.case, "entered-never-left", certainty=DEFAULT_CERTAINTY)
    found = {told.actor[r["track"]]: r["entered_t"] for r in rows}
    assert found.keys() == wanted
    for actor in wanted:
        away = max(n for n in range(last + 1) if actor not in present(scene, n))
        assert found[actor] == pytest.approx(away / scene.fps, abs=SLACK_S)


def test_who_was_there(told: Told) -> None:
    """Who is hidden behind a pillar may be told or not."""
    scene = told.scene
    slack = round(SLACK_S * scene.fps)
    for frame in range(slack, scene.frame_count - slack, scene.fps):
        rows = ask(told.case, "who-was-in", "scene", at=Moment(frame=frame))
        found = {told.actor[r["track"]] for r in rows}
        around = [frame + n for n in (-slack, 0, slack)]
        shown = [
            {a.id for a in scene.truth.frames[n].actors if a.visibility > 0.5}
            for n in around
        ]
        there = [present(scene, n) for n in around]
        assert found >= set.intersection(*there, *shown), frame
        assert found <= set.union(*there), frame


def test_nobody_changes_partners_but_in_the_script(told: Told) -> None:
    for row in ask(told.case, "grouping-and-splitting", certainty=DEFAULT_CERTAINTY):
        assert told.scene.name in ("demo", "three_way_group"), row
