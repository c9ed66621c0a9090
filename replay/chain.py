"""Reading an annotated log's digest chain: the frames as the log holds them, and whether every link is whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

from recorders import channels
from recorders.errors import LimitError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogReader, Message
from recorders.messages import Digest
from replay import digest
from replay.checkpoint import PREFIX
from replay.facts import GOLDEN, Facts, facts_of, sha256

WHOLE = -1


@dataclass(frozen=True)
class Difference:
    """Where two replays part: frame, channel, what in it, both values (shortened for a line).

    ``frame`` is `WHOLE` for what belongs to no frame.
    """

    frame: int
    channel: str
    field: str
    recorded: str
    replayed: str

    def __str__(self) -> str:
        words = [f"frame {self.frame}"] if self.frame != WHOLE else []
        words += [word for word in (self.channel, self.field) if word]
        return f"{', '.join(words)}: recorded {self.recorded}, now {self.replayed}"


@dataclass(frozen=True)
class Verification:
    """The verdict: identical, or the first difference and the reasons that are known.

    Attributes:
        identical: nothing differs.
        frames: annotated frames that were found equal.
        difference: the first thing that differs; where the recording was changed, that change.
        reasons: what is not as it was, each with both values; with `identical`, what changed without effect.
        output_digest: the log's.
        effect: the first annotation that differs, where ``difference`` is its cause.
    """

    identical: bool
    frames: int
    difference: Difference | None = None
    reasons: list[str] = field(default_factory=list)
    output_digest: str = ""
    effect: Difference | None = None


@dataclass(frozen=True)
class FrameRecord:
    """An annotated frame as the log holds it.

    Attributes:
        time_ns: log time.
        digests: the digest messages of this time: one, unless the log was altered.
        payloads: channel and payload in the order in which they were written.
        recorded: the digest of the recorded messages up to this frame, None where the log does not hold them.
    """

    time_ns: int
    digests: list[Digest]
    payloads: list[tuple[str, bytes]]
    recorded: str | None = None

    @property
    def digest(self) -> Digest:
        """The frame's digest."""
        return self.digests[0]


def recorded_frames(log: LogReader, camera: str, with_recorded: bool = False) -> Iterator[FrameRecord]:
    """The annotated frames of a log in order.

    Args:
        log: an annotated log.
        camera: whose annotations.
        with_recorded: digest the recorded messages of each frame, too.

    Raises:
        RecordingError: a digest cannot be read.
        LimitError: more messages at one time than the limits allow.
    """
    names = {channels.topic(camera, name): name for name in channels.ANNOTATED}
    wanted = None if with_recorded else [c.topic for c in log.channels if c.topic in names]
    detections = channels.topic(camera, "detections")
    pending: list[Message] = []
    found = ""
    for now, group in groupby(log.messages(wanted), key=lambda m: m.log_time_ns):
        digests: list[Digest] = []
        payloads: list[tuple[str, bytes]] = []
        closes = False
        for count, message in enumerate(group):
            if count >= log.limits.max_messages_per_frame:
                limit = log.limits.max_messages_per_frame
                raise LimitError(f"over {limit} messages at {now} ns (max_messages_per_frame)", log.path)
            name = names.get(message.topic)
            if name is None:
                pending.append(message)
                closes = closes or message.topic == detections
            elif name == "digest":
                digests.append(channels.decode("digest", message.data, path=str(log.path)))
            else:
                payloads.append((name, message.data))
        if closes:
            found = digest.recorded_digest(pending)
            pending = []
        if digests or payloads:
            yield FrameRecord(now, digests, payloads, found if with_recorded else None)


