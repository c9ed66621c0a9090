"""The tracker on scenes whose truth is exact, and on the real recordings' hard spots."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from fixtures.logs import record_scene, write_scene_log
from fixtures.scenes import generate
from recorders.annotated.checkpoint import decode_state, encode_state
from recorders.annotated.reader import AnnotatedLog
from recorders.errors import UsageError
from recorders.masks import label_blobs
from recorders.messages import Detections, Regions
from recorders.recording import RecordOptions, record
from recorders.scene import Frame, SceneInfo, SceneLog
from recorders.segmentation.blobs import components
from recorders.sources import open_source
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.engine import Forward
from replay.evaluate import Scores, evaluate, fit_truth, read_truth
from replay.evaluate.track_table import read_tracks
from replay.run import ReplayOptions
from replay.trackers.catalogue import TRACKERS
from replay.trackers.shells import ShellsParameters, ShellsTracker, make
from replay.trackers.shells.colours import bins_of
from replay.trackers.shells.foreground import Foreground
from replay.trackers.shells.objects import Bodies, Body
from replay.trackers.shells.resolve import Resolver, SeenFrame

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


@pytest.fixture(scope="module")
def measures() -> Iterator[ModuleType]:
    sys.path.insert(0, str(BENCHMARKS))
    try:
        import shells_measures

        yield shells_measures
    finally:
        sys.path.remove(str(BENCHMARKS))


@pytest.fixture(scope="module")
def tank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six fish, of whom many meet."""
    scene = generate("six_fish", seed=5, frames=260)
    return write_scene_log(
        scene, tmp_path_factory.mktemp("tank") / "tank.mcap", style="merged"
    )


@pytest.mark.parametrize(
    ("name", "seed"),
    [pytest.param("three_fish", 0, marks=pytest.mark.long), ("six_fish", 2)],
)
def test_every_fish_keeps_its_identity(
    measures: ModuleType, tmp_path: Path, name: str, seed: int
) -> None:
    scene = generate(name, seed=seed)
    log = record_scene(scene, tmp_path / "tank.mcap")
    boxes, labels = measures.follow(log, "shells")
    result = measures.judge_tank(scene, boxes)
    assert result.asked > 0
    assert result.lost == 0
    assert np.median(result.errors_px) < 3.0  # half a body's width is 6.6
    assert len(labels) == scene.frame_count
    blind = measures.judge_tank(scene, measures.follow(log, "sort")[0])
    assert blind.lost > 0


def test_pixels_of_shared_blobs_go_to_their_owners(
    measures: ModuleType, tmp_path: Path
) -> None:
    scene = generate("three_fish", seed=1, frames=300)
    log = write_scene_log(scene, tmp_path / "exact.mcap", style="merged")
    pixels, right, near = measures.pixel_accuracy(scene, *measures.follow(log, "shells"))
    assert pixels > 1000
    assert right > 0.85
    assert right > near


def test_everything_can_be_resumed_bit_for_bit(tmp_path: Path) -> None:
    path = write_scene_log(
        generate("three_fish", seed=3, frames=140), tmp_path / "a.mcap", style="merged"
    )
    config = replay_config("shells")
    with SceneLog(path) as scene:
        tracker = TRACKERS["shells"](scene.info, config)
        other = None
        for frame in scene.frames():
            said = tracker.step(frame)
            if other is not None:
                assert other.step(frame) == said
            state = encode_state(tracker.state())
            if other is None or frame.index % 20 == 0:
                other = TRACKERS["shells"](scene.info, config)
                other.restore(decode_state(state))
            assert encode_state(other.state()) == state


def test_detections_alone_and_an_empty_scene_are_followed(tmp_path: Path) -> None:
    scene = generate("pass_by", seed=1, frames=150)
    path = write_scene_log(scene, tmp_path / "a.mcap", pictures="none", masks=False)
    with SceneLog(path) as log:
        steps = list(Forward(log, TRACKERS["shells"], replay_config("shells")).steps())
    assert {t.id for s in steps for t in s.targets.targets} == {1, 2}
    assert not any(s.extra for s in steps)
    empty = write_scene_log(
        generate("empty_scene", frames=20), tmp_path / "b.mcap", style="merged"
    )
    with SceneLog(empty) as log:
        assert not any(
            s.targets.targets
            for s in Forward(log, TRACKERS["shells"], replay_config("shells")).steps()
        )


def test_relations_never_jump(measures: ModuleType, tank: Path, tmp_path: Path) -> None:
    options = ReplayOptions(
        tracker="shells", config=replay_config("shells"), annotations_only=True
    )
    replay(tank, tmp_path / "out.mcap", options)
    changes, direct = measures.direct_steps(tmp_path / "out.mcap")
    assert changes > 20
    assert direct == 0
    steps = [measures.random_steps(seed) for seed in range(200)]
    assert sum(changes for changes, _ in steps) > 2000
    assert sum(direct for _, direct in steps) == 0


def test_without_interaction_nobody_is_joint(tank: Path) -> None:
    """Where shells have to meet for a minute before they count, nobody becomes JOINT."""

    def joint(*settings: str) -> int:
        """The most pairs that are JOINT, in a frame of the first 100."""
        with SceneLog(tank) as scene:
            tracker = make(scene.info, replay_config("shells", assignments=settings))
            assert isinstance(tracker, ShellsTracker)
            most = 0
            for frame in islice(scene.frames(), 100):
                tracker.step(frame)
                state = tracker.state()
                most = max(most, sum(e[2] == "JOINT" for e in state["book"]["edges"]))
            return most

    assert joint() > 0
    assert joint("relations.enter_duration_s=60") == 0


