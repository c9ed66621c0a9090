"""Compare two annotated logs byte by byte: whether they are identical, and where each channel differs first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import groupby, zip_longest

from recorders import channels
from recorders.errors import LimitError
from recorders.log import LogReader
from recorders.messages import Digest, Tracks
from replay.verifying import difference_in

RECORDING = "recording"
Payloads = dict[str, list[bytes]]


@dataclass
class First:
    """Where a channel differs first, what there, and in how many frames it does."""

    frame: int
    field: str
    a: str
    b: str
    frames: int = 1


@dataclass
class Raw:
    """The outcome.

    Attributes:
        identical: same times, same payloads in every channel.
        frames: frames at the same times.
        channels: first difference of each channel, by name; `RECORDING` for the recorded messages under them.
    """

    identical: bool = True
    frames: int = 0
    channels: dict[str, First] = field(default_factory=dict)


def compare_bytes(a: LogReader, b: LogReader, camera_a: str, camera_b: str) -> Raw:
    """Compare the annotated payloads of two logs, frame by frame.

    Raises:
        RecordingError: a log is damaged.
        LimitError: more messages at one time than the limits allow.
    """
    out = Raw()
    left, right = _frames(a, camera_a), _frames(b, camera_b)
    ours, theirs = next(left, None), next(right, None)
    while ours is not None and theirs is not None:
        if ours[0] != theirs[0]:
            out.identical = False
            if ours[0] < theirs[0]:
                ours = next(left, None)
            else:
                theirs = next(right, None)
            continue
        out.frames += 1
        if ours[1] != theirs[1]:
            _note(out, ours[1], theirs[1], a)
        ours, theirs = next(left, None), next(right, None)
    out.identical = out.identical and ours is None and theirs is None
    return out


def _frames(log: LogReader, camera: str) -> Iterator[tuple[int, Payloads]]:
    names = {channels.topic(camera, name): name for name in channels.ANNOTATED}
    wanted = [c.topic for c in log.channels if c.topic in names]
    limit = log.limits.max_messages_per_frame
    for now, group in groupby(log.messages(wanted), key=lambda m: m.log_time_ns):
        payloads: Payloads = {}
        for count, message in enumerate(group):
            if count >= limit:
                raise LimitError(f"over {limit} messages at {now} ns (max_messages_per_frame)", log.path)
            payloads.setdefault(names[message.topic], []).append(message.data)
        yield now, payloads


def _note(out: Raw, a: Payloads, b: Payloads, log: LogReader) -> None:
    out.identical = False
    different = [name for name in channels.ANNOTATED if a.get(name) != b.get(name)]
    frame = -1
    for name in different:
        known = out.channels.get(name)
        if name == "digest":
            _note_recording(out, a, b, log)
        if known is not None:
            known.frames += 1
            continue
        if frame < 0:
            frame = _frame_of(a, b, log)
        pairs = zip_longest(a.get(name, []), b.get(name, []))
        x, y = next((x, y) for x, y in pairs if x != y)
        out.channels[name] = First(frame, *difference_in(name, x, y))


def _frame_of(a: Payloads, b: Payloads, log: LogReader) -> int:
    for payload in (*a.get("tracks", []), *b.get("tracks", [])):
        found: Tracks = channels.decode("tracks", payload, path=str(log.path))
        return found.frame
    return 0


def _note_recording(out: Raw, a: Payloads, b: Payloads, log: LogReader) -> None:
    sides: list[Digest] = [
        channels.decode("digest", payload, path=str(log.path))
        for payload in (*a.get("digest", [])[:1], *b.get("digest", [])[:1])
    ]
    if len(sides) == 2 and sides[0].recorded != sides[1].recorded:
        if RECORDING in out.channels:
            out.channels[RECORDING].frames += 1
        else:
            first = First(sides[0].frame, "digest", sides[0].recorded[:16], sides[1].recorded[:16])
            out.channels[RECORDING] = first