def verify_chain(
    path: str | Path, limits: Limits = DEFAULT_LIMITS, progress: Callable[[str, int], None] | None = None
) -> Verification:
    """Check the digests alone; nothing is replayed.

    Every payload hashes to its channel's digest, every digest to the next link, the last to the log's; so do the
    recorded messages where the log holds them all, the checkpoints, and the facts that the log says of itself.

    Raises:
        RecordingError: not an annotated log, or damaged beyond reading.
        UsageError: a golden file, which has no digests.
    """
    with LogReader(path, limits) as log:
        facts = facts_of(log)
        if any(name == GOLDEN for name, _ in log.metadata()):
            raise UsageError(f"{path}: a golden file holds no digests to verify; compare it with `scenetrace diff`")
        altered = facts.altered()
        reasons = [f"the metadata's {name} was altered after the replay" for name in altered]
        found: Difference | None = None
        for name, (then, now) in altered.items():
            found = found or Difference(WHOLE, "metadata", f"{name}'s digest", then[:16] or "none", now[:16] or "none")
        link, frames = facts.link_before, 0
        for record in recorded_frames(log, facts.camera, with_recorded=facts.whole):
            wrong = _wrong(record, link, facts, frames)
            if wrong is not None:
                return Verification(False, frames, wrong[0], [*reasons, wrong[1]], facts.output_digest)
            link = record.digest.link
            frames += 1
            if progress is not None:
                progress("checking", record.digest.frame)
        wrong = _wrong_end(facts, frames, link) or _wrong_checkpoint(log, facts)
        if wrong is not None:
            found = found or wrong[0]
            reasons.append(wrong[1])
        return Verification(found is None, frames, found, reasons, facts.output_digest)


def _wrong(record: FrameRecord, link: str, facts: Facts, frames: int) -> tuple[Difference, str] | None:
    """What is wrong with a frame, and in words; None if it is whole."""
    if len(record.digests) != 1:
        last = facts.first_frame + frames
        number = record.digests[0].frame if record.digests else last
        difference = Difference(number, "digest", "messages", "1", str(len(record.digests)))
        return (
            difference,
            f"{len(record.digests)} digests at {record.time_ns} ns: frames were altered, removed or moved",
        )
    d = record.digest
    expected_frame = facts.first_frame + frames
    if d.frame != expected_frame:
        then, now = ("a frame", "none") if d.frame > expected_frame else (f"frame {expected_frame}", f"frame {d.frame}")
        reason = "frames were altered, removed or moved after the replay"
        return Difference(min(d.frame, expected_frame), "frames", "", then, now), reason
    if record.recorded is not None and record.recorded != d.recorded:
        difference = Difference(d.frame, "recorded messages", "digest", d.recorded[:16], record.recorded[:16])
        return difference, f"the recorded messages of frame {d.frame} were altered after the replay"
    hashes = digest.channel_digests(record.payloads)
    for name in sorted({*hashes, *d.channels}):
        if hashes.get(name) != d.channels.get(name):
            then, now = (text[:16] if text else "no message" for text in (d.channels.get(name), hashes.get(name)))
            difference = Difference(d.frame, name, "digest", then, now)
            return difference, f"the channel {name} was altered after the replay"
    expected = digest.link(link, d.frame, record.time_ns, d.recorded, d.channels)
    if expected != d.link:
        difference = Difference(d.frame, "digest", "link", d.link[:16], expected[:16])
        return difference, "the chain is broken: frames were altered, removed or moved after the replay"
    return None


def _wrong_end(facts: Facts, frames: int, link: str) -> tuple[Difference, str] | None:
    if frames != facts.frames:
        difference = Difference(WHOLE, "frames", "number", str(facts.frames), str(frames))
        return difference, f"{facts.frames} frames were written, {frames} are here"
    if frames and link != facts.output_digest:
        difference = Difference(WHOLE, "metadata", "output_digest", facts.output_digest[:16], link[:16])
        return difference, "the chain does not end in the log's output digest"
    return None


def _wrong_checkpoint(log: LogReader, facts: Facts) -> tuple[Difference, str] | None:
    if facts.checkpoints is None:
        return None
    left = dict(facts.checkpoints)
    for attachment in log.attachments():
        if not attachment.name.startswith(f"{PREFIX}/"):
            continue
        now, then = sha256(attachment.data), left.pop(attachment.name, "nothing")
        if now != then:
            difference = Difference(WHOLE, attachment.name, "digest", then[:16], now[:16])
            return difference, f"the attachment {attachment.name} was altered after the replay"
    if left:
        name = min(left)
        return Difference(WHOLE, name, "", "an attachment", "none"), f"the attachment {name} was removed"
    return None
