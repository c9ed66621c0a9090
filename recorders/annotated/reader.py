"""An annotated log, frame by frame: what `eval`, `export`, `explain` and `report` read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import islice, pairwise
from pathlib import Path
from statistics import median_low
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from recorders import channels
from recorders.annotated.frames import annotated_cameras, instants
from recorders.annotated.provenance import METADATA
from recorders.closing import Closing
from recorders.errors import LimitError, RecordingError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogReader, Message
from recorders.messages import Event, Graph, Group, Regions, Relation, Track, Withheld
from recorders.names import whole
from recorders.unreadable import Unreadable

if (
    TYPE_CHECKING
):  # pictures and the recording are what few readers of an annotated log read
    from recorders.annotated.membership import Labels
    from recorders.pictures import Image
    from recorders.scene import Frame, SceneLog

SCENE = (
    "tracks", "relations", "groups", "held_back", "events", "graph", "regions", "membership"
)  # fmt: skip
SAMPLED_FRAMES = 65
_GROUND, _WORDS = 96, (255, 255, 255)
_NO_PICTURE = "no picture at this time"
_ONCE = frozenset(
    {"tracks", "targets", "relations", "groups", "held_back", "graph", "membership"}
)
"""What a frame has one message of at the most."""


@dataclass(frozen=True)
class AnnotatedFrame:
    """One frame's annotation.

    Attributes:
        index: from 0, counted over the whole recording.
        time_ns: log time.
        tracks, relations, groups: of this frame, in the log's order.
        events: what happened in this frame.
        regions: the latest recorded regions, None without.
        graph: the latest graph, None before the first.
        membership: the encoded picture of which pixel belongs to whom, None without.
        held_back: what was followed in this frame and is not told.
    """

    index: int
    time_ns: int
    tracks: list[Track]
    relations: list[Relation]
    groups: list[Group]
    events: list[Event]
    regions: Regions | None = None
    graph: Graph | None = None
    membership: bytes | None = None
    held_back: list[Withheld] = field(default_factory=list)


class AnnotatedLog(Closing):
    """An annotated log.

    Args:
        path: the file.
        camera: the camera that is read; the only one if not given.
        limits: bounds on what it may make us allocate.
        as_it_is: frames are read as they stand, also where they do not rise or a message of one
            stands twice: to compare a log that was altered.

    Attributes:
        path: the file.
        camera: the camera that is read.
        facts: what the log says of its own making (tracker, configuration, digests), as strings.
        tracker: the tracker's name, empty if not said.

    Raises:
        RecordingError: it holds no tracks; the text says how to make an annotated log.
        UsageError: no such camera, or several and none chosen.
    """

    def __init__(
        self,
        path: str | Path,
        camera: str | None = None,
        limits: Limits = DEFAULT_LIMITS,
        *,
        as_it_is: bool = False,
    ) -> None:
        self.path = Path(path)
        self.limits = limits
        self._as_it_is = as_it_is
        self._log = LogReader(path, limits)
        try:
            self.camera = self._choose(camera)
            self.facts = next(
                (values for name, values in self._log.metadata() if name == METADATA), {}
            )
            self.tracker = self.facts.get("tracker", "")
        except BaseException:
            self._log.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._log.close()
        if "scene" in self.__dict__:
            self.scene.close()

    def _choose(self, wanted: str | None) -> str:
        cameras = annotated_cameras(self._log)
        if not cameras:
            raise RecordingError(
                "holds no tracks; make an annotated log of it with "
                f"`scenetrace replay {self.path} -o annotated.mcap --tracker events`",
                self.path,
            )
        if wanted is None and len(cameras) > 1:
            raise UsageError(
                f"{self.path}: several cameras ({', '.join(cameras)}); choose one with --camera"
            )
        if wanted is not None and wanted not in cameras:
            raise UsageError(
                f"{self.path}: no tracks of a camera {wanted!r}; there are: {', '.join(cameras)}"
            )
        return cameras[0] if wanted is None else wanted

    @cached_property
    def start_ns(self) -> int:
        """Log time of frame 0; where a span was cut out, reckoned back at the frames' nominal
        time.
        """
        seen = [
            (frame.time_ns, frame.index)
            for frame in islice(self.frames(("tracks",)), SAMPLED_FRAMES)
        ]
        if not seen:
            return self._log.start_ns or 0
        first_ns, index = seen[0]
        steps = [b[0] - a[0] for a, b in pairwise(seen)]
        return first_ns - index * median_low(steps) if index and steps else first_ns

    @cached_property
    def zone_point(self) -> str:
        """Where a target stands for named zones: ``foot`` or ``centre`` of its box."""
        try:
            made_with = msgspec.json.decode(self.facts.get("configuration", "{}"))
            return str(made_with["regions"]["zone_point"])
        except (msgspec.DecodeError, KeyError, TypeError):
            return "foot"

    def recorded_facts(self) -> list[dict[str, str]]:
        """What was written down when the scene was recorded, one mapping a camera: the source, its
        digest and so on.
        """
        return [
            dict(values)
            for name, values in self._log.metadata()
            if name == "scenetrace.recording"
        ]

    def time_of(self, index: int) -> int:
        """Log time of a frame.

        Raises:
            UsageError: the log does not hold it.
        """
        last = -1
        for frame in self.frames(("tracks",)):
            if frame.index == index:
                return frame.time_ns
            last = frame.index
        raise UsageError(f"frame:{index}: not in {self.path}, whose last frame is {last}")

    def size(self) -> tuple[int, int] | None:
        """(width, height) of the picture, None if the log does not say (it was written with
        annotations alone).
        """
        width, height = (whole(self.facts.get(name, "")) for name in ("width", "height"))
        if width is not None and height is not None:
            return width, height
        for name in ("detections", "regions"):
            for message in islice(
                self._log.messages([channels.topic(self.camera, name)]), 1
            ):
                found = self._decode(name, message)
                return found.width, found.height
        return None

    def graphs(self) -> Iterator[Graph]:
        """The messages of the interaction graph in order: one whenever something changed."""
        for message in self._log.messages([channels.topic(self.camera, "graph")]):
            yield self._decode("graph", message)

    def frames(
        self,
        names: Sequence[str] = SCENE,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[AnnotatedFrame]:
        """The frames in order; ``names`` chooses the channels that are read, beside the tracks.

        Only those at or after ``start_ns`` and before ``end_ns``, with what was said before and
        still holds.

        Raises:
            RecordingError: a message is damaged, or there are two frames at one time, as where
                logs were joined; not if the log is read as it is.
            LimitError: more messages at one time than the limits allow.
        """
        regions: Regions | None = self._before("regions", names, start_ns)
        graph: Graph | None = self._before("graph", names, start_ns)
        last: int | None = None
        wanted = {"tracks", *names}
        for moment in instants(
            self._log, self.camera, wanted, start_ns=start_ns, end_ns=end_ns
        ):
            found: dict[str, Any] = {"events": []}
            for name, message in moment.annotated:
                decoded = self._decode_at(name, message, last)
                twice = (name in found and name in _ONCE) or decoded in found["events"]
                if twice and not self._as_it_is:
                    raise RecordingError(
                        f"two messages for one frame, at {message.log_time_ns} ns: logs were"
                        " joined, or one was recorded twice; replay the scene anew",
                        self.path,
                        record=message.topic,
                    )
                if name == "events":
                    found["events"].append(decoded)
                else:
                    found[name] = decoded
            regions = found.get("regions", regions)
            graph = found.get("graph", graph)
            if "tracks" in found:
                falls = last is not None and found["tracks"].frame <= last
                if falls and not self._as_it_is:
                    raise RecordingError(
                        f"frame {found['tracks'].frame} after frame {last}; frames must rise",
                        self.path,
                        record="tracks",
                    )
                last = found["tracks"].frame
                yield _frame(moment.time_ns, found, regions, graph)

    def _decode_at(self, name: str, message: Message, last: int | None) -> Any:
        """The message; an error says after which frame it stands."""
        try:
            return self._decode(name, message)
        except LimitError:
            raise
        except RecordingError as error:
            place = "the first frame" if last is None else f"the one after frame {last}"
            raise RecordingError(
                f"{error.reason}, at {message.log_time_ns} ns: {place}",
                error.path,
                record=message.topic,
            ) from error

    def _before(self, name: str, names: Sequence[str], start_ns: int | None) -> Any:
        if start_ns is None or name not in names:
            return None
        topic = channels.topic(self.camera, name)
        message = self._log.latched(topic, start_ns - 1)
        return None if message is None else self._decode(name, message)

    def _decode(self, name: str, message: Message) -> Any:
        return channels.decode(name, message.data, path=str(self.path), limits=self.limits)

    @property
    def frame_count(self) -> int | None:
        """How many frames there are, None where the file does not say."""
        topic = channels.topic(self.camera, "tracks")
        return next(
            (
                channel.message_count
                for channel in self._log.channels
                if channel.topic == topic
            ),
            None,
        )

    @property
    def has_pictures(self) -> bool:
        """The log holds the recording's pictures."""
        return {channels.topic(self.camera, n) for n in ("image", "detections")} <= {
            channel.topic for channel in self._log.channels
        }

    def pictures(self) -> Iterator[tuple[int, Callable[[], Image]]]:
        """Log time and a loader of the picture, (height, width, 3) BGR, of every frame that was
        recorded with one.

        Call loaders in order, each at most once and before the next is taken.

        Raises:
            RecordingError: the log holds no pictures.
        """
        if not self.has_pictures:
            raise RecordingError("holds no pictures to draw on", self.path)
        scene = self.scene
        for frame in scene.frames():
            if scene.info.has_images:
                yield (
                    frame.time_ns,
                    partial(self.picture_of, frame, frame.time_ns, frame.index),
                )

    def picture_of(self, frame: Frame | None, time_ns: int, index: int) -> Image:
        """A frame's picture, or a plain ground; that the log has none of it is noted.

        Args:
            frame: what was recorded at that time, None where nothing was.
            time_ns: the frame's log time.
            index: the frame's number.
        """
        image = None if frame is None else frame.image
        if image is not None:
            return image
        if frame is None or not frame.has_picture:
            self._missing.note(time_ns, "no picture of a frame is in the log", index)
        return without_picture(self.scene.info.width, self.scene.info.height)

    @cached_property
    def _missing(self) -> Unreadable:
        return Unreadable(channels.topic(self.camera, "image"))

    @cached_property
    def scene(self) -> SceneLog:
        """The recording that the log holds; open as long as this log is.

        Raises:
            RecordingError: it holds none.
        """
        from recorders.scene import SceneLog

        return SceneLog(self.path, self.camera, self.limits)

    def membership(self, frame: AnnotatedFrame) -> Labels | None:
        """Which pixel belongs to whom: (height, width) uint16 of `recorders.annotated.membership.value_of`
        each track, or None.
        """
        from recorders.annotated.membership import decode_labels

        return (
            None
            if frame.membership is None
            else decode_labels(frame.membership, self.path, self.limits)
        )


def without_picture(width: int, height: int) -> Image:
    """A plain ground that says that there is no picture, (height, width, 3) BGR."""
    from recorders.vision import cv2

    ground = np.full((height, width, 3), _GROUND, np.uint8)
    scale = max(0.3, width / 800)
    place = (round(8 * scale), round(height - 10 * scale))
    cv2.putText(
        ground, _NO_PICTURE, place, cv2.FONT_HERSHEY_SIMPLEX, scale, _WORDS, 1, cv2.LINE_8
    )
    return ground


def _frame(
    now: int, found: dict[str, Any], regions: Regions | None, graph: Graph | None
) -> AnnotatedFrame:
    membership = found.get("membership")
    return AnnotatedFrame(
        found["tracks"].frame,
        time_ns=now,
        tracks=found["tracks"].tracks,
        relations=found["relations"].relations if "relations" in found else [],
        groups=found["groups"].groups if "groups" in found else [],
        events=found["events"],
        regions=regions,
        graph=graph,
        membership=None if membership is None else membership.data,
        held_back=found["held_back"].withheld if "held_back" in found else [],
    )
