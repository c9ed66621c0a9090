"""A log opened as a sequence of frames: exactly what it holds, nothing is computed anew."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from reasoning.graph import to_networkx
from recorders.annotated.membership import Labels
from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.closing import Closing
from recorders.errors import RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.messages import Detections, Event, Graph, Group, Regions, Relation, Track
from recorders.pictures import Image
from recorders.scene import Frame, SceneLog
from replay.export.graphml import interaction_graph
from replay.library.answers import Rows, ask, query

if TYPE_CHECKING:
    import networkx as nx

    from reasoning.questions import Case

NANOS = 1_000_000_000


class SceneFrame:
    """One frame of an opened log. What was recorded is read when first asked for, once.

    Attributes:
        index: the frame's number, from 0, counted over the whole recording.
        time_ns: log time.
        t: seconds from the recording's start.
    """

    def __init__(
        self, log: OpenLog, index: int, time_ns: int, annotation: AnnotatedFrame | None
    ) -> None:
        self.index = index
        self.time_ns = time_ns
        self.t = (time_ns - log.start_ns) / NANOS
        self._log = log
        self._annotation = annotation

    def __repr__(self) -> str:
        return f"SceneFrame({self.index}, t={self.t:.3f})"

    def _repr_html_(self) -> str:
        """In a notebook: the picture with what was found, and what happened."""
        from replay.library import html

        return html.frame_html(self)

    @property
    def annotated(self) -> bool:
        """A tracker has looked at it."""
        return self._annotation is not None

    @property
    def path(self) -> Path:
        """The log."""
        return self._log.path

    @property
    def _found(self) -> AnnotatedFrame:
        if self._annotation is None:
            raise RecordingError(
                f"holds no tracks; make an annotated log of it with `scenetrace replay"
                f" {self._log.path} -o annotated.mcap`",
                self._log.path,
            )
        return self._annotation

    @property
    def tracks(self) -> list[Track]:
        """All tracks by id, also those not held to be in the picture (``present`` is False)."""
        return self._found.tracks

    @property
    def present(self) -> list[Track]:
        """The tracks held to be in the picture: those of ``export --to mot``."""
        return [track for track in self.tracks if track.present]

    @property
    def relations(self) -> list[Relation]:
        """The edges that are not INDEPENDENT, by (a, b)."""
        return self._found.relations

    @property
    def groups(self) -> list[Group]:
        """The groups, by label."""
        return self._found.groups

    @property
    def events(self) -> list[Event]:
        """What happened in this frame."""
        return self._found.events

    @property
    def regions(self) -> Regions | None:
        """The regions in force, None where none were recorded."""
        return (
            self.recorded.regions if self._annotation is None else self._annotation.regions
        )

    @cached_property
    def graph(self) -> nx.MultiGraph | None:
        """The log's latest interaction graph, see `to_networkx`; None before the first.

        It is written whenever something changed: ``graph.graph["frame"]`` says when. Edges with
        ``end_frame`` had ended then.
        """
        message = self._found.graph
        return None if message is None else to_networkx(message)

    @property
    def membership(self) -> Labels | None:
        """Which pixel belongs to whom, (height, width) uint16, None where no tracker said so."""
        return self._log.membership(self._found)

    @cached_property
    def recorded(self) -> Frame:
        """What was recorded for this frame.

        Raises:
            RecordingError: the log holds no recording (it was written with annotations alone).
        """
        return self._log.recorded_frame(self.index, self.time_ns)

    @property
    def picture(self) -> Image | None:
        """The picture, (height, width, 3) uint8, channels in the order BGR, None without.

        Never write into it; ``picture[..., ::-1]`` is RGB.
        """
        return self.recorded.image if self._log.has_recording else None

    @property
    def mask(self) -> Image | None:
        """The foreground mask, (height, width) uint8, 0 or 255, None without."""
        return self.recorded.mask if self._log.has_recording else None

    @property
    def detections(self) -> Detections | None:
        """The recorded detections, None where the log holds no recording."""
        return self.recorded.detections if self._log.has_recording else None


class OpenLog(Closing):
    """A scene log or an annotated log as a sequence of `SceneFrame`.

    ``log[280]`` is frame 280, by its number in the recording, also where the log is a span of it;
    ``log[-1]`` the last one; ``log[10:20]`` a list; ``log.at(12.5)`` the frame at a time.

    >>> # with scenetrace.open("annotated.mcap") as log:
    >>> #     print(log[280].present, log.graph.number_of_edges())

    Attributes:
        path: the file.
        camera: the camera that is read.
        annotated: it holds a tracker's answers.
        has_recording: it holds what was recorded.

    Raises:
        RecordingError: it is neither, or damaged.
        UsageError: no such camera, or several and none chosen.
    """

    def __init__(
        self, path: str | Path, camera: str | None = None, limits: Limits = DEFAULT_LIMITS
    ) -> None:
        self.path = Path(path)
        self._limits = limits
        self._scene: SceneLog | None = _opened(SceneLog, self.path, camera, limits)
        self._log: AnnotatedLog | None = None
        self._case: Case | None = None
        self._reading: Iterator[Frame] | None = None
        self._next = -1
        try:
            self._log = _opened(AnnotatedLog, self.path, camera, limits)
            if self._log is None and self._scene is None:
                SceneLog(self.path, camera, limits).close()  # raises, and says why
        except BaseException:
            self.close()
            raise
        self.annotated = self._log is not None
        self.has_recording = self._scene is not None

    def close(self) -> None:
        """Close the file. Frames that were taken keep what they have read."""
        for part in (self._scene, self._log, self._case):
            if part is not None:
                part.close()

    def __repr__(self) -> str:
        kind = f"annotated by {self.tracker}" if self.annotated else "a scene"
        return f"OpenLog({str(self.path)!r}, {kind}, {len(self)} frames)"

    def _repr_html_(self) -> str:
        """In a notebook: what it is, and who was there when."""
        from replay.library import html

        return html.log_html(self)

    @property
    def camera(self) -> str:
        """The camera's name."""
        part = self._log or self._scene
        assert part is not None
        return part.camera

    @property
    def facts(self) -> Mapping[str, str]:
        """What an annotated log says of its own making, as strings; empty for a scene log."""
        return {} if self._log is None else self._log.facts

    @property
    def tracker(self) -> str:
        """The tracker's name, empty for a scene log."""
        return "" if self._log is None else self._log.tracker

    @cached_property
    def size(self) -> tuple[int, int] | None:
        """(width, height) of the picture in pixels, None where the log does not say."""
        if self._scene is not None:
            return self._scene.info.width, self._scene.info.height
        return None if self._log is None else self._log.size()

    @cached_property
    def start_ns(self) -> int:
        """Log time of frame 0."""
        if self._log is not None:
            return self._log.start_ns
        return self._times[0] if self._times else 0

    @cached_property
    def _places(self) -> dict[int, int]:
        """Number and log time of each frame, in order."""
        if self._log is not None:
            return {frame.index: frame.time_ns for frame in self._log.frames(("tracks",))}
        assert self._scene is not None
        return dict(enumerate(self._scene.frame_times()))

    @cached_property
    def _times(self) -> list[int]:
        return list(self._places.values())

    @cached_property
    def _numbers(self) -> list[int]:
        return list(self._places)

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, which: int) -> SceneFrame: ...

    @overload
    def __getitem__(self, which: slice) -> list[SceneFrame]: ...

    def __getitem__(self, which: int | slice) -> SceneFrame | list[SceneFrame]:
        if isinstance(which, slice):
            end = self._numbers[-1] + 1 if self._numbers else 0
            chosen = range(*which.indices(end))
            return [self[number] for number in chosen if number in self._places]
        number = int(which)
        if number < 0:
            if -number > len(self):
                raise IndexError(f"frame {number}: {self.path} has {len(self)} frames")
            number = self._numbers[number]
        if number not in self._places:
            raise IndexError(f"frame {number}: {self._span()}")
        return self._at(number, self._places[number])

    def _span(self) -> str:
        if not self._numbers:
            return f"{self.path} has no frames"
        return f"{self.path} has frames {self._numbers[0]} to {self._numbers[-1]}"

    def _at(self, number: int, time_ns: int) -> SceneFrame:
        if self._log is None:
            return SceneFrame(self, number, time_ns, None)
        found = next(self._log.frames(start_ns=time_ns, end_ns=time_ns + 1))
        return SceneFrame(self, number, time_ns, found)

    def __iter__(self) -> Iterator[SceneFrame]:
        if self._log is None:
            for number, time_ns in self._places.items():
                yield SceneFrame(self, number, time_ns, None)
            return
        for found in self._log.frames():
            yield SceneFrame(self, found.index, found.time_ns, found)

    def __reversed__(self) -> Iterator[SceneFrame]:
        for number in reversed(self._numbers):
            yield self[number]

    def at(self, seconds: float) -> SceneFrame:
        """The last frame at or before a time, in seconds from the recording's start.

        Raises:
            IndexError: there is none, or the time lies a second or more after the last frame.
        """
        time_ns = self.start_ns + round(seconds * NANOS)
        place = bisect_right(self._times, time_ns) - 1
        if place < 0 or time_ns - self._times[-1] >= NANOS:
            raise IndexError(f"{seconds} s: {self._span()}")
        return self[self._numbers[place]]

    def recorded_frame(self, number: int, time_ns: int) -> Frame:
        """What was recorded for a frame.

        Raises:
            RecordingError: the log does not hold it.
        """
        if self._scene is None:
            raise RecordingError("holds no recording, annotations alone", self.path)
        if self._reading is None or number != self._next:
            self._reading = self._scene.frames(time_ns, number)
        frame = next(self._reading, None)
        self._next = number + 1
        if frame is None or frame.time_ns != time_ns:
            self._next = -1
            raise RecordingError(f"holds no recording of frame {number}", self.path)
        return frame

    def membership(self, frame: AnnotatedFrame) -> Labels | None:
        """Which pixel belongs to whom in a frame, None where no tracker said so."""
        return None if self._log is None else self._log.membership(frame)

    @cached_property
    def graph(self) -> nx.MultiGraph:
        """The interaction graph over time: one edge per interval, see
        `reasoning.graph.over_time`.

        Raises:
            RecordingError: the log holds no tracks.
        """
        if self._log is None:
            raise RecordingError("holds no graph: it is a scene log", self.path)
        return interaction_graph(self._log)

    def sql(self, text: str, parameters: Any = ()) -> Rows:
        """Ask this log in SQL, see `query`."""
        return query(self._asked(), text, parameters)

    def ask(self, name: str, *words: str | float, **options: Any) -> Rows:
        """Ask this log a ready question, see `ask`."""
        return ask(self._asked(), name, *words, **options)

    def _asked(self) -> Case:
        from reasoning.questions import Case

        if self._case is None:
            self._case = Case([self.path], log_limits=self._limits)
        return self._case


def graph_of(what: OpenLog | SceneFrame | Graph) -> nx.MultiGraph:
    """The interaction graph as a networkx MultiGraph: of a frame, of a log over time, or of a
    message of the log's ``graph`` channel.

    Nodes, edges and attributes are the log's own, and the same in every export; attributes are
    numbers and words, so that every writer of networkx takes them.

    Raises:
        RecordingError: the log holds no graph, or none yet in this frame.
    """
    if isinstance(what, Graph):
        return to_networkx(what)
    found = what.graph
    if found is None:
        raise RecordingError("holds no graph up to this frame", what.path)
    return found


def _opened(kind: Any, path: Path, camera: str | None, limits: Limits) -> Any:
    """A reader of the log, or None where it holds nothing of that kind."""
    try:
        return kind(path, camera, limits)
    except RecordingError as error:
        if error.offset is not None or not path.is_file():
            raise
        return None