@pytest.mark.parametrize("related", [True, False])
def test_who_is_not_related_is_no_rival(related: bool) -> None:
    """Two of different colours in one blob: related, each has its own half; else each has all of
    its shell.
    """
    image = np.zeros((60, 100, 3), np.uint8)
    image[20:40, 20:50], image[20:40, 50:80] = (0, 0, 220), (220, 0, 0)
    mask = (image.max(axis=2) > 0).astype(np.uint8) * np.uint8(255)
    p = ShellsParameters()
    bodies = Bodies(p)
    for k, x in enumerate((22.0, 48.0)):
        bodies.start((x, 20.0, 30.0, 20.0), Body(k + 1, 0, 0, 0, area=600.0))
        own = np.ones((20, 10), bool)
        bodies.items[k].look(bins_of(image[20:40, 25 + 40 * k : 35 + 40 * k]), own)
    seen = SeenFrame(
        Foreground(mask, label_blobs(mask)[1], components(mask, 10.0)[2]),
        np.zeros((0, 4)),
        np.zeros(0, np.int64),
        lambda: image,
    )
    resolver = Resolver(
        seen, bodies, np.arange(2), bodies.radii(0.2), lambda a, b: related, p
    )
    assert resolver.blobs() == {0: 1, 1: 1}
    resolver.resolve()
    found = sum(resolver.found[k].pixels for k in (0, 1))
    assert (found == 1200) if related else (found > 1300)


def test_nothing_is_learnt_in_joint(tank: Path) -> None:
    frozen = 0
    with SceneLog(tank) as scene:
        tracker = make(scene.info, replay_config("shells"))
        before: dict[int, tuple[Any, ...]] = {}
        for frame in scene.frames():
            tracker.step(frame)
            state = tracker.state()
            joint = {i for e in state["book"]["edges"] if e[2] == "JOINT" for i in e[:2]}
            now = {
                b["id"]: (b["area"], b["updates"])
                for b in state["bodies"]["items"]
                if b["id"]
            }
            for i in joint & now.keys() & before.keys():
                frozen += 1
                assert now[i] == before[i], (frame.index, i)
            before = now
    assert frozen > 50


def test_an_outline_that_shells_cannot_have_is_refused() -> None:
    scene = SceneInfo(100, 100, 40_000_000, True, True)
    with pytest.raises(UsageError, match="outline = ellipse"):
        make(scene, replay_config("shells", assignments=["shell_model.outline=ellipse"]))


def scored(
    log: Path, tmp_path: Path, truth: Path, size: tuple[int, int] | None = None
) -> Scores:
    replay(
        log,
        tmp_path / "out.mcap",
        ReplayOptions(tracker="shells", config=replay_config("shells")),
    )
    with AnnotatedLog(tmp_path / "out.mcap") as annotated:
        tracks = read_tracks(annotated)
    assert tracks.size is not None
    return evaluate(fit_truth(read_truth(truth), tracks.size, size), tracks.table)


@pytest.mark.real
def test_pets_from_pixels(real_data: Path, pets: Path, tmp_path: Path) -> None:
    s = scored(
        pets / "scene.mcap", tmp_path, real_data / "pets09-s2l1" / "gt.txt", (768, 576)
    )
    assert s.hota.hota > 55
    assert s.clear.mota > 72
    assert s.identity.idf1 > 75
    assert s.clear.switches <= 15


@pytest.mark.real
@pytest.mark.parametrize(
    ("name", "count"),
    [pytest.param("two_flies", 2, marks=pytest.mark.long), ("three_flies", 3)],
)
def test_flies_keep_their_identities(
    real_data: Path, tmp_path: Path, name: str, count: int
) -> None:
    folder = real_data / "flies"
    log = tmp_path / "scene.mcap"
    record(open_source(folder / f"{name}.mp4"), log, RecordOptions(detect="threshold"))
    s = scored(log, tmp_path, folder / f"{name}.gt.txt")
    assert s.clear.switches == 0
    assert s.result_ids == s.true_ids == count
    assert s.identity.idf1 > 90


def test_objects_start_within_the_regions_and_go_when_they_are_outside(
    tmp_path: Path,
) -> None:
    """The right half is outer zone: one who walks in starts in the left, one who walks out ends
    where it ends.
    """
    scene = generate("pass_by", seed=1, frames=150)
    half = scene.width / 2
    square = [
        (0.0, 0.0),
        (half, 0.0),
        (half, float(scene.height)),
        (0.0, float(scene.height)),
    ]
    drawn = Regions(scene.width, scene.height, [square], [square], source="file")
    path = write_scene_log(scene, tmp_path / "a.mcap", style="merged")
    with SceneLog(path) as log:
        tracker = TRACKERS["shells"](log.info, replay_config("shells"))
        said = []
        for frame in log.frames():
            frame.regions = drawn
            said.append(tracker.step(frame))
    seen = [t for s in said for t in s.targets if t.observed]
    assert {t.id for t in seen} == {1, 2}
    assert all(t.box[0] < half for t in seen)
    removed = [n for s in said for n in s.notices if n.kind == "track_removed"]
    assert [n.subjects for n in removed] == [[1]]
    assert removed[0].rule.startswith("EVENTS 3.2: wholly outside")


def test_an_animal_on_the_rim_of_the_picture_is_followed_where_no_regions_are_drawn() -> (
    None
):
    info = SceneInfo(200, 200, 40_000_000, has_images=False, has_masks=False)
    tracker = TRACKERS["shells"](info, replay_config("shells"))
    for k in range(
        40
    ):  # 6 pixels wide, in a rim of 8 that the default region of interest leaves out
        boxes = [(0.0, 40.0 + 2 * k, 6.0, 6.0)]
        said = tracker.step(Frame(k, 40_000_000 * k, Detections(k, 200, 200, boxes, [1.0])))
    assert [(t.id, t.observed) for t in said.targets] == [(1, True)]
