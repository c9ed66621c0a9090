"""PARTS on scenes: identities kept, parts said to be hidden, started by hand, by boxes alone,
plugged-in heads.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fixtures.logs import write_scene_log, write_truth
from fixtures.scenes import GeneratedScene, generate
from reasoning.regions import RegionParameters
from recorders.annotated.reader import AnnotatedLog
from recorders.messages import Target
from recorders.scene import SceneInfo, SceneLog
from replay.annotated_writer import replay
from replay.cli import main
from replay.configuration import replay_config
from replay.engine import Forward
from replay.evaluate import MotTable, Scores, evaluate, fit_truth, read_truth
from replay.evaluate.track_table import read_tracks
from replay.run import ReplayOptions
from replay.trackers.association import iou
from replay.trackers.parts import PartsTracker
from replay.trackers.parts.heads import Head
from replay.trackers.parts.parameters import PartsParameters
from replay.verification import verify

SIZE = (320, 240)


@cache
def crossing() -> GeneratedScene:
    return generate("pass_by", seed=2, size=SIZE)


@pytest.fixture(scope="module")
def passing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two who pass one another, one before the other, as a motion detector sees them."""
    scene = crossing()
    return write_scene_log(
        scene, tmp_path_factory.mktemp("parts") / "scene.mcap", style="merged"
    )


def forward(path: Path, *assignments: str, **more: Any) -> list[list[Target]]:
    config = replay_config("parts", assignments=assignments)

    def make(info: SceneInfo, _: object) -> PartsTracker:
        found: Any = config
        return PartsTracker(info, found["parts"], found["part_features"], **more)

    with SceneLog(path) as log:
        return [step.targets.targets for step in Forward(log, make, config).steps()]


@pytest.fixture(scope="module")
def answers(passing: Path) -> list[list[Target]]:
    """What is said of those who pass one another, with every default."""
    return forward(passing)


def test_identities_survive_a_crossing_in_one_blob(answers: list[list[Target]]) -> None:
    scene = crossing()
    owners: dict[int, set[int]] = {}
    for truth, targets in zip(scene.truth.frames, answers, strict=True):
        seen = [t for t in targets if t.observed]
        for actor in truth.actors:
            if seen and actor.visible == actor.pixels:
                overlap = iou(np.array([actor.full_box]), np.array([t.box for t in seen]))[
                    0
                ]
                if overlap.max() > 0.5:
                    owners.setdefault(actor.id, set()).add(seen[int(overlap.argmax())].id)
    assert sorted(len(ids) for ids in owners.values()) == [1, 1]
    assert owners[1] != owners[2]


def test_who_stands_behind_has_hidden_parts_and_who_stands_before_has_not(
    answers: list[list[Target]],
) -> None:
    scene = crossing()
    worst = min(
        (f.index for f in scene.truth.frames if len(f.actors) == 2),
        key=lambda k: min(a.visibility for a in scene.truth.frames[k].actors),
    )
    hidden: dict[str, int] = {"behind": 0, "before": 0}
    for index in range(worst - 3, worst + 4):
        frame = scene.truth.frames[index]
        near = frame.actor(frame.depth_order[-1])
        assert near is not None
        targets = answers[index]
        overlap = [
            float(iou(np.array([near.full_box]), np.array([t.box]))[0, 0]) for t in targets
        ]
        for k, target in enumerate(targets):
            hidden["before" if k == int(np.argmax(overlap)) else "behind"] += len(
                target.hidden_parts
            )
    assert hidden["behind"] >= 7
    assert hidden["before"] <= 5


def test_gates_are_told_and_double_while_a_target_is_missed(
    answers: list[list[Target]],
) -> None:
    most = PartsParameters().gate_most
    sides: dict[int, tuple[bool, float]] = {}
    doubled = 0
    for targets in answers:
        for t in targets:
            assert t.newborn or isinstance(t.gate, tuple)
            if not isinstance(t.gate, tuple):
                continue
            missed, before = sides.get(t.id, (False, 0.0))
            side = t.gate[2]
            if missed and side < 2 * most * t.box[3]:
                # Twice the last one, as the speed that it began with has not changed since.
                assert side == pytest.approx(2 * before, rel=0.2)
                doubled += 1
            sides[t.id] = (not t.observed, side)
    assert doubled


