"""Reading an annotated log's digest chain: the frames as the log holds them, and whether every
link is whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from recorders import channels
from recorders.annotated import digest
from recorders.annotated.checkpoint import MEDIA_TYPE, PREFIX, decode
from recorders.annotated.frames import instants
from recorders.annotated.provenance import (
    DIGESTS,
    GOLDEN,
    AlteredFactsError,
    Provenance,
    extras,
    provenance_of,
    sha256,
)
from recorders.errors import RecordingError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogReader, Message
from recorders.messages import Digest

WHOLE = -1
RECORDED = "recorded messages"


def short_digests(a: str, b: str) -> tuple[str, str]:
    """Two digests in 16 characters each; where those are the same, from the place on where they
    differ.

    >>> short_digests("0123456789abcdef01", "0123456789abcdef02")
    ('...1', '...2')
    """
    if a[:16] != b[:16] or a == b:
        return a[:16], b[:16]
    at = next(
        (index for index, (x, y) in enumerate(zip(a, b, strict=False)) if x != y),
        min(len(a), len(b)),
    )
    return f"...{a[at : at + 16]}", f"...{b[at : at + 16]}"


@dataclass(frozen=True)
class ReplayDifference:
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
        frames: annotated frames that were found equal, up to the first difference where that has
            a frame.
        difference: the first thing that differs; where the recording was changed, that change.
        reasons: what is not as it was, each with both values; with `identical`, what changed
            without effect.
        output_digest: the log's.
        effect: the first annotation that differs, where ``difference`` is its cause.
    """

    identical: bool
    frames: int
    difference: ReplayDifference | None = None
    reasons: list[str] = field(default_factory=list)
    output_digest: str = ""
    effect: ReplayDifference | None = None


@dataclass(frozen=True)
class FrameRecord:
    """An annotated frame as the log holds it.

    Attributes:
        time_ns: log time.
        digests: the digest messages of this time that can be read: one, unless the log was altered.
        payloads: channel and payload in the order in which they were written.
        stamps: channel, publish time and sequence number of each annotated message, digests
            included.
        recorded: the digest of the recorded messages up to this frame, None where the log does
            not hold them.
    """

    time_ns: int
    digests: list[Digest]
    payloads: list[tuple[str, bytes]]
    stamps: list[tuple[str, int, int]]
    recorded: str | None = None

    @property
    def digest(self) -> Digest:
        """The frame's digest."""
        return self.digests[0]


class RecordedInput:
    """The input's digest chain, made anew from the recorded messages that an annotated log holds."""

    def __init__(self, detections: str) -> None:
        self._detections = detections
        self._pending: list[Message] = []
        self._closes = False
        self._link = digest.START
        self.frames = 0
        self.last = ""

    def add(self, message: Message) -> None:
        """Take the next recorded message."""
        self._pending.append(message)
        self._closes = self._closes or message.topic == self._detections

    def end_of_time(self) -> None:
        """All messages of one time have been added."""
        if self._closes:
            self.last = digest.recorded_digest(self._pending)
            self._link = digest.chain_link(self._link, self.last)
            self.frames += 1
            self._pending, self._closes = [], False

    def final_link(self) -> str:
        """The chain's last link, with the messages after the last frame."""
        return (
            digest.chain_link(self._link, digest.recorded_digest(self._pending))
            if self._pending
            else self._link
        )


def recorded_frames(
    log: LogReader, camera: str, recorded: RecordedInput | None = None
) -> Iterator[FrameRecord]:
    """The annotated frames of a log in order.

    Args:
        log: an annotated log.
        camera: whose annotations.
        recorded: takes the recorded messages, too, if given.

    Raises:
        LimitError: more messages at one time than the limits allow.
    """
    for moment in instants(log, camera, with_recorded=recorded is not None):
        if recorded is not None:
            for message in moment.recorded:
                recorded.add(message)
            recorded.end_of_time()
        if not moment.annotated:
            continue
        digests: list[Digest] = []
        payloads: list[tuple[str, bytes]] = []
        for name, message in moment.annotated:
            if name == "digest":
                digests += _readable(message, log)
            else:
                payloads.append((name, message.data))
        stamps = [(name, m.publish_time_ns, m.sequence) for name, m in moment.annotated]
        yield FrameRecord(
            moment.time_ns,
            digests,
            payloads,
            stamps,
            None if recorded is None else recorded.last,
        )


def _readable(message: Message, log: LogReader) -> list[Digest]:
    """A digest message; none where it is no longer one."""
    try:
        return [channels.decode("digest", message.data, path=str(log.path))]
    except RecordingError:
        return []


