"""A comparison's memory grows with what happens, not with the frames."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

from fixtures.planted_differences import copy_log
from recorders import channels
from recorders.annotated import digest
from recorders.annotated.provenance import with_fact_digests
from recorders.log import LogWriter
from recorders.messages import Digest, Track, Tracks
from replay.compare import compare

FRAME_NS = 40_000_000


def write_long(path: Path, frames: int, shift: float) -> Path:
    """Six tracks that stay for all frames, in log chunks as a replay writes them."""
    with LogWriter(path) as log:
        ids = {
            name: log.channel(
                channels.topic("camera", name),
                channels.schema(name),
                channels.message_encoding(name),
            )
            for name in ("tracks", "digest")
        }
        for k in range(frames):
            tracks = [
                Track(
                    i, (60.0 * i + shift, 40.0 + k % 7, 20.0, 40.0), None, (1.0, 0.0), 24.0, "motion", 0.9, True, True,
                    -1, False, False, False, [], [], [], None, "inside",
                )
                for i in range(6)
            ]  # fmt: skip
            log.write(
                ids["tracks"], channels.encode("tracks", Tracks(k, tracks)), k * FRAME_NS
            )
            log.write(
                ids["digest"],
                channels.encode("digest", Digest(k, "", {}, digest.START)),
                k * FRAME_NS,
            )
        facts = {
            "format_version": "1", "kind": "annotated", "tracker": "events", "camera": "camera", "configuration": "{}",
            "packages": "{}", "scene": "scene.mcap", "input_digest": "", "input_frames": str(frames),
            "output_digest": "", "link_before": "", "first_frame": "0", "frames": str(frames),
            "annotations_only": "true",
        }  # fmt: skip
        log.metadata("scenetrace", with_fact_digests(facts))
    return path


def peak_bytes(folder: Path, frames: int) -> int:
    a = write_long(folder / f"a{frames}.mcap", frames, 0.0)
    b = write_long(folder / f"b{frames}.mcap", frames, 0.25)
    tracemalloc.start()
    try:
        found = compare(a, b)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert [d.change for d in found.differences] == ["moved"] * 6, found.lines()
    assert all(d.details["frames"] == frames for d in found.differences)
    return peak


def test_memory_stays_flat(tmp_path: Path) -> None:
    copy_log(write_long(tmp_path / "warm.mcap", 50, 0.0), tmp_path / "copy.mcap")
    compare(tmp_path / "warm.mcap", tmp_path / "copy.mcap")
    short, long = peak_bytes(tmp_path, 200), peak_bytes(tmp_path, 1200)
    # What grows are three numbers per frame and the logs' own index, one entry per chunk: 20 MB
    # over an hour.
    assert long < short + 1000 * 300, (short, long)
