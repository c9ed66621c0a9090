"""Every planted difference is found by `verify` and `diff`, at its frame; nothing is found where
nothing is.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from fixtures.planted_differences import (
    ANNOTATION_PLANTS,
    RECORDED,
    RECORDING_PLANTS,
    copy_log,
)
from recorders.annotated.provenance import with_fact_digests
from recorders.errors import RecordingError
from replay.compare import compare
from replay.verification import verify, verify_chain

NOT_IN_THE_STORY = ("metadata", "checkpoint/")


@pytest.mark.parametrize("plant", ANNOTATION_PLANTS)
def test_what_is_altered_after_the_replay(
    trusted: Path, truth: Any, tmp_path: Path, plant: str
) -> None:
    original, altered = trusted / "annotated.mcap", tmp_path / "annotated.mcap"
    planted = ANNOTATION_PLANTS[plant](original, altered)
    for verdict in (verify_chain(altered), verify(altered, tracker=truth)):
        assert not verdict.identical
        assert verdict.difference is not None
        assert (verdict.difference.frame, verdict.difference.channel) == (
            planted.frame,
            planted.channel,
        )
        assert any("altered" in reason for reason in verdict.reasons)
    found = compare(original, altered)
    if planted.channel.startswith(NOT_IN_THE_STORY):
        # The story is the same; what the log says of its making is told beside it.
        assert found.equal
        assert bool(found.made) == (planted.channel == "metadata")
    else:
        assert not found.identical
        assert found.differences[0].frame == planted.frame, found.lines()
        assert {d.frame for d in found.differences} <= {planted.frame, planted.frame + 1}


@pytest.mark.parametrize("plant", RECORDING_PLANTS)
def test_what_is_altered_in_the_recording(
    trusted: Path, truth: Any, told: Any, tmp_path: Path, plant: str
) -> None:
    original, scene = trusted / "annotated.mcap", tmp_path / "scene.mcap"
    planted = RECORDING_PLANTS[plant](trusted / "scene.mcap", scene)
    verdict = verify(original, scene, tracker=truth)
    assert not verdict.identical
    assert verdict.difference is not None
    assert verdict.difference.frame == planted.frame
    assert verdict.difference.channel == RECORDED
    assert any(
        "the recording is not the one that was replayed" in reason
        for reason in verdict.reasons
    )
    if plant == "two frames' detections swapped":
        with pytest.raises(RecordingError, match=r"frame 44 .* comes after frame 45"):
            told(scene, tmp_path / "annotated.mcap")
        return
    found = compare(original, told(scene, tmp_path / "annotated.mcap"))
    at = [d.frame for d in found.differences if d.what in ("recording", "frames")]
    assert min(at) == planted.frame, found.lines()


@pytest.mark.parametrize("plant", RECORDING_PLANTS)
def test_what_is_altered_in_the_recording_within_an_annotated_log(
    trusted: Path, tmp_path: Path, plant: str
) -> None:
    planted = RECORDING_PLANTS[plant](trusted / "annotated.mcap", tmp_path / "altered.mcap")
    verdict = verify_chain(tmp_path / "altered.mcap")
    assert not verdict.identical
    assert verdict.difference is not None
    assert verdict.difference.frame == planted.frame


def test_a_parameter_that_is_lied_about_by_1e_9(
    trusted: Path, truth: Any, told: Any, tmp_path: Path
) -> None:
    honest, other, lie = (
        trusted / "annotated.mcap",
        tmp_path / "other.mcap",
        tmp_path / "lie.mcap",
    )
    told(trusted / "scene.mcap", other, f"shell_model.k_s={0.2 + 1e-9!r}")

    def forged(values: dict[str, str]) -> dict[str, str]:
        configuration = msgspec.json.decode(values["configuration"])
        configuration["shell_model"]["k_s"] = 0.2
        text = msgspec.json.encode(configuration, order="deterministic").decode()
        return with_fact_digests(
            {
                k: v
                for k, v in {**values, "configuration": text}.items()
                if k != "fact_digests"
            }
        )

    copy_log(other, lie, facts=forged)
    assert verify_chain(lie).identical, "the chain alone cannot know what is said with care"
    verdict = verify(lie, tracker=truth)
    assert not verdict.identical
    assert verdict.difference is not None
    assert (verdict.difference.frame, verdict.difference.channel) == (0, "tracks")
    assert "shell_radius" in verdict.difference.field
    assert verdict.difference.recorded != verdict.difference.replayed
    found = compare(honest, other)
    assert found.made == ["parameter: shell_model.k_s = 0.200000001, not 0.2"]
    assert found.differences[0].frame == 0
    assert "shell_radius" in str(found.differences[0].details)
    assert verify(other, tracker=truth).identical


def test_no_false_alarm(trusted: Path, truth: Any, told: Any, tmp_path: Path) -> None:
    original = trusted / "annotated.mcap"
    copy_log(original, tmp_path / "copy.mcap")
    told(original, tmp_path / "again.mcap")
    for path in (original, tmp_path / "copy.mcap", tmp_path / "again.mcap"):
        assert verify_chain(path).identical
        assert compare(original, path).identical
    verdict = verify(tmp_path / "copy.mcap", tracker=truth)
    assert verdict.identical
    assert verdict.reasons == []