def verify_chain(
    path: str | Path,
    limits: Limits = DEFAULT_LIMITS,
    progress: Callable[[str, int], None] | None = None,
) -> Verification:
    """Check the digests alone; nothing is replayed.

    Every payload hashes to its channel's digest, every digest to the next link, the last to the
    log's; so do the recorded messages where the log holds them all, the checkpoints, and the
    facts that the log says of itself.

    Raises:
        RecordingError: not an annotated log, or damaged beyond reading.
        UsageError: a golden file, which has no digests.
    """
    with LogReader(path, limits) as log:
        try:
            facts = provenance_of(log)
        except AlteredFactsError as error:
            difference = ReplayDifference(
                WHOLE,
                "metadata",
                error.fact,
                "a fact" if error.fact else "one record",
                "none to be read",
            )
            return Verification(
                False, 0, difference, [f"altered after the replay: {error.reason}"]
            )
        if any(name == GOLDEN for name, _ in log.metadata()):
            raise UsageError(
                f"{path}: a golden file holds no digests to verify; compare it with"
                " `scenetrace diff`"
            )
        altered = facts.altered()
        reasons = [
            f"the metadata's {name} was altered after the replay" for name in altered
        ]
        found: ReplayDifference | None = None
        for name, (then, now) in altered.items():
            field = name if name == DIGESTS else f"{name}'s digest"
            found = found or ReplayDifference(
                WHOLE, "metadata", field, *short_digests(then or "none", now or "none")
            )
        recorded = (
            None
            if facts.annotations_only
            else RecordedInput(channels.topic(facts.camera, "detections"))
        )
        link, frames = facts.link_before, 0
        for record in recorded_frames(log, facts.camera, recorded):
            wrong = _wrong(record, link, facts, frames)
            if wrong is not None:
                return Verification(
                    False, frames, wrong[0], [*reasons, wrong[1]], facts.output_digest
                )
            link = record.digest.link
            frames += 1
            if progress is not None:
                progress("checking", record.digest.frame)
        checks = (
            _wrong_end(facts, frames, link),
            _wrong_input(facts, recorded),
            _wrong_channels(log, facts),
            _wrong_checkpoint(log, facts),
            _wrong_extras(log, facts),
        )
        for wrong in filter(None, checks):
            found = found or wrong[0]
            reasons.append(wrong[1])
        return Verification(found is None, frames, found, reasons, facts.output_digest)


def _wrong(
    record: FrameRecord, link: str, facts: Provenance, frames: int
) -> tuple[ReplayDifference, str] | None:
    """What is wrong with a frame, and in words; None if it is whole."""
    if len(record.digests) != 1:
        last = facts.first_frame + frames
        number = record.digests[0].frame if record.digests else last
        difference = ReplayDifference(
            number, "digest", "messages", "1", str(len(record.digests))
        )
        return (
            difference,
            (
                f"{len(record.digests)} digests at {record.time_ns} ns: frames were"
                " altered, removed or moved"
            ),
        )
    d = record.digest
    expected_frame = facts.first_frame + frames
    if d.frame != expected_frame:
        then, now = (
            ("a frame", "none")
            if d.frame > expected_frame
            else (f"frame {expected_frame}", f"frame {d.frame}")
        )
        reason = "frames were altered, removed or moved after the replay"
        return ReplayDifference(
            min(d.frame, expected_frame), "frames", "", then, now
        ), reason
    # A span's first frame came with messages from before the span, which are not here.
    complete = record.recorded is not None and (frames > 0 or facts.from_ns is None)
    if complete and record.recorded != d.recorded:
        assert record.recorded is not None
        difference = ReplayDifference(
            d.frame, RECORDED, "digest", *short_digests(d.recorded, record.recorded)
        )
        return (
            difference,
            f"the recorded messages of frame {d.frame} were altered after the replay",
        )
    hashes = digest.channel_digests(record.payloads)
    for name in sorted({*hashes, *d.channels}):
        if hashes.get(name) != d.channels.get(name):
            then, now = (found.get(name, "no message") for found in (d.channels, hashes))
            difference = ReplayDifference(
                d.frame, name, "digest", *short_digests(then, now)
            )
            return difference, f"the channel {name} was altered after the replay"
    return _wrong_stamp(record) or _wrong_span(record, facts) or _wrong_link(record, link)


def _wrong_span(
    record: FrameRecord, facts: Provenance
) -> tuple[ReplayDifference, str] | None:
    """A frame where the log says that it has none."""
    for name, bound, outside in (
        (
            "from_ns",
            facts.from_ns,
            facts.from_ns is not None and record.time_ns < facts.from_ns,
        ),
        ("to_ns", facts.to_ns, facts.to_ns is not None and record.time_ns >= facts.to_ns),
    ):
        if outside:
            digest = record.digest
            difference = ReplayDifference(
                digest.frame, "metadata", name, str(bound), f"a frame at {record.time_ns}"
            )
            return (
                difference,
                (
                    f"the metadata's {name} was altered after the replay: frame {digest.frame}"
                    " is outside of it"
                ),
            )
    return None


def _wrong_stamp(record: FrameRecord) -> tuple[ReplayDifference, str] | None:
    """A publish time or a sequence number that no replay gives."""
    digest = record.digest
    for name, publish_ns, sequence in record.stamps:
        for what, then, now in (
            ("publish time", record.time_ns, publish_ns),
            ("sequence number", digest.frame, sequence),
        ):
            if then != now:
                return (
                    ReplayDifference(digest.frame, name, what, str(then), str(now)),
                    f"a {what} was altered after the replay",
                )
    return None


