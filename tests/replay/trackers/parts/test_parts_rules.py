"""The paper's rules on scenes that tempt into breaking them: PARTS 2 and 4, SHELLS 2.3."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from recorders.messages import NO_BLOB
from recorders.scene import SceneLog
from replay.engine import Engine, FrameResult


def played(path: Path) -> list[FrameResult]:
    with SceneLog(path) as log:
        return list(Engine(log, "parts").run())


def observed(scenes: list[FrameResult]) -> dict[int, list[int]]:
    """Frames in which each target was seen, by id."""
    seen: dict[int, list[int]] = {}
    for s in scenes:
        for t in s.targets.targets:
            if t.observed:
                seen.setdefault(t.id, []).append(s.frame.index)
    return seen


def test_who_turns_from_red_to_white_is_no_match_even_alone(tmp_path: Path) -> None:
    scene = generate("colour_swap", seed=1)
    seen = observed(played(write_scene_log(scene, tmp_path / "a.mcap", style="merged")))
    # He turns in frame 75; until then one target, from then on another.
    assert len(seen) == 2
    assert max(seen[1]) == 74
    assert min(seen[2]) >= 75


def test_a_dog_and_a_wheel_are_followed_whole(tmp_path: Path) -> None:
    scene = generate("dog_and_wheel", seed=1)
    scenes = played(write_scene_log(scene, tmp_path / "a.mcap", style="merged"))
    told: dict[int, list[tuple[int, float, float]]] = {1: [], 2: []}
    whose: dict[int, Counter[int]] = {1: Counter(), 2: Counter()}
    for s in scenes:
        for a in scene.truth.frames[s.frame.index].actors:
            if a.visible_box is None:
                continue
            x, y, w, h = a.visible_box
            for t in s.targets.targets:
                tx, ty, tw, th = t.box
                across, down = tx + tw / 2 - x, ty + th / 2 - y
                if t.present and 0 < across < w and 0 < down < h:
                    whose[a.id][t.id] += 1
                    told[a.id].append((s.frame.index, tw / w, th / h))
    for actor in (1, 2):
        most, frames = whose[actor].most_common(1)[0]
        # One target each nearly all the time, never a second one for a head or a half.
        assert frames > 100
        assert frames >= 0.9 * sum(whose[actor].values()), most
        sizes = sorted(w * h for _, w, h in told[actor])
        assert 0.6 < sizes[len(sizes) // 2] < 1.5


def test_boxes_alone_join_while_one_is_hidden(tmp_path: Path) -> None:
    path = write_scene_log(
        generate("full_occlusion", seed=1),
        tmp_path / "a.mcap",
        pictures="none",
        masks=False,
    )
    joint = 0
    for s in played(path):
        told = {t.id: t for t in s.targets.targets}
        for r in s.annotation.relations.relations:
            if r.state != "JOINT" or not {r.a, r.b} <= set(told):
                continue
            a, b = told[r.a], told[r.b]
            if a.observed != b.observed and a.blob == b.blob:
                assert a.blob != NO_BLOB
                joint += 1
    assert joint > 5
