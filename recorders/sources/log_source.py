"""A camera in a log of others: pictures and detections of an MCAP file or a ROS bag as frames,
everything else passed on.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import islice, pairwise
from statistics import median_low

import msgspec

from recorders.clock import Clock, nominal_ns
from recorders.errors import LimitError, RecordingError, SourceError, UsageError
from recorders.files import sha256
from recorders.frame_order import FrameOrder
from recorders.left_out import LeftOut
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import Attachment, Message
from recorders.messages import Box, Detections
from recorders.payloads import (
    Detected,
    PayloadError,
    VideoPacket,
    own_stamp_ns,
    read_detections,
    read_picture,
)
from recorders.pictures import Image, check_size
from recorders.sources.log_files import LogFiles
from recorders.sources.log_pictures import Pictured, PictureReader, bits_of
from recorders.sources.pairing import Joined, Pairing
from recorders.sources.repeats import Repeats, SizesMet
from recorders.sources.source import (
    NANOS,
    Rate,
    SourceFrame,
    detections_of,
    fitted,
    outside,
    spread,
)
from recorders.sources.topics import Topics, choose_topics

CLOCKS = ("log", "publish", "header", "file")
LAST_NS = 2**63 - 1
_SAMPLED = 64
_TRIED = 1000
_ASSUMED_NS = NANOS // 25
_BURST = 10
_TOLD_APART_NS = 1000
_DISTINCT = 0.75


@dataclass(frozen=True)
class LogOptions:
    """What of a log is read, and how.

    Attributes:
        image_topic, detections_topic: None: the only one; ``none``: leave them.
        clock: which time is a picture's: ``log`` (when it was recorded), ``publish``, ``header``
            (its own stamp), or ``file`` (log times in the order of the file, where the recorder's
            clock was set back).
        tolerance_ns: how far apart picture and detections may be; None: half a frame.
        topics: patterns of the other topics that are passed on; None: all.
        exclude: patterns of those that are not.
    """

    image_topic: str | None = None
    detections_topic: str | None = None
    clock: str = "log"
    tolerance_ns: int | None = None
    topics: Sequence[str] | None = None
    exclude: Sequence[str] = ()


class LogSource:
    """A camera in a log of others.

    A picture is a frame, with the detections that belong to it. Where detections come for every
    second picture or less often, only the pictures that have some are frames: of the others nobody
    knows what was there. Without pictures each message of detections is a frame.

    Attributes:
        start_ns: when the first frame was taken, by the chosen clock.

    Raises:
        SourceError, RecordingError: nothing in it can be read.
        UsageError: a topic is not there, or must be chosen.
    """

    has_images: bool
    has_detections: bool

    def __init__(
        self,
        log: LogFiles,
        options: LogOptions | None = None,
        fps: Fraction | None = None,
        size: tuple[int, int] | None = None,
        limits: Limits = DEFAULT_LIMITS,
    ) -> None:
        self._log = log
        self._options = options or LogOptions()
        self._limits = limits
        self.path = log.path
        self.notes: list[str] = []
        self.losses: list[str] = []
        self._left_out = LeftOut()
        self._rate = None if fps is None else Rate(fps)
        if self._options.clock not in CLOCKS:
            raise UsageError(
                f"--time {self._options.clock}: must be one of {', '.join(CLOCKS)}"
            )
        self.topics = choose_topics(
            log, self._options.image_topic, self._options.detections_topic
        )
        self.has_images = self.topics.image is not None
        self.has_detections = self.topics.detections is not None
        self.name = _named(log.name, self.topics)
        self._made_for = size
        self._look(size)
        self._repeats: dict[str, Repeats] = {}
        self.frame_count = self._expected()
        self._said = list(self.notes)

    # What is learnt before the first frame.

    def _look(self, size: tuple[int, int] | None) -> None:
        images = self._sampled(self.topics.image)
        found = self._sampled(self.topics.detections)
        self._check_detections()
        first = self._first_picture()
        self.stills = first is not None and first.encoded is not None
        self._bits = self._bits_used()
        if first is not None:
            assert first.size is not None
            self.width, self.height = first.size
        elif self.has_images:
            lines = "; ".join(self._left_out.lines()) or "no messages"
            raise SourceError(
                f"no picture of {self.topics.image} can be decoded: {lines}", self.path
            )
        else:
            self.width, self.height = self._size_of_boxes(size)
        check_size(self.width, self.height, self.path, self._limits)
        leading = images or found
        times = [topic for topic, _ in leading]
        nominal = nominal_ns(times)
        self.frame_ns = nominal or _ASSUMED_NS
        if self._rate is not None:
            self.frame_ns = self._rate.frame_ns
        elif nominal is None and len(times) > 1:
            raise UsageError(
                f"{self.path}: all frames have one time by the clock {self._options.clock!r};"
                " choose another with --time, or give the rate with --fps"
            )
        self.start_ns = min(max(0, times[0]), LAST_NS) if times else 0
        self._times = {
            topic: [time for time, _ in sampled]
            for topic, sampled in (
                (self.topics.image, images),
                (self.topics.detections, found),
            )
            if topic is not None
        }
        self._decide_pairing(images, found)
        self._warn_of_bursts(leading)

    def _sampled(self, topic: str | None) -> list[tuple[int, int]]:
        """Time by the chosen clock and own stamp of the first messages of a topic."""
        if topic is None:
            return []
        found = []
        repeats = Repeats(None, self._says_which)
        for message in islice(self._messages([topic]), _SAMPLED):
            if repeats.has(message):
                continue
            stamp = self._stamp(message)
            now = self._clock(message, stamp)
            if message.log_time_ns <= LAST_NS:
                found.append((now, stamp))
        return found

    def _says_which(self, message: Message) -> bool:
        """Whether a message says which picture it is, or is of."""
        if message.topic == self.topics.image:
            return own_stamp_ns(message) != 0
        try:
            found = read_detections(message.channel, message.data)
        except PayloadError:
            return False
        return found.frame is not None or found.stamp_ns != 0

    def _stamp(self, message: Message) -> int:
        try:
            if message.topic == self.topics.image:
                return read_picture(message.channel, message.data).stamp_ns
            return read_detections(message.channel, message.data).stamp_ns
        except PayloadError:
            return 0

    def _check_detections(self) -> None:
        """Refuse a topic of which nothing can be read: no picture would have any detections.

        Raises:
            SourceError: its first messages all cannot.
        """
        if self.topics.detections is None:
            return
        why = ""
        for message in islice(self._messages([self.topics.detections]), _SAMPLED):
            try:
                read_detections(message.channel, message.data)
            except PayloadError as error:
                why = why or str(error)
            else:
                return
        if why:
            raise SourceError(
                f"no message of {self.topics.detections} can be read: {why};"
                " --detections-topic none records the pictures alone",
                self.path,
            )

    def _first_picture(self) -> Pictured | None:
        if self.topics.image is None:
            return None
        reader = PictureReader(self.path, self._left_out, self._limits)
        for message in islice(self._messages([self.topics.image]), _TRIED):
            for picture in reader.take(message):
                if picture.load is not None:
                    return picture
        return next(iter(reader.rest()), None)

    def _bits_used(self) -> int:
        """How many bits the values of pictures of more than eight fill, by the first of them."""
        if self.topics.image is None:
            return 0
        bits = 0
        for message in islice(self._messages([self.topics.image]), _SAMPLED):
            one = bits_of(message, self.path, self._limits)
            bits = max(bits, one)
            if not one:
                break
        if bits > 8:
            self.notes.append(
                f"values of more than eight bits fill {bits}: the upper 8 of those are kept"
            )
        return bits

    def _size_of_boxes(self, size: tuple[int, int] | None) -> tuple[int, int]:
        """What the boxes were made for, where there are no pictures."""
        if size is not None:
            return size
        right = bottom = 1.0
        assert self.topics.detections is not None
        for message in self._messages([self.topics.detections]):
            try:
                found = read_detections(message.channel, message.data)
            except PayloadError:
                continue
            if found.size is not None:
                return found.size
            for x, y, w, h in found.boxes:
                right, bottom = max(right, x + w), max(bottom, y + h)
        reach = int(-(-right // 1)), int(-(-bottom // 1))
        self.notes.append(
            f"no picture size is known: assuming {reach[0]}x{reach[1]}, as far as boxes"
            " reach; say it with --size"
        )
        return reach

    def _decide_pairing(
        self, images: list[tuple[int, int]], found: list[tuple[int, int]]
    ) -> None:
        stamps = {stamp for _, stamp in images if stamp} | self._later_stamps(images, found)
        matching = sum(stamp in stamps for _, stamp in found)
        distinct = len({s for _, s in found}) > 1 or len(found) == 1
        self._by_stamp = (
            bool(matching) and distinct and 2 * matching >= min(len(found), len(images))
        )
        tolerance = self._options.tolerance_ns
        self._tolerance_ns = self.frame_ns // 2 if tolerance is None else tolerance
        self._several = False
        steps = [b[0] - a[0] for a, b in pairwise(found) if b[0] > a[0]]
        every = round(median_low(steps) / self.frame_ns) if steps and images else 1
        self._every = max(1, every)
        # Several messages of one picture: their times are the same where the pictures' are not.
        places = [stamp if self._by_stamp else now for now, stamp in found]
        alike = len(set(places)) <= _DISTINCT * len(places)
        self._several = alike and len({now for now, _ in images}) > _DISTINCT * len(images)
        if not (images and found):
            return
        how = (
            "by their equal stamps"
            if self._by_stamp
            else f"by time, within {self._tolerance_ns / 1e6:g} ms (--tolerance)"
        )
        self.notes.append(f"pictures and detections are paired {how}")
        if self._several:
            self.notes.append(
                "several messages of detections belong to one picture: they are joined"
            )
        if self._every > 1:
            self.notes.append(
                f"detections come with one picture in {self._every}: those pictures are the frames"
            )

    def _later_stamps(
        self, images: list[tuple[int, int]], found: list[tuple[int, int]]
    ) -> set[int]:
        """Stamps of later pictures, where the first detections belong to them: a detector may
        have been started late.
        """
        first = min((stamp for _, stamp in found if stamp), default=0)
        last = max((stamp for _, stamp in images), default=0)
        if not first > last > 0 or self.topics.image is None:
            return set()
        late = max(stamp for _, stamp in found)
        later: set[int] = set()
        for message in islice(self._messages([self.topics.image]), _SAMPLED, _TRIED * 10):
            stamp = self._stamp(message)
            later.add(stamp)
            if stamp > late:
                break
        return later - {0}

    def _warn_of_bursts(self, leading: list[tuple[int, int]]) -> None:
        """Times in bursts tell when messages arrived, not when pictures were taken."""
        steps = [b[0] - a[0] for a, b in pairwise(leading)]
        if len(steps) < 3 or self._options.clock not in ("log", "file") or self._rate:
            return
        if self.frame_ns > _BURST * max(1, median_low(steps)):
            self.notes.append(
                "the log times come in bursts: they tell when messages arrived; where"
                " another clock tells when pictures were taken, choose it with --time"
                " header or --time publish, or give the rate with --fps"
            )

    def _expected(self) -> int | None:
        topic = self.topics.image
        if topic is None or self._every > 1:
            topic = self.topics.detections
        counts = [
            channel.message_count
            for channel in self._log.channels
            if channel.topic == topic
        ]
        known = [count for count in counts if count is not None]
        return sum(known) if len(known) == len(counts) else None

    # Reading.

    def _messages(self, topics: Sequence[str]) -> Iterator[Message]:
        return self._log.messages(topics, stored=self._options.clock == "file")

    def _pairing_time(self, message: Message) -> int:
        if self._options.clock == "publish":
            return message.publish_time_ns
        return message.log_time_ns

    def _clock(self, message: Message, stamp: int) -> int:
        if self._options.clock == "publish":
            return message.publish_time_ns
        if self._options.clock == "header" and stamp:
            return stamp
        return message.log_time_ns

    def _onwards(self, messages: Iterator[Message]) -> Iterator[Message]:
        """In the file's order: where log times go back, they go on from where they were."""
        if self._options.clock != "file":
            yield from messages
            return
        last, offset = -1, 0
        for message in messages:
            now = message.log_time_ns + offset
            if now < last - 3 * self.frame_ns:
                self._set_back += 1
                offset += last + self.frame_ns - now
                now = last + self.frame_ns
            last = max(last, now)
            yield msgspec.structs.replace(message, log_time_ns=now)

    def _joined(self, pairing: Pairing) -> Iterator[tuple[int, Joined]]:
        self._reader = reader = PictureReader(self.path, self._left_out, self._limits)
        reader.bits = self._bits
        wanted = [
            topic
            for topic in (self.topics.image, self.topics.detections)
            if topic is not None
        ]
        for message in self._onwards(self._messages(wanted)):
            if max(message.log_time_ns, message.publish_time_ns) > LAST_NS:
                self._left_out.note(
                    "a message with a time before 1970 or after 2262",
                    f"{_signed(message.log_time_ns)} ns on {message.topic}",
                )
            elif self._repeats[message.topic].has(message):
                continue
            elif message.topic == self.topics.image:
                for picture in reader.take(message):
                    yield from self._with_picture(pairing, picture)
            else:
                found = self._detected(message)
                if found is None:
                    continue
                if self.has_images:
                    yield from map(self._dated, pairing.detections(message, found))
                else:
                    yield self._clock(message, found.stamp_ns), Joined(None, found)
        for picture in reader.rest():
            yield from self._with_picture(pairing, picture)
        yield from map(self._dated, pairing.rest())

    def _with_picture(
        self, pairing: Pairing, picture: Pictured
    ) -> Iterator[tuple[int, Joined]]:
        if self.has_detections:
            yield from map(self._dated, pairing.picture(picture))
        elif picture.load is not None:
            yield self._dated(Joined(picture, None))

    def _dated(self, one: Joined) -> tuple[int, Joined]:
        if one.picture is None:
            assert one.message is not None
            assert one.detected is not None
            stamp = one.detected.stamp_ns
            now = self._clock(one.message, stamp)
            at_stamp = self._options.clock == "header" and stamp
            return now if at_stamp else now - one.late_ns, one
        return self._clock(one.picture.message, one.picture.stamp_ns), one

    def _detected(self, message: Message) -> Detected | None:
        try:
            found = read_detections(message.channel, message.data)
        except PayloadError as error:
            where = f"{message.log_time_ns} ns on {message.topic}"
            self._left_out.note(f"detections that cannot be read ({error})", where)
            return None
        if found.others:
            self._drawn += 1
        if found.left_out:
            self._left_out.note(
                "a box without width or height, or not finite",
                f"{message.log_time_ns} ns on {message.topic}",
            )
        return found

    def frames(self) -> Iterator[SourceFrame]:
        """All frames in order."""
        self.losses.clear()
        self._left_out.clear()
        self._scaled = self._set_back = self._drawn = self._alone = 0
        self._resized = SizesMet()
        self._order = FrameOrder()
        self._repeats = {
            topic: Repeats(times, self._says_which) for topic, times in self._times.items()
        }
        pairing = Pairing(
            self._by_stamp,
            self._tolerance_ns,
            self._pairing_time,
            self._limits,
            self.frame_ns,
            self._several,
        )
        clock: Clock[Joined] = Clock(self.frame_ns)
        joined = (
            j
            for j in self._joined(pairing)
            if self._every == 1 or j[1].detected is not None
        )
        count = 0
        for time_ns, one in clock.times(joined):
            now = time_ns if self._rate is None else self._rate.time_ns(count)
            if self.start_ns + now > LAST_NS:
                self._left_out.note("a frame after 2262", f"frame {count}")
                continue
            yield self._frame(count, now, one)
            count += 1
        self._sum_up(count, clock, pairing)

    def _frame(self, index: int, now: int, one: Joined) -> SourceFrame:
        picture = one.picture
        detections = self._detections(index, one) if self.has_detections else None
        if picture is None and self.has_images:
            self._alone += 1
        if picture is None or picture.load is None:
            return SourceFrame(index, now, detections=detections)
        size = (self.width, self.height)
        load: Callable[[], Image] = picture.load
        encoded, kind = picture.encoded, picture.format
        if picture.size != size:
            self._scaled += 1
            load, encoded, kind = partial(_fitted, picture.load, size), None, None
        return SourceFrame(index, now, load, encoded, kind, detections)

    def _detections(self, index: int, one: Joined) -> Detections:
        found = one.detected
        if found is None:
            return detections_of(index, self.width, self.height, [], [])
        if found.frame is not None and self._order.interleaves(found.frame):
            raise SourceError(
                f"frame {found.frame} of {self.topics.detections} comes after frame"
                f" {self._order.highest}, and frames before both came earlier still: the"
                " recorder's clock was set back; --time file follows the file's order",
                self.path,
            )
        made_for = self._made_for or found.size
        if made_for is None and one.picture is not None:
            made_for = one.picture.size
        if found.size is not None and self._made_for is None:
            self._resized.take(found.size, index)
        across, down = (
            (1.0, 1.0)
            if made_for is None
            else (self.width / made_for[0], self.height / made_for[1])
        )
        kept: list[tuple[Box, float, str]] = []
        for box, score, label in zip(found.boxes, found.scores, found.labels, strict=True):
            x, y, w, h = box
            scaled = (x * across, y * down, w * across, h * down)
            if outside(scaled, self.width, self.height):
                self._left_out.note(
                    f"a box beyond the picture of {self.width}x{self.height} (--size says"
                    " what size boxes were made for)",
                    f"frame {index} on {self.topics.detections}",
                )
                continue
            kept.append((scaled, score, label))
        most = self._limits.max_detections_per_frame
        if len(kept) > most:
            self._left_out.note(
                f"all but the first {most} detections of a frame (--limit"
                " max_detections_per_frame=N)",
                f"frame {index} on {self.topics.detections}",
            )
            kept = kept[:most]
        return detections_of(
            index,
            self.width,
            self.height,
            [entry[0] for entry in kept],
            [entry[1] for entry in kept],
            [entry[2] for entry in kept],
        )

    def _sum_up(self, count: int, clock: Clock[Joined], pairing: Pairing) -> None:
        self.frame_count = count
        self.notes[:] = self._said
        if self._rate is None:
            clock.joined += self._set_back
            self.notes += clock.notes()
        for topic, repeats in self._repeats.items():
            self.notes += repeats.notes(topic)
        self.notes += self._resized.notes((self.width, self.height))
        self.losses += self._resized.losses((self.width, self.height))
        self.losses += [*self._log.losses, *self._left_out.lines()]
        if self._reader.clipped:
            self.losses.append(
                f"{self._reader.clipped} pictures have values of more than {self._bits} bits:"
                " what is brighter than those is white"
            )
        if self._scaled:
            self.losses.append(
                f"{self._scaled} pictures of another size were scaled to"
                f" {self.width}x{self.height}"
            )
        if pairing.largest_ns >= _TOLD_APART_NS:
            self.notes.append(
                f"pictures and their detections are up to {pairing.largest_ns / 1e6:g} ms"
                " apart"
            )
        if pairing.unpaired_pictures and self.has_detections and self._every == 1:
            self.notes.append(
                f"{pairing.unpaired_pictures} pictures have no detections of their own: they"
                " count as pictures in which nothing was found"
            )
        if pairing.unpaired_detections:
            self.losses.append(
                f"{pairing.unpaired_detections} messages of detections without a picture"
                f" near, the first at {pairing.first_unpaired} ns (--tolerance)"
            )
        if self._alone:
            self.notes.append(
                f"{self._alone} frames have detections and no picture, which is missing in"
                f" {self.topics.image}"
            )
        if self._drawn:
            self.notes.append(
                f"{self._drawn} messages of {self.topics.detections} draw more than boxes (lines,"
                " outlines, points, circles): that is no detection"
            )
        if not count:
            why = f": {self.losses[0]}" if self.losses else ""
            raise SourceError(f"no frame of it can be recorded{why}", self.path)

    def sample(self, count: int) -> Iterator[Image]:
        """About ``count`` pictures spread over the recording."""
        if self.topics.image is None:
            return
        reader = PictureReader(self.path, LeftOut(), self._limits)
        reader.bits = self._bits
        among = max(1, self._expected() or self.frame_count or count)
        index = 0
        stills: bool | None = None
        for message in self._messages([self.topics.image]):
            if message.log_time_ns > LAST_NS:
                continue
            stills = _stands_alone(message) if stills is None else stills
            wanted = spread(index, count, among)
            index += 1
            # A video has to be decoded as a whole; what stands alone only where it is wanted.
            if not wanted and stills:
                continue
            for picture in reader.take(message):
                if wanted and picture.load is not None:
                    try:
                        image = picture.load()
                    except LimitError:
                        raise
                    except (SourceError, RecordingError):
                        continue
                    yield fitted(image, self.width, self.height)

    def others(self) -> Iterator[Message]:
        """Every message that is passed on as it is, by log time; to be read beside the frames."""
        taken = {self.topics.image, self.topics.detections}
        wanted = sorted(
            {channel.topic for channel in self._log.channels}
            - {topic for topic in taken if topic}
        )
        chosen = [topic for topic in wanted if self._passes(topic)]
        if not chosen:
            return
        log = self._log.again()
        try:
            yield from log.messages(chosen)
        finally:
            log.close()

    def attachments(self) -> Iterator[Attachment]:
        """The log's attachments."""
        return self._log.attachments()

    def metadata(self) -> list[tuple[str, dict[str, str]]]:
        """The log's metadata records."""
        return self._log.metadata()

    def _passes(self, topic: str) -> bool:
        if self._options.topics is not None and not any(
            fnmatch.fnmatchcase(topic, pattern) for pattern in self._options.topics
        ):
            return False
        return not any(
            fnmatch.fnmatchcase(topic, pattern) for pattern in self._options.exclude
        )

    def digests(self) -> list[tuple[str, str]]:
        """SHA-256 of each file."""
        return [(path.name, sha256(path)) for path in self._log.files()]


def _named(kind: str, topics: Topics) -> str:
    parts = [topic for topic in (topics.image, topics.detections) if topic is not None]
    return f"{kind}: {' with '.join(parts)}"


def _signed(time_ns: int) -> int:
    return time_ns - 2**64 if time_ns > LAST_NS else time_ns


def _fitted(load: Callable[[], Image], size: tuple[int, int]) -> Image:
    return fitted(load(), *size)


def _stands_alone(message: Message) -> bool:
    try:
        return not isinstance(read_picture(message.channel, message.data), VideoPacket)
    except PayloadError:
        return True
