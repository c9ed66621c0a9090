"""Many clips and pictures of one log at once: each recorded picture is decoded once and drawn on
once, however many clips it is in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recorders.annotated.reader import SCENE, AnnotatedFrame, AnnotatedLog
from recorders.channels import NANOS
from recorders.errors import RecordingError, UsageError
from recorders.payloads import PICTURES, payload_kind, read_picture
from recorders.payloads.pictures import RawPicture
from recorders.pictures import Image, encode_jpeg, encode_png
from recorders.scene import Frame, SceneLog
from recorders.scene_pictures import is_video
from replay.draw import DrawOptions, draw_frame
from replay.export.video import GROUND, Encoder, frame_overlay
from replay.hiding import Bystanders

JPEG_QUALITY = 90
PRESET = "superfast"
MOST_OPEN = 8
"""Clips that are written at one time: each holds some pictures in its encoder."""
_TOGETHER_NS = 2 * NANOS


@dataclass(frozen=True)
class Shot:
    """A clip to be written: H.264 in an MP4.

    Attributes:
        path: where.
        from_ns, to_ns: log times, the end excluded.
        subjects: who is marked; nobody else is.
        marked: False: the picture as it was recorded.
    """

    path: Path
    from_ns: int
    to_ns: int
    subjects: frozenset[int]
    marked: bool


@dataclass(frozen=True)
class ShotFile:
    """A picture to be written, as a Shot's; its suffix is chosen by what it holds.

    Attributes:
        path: where, without a suffix.
        time_ns: the frame's log time.
        subjects, marked: as of a `Shot`; not marked and nobody hidden: the recorded bytes
            themselves, where they are a picture's.
    """

    path: Path
    time_ns: int
    subjects: frozenset[int]
    marked: bool


class Camera:
    """Writes shots and stills of one camera of a log.

    Args:
        log: the annotated log.
        hide: everybody but the subjects is hidden.
        zone: time zone of the clock in marked pictures.
    """

    def __init__(self, log: AnnotatedLog, *, hide: bool = False, zone: str = "UTC") -> None:
        if log.size() is None and not log.has_pictures:
            raise UsageError(f"{log.path}: holds neither pictures nor their size")
        if hide and not log.has_pictures:
            raise UsageError(
                f"{log.path}: holds no pictures in which anybody could be hidden"
            )
        self._log = log
        self._zone = zone
        self._bystanders = Bystanders(log) if hide else None

    def write(
        self,
        shots: Sequence[Shot],
        stills: Sequence[ShotFile] = (),
        progress: Callable[[str, int], None] | None = None,
    ) -> dict[Path, Path]:
        """Write them all; answers where each still is, with its suffix.

        Raises:
            RecordingError: a shot has no frame, or the log is damaged.
        """
        placed: dict[Path, Path] = {}
        done = 0
        for number, some in enumerate(_batches(shots)):
            now = list(stills) if number == 0 else []
            done = self._pass(some, now, placed, progress, done)
        return placed

    def _pass(
        self,
        shots: Sequence[Shot],
        stills: Sequence[ShotFile],
        placed: dict[Path, Path],
        progress: Callable[[str, int], None] | None,
        done: int,
    ) -> int:
        at: dict[int, list[ShotFile]] = {}
        for still in stills:
            at.setdefault(still.time_ns, []).append(still)
        spans = [(s.from_ns, s.to_ns) for s in shots] + [(t, t + 1) for t in at]
        encoders: dict[Path, Encoder] = {}
        with ExitStack() as open_ones:
            for start, end in _merged(spans):
                for frame, recorded in self._frames(start, end):
                    view = _View(self, frame, recorded)
                    for shot in shots:
                        if shot.from_ns <= frame.time_ns < shot.to_ns:
                            _add(encoders, open_ones, shot, view)
                    for still in at.get(frame.time_ns, ()):
                        placed[still.path] = view.save(still)
                    done += 1
                    if progress is not None:
                        progress("drawing", done - 1)
            for shot in shots:
                if shot.path not in encoders:
                    raise RecordingError(
                        f"no frame from {shot.from_ns} to {shot.to_ns} ns to draw",
                        self._log.path,
                    )
                encoders[shot.path].finish()
        return done

    def _frames(
        self, start: int, end: int
    ) -> Iterator[tuple[AnnotatedFrame, Frame | None]]:
        """Annotated frames of a span, each with what was recorded at its time."""
        annotated = self._log.frames(SCENE, start, end)
        if not self._log.has_pictures:
            yield from ((frame, None) for frame in annotated)
            return
        with SceneLog(self._log.path, self._log.camera, self._log.limits) as scene:
            recorded = scene.frames(start, again=True)
            latest = next(recorded, None)
            for frame in annotated:
                while latest is not None and latest.time_ns < frame.time_ns:
                    latest = next(recorded, None)
                same = latest is not None and latest.time_ns == frame.time_ns
                yield frame, latest if same else None

    def picture(self, frame: AnnotatedFrame, recorded: Frame | None) -> Image:
        """The recorded picture, or a ground."""
        if self._log.has_pictures:
            return self._log.picture_of(recorded, frame.time_ns, frame.index)
        size = self._log.size()
        assert size is not None
        return np.full((size[1], size[0], 3), GROUND, np.uint8)

    def hidden(
        self, image: Image, recorded: Frame | None, subjects: frozenset[int]
    ) -> Image:
        """The picture without bystanders, where they are to be hidden."""
        if self._bystanders is None or recorded is None or recorded.image is None:
            return image
        return self._bystanders.hidden(image, recorded, subjects)

    def marked(
        self, image: Image, frame: AnnotatedFrame, subjects: frozenset[int]
    ) -> Image:
        """The picture with the subjects marked, and nobody else."""
        options = DrawOptions(
            scale=_enlarged(image.shape[1]), only=subjects, shells=False, groups=False,
            regions=False, gates=False, membership=False, details=False,
        )  # fmt: skip
        overlay = frame_overlay(self._log, frame, [], zone=self._zone)
        return draw_frame(image, overlay, options)

    @property
    def hides(self) -> bool:
        """Whether bystanders are hidden."""
        return self._bystanders is not None


class _View:
    """One frame, each way of showing it made once."""

    def __init__(
        self, camera: Camera, frame: AnnotatedFrame, recorded: Frame | None
    ) -> None:
        self._camera = camera
        self._frame = frame
        self._recorded = recorded
        self._made: dict[tuple[frozenset[int], bool], Image] = {}
        self.time_ns = frame.time_ns

    def image(self, subjects: frozenset[int], marked: bool) -> Image:
        """As it shall be shown."""
        key = subjects if marked or self._camera.hides else frozenset(), marked
        if key not in self._made:
            image = self._camera.picture(self._frame, self._recorded)
            image = self._camera.hidden(image, self._recorded, subjects)
            if marked:
                image = self._camera.marked(image, self._frame, subjects)
            self._made[key] = image
        return self._made[key]

    def save(self, still: ShotFile) -> Path:
        """Write a still; answers where."""
        suffix, data = ".png", b""
        if not (still.marked or self._camera.hides) and self._recorded is not None:
            suffix, data = _recorded_bytes(self._recorded)
        if not data:
            image = self.image(still.subjects, still.marked)
            suffix = ".jpg" if still.marked else ".png"
            data = encode_jpeg(image, JPEG_QUALITY) if still.marked else encode_png(image)
        path = still.path.with_name(still.path.name + suffix)
        path.write_bytes(data)
        return path


def _recorded_bytes(recorded: Frame) -> tuple[str, bytes]:
    """A recorded picture's own bytes and the suffix of their kind; empty where it is no JPEG or
    PNG by itself.
    """
    for message in recorded.messages:
        if is_video(message) or payload_kind(message.channel) not in PICTURES:
            continue
        if not message.topic.endswith("/image") or message.log_time_ns != recorded.time_ns:
            continue
        picture = read_picture(message.channel, message.data)
        data = b"" if isinstance(picture, RawPicture) else bytes(picture.data)
        if data.startswith(b"\xff\xd8"):
            return ".jpg", data
        if data.startswith(b"\x89PNG"):
            return ".png", data
    return ".png", b""


def _add(
    encoders: dict[Path, Encoder], open_ones: ExitStack, shot: Shot, view: _View
) -> None:
    image = view.image(shot.subjects, shot.marked)
    if shot.path not in encoders:
        made = Encoder(shot.path, image, view.time_ns, PRESET)
        open_ones.callback(made.close)
        encoders[shot.path] = made
    encoders[shot.path].add(image, view.time_ns)


def _batches(shots: Sequence[Shot]) -> list[list[Shot]]:
    """Shots in so many passes that no more than `MOST_OPEN` are open in one; one at least."""
    passes: list[list[Shot]] = [[]]
    for shot in sorted(shots, key=lambda s: (s.from_ns, s.to_ns, str(s.path))):
        for some in passes:
            if len(some) < MOST_OPEN:
                some.append(shot)
                break
        else:
            passes.append([shot])
    return passes


def _merged(spans: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Spans that meet, or nearly so, as one; in order."""
    out: list[tuple[int, int]] = []
    for start, end in sorted(spans):
        if out and start <= out[-1][1] + _TOGETHER_NS:
            out[-1] = out[-1][0], max(end, out[-1][1])
        else:
            out.append((start, end))
    return out


def _enlarged(width: int) -> float:
    """Letters need pixels: small pictures are made about 640 wide."""
    return max(1.0, round(2 * 640 / max(width, 1)) / 2)
