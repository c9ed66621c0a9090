"""Our own golden files: scripted scenes through every tracker of the catalogue, by the plugin
alone.

A new tracker is in by being in the catalogue: the first run writes its files and fails, as for
anybody else.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from replay.trackers.catalogue import TRACKERS

SCENES = ("three_way_group", "full_occlusion", "leave_and_come_back")
FRAMES = 80
SMALL_BYTES = 200_000


@pytest.fixture(scope="session")
def scene_log(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Scene logs by the script's name, each written once: people merge into blobs where they
    meet.
    """
    folder = tmp_path_factory.mktemp("golden-scenes")

    def make(script: str) -> Path:
        path = folder / f"{script}.mcap"
        if not path.exists():
            write_scene_log(
                generate(script, size=(160, 120), frames=FRAMES),
                path,
                style="merged",
                pictures="png",
            )
        return path

    return make


@pytest.mark.parametrize("tracker", TRACKERS)
@pytest.mark.parametrize("script", SCENES)
def test_scene(
    golden_scene: Callable[..., object],
    scene_log: Callable[[str], Path],
    script: str,
    tracker: str,
) -> None:
    # A process of its own costs a second: one scene per tracker is enough to try another hash seed.
    golden_scene(
        scene_log(script),
        tracker=tracker,
        name=f"{script}-{tracker}",
        other_process=script == SCENES[0],
    )


def test_golden_files_stay_small_and_are_all_used() -> None:
    files = sorted(Path(__file__).parent.glob("*.mcap"))
    assert {f.stem for f in files} <= {f"{s}-{t}" for s in SCENES for t in TRACKERS}
    assert [f.name for f in files if f.stat().st_size > SMALL_BYTES] == []
