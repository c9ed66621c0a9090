"""Planted differences and unchanged pairs: a part of `bench_trust`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace as changed
from pathlib import Path
from typing import Any

from trust_common import SECOND, options, table

from fixtures.logs import write_scene_log
from fixtures.planted_differences import (
    ANNOTATION_PLANTS,
    RECORDED,
    RECORDING_PLANTS,
    Planted,
)
from fixtures.scenes import SCRIPTS, generate
from recorders.errors import RecordingError
from replay import annotated_writer as writing
from replay.compare import Comparison, compare
from replay.configuration import replay_config
from replay.run import ReplayOptions
from replay.verification import verify, verify_chain


def plants(folder: Path, trackers: Sequence[str]) -> bool:
    scene = write_scene_log(
        generate("three_way_group", seed=1, size=(160, 120), frames=110), folder / "p.mcap", style="merged",
        pictures="png",
    )  # fmt: skip
    good, found = True, 0
    for tracker in trackers:
        rows = planted(scene, folder, tracker)
        print(f"\nPlanted differences, {tracker}: found at their frame")
        table(["plant", "frame", "verify", "diff"], rows)
        good = good and all("NO" not in row for row in rows)
        found += sum("NO" not in row for row in rows)
    print(f"\n{found} plants found")
    for tracker in trackers:
        pairs, alarms = unchanged(folder, tracker)
        print(f"False alarms on unchanged pairs, {tracker}: {alarms} of {pairs}")
        good = good and not alarms
    return good


def planted(scene: Path, folder: Path, tracker: str) -> list[list[str]]:
    """A row for each plant."""
    rows = []
    config = replay_config(tracker)
    whole = ReplayOptions(tracker=tracker, config=config, checkpoint_ns=SECOND, force=True)
    original, altered = folder / "pa.mcap", folder / "pb.mcap"
    writing.replay(scene, original, whole)
    for name, plant in ANNOTATION_PLANTS.items():
        what = plant(original, altered)
        seen = compare(original, altered)
        rows.append(
            [
                f"altered afterwards: {name}",
                *outcome(what, (verify_chain(altered), verify(altered)), seen),
            ]
        )
    for name, plant in RECORDING_PLANTS.items():
        what = plant(original, altered)
        seen = compare(original, altered)
        rows.append(
            [
                f"recording in the log: {name}",
                *outcome(what, (verify_chain(altered), verify(altered)), seen),
            ]
        )
        what = plant(scene, altered)
        verdict = verify(original, altered)
        try:
            writing.replay(altered, folder / "pc.mcap", whole)
            again: Comparison | RecordingError = compare(original, folder / "pc.mcap")
        except RecordingError as e:
            again = e
        rows.append([f"another recording: {name}", *outcome(what, (verdict,), again)])
    config = replay_config(tracker, assignments=[f"shell_model.k_s={0.2 + 1e-9!r}"])
    writing.replay(scene, folder / "pc.mcap", changed(whole, config=config))
    other = compare(original, folder / "pc.mcap")
    named = other.made == ["parameter: shell_model.k_s = 0.200000001, not 0.2"]
    first = bool(other.differences) and "shell_radius" in str(other.differences[0].details)
    rows.append(
        ["another parameter: k_s by 1e-9", "0", "-", "yes" if named and first else "NO"]
    )
    return rows


# What `diff` calls a difference in each channel.
SHOWN = {
    "tracks": {"track", "identity"},
    "relations": {"relation"},
    "groups": {"group"},
    "events": {"event"},
    "graph": {"message"},
    "annotations": {"message"},
    "digest": {"message"},
    RECORDED: {"recording", "frames"},
}


def outcome(
    planted: Planted, verdicts: Sequence[Any], diff: Comparison | RecordingError
) -> list[str]:
    """Frame, and whether verify and diff name it: the first difference, in the channel that was
    altered.
    """
    place = "-" if planted.frame < 0 else str(planted.frame)
    right = all(
        v.difference is not None and v.difference.frame == planted.frame for v in verdicts
    )
    if isinstance(diff, RecordingError):
        seen = f"no replay of it: {diff.reason}"
    elif planted.frame >= 0:
        kinds = SHOWN[planted.channel]
        first = min((d.frame for d in diff.differences if d.what in kinds), default=-1)
        seen = "yes" if first == planted.frame else "NO"
    elif planted.channel == "metadata":
        seen = "yes" if diff.made else "NO"
    else:
        seen = "not in what happens" if diff.equal else "NO"
    return [place, "yes" if right else "NO", seen]


def unchanged(folder: Path, tracker: str) -> tuple[int, int]:
    """Replays of one scene twice, over all scripts until there are 50 pairs."""
    pairs = alarms = 0
    while pairs < 50:
        for name in SCRIPTS:
            scene = generate(name, seed=pairs, size=(96, 72), frames=25)
            log = write_scene_log(scene, folder / "u.mcap", style="merged", force=True)
            for out in ("ua.mcap", "ub.mcap"):
                writing.replay(log, folder / out, options(tracker))
            quiet = compare(folder / "ua.mcap", folder / "ub.mcap").identical
            alarms += not (quiet and verify(folder / "ub.mcap", log).identical)
            pairs += 1
            if pairs == 50:
                break
    return pairs, alarms
