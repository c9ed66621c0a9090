"""Verify: replay again from what an annotated log says of itself, and name the first difference and its reason."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import Any

import msgspec

from recorders import channels
from recorders.errors import RecordingError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogReader
from recorders.messages import Digest
from recorders.scene import SceneLog
from replay import digest
from replay.configuration import package_versions, replay_config
from replay.replaying import Annotated, Progress, ReplayOptions, Run
from replay.trackers.tracker import TrackerFactory
from replay.writing import METADATA


@dataclass(frozen=True)
class Difference:
    """Where two replays part: frame, channel, what in it, both values (shortened for a line)."""

    frame: int
    channel: str
    field: str
    recorded: str
    replayed: str

    def __str__(self) -> str:
        where = f"frame {self.frame}, {self.channel}" + (f", {self.field}" if self.field else "")
        return f"{where}: recorded {self.recorded}, now {self.replayed}"


@dataclass(frozen=True)
class Verification:
    """The verdict: identical, or the first difference and the reasons that are known."""

    identical: bool
    frames: int
    difference: Difference | None = None
    reasons: list[str] = field(default_factory=list)
    output_digest: str = ""


@dataclass(frozen=True)
class FrameRecord:
    """An annotated frame as the log holds it."""

    digest: Digest
    time_ns: int
    payloads: list[tuple[str, bytes]]


def facts_of(log: LogReader) -> dict[str, str]:
    """What an annotated log says of itself.

    Raises:
        RecordingError: it is not an annotated log.
    """
    for name, values in log.metadata():
        if name == METADATA and values.get("kind") == "annotated":
            return values
    raise RecordingError(
        "not an annotated log (no metadata `scenetrace` of a replay); make one with `scenetrace replay`", log.path
    )


def recorded_frames(log: LogReader, camera: str) -> Iterator[FrameRecord]:
    """The annotated frames of a log in order, with their payloads in the order in which they were written."""
    topics = {channels.topic(camera, name): name for name in channels.ANNOTATED}
    payloads: list[tuple[str, bytes]] = []
    for message in log.messages([t for t in topics if t in {c.topic for c in log.channels}]):
        name = topics[message.topic]
        if name != "digest":
            payloads.append((name, message.data))
            continue
        found: Digest = channels.decode("digest", message.data, path=str(log.path))
        yield FrameRecord(found, message.log_time_ns, payloads)
        payloads = []
    if payloads:
        raise RecordingError(f"{len(payloads)} annotated messages after the last digest: cut or altered", log.path)


def verify_chain(path: str | Path, limits: Limits = DEFAULT_LIMITS) -> Verification:
    """Check the digest chain alone: every payload hashes to its digest, every link to the next, the last to the log's.

    It finds what was altered in the annotations after they were written; it replays nothing.
    """
    with LogReader(path, limits) as log:
        facts = facts_of(log)
        link, frames = facts["link_before"], 0
        for record in recorded_frames(log, facts["camera"]):
            d = record.digest
            hashes = digest.channel_digests(record.payloads)
            for name in sorted({*hashes, *d.channels}):
                if hashes.get(name) != d.channels.get(name):
                    found = Difference(d.frame, name, "digest", _short(d.channels.get(name)), _short(hashes.get(name)))
                    return Verification(False, frames, found, [f"the channel {name} was altered after the replay"])
            link = digest.link(link, d.frame, record.time_ns, d.recorded, d.channels)
            if link != d.link:
                found = Difference(d.frame, "digest", "link", _short(d.link), _short(link))
                return Verification(
                    False, frames, found, ["the chain is broken: frames were altered, removed or moved"]
                )
            frames += 1
        if frames != int(facts["frames"]) or (frames and link != facts["output_digest"]):
            found = Difference(frames, "digest", "end", facts["output_digest"][:16], link[:16])
            return Verification(False, frames, found, [f"{facts['frames']} frames were written, {frames} are here"])
        return Verification(True, frames, None, [], link)


def verify(
    path: str | Path,
    scene: str | Path | None = None,
    *,
    factory: TrackerFactory | None = None,
    limits: Limits = DEFAULT_LIMITS,
    progress: Progress | None = None,
) -> Verification:
    """Replay again with the recorded tracker and configuration and compare, frame by frame.

    Args:
        path: the annotated log.
        scene: the scene log, where the annotated log does not hold the recording whole; a file of the recorded name
            beside the annotated log is found by itself.
        factory: the tracker, where it is not one of the catalogue's.
        limits: bounds for reading.
        progress: called with the stage's name and the frame's number.

    Raises:
        RecordingError, UsageError.
    """
    chain = verify_chain(path, limits)
    with LogReader(path, limits) as log:
        facts = facts_of(log)
        options = ReplayOptions(
            tracker=facts["tracker"],
            config=_recorded_config(facts, path),
            camera=facts["camera"],
            factory=factory,
            limits=limits,
        )
        reasons = list(chain.reasons) + _changed_packages(facts)
        with SceneLog(_scene_of(Path(path), facts, scene), facts["camera"], limits) as source:
            run = Run(source, options, progress)
            found, frames = _compare(run, log, facts)
            # Read on, so that a change behind the span is seen too.
            if found is None and run.last_index + 1 == int(facts["input_frames"]) and source.trailing:
                run.input_link = digest.chained(run.input_link, digest.recorded_digest(source.trailing))
            complete = run.last_index + 1 >= int(facts["input_frames"])
        if complete and run.last_index + 1 == int(facts["input_frames"]) and run.input_link != facts["input_digest"]:
            reasons.append("the recording is not the one that was replayed (its input digest differs)")
            found = found or Difference(
                run.last_index, "recorded messages", "input digest", facts["input_digest"][:16], run.input_link[:16]
            )
    return Verification(
        found is None and chain.identical, frames, found or chain.difference, reasons, chain.output_digest
    )


def _recorded_config(facts: dict[str, str], path: str | Path) -> Any:
    try:
        values = msgspec.json.decode(facts["configuration"].encode(), type=dict[str, dict[str, Any]])
    except msgspec.MsgspecError as e:
        raise RecordingError(f"its recorded configuration cannot be read: {e}", path) from e
    return replay_config(facts["tracker"], values=values)


def _changed_packages(facts: dict[str, str]) -> list[str]:
    then = msgspec.json.decode(facts["packages"].encode(), type=dict[str, str])
    now = package_versions()
    names = sorted({*then, *now})
    return [
        f"{name} was {then.get(name, 'absent')}, is {now.get(name, 'absent')}"
        for name in names
        if then.get(name) != now.get(name)
    ]


def _scene_of(path: Path, facts: dict[str, str], given: str | Path | None) -> Path:
    if given is not None:
        return Path(given)
    whole = facts["annotations_only"] == "false" and not facts["from_ns"] and not facts["to_ns"]
    if whole:
        return path
    beside = path.with_name(facts["scene"])
    if beside.exists():
        return beside
    raise UsageError(
        f"{path}: does not hold the whole recording, and {beside} is not there; say where it is with --scene SCENE.mcap"
    )


def _compare(run: Run, log: LogReader, facts: dict[str, str]) -> tuple[Difference | None, int]:
    """The first difference between a run and a log, and how many frames were equal before it."""
    records = recorded_frames(log, facts["camera"])
    expected = next(records, None)
    frames = 0
    last = int(facts["input_frames"]) - 1
    for now in run.frames():
        if expected is None or now.digest.frame < expected.digest.frame:
            if now.digest.frame >= last:
                break
            continue
        found = _first_difference(expected, now)
        if found is not None:
            return found, frames
        frames += 1
        expected = next(records, None)
        if expected is None and now.digest.frame >= last:
            break
    if expected is not None:
        return Difference(expected.digest.frame, "frames", "", "a frame", "none"), frames
    return None, frames


def _first_difference(then: FrameRecord, now: Annotated) -> Difference | None:
    d = now.digest
    if then.digest == d:
        return None
    if then.digest.frame != d.frame:
        return Difference(then.digest.frame, "frames", "number", str(then.digest.frame), str(d.frame))
    if then.time_ns != now.frame.time_ns:
        return Difference(d.frame, "frames", "log time", str(then.time_ns), str(now.frame.time_ns))
    if then.digest.recorded != d.recorded:
        return Difference(d.frame, "recorded messages", "digest", then.digest.recorded[:16], d.recorded[:16])
    for name in channels.ANNOTATED:
        ours = [payload for n, payload in now.payloads if n == name]
        theirs = [payload for n, payload in then.payloads if n == name]
        for a, b in zip_longest(theirs, ours):
            if a != b:
                place, old, new = _difference_in(name, a, b)
                return Difference(d.frame, name, place, old, new)
    return Difference(d.frame, "digest", "link", then.digest.link[:16], d.link[:16])


def _difference_in(name: str, then: bytes | None, now: bytes | None) -> tuple[str, str, str]:
    if then is None or now is None or name not in channels.JSON_CHANNELS:
        return "message", _short(then), _short(now)
    try:
        a, b = (msgspec.json.decode(data) for data in (then, now))
    except msgspec.MsgspecError:
        return "message", _short(then), _short(now)
    return first_unequal(a, b) or ("message", _short(then), _short(now))


def first_unequal(a: Any, b: Any, place: str = "") -> tuple[str, str, str] | None:
    """Where two plain values differ first, in the order of their fields; rows with an id are named by it."""
    if isinstance(a, dict) and isinstance(b, dict):
        for key in [*a, *(k for k in b if k not in a)]:
            found = first_unequal(a.get(key), b.get(key), f"{place}.{key}" if place else str(key))
            if found is not None:
                return found
        return None
    if isinstance(a, list) and isinstance(b, list):
        for k, (x, y) in enumerate(zip_longest(a, b)):
            found = first_unequal(x, y, f"{place}[{_row_name(x, y, k)}]")
            if found is not None:
                return found
        return None
    return None if a == b and type(a) is type(b) else (place, _short(a), _short(b))


def _row_name(x: Any, y: Any, k: int) -> str:
    row = x if isinstance(x, dict) else y
    if isinstance(row, dict) and "id" in row:
        return f"id {row['id']}"
    return str(k)


def _short(value: Any) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