def _wrong_link(record: FrameRecord, link: str) -> tuple[ReplayDifference, str] | None:
    d = record.digest
    expected = digest.link(link, d.frame, record.time_ns, d.recorded, d.channels)
    if expected != d.link:
        difference = ReplayDifference(
            d.frame, "digest", "link", *short_digests(d.link, expected)
        )
        return (
            difference,
            "the chain is broken: frames were altered, removed or moved after the replay",
        )
    return None


def _wrong_end(
    facts: Provenance, frames: int, link: str
) -> tuple[ReplayDifference, str] | None:
    if frames != facts.frames:
        difference = ReplayDifference(
            WHOLE, "frames", "number", str(facts.frames), str(frames)
        )
        return difference, f"{facts.frames} frames were written, {frames} are here"
    if facts.from_ns is None and facts.to_ns is None and frames != facts.input_frames:
        difference = ReplayDifference(
            facts.first_frame + frames, "frames", "", "a frame", "none"
        )
        return (
            difference,
            (
                f"{facts.input_frames} frames were replayed and none left out, but {frames}"
                " are here: altered"
            ),
        )
    if frames and link != facts.output_digest:
        difference = ReplayDifference(
            WHOLE, "metadata", "output_digest", *short_digests(facts.output_digest, link)
        )
        return difference, "the chain does not end in the log's output digest"
    return None


def _wrong_input(
    facts: Provenance, recorded: RecordedInput | None
) -> tuple[ReplayDifference, str] | None:
    """Recorded messages behind the last annotated frame, which no frame's digest holds."""
    if recorded is None or not facts.whole:
        return None
    if recorded.frames != facts.input_frames:
        difference = ReplayDifference(
            WHOLE, RECORDED, "frames", str(facts.input_frames), str(recorded.frames)
        )
        return (
            difference,
            f"{facts.input_frames} frames were recorded, {recorded.frames} are here",
        )
    link = recorded.final_link()
    if link != facts.input_digest:
        difference = ReplayDifference(
            WHOLE, RECORDED, "input digest", *short_digests(facts.input_digest, link)
        )
        return (
            difference,
            (
                "recorded messages after the last frame were altered, added or removed"
                " after the replay"
            ),
        )
    return None


def _wrong_channels(
    log: LogReader, facts: Provenance
) -> tuple[ReplayDifference, str] | None:
    """Annotated channels under another schema, and channels that a log of annotations alone
    cannot have.
    """
    names = {channels.topic(facts.camera, name): name for name in channels.ANNOTATED}
    for channel in log.channels:
        name = names.get(channel.topic)
        if name is None:
            if facts.annotations_only:
                difference = ReplayDifference(
                    WHOLE, channel.topic, "", "no such channel", "a channel"
                )
                return difference, f"the channel {channel.topic} was added after the replay"
            continue
        now = (
            channel.schema.name if channel.schema is not None else "none",
            channel.message_encoding,
        )
        then = (channels.schema(name).name, channels.message_encoding(name))
        if now != then:
            difference = ReplayDifference(
                WHOLE, name, "schema", " ".join(then), " ".join(now)
            )
            return (
                difference,
                f"the schema of the channel {name} was altered after the replay",
            )
    return None


def _wrong_checkpoint(
    log: LogReader, facts: Provenance
) -> tuple[ReplayDifference, str] | None:
    if facts.checkpoints is None:
        return None
    left = dict(facts.checkpoints)
    for attachment in log.attachments():
        if not attachment.name.startswith(f"{PREFIX}/"):
            continue
        now, then = sha256(attachment.data), left.pop(attachment.name, "nothing")
        if now != then:
            difference = ReplayDifference(
                WHOLE, attachment.name, "digest", *short_digests(then, now)
            )
            return (
                difference,
                f"the attachment {attachment.name} was altered after the replay",
            )
        time_ns = decode(attachment.data, str(log.path)).time_ns
        for what, wanted, found in (
            ("log time", time_ns, attachment.log_time_ns),
            ("create time", 0, attachment.create_time_ns),
            ("media type", MEDIA_TYPE, attachment.media_type),
        ):
            if found != wanted:
                difference = ReplayDifference(
                    WHOLE, attachment.name, what, str(wanted), str(found)
                )
                return (
                    difference,
                    (
                        f"the {what} of the attachment {attachment.name} was altered after"
                        " the replay"
                    ),
                )
    if left:
        name = min(left)
        return (
            ReplayDifference(WHOLE, name, "", "an attachment", "none"),
            f"the attachment {name} was removed",
        )
    return None


def _wrong_extras(log: LogReader, facts: Provenance) -> tuple[ReplayDifference, str] | None:
    """Attachments and metadata that the recording brought along."""
    if facts.extras is None:
        return None
    now = extras(log.attachments(), log.metadata())
    for name in sorted({*facts.extras, *now}):
        a, b = facts.extras.get(name, "nothing"), now.get(name, "nothing")
        if a != b:
            return (
                ReplayDifference(WHOLE, name, "digest", *short_digests(a, b)),
                f"the {name} was altered after the replay",
            )
    return None
