"""A source of somebody else's, in a package of its own."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import scenetrace
from replay.cli import main

CODE = """
from pathlib import Path

import numpy as np

from scenetrace import SourceFrame


class Ramp:
    name, width, height, frame_ns = "grey ramp", 64, 48, 100_000_000
    has_images, stills, has_detections = True, False, False

    def __init__(self, where):
        self.path, self.frame_count = Path(where), int(where)
        self.notes, self.losses = [], []

    def frames(self):
        for k in range(self.frame_count):
            picture = np.full((48, 64, 3), 10 * k, np.uint8)
            yield SourceFrame(k, k * self.frame_ns, lambda picture=picture: picture)

    def sample(self, count):
        return (frame.image for frame in self.frames())

    def digests(self):
        return []


class Half:
    def __init__(self, where):
        self.path = Path(where)
"""


@pytest.fixture(autouse=True)
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    about = tmp_path / "site" / "ramp_source-1.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: ramp-source\nVersion: 1\n"
    )
    entries = "[scenetrace.sources]\nramp = ramp_source:Ramp\nhalf = ramp_source:Half\n"
    (about / "entry_points.txt").write_text(entries)
    (tmp_path / "site" / "ramp_source.py").write_text(CODE)
    monkeypatch.syspath_prepend(tmp_path / "site")
    yield
    sys.modules.pop("ramp_source", None)


@pytest.mark.parametrize("word", ["ramp:12", "ramp_source:Ramp:12"])
def test_it_is_recorded(word: str, tmp_path: Path) -> None:
    out = tmp_path / "scene.mcap"
    words = ["record", word, "-o", str(out), "--detect", "none", "--codec", "png"]
    assert main(words) == 0
    done = scenetrace.record(word, out, detect="none", codec="png", force=True)
    assert done.frames == 12
    with scenetrace.open(tmp_path / "scene.mcap") as log:
        assert log[5].t == pytest.approx(0.5)
        np.testing.assert_array_equal(log[5].picture, np.full((48, 64, 3), 50, np.uint8))


def test_what_is_wrong_with_it_is_told(tmp_path: Path) -> None:
    for word, said in (
        ("ramp:many", "the source ramp fails: ValueError"),
        ("half:1", "the source half lacks name and width"),
        ("ramp_source:None_:1", "has no 'None_'"),
        ("nothing:1", "no such file or folder"),
    ):
        with pytest.raises(scenetrace.SceneTraceError, match=said):
            scenetrace.record(word, tmp_path / "scene.mcap", detect="none")
        assert not (tmp_path / "scene.mcap").exists()