def test_boxes_alone_are_tracked_with_the_features_that_need_no_pixels(
    tmp_path: Path,
) -> None:
    scene = generate("three_way_group", seed=1, size=SIZE, frames=200)
    path = write_scene_log(scene, tmp_path / "boxes.mcap", pictures="none", masks=False)
    ids = {t.id for targets in forward(path) for t in targets if t.present}
    assert 2 <= len(ids) <= 5


def test_a_target_started_by_hand_is_the_only_one_told_of_and_verify_starts_it_again(
    passing: Path, tmp_path: Path
) -> None:
    scene = crossing()
    actor = scene.truth.frames[50].actor(1)
    assert actor is not None
    out = tmp_path / "a.mcap"
    box = ",".join(f"{v:g}" for v in actor.full_box)
    assert (
        main(
            [
                "replay",
                str(passing),
                "-o",
                str(out),
                "--tracker",
                "parts",
                "--init",
                f"frame:50:{box}",
            ]
        )
        == 0
    )
    with AnnotatedLog(out) as log:
        assert "frame:50:" in str(log.facts)
        table = read_tracks(log).table
    assert set(table.ids.tolist()) == {1}
    last = scene.truth.frames[130].actor(1)
    assert last is not None
    assert iou(table.boxes[table.frames == 130], np.array([last.full_box])).max() > 0.5
    assert verify(out).identical
    assert (
        main(
            [
                "replay",
                str(passing),
                "-o",
                str(tmp_path / "b.mcap"),
                "--init",
                "frame:0:1,2,3,4",
            ]
        )
        == 2
    )


@pytest.mark.parametrize(
    ("start", "code", "words"),
    [
        ("frame:500:10,10,20,60", 2, "the recording has"),
        ("frame:5:1000,10,20,60", 2, "outside of the picture"),
        ("frame:5:100,100,0.1,0.1", 2, "not the size of anybody"),
        ("frame:5:100,100,5000,5000", 2, "outside of the picture"),
        ("frame:0:10,4,12,30", 3, "none of 1 targets started by hand were found"),
    ],
)
def test_a_start_that_the_recording_cannot_hold_or_that_finds_nobody_is_said(
    passing: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    start: str,
    code: int,
    words: str,
) -> None:
    out = tmp_path / "a.mcap"
    assert (
        main(
            ["replay", str(passing), "-o", str(out), "--tracker", "parts", "--init", start]
        )
        == code
    )
    assert words in capsys.readouterr().err
    assert out.exists() == (code == 3)


