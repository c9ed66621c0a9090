"""Boxes without pixels: through missing detections, among neighbours, with unsure detections."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from recorders.messages import Box, Detections, Target
from recorders.recording import record
from recorders.scene import Frame, SceneInfo
from recorders.sources import open_source
from replay.annotated import AnnotatedLog, read_tracks
from replay.configuration import replay_config
from replay.evaluate import evaluate, read_truth
from replay.replaying import ReplayOptions
from replay.trackers.catalogue import TRACKERS
from replay.writing import replay

FRAME_NS = 100_000_000


def play(frames: int, boxes: Callable[[int], Sequence[Box]], score: float = 1.0) -> list[list[Target]]:
    """What is said of every frame's boxes at 10 frames/s."""
    info = SceneInfo(400, 200, FRAME_NS, has_images=False, has_masks=False)
    tracker = TRACKERS["shells"](info, replay_config("shells"))
    said = []
    for k in range(frames):
        found = list(boxes(k))
        seen = Detections(k, 400, 200, found, [score] * len(found))
        said.append(list(tracker.step(Frame(k, FRAME_NS * k, seen)).targets))
    return said


def present(targets: Sequence[Target]) -> dict[int, float]:
    """Centres in x of those that are held present, by id."""
    return {t.id: t.box[0] + t.box[2] / 2 for t in targets if t.present}


def test_who_passes_behind_another_is_held_on_its_way_and_goes_on_as_itself() -> None:
    def boxes(k: int) -> list[Box]:
        standing, walking = (180.0, 60.0, 40.0, 100.0), (40.0 + 5.0 * k, 55.0, 36.0, 96.0)
        return [standing] if 23 <= k <= 31 else [standing, walking]

    said = play(60, boxes)
    assert all({t.id for t in targets} <= {1, 2} for targets in said)
    walker = 2 if present(said[15])[2] < 180 else 1
    for k in range(15, 60):
        assert abs(present(said[k])[walker] - (58 + 5 * k)) < 12, k


def test_one_missing_detection_does_not_push_a_row_of_neighbours_on() -> None:
    """Five in a row, a shoulder's width apart, the first unseen for a while as a sixth joins at the other end."""

    def boxes(k: int) -> list[Box]:
        row: list[Box] = [(60.0 + 40 * i, 60.0, 30.0, 90.0) for i in range(5)]
        if k >= 20:
            row.append((260.0, 60.0, 30.0, 90.0))
        return row[1:] if 20 <= k < 23 else row

    said = play(45, boxes)
    before, after = present(said[19]), present(said[44])
    assert len(before) == 5
    assert len(after) == 6
    for identity, x in before.items():
        assert abs(after[identity] - x) < 5


def test_unsure_detections_start_nobody_but_hold_who_is_known() -> None:
    assert not any(play(20, lambda _: [(100.0, 60.0, 30.0, 90.0)], score=0.5))


@pytest.mark.real
@pytest.mark.parametrize(
    ("name", "fps", "size", "hota", "mota", "idf1"),
    [("pets09-s2l1", 7, (768, 576), 42, 66, 58), ("tud-campus", 25, (640, 480), 55, 65, 77)],
)
def test_detections_of_real_recordings_alone(
    real_data: Path, tmp_path: Path, name: str, fps: int, size: tuple[int, int], hota: float, mota: float, idf1: float
) -> None:
    folder = real_data / name
    record(open_source(folder / "det.txt", fps=fps, size=size), tmp_path / "scene.mcap")
    options = ReplayOptions(tracker="shells", config=replay_config("shells"), annotations_only=True)
    replay(tmp_path / "scene.mcap", tmp_path / "out.mcap", options)
    with AnnotatedLog(tmp_path / "out.mcap") as annotated:
        s = evaluate(read_truth(folder / "gt.txt"), read_tracks(annotated).table)
    assert s.hota.hota > hota
    assert s.clear.mota > mota
    assert s.identity.idf1 > idf1
