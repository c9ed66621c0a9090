"""Compare two annotated logs byte by byte: whether they are identical, and where each channel
differs first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import zip_longest
from operator import itemgetter
from typing import Any

from recorders import channels
from recorders.annotated.chain import short_digests
from recorders.annotated.frames import instants
from recorders.errors import RecordingError
from recorders.log import LogReader
from replay.first_difference import difference_in

RECORDING = "recording"
Payloads = dict[str, list[bytes]]
Recorded = tuple[str, int, int, int, bytes]
_PARTS = ((1, "log time"), (2, "publish time"), (3, "sequence number"), (4, "payload"))


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
        identical: same times, same payloads in every channel; the same recording, where it was
            compared.
        frames: frames at the same times.
        channels: first difference of each channel, by name; `RECORDING` for the recorded messages
            under them.
    """

    identical: bool = True
    frames: int = 0
    channels: dict[str, First] = field(default_factory=dict)


@dataclass
class _Frame:
    """The annotated messages of one time, and the recorded ones since the frame before.

    Attributes:
        payloads: by channel.
        stamps: publish time and sequence number of each message, by channel.
        recorded: topic, times, sequence number and payload of each message, by time and topic.
    """

    time_ns: int
    payloads: Payloads
    stamps: dict[str, list[tuple[int, int]]]
    recorded: list[Recorded]


def compare_bytes(
    a: LogReader,
    b: LogReader,
    camera_a: str,
    camera_b: str,
    everything: bool = False,
    only_shared: bool = False,
) -> Raw:
    """Compare the annotated payloads of two logs, frame by frame.

    With ``everything``, the recorded messages, publish times and sequence numbers are compared,
    too; with ``only_shared``, frames that only one of them has do not count.

    Raises:
        RecordingError: a log is damaged.
        LimitError: more messages at one time than the limits allow.
    """
    out = Raw()
    left, right = _Frames(a, camera_a, everything), _Frames(b, camera_b, everything)
    ours, theirs = left.next(), right.next()
    while ours is not None and theirs is not None:
        if ours.time_ns != theirs.time_ns:
            out.identical = out.identical and only_shared
            if ours.time_ns < theirs.time_ns:
                ours = left.next()
            else:
                theirs = right.next()
            continue
        out.frames += 1
        if ours != theirs:
            _note(out, ours, theirs)
        before = ours
        ours, theirs = left.next(), right.next()
        if ours is None and theirs is None and left.trailing != right.trailing:
            _note_recorded(
                out, _frame_of(before.payloads, {}) + 1, left.trailing, right.trailing
            )
    out.identical = out.identical and (
        out.frames > 0 if only_shared else ours is None and theirs is None
    )
    return out


class _Frames:
    """A log's frames; ``trailing`` holds the recorded messages after the last one when they are
    through.
    """

    def __init__(self, log: LogReader, camera: str, everything: bool) -> None:
        self.trailing: list[Recorded] = []
        self._log = log
        self._camera = camera
        self._everything = everything
        self._frames = self._all()

    def next(self) -> _Frame | None:
        """The next frame."""
        return next(self._frames, None)

    def _all(self) -> Iterator[_Frame]:
        for moment in instants(self._log, self._camera, with_recorded=self._everything):
            payloads: Payloads = {}
            stamps: dict[str, list[tuple[int, int]]] = {}
            for name, m in moment.annotated:
                payloads.setdefault(name, []).append(m.data)
                if self._everything:
                    stamps.setdefault(name, []).append((m.publish_time_ns, m.sequence))
            # Topics share one time in whatever order they lie in the file.
            self.trailing += sorted(
                (
                    (
                        message.topic,
                        moment.time_ns,
                        message.publish_time_ns,
                        message.sequence,
                        message.data,
                    )
                    for message in moment.recorded
                ),
                key=itemgetter(0),
            )
            if payloads:
                recorded, self.trailing = self.trailing, []
                yield _Frame(moment.time_ns, payloads, stamps, recorded)


def _note(out: Raw, a: _Frame, b: _Frame) -> None:
    out.identical = False
    frame = _frame_of(a.payloads, b.payloads)
    told = False
    for name in channels.ANNOTATED:
        if a.payloads.get(name) != b.payloads.get(name):
            if name == "digest":
                told = _note_recording(out, a.payloads, b.payloads)
            pairs = zip_longest(a.payloads.get(name, []), b.payloads.get(name, []))
            x, y = next((x, y) for x, y in pairs if x != y)
            _count(out, name, partial(_first_in, frame, name, x, y))
        elif a.stamps.get(name) != b.stamps.get(name):
            stamps = zip(a.stamps[name], b.stamps[name], strict=True)
            p, q = next((p, q) for p, q in stamps if p != q)
            what, k = ("publish time", 0) if p[0] != q[0] else ("sequence number", 1)
            _count(out, name, partial(First, frame, what, str(p[k]), str(q[k])))
    if a.recorded != b.recorded and not told:
        _note_recorded(out, frame, a.recorded, b.recorded)


def _first_in(frame: int, name: str, x: bytes | None, y: bytes | None) -> First:
    """Where two payloads of a channel differ."""
    return First(frame, *difference_in(name, x, y))


def _count(out: Raw, name: str, first: Callable[[], First]) -> None:
    """One more frame in which a channel differs."""
    known = out.channels.get(name)
    if known is not None:
        known.frames += 1
    else:
        out.channels[name] = first()


def _note_recorded(
    out: Raw, frame: int, a: Sequence[Recorded], b: Sequence[Recorded]
) -> None:
    out.identical = False
    x, y = next((x, y) for x, y in zip_longest(a, b) if x != y)
    topic = (x or y or ("",))[0]
    if x is None or y is None or x[0] != y[0]:
        old, new = ("nothing" if one is None else one[0] for one in (x, y))
        first = First(frame, "messages", old, new)
    else:
        k, what = next((k, what) for k, what in _PARTS if x[k] != y[k])
        place, old, new = what, str(x[k]), str(y[k])
        if what == "payload":
            place, old, new = difference_in(channels.split(topic)[1], x[4], y[4])
        first = First(frame, f"{topic}, {place}", old, new)
    _count(out, RECORDING, lambda: first)


def _frame_of(a: Payloads, b: Payloads) -> int:
    """A frame's number, from whichever of its messages can be read: whoever needs the others says
    what is wrong.
    """
    for name in ("tracks", "relations", "groups", "targets", "digest"):
        for payload in (*a.get(name, []), *b.get(name, [])):
            found = _readable(name, payload)
            if found is not None:
                return int(found.frame)
    return 0


def _readable(name: str, payload: bytes) -> Any:
    """A message; None where it is none any more."""
    try:
        return channels.decode(name, payload)
    except RecordingError:
        return None


def _note_recording(out: Raw, a: Payloads, b: Payloads) -> bool:
    """Whether two frames' digests say that their recordings differ."""
    payloads = (*a.get("digest", [])[:1], *b.get("digest", [])[:1])
    sides = [
        digest
        for digest in (_readable("digest", payload) for payload in payloads)
        if digest is not None
    ]
    if len(sides) < 2 or sides[0].recorded == sides[1].recorded:
        return False
    first = First(
        sides[0].frame, "digest", *short_digests(sides[0].recorded, sides[1].recorded)
    )
    _count(out, RECORDING, lambda: first)
    return True