@pytest.mark.parametrize(
    "words",
    [
        ["--set", "parts.hindsight=false"],
        ["--from", "frame:10"],
        ["--from", "frame:80", "--to", "frame:90"],
    ],
    ids=["forward alone", "a span after", "a span within"],
)
def test_a_start_that_finds_nobody_is_said_whatever_is_written(
    passing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    nobody, out = "frame:5:10,4,12,30", tmp_path / "a.mcap"
    command = ["replay", str(passing), "-o", str(out), "--tracker", "parts", *words]
    assert main([*command, "--init", nobody]) == 3
    assert "none of 1 targets started by hand were found" in capsys.readouterr().err
    actor = crossing().truth.frames[50].actor(1)
    assert actor is not None
    box = ",".join(f"{v:g}" for v in actor.full_box)
    assert main([*command, "--force", "--init", f"frame:50:{box}"]) == 0, (
        "somebody is in that box"
    )


def test_scores_of_fitted_features_say_what_they_were_fitted_on(
    passing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = write_truth(crossing(), tmp_path / "gt.txt")
    for tracker, said in (("parts", True), ("events", False)):
        out = tmp_path / f"{tracker}.mcap"
        assert main(["replay", str(passing), "-o", str(out), "--tracker", tracker]) == 0
        capsys.readouterr()
        assert main(["eval", str(out), "--truth", str(truth)]) == 0
        assert ("were fitted on" in capsys.readouterr().err) == said
    words = [
        "eval",
        str(tmp_path / "events.mcap"),
        "--truth",
        str(truth),
        "--plot",
        str(tmp_path / "both.png"),
    ]
    assert main([*words, "--also", str(tmp_path / "parts.mcap")]) == 0
    assert capsys.readouterr().err.count("were fitted on") == 1, (
        "of what is drawn beside it, too"
    )


def test_targets_begin_and_stay_in_the_regions_alone_unless_they_were_started_by_hand(
    tmp_path: Path,
) -> None:
    """Inset by 0.3 of 240 pixels, the regions are x from 72 to 248, y from 72 to 168."""
    scene = crossing()
    path = write_scene_log(scene, tmp_path / "inset.mcap", style="merged", regions=False)
    regions = RegionParameters(roi_inset=0.3, border_inset=0.3)
    answers = forward(path, region_parameters=regions)
    born = [t for targets in answers for t in targets if t.newborn]
    assert born
    assert all(60 < t.box[0] + t.box[2] / 2 < 260 for t in born)
    for targets in answers:
        assert all(t.box[0] < 248 and t.box[0] + t.box[2] > 72 for t in targets)
    actor = scene.truth.frames[40].actor(1)
    assert actor is not None
    assert actor.full_box[0] + actor.full_box[2] < 72
    box = ",".join(f"{v:g}" for v in actor.full_box)
    by_hand = forward(path, f"parts.init=frame:40:{box}", region_parameters=regions)
    assert [t.id for t in by_hand[44]] == [1]


def test_another_head_detector_can_be_plugged_in(passing: Path) -> None:
    asked = []

    def heads(image: object, mask: object, box: np.ndarray, height: float) -> list[Head]:
        asked.append(height)
        return [Head(float(box[0] + box[2] / 2), float(box[1]), 1.0)]

    with_them = forward(passing, find_heads=heads)
    assert asked
    assert all(0 < h < 300 for h in asked)
    without = forward(passing, find_heads=lambda *_: [])
    assert with_them != without
    assert forward(passing, "parts.use_heads=false") == without


def test_without_parts_who_passes_is_followed_by_place_and_size_alone(
    passing: Path, answers: list[list[Target]]
) -> None:
    without = forward(passing, "parts.use_parts=false")
    assert answers != without
    assert any(t.observed for targets in without for t in targets)


def test_without_pruning_the_heads_image_is_never_looked_for(
    passing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("the head's image was looked for")

    monkeypatch.setattr("replay.trackers.parts.matching.refine", refuse)
    assert any(
        t.observed
        for targets in forward(passing, "parts.use_pruning=false")
        for t in targets
    )


@pytest.mark.xfail(
    reason="while nine is within another's blob, a whole blob that nobody took is taken for his:"
    " by hand and in hindsight 7 of 10 are mostly tracked, the paper has 10 of 10"
)
def test_by_hand_a_target_is_told_of_as_well_as_if_everybody_were(
    pets_of_truth: tuple[Path, MotTable], tmp_path: Path
) -> None:
    """Person 9 is lost behind a sign and among others, and is there again later: hindsight joins
    what was followed.
    """
    scene, truth = pets_of_truth
    own = truth.select(truth.ids == 9)
    box = ",".join(f"{v:.2f}" for v in own.boxes[0].tolist())
    config = replay_config("parts", assignments=(f"parts.init=frame:0:{box}",))
    replay(scene, tmp_path / "a.mcap", ReplayOptions(tracker="parts", config=config))
    with AnnotatedLog(tmp_path / "a.mcap") as log:
        table = read_tracks(log).table
    assert set(table.ids.tolist()) == {1}, "nobody else is told of"
    followed = evaluate(own, table).trajectories
    assert followed.mostly_tracked_single_id == 1


@pytest.fixture(scope="module")
def pets_of_truth(real_data: Path, pets: Path) -> tuple[Path, MotTable]:
    """PETS09-S2L1 from pixels, with the truth."""
    truth = fit_truth(
        read_truth(real_data / "pets09-s2l1" / "gt.txt"), (480, 360), (768, 576)
    )
    return pets / "scene.mcap", truth


def test_pets_from_pixels_is_better_than_opencv_with_sort_or_norfair(
    pets_of_truth: tuple[Path, MotTable], tmp_path: Path
) -> None:
    scene, truth = pets_of_truth
    replay(
        scene,
        tmp_path / "a.mcap",
        ReplayOptions(tracker="parts", config=replay_config("parts")),
    )
    with AnnotatedLog(tmp_path / "a.mcap") as log:
        scores: Scores = evaluate(truth, read_tracks(log).table)
    assert scores.hota.hota > 57
    assert scores.clear.mota > 75
    assert scores.identity.idf1 > 76
    errors = scores.trajectories.followed
    assert all(
        e <= limit for e, limit in zip(errors.headline, (3.0, 1.8, 13.1, 5.2), strict=True)
    )
    assert errors.share > 80
