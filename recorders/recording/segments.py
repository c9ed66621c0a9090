"""The logs of a recording: one, or one for every so much time, each of which stands alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from recorders import channels
from recorders.errors import OutputExistsError
from recorders.log import LogWriter
from recorders.log.writer import FLUSH_INTERVAL_NS, LIVE_FLUSH_NS
from recorders.messages import Regions
from recorders.recording.options import RecordOptions
from recorders.recording.scene_writer import RecordSummary, SceneWriter
from recorders.recording.stages import Encoded, segment_of
from recorders.sources import Source


class CameraScene(Protocol):
    """One camera of a recording."""

    source: Source
    options: RecordOptions
    regions: Regions | None
    facts: dict[str, str]


class Logs:
    """Writes frames into the log whose time it is.

    With ``segment_ns`` the log ``scene.mcap`` becomes ``scene-0001.mcap``, ``scene-0002.mcap`` and
    so on: each begins with the regions, with a key frame where pictures are a video, and counts
    its frames from 0; log times go on.

    Args:
        out: the log's name.
        scenes: the cameras by name.
        options: of the recording.
        live: what is written is in the file at once.

    Attributes:
        log: the one being written.
        part: its name until it is complete.
        done: summaries of the logs that are complete, of each a list by camera.

    Raises:
        OutputExistsError: one of that name, or a segment of it, is there, and ``force`` is off.
    """

    def __init__(
        self,
        out: Path,
        scenes: Mapping[str, CameraScene],
        options: RecordOptions,
        *,
        live: bool,
    ) -> None:
        self._out = out
        self._scenes = scenes
        self._options = options
        self._live = live
        self._number = 0
        self.done: list[list[RecordSummary]] = []
        self._frames = 0
        if options.segment_ns is not None and not options.force:
            there = next(
                iter(sorted(out.parent.glob(f"{out.stem}-[0-9]*{out.suffix}"))), None
            )
            if there is not None:
                raise OutputExistsError(there)
        self._open()

    def _open(self) -> None:
        self.path = self._out
        if self._options.segment_ns is not None:
            name = f"{self._out.stem}-{len(self.done) + 1:04d}{self._out.suffix}"
            self.path = self._out.with_name(name)
        self.part = self.path.with_name(self.path.name + ".part")
        self.log = LogWriter(
            self.path,
            force=self._options.force,
            keep_part=True,
            picture_topics=[
                channels.topic(name, kind)
                for name in self._scenes
                for kind in channels.PICTURES
            ],
            flush_interval_ns=LIVE_FLUSH_NS if self._live else FLUSH_INTERVAL_NS,
            limits=self._options.limits,
        )
        self._writers = [
            SceneWriter(self.log, scene.source, scene.options, scene.regions, scene.facts)
            for scene in self._scenes.values()
        ]
        self._frames = 0

    def write(self, number: int, frame: Encoded) -> None:
        """Write a frame of the camera of that number; frames come in the order of their times."""
        now = segment_of(frame.time_ns, self._options.segment_ns)
        if now != self._number and self._frames:
            self._finish()
            self._open()
        self._number = now
        self._writers[number].write(frame)
        self._frames += 1

    def _finish(self) -> None:
        summaries = [writer.finish(self.path) for writer in self._writers]
        self.log.close()
        self.done.append(summaries)

    def finish(self) -> list[RecordSummary]:
        """Complete the last log; what the whole recording was, by camera."""
        self._finish()
        whole = []
        for parts in zip(*self.done, strict=True):
            last = parts[-1]
            whole.append(
                replace(
                    last,
                    path=self._out if len(parts) == 1 else parts[0].path,
                    frames=sum(part.frames for part in parts),
                    detections=sum(part.detections for part in parts),
                    duration_ns=last.end_ns - parts[0].begin_ns,
                    begin_ns=parts[0].begin_ns,
                    logs=tuple(part.path for part in parts),
                )
            )
        return whole
