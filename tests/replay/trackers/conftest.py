"""What several trackers' tests record once."""

from __future__ import annotations

from pathlib import Path

import pytest

from recorders.recording import RecordOptions, record
from recorders.sources import open_source


@pytest.fixture(scope="session")
def pets_scene(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """PETS09-S2L1 from pixels: its own seven frames a second, bodies by motion."""
    scene = tmp_path_factory.mktemp("pets") / "scene.mcap"
    video = real_data / "pets09-s2l1" / "video.avi"
    record(open_source(video, fps=7), scene, RecordOptions(detect="motion"))
    return scene
