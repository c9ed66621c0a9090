"""Where targets stood, in metres, as 3D panels take it."""

from __future__ import annotations

from pathlib import Path

import pytest
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from recorders.annotated.reader import AnnotatedLog
from recorders.log import LogReader
from replay.annotated_writer import replay
from replay.cli import main
from replay.run import ReplayOptions


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ground")
    scene = generate("three_way_group", size=(160, 120), frames=40)
    write_scene_log(scene, folder / "scene.mcap", style="merged", pictures="none")
    replay(folder / "scene.mcap", folder / "annotated.mcap", ReplayOptions())
    return folder / "annotated.mcap"


def test_targets_stand_where_the_points_say(annotated: Path, tmp_path: Path) -> None:
    points = tmp_path / "points.csv"
    corners = [(0, 0), (100, 0), (100, 100), (0, 100)]
    rows = [f"{x},{y},{x / 10},{y / 10}" for x, y in corners]
    points.write_text("\n".join(["x,y,X,Y", *rows]))
    out = tmp_path / "ground.mcap"
    words = [
        "export",
        str(annotated),
        "--to",
        "3d",
        "--homography",
        str(points),
        "-o",
        str(out),
    ]
    assert main(words) == 0
    with LogReader(out) as log:
        (channel,) = log.channels
        assert channel.topic == "/camera/ground"
        assert channel.schema is not None
        assert channel.schema.name == "foxglove.SceneUpdate"
        updates = [(m.log_time_ns, SceneUpdate.FromString(m.data)) for m in log.messages()]
    shown = 0
    with AnnotatedLog(annotated) as log_:
        for frame, (time_ns, update) in zip(log_.frames(), updates, strict=True):
            assert frame.time_ns == time_ns
            (entity,) = update.entities
            assert entity.frame_id == "ground"
            at = {
                int(text.text): (cylinder.pose.position.x, cylinder.pose.position.y)
                for text, cylinder in zip(entity.texts, entity.cylinders, strict=True)
            }
            for track in frame.tracks:
                if track.id in at:
                    x, y, w, h = track.box
                    wanted = ((x + w / 2) / 10, (y + h) / 10)
                    assert at[track.id] == pytest.approx(wanted, abs=0.2)
                    shown += 1
    assert shown > 40


def test_metres_have_to_be_known(
    annotated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["export", str(annotated), "--to", "3d", "-o", str(tmp_path / "a.mcap")]
    assert main(words) == 2
    assert "--to 3d needs metres: --homography points.csv" in capsys.readouterr().err
