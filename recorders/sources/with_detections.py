"""Pictures from one source with the detections of a file beside them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from recorders.formats.opening import BoxOptions
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.messages import Box, Detections
from recorders.pictures import Image
from recorders.sources.boxes import BoxFile, FrameRows
from recorders.sources.source import (
    NumberedSource,
    Source,
    SourceFrame,
    detections_of,
    pairs_of,
    spread,
)


def _named(pictures: Source) -> dict[str, int] | None:
    """The number of each picture, from 1, by its name."""
    if not isinstance(pictures, NumberedSource):
        return None
    numbers = pictures.numbers or range(1, len(pictures.names) + 1)
    return dict(zip(pictures.names, numbers, strict=True))


class WithDetections:
    """A source of pictures whose frame k has the detections of the file's k-th frame.

    Where pictures have numbers with gaps between, numbers decide: a picture has the detections of
    the frame of its own number, and a frame whose picture is missing is a frame without one.

    Args:
        pictures: the pictures.
        detections: the file of boxes.
        size: the picture size that the file was made for, its boxes are scaled from it; None: the
            pictures' own.
        options: what the file does not say of itself.
        limits: what a source may make us allocate.

    Raises:
        SourceError, UsageError, LimitError: as `BoxFile`; or most boxes lie beyond the pictures.
    """

    has_images = True
    has_detections = True

    def __init__(
        self,
        pictures: Source,
        detections: Path,
        size: tuple[int, int] | None = None,
        options: BoxOptions | None = None,
        limits: Limits = DEFAULT_LIMITS,
    ) -> None:
        self._pictures = pictures
        made_for = size or (pictures.width, pictures.height)
        options = replace(options or BoxOptions(), pictures=_named(pictures))
        self._file = BoxFile(detections, made_for, options, limits, pictures.frame_count)
        self.path = pictures.path
        self.name = f"{pictures.name} with {self._file.name}"
        self.stills = pictures.stills
        self.width, self.height = pictures.width, pictures.height
        self.frame_ns, self.frame_count = pictures.frame_ns, pictures.frame_count
        self.losses: list[str] = []
        self._numbers = pictures.numbers if isinstance(pictures, NumberedSource) else None
        self.notes = [*pictures.notes, *self._own_notes()]
        self._scale = self.width / made_for[0], self.height / made_for[1]
        what = f"pictures are {self.width}x{self.height}"
        if size is not None:
            what = f"size given is {size[0]}x{size[1]} and the {what}"
        self._file.check_inside(*made_for, what)

    def _own_notes(self) -> list[str]:
        found = self._file.notes()
        if self._numbers is not None:
            found.append(
                "the detections belong to the pictures of the same number, and times follow"
                " the numbers"
            )
        return found

    def _scaled(self, box: Box) -> Box:
        x, y, w, h = box
        across, down = self._scale
        return x * across, y * down, w * across, h * down

    def _detections(self, index: int, rows: FrameRows | None) -> Detections:
        if rows is None:
            return detections_of(index, self.width, self.height, [], [])
        boxes = [self._scaled(box) for box in rows.boxes]
        return detections_of(
            index, self.width, self.height, boxes, rows.scores, rows.labels
        )

    def _number(self, frame: SourceFrame) -> int:
        """The frame's number, from 1."""
        return frame.index + 1 if self._numbers is None else self._numbers[frame.index]

    def frames(self) -> Iterator[SourceFrame]:
        """All pictures, each with its detections, if only none."""
        self.losses.clear()
        self.notes[:] = [*self._pictures.notes, *self._own_notes()]
        rows = self._file.by_frame()
        ahead = next(rows, None)
        for frame in self._pictures.frames():
            number = self._number(frame)
            while ahead is not None and ahead.number < number:
                if self._numbers is not None:
                    yield self._without_picture(ahead)
                ahead = next(rows, None)
            mine = None
            if ahead is not None and ahead.number == number:
                mine, ahead = ahead, next(rows, None)
            if self._numbers is not None:
                frame.index = number - 1
                frame.time_ns = self._time_ns(number)
            frame.detections = self._detections(frame.index, mine)
            yield frame
        self._sum_up(ahead, rows)

    def given(self, count: int) -> Iterator[Detections]:
        """The detections of about so many frames spread evenly over the file, without their
        pictures; also of frames that have none.
        """
        rows = self._file.by_frame()
        ahead = next(rows, None)
        among = max(self.frame_count or 0, self._file.last_frame)
        for index in range(among):
            mine = None
            if ahead is not None and ahead.number == index + 1:
                mine, ahead = ahead, next(rows, None)
            if spread(index, count, among):
                yield self._detections(index, mine)

    def _time_ns(self, number: int) -> int:
        assert isinstance(self._pictures, NumberedSource)
        return self._pictures.time_ns(number - 1)

    def _without_picture(self, rows: FrameRows) -> SourceFrame:
        index = rows.number - 1
        return SourceFrame(
            index, self._time_ns(rows.number), detections=self._detections(index, rows)
        )

    def _sum_up(self, ahead: FrameRows | None, rest: Iterator[FrameRows]) -> None:
        count = first = 0
        while ahead is not None:
            first = first or ahead.number
            count += len(ahead.boxes)
            ahead = next(rest, None)
        self.notes[:] = [*self._pictures.notes, *self._own_notes()]
        self.losses += self._pictures.losses + self._file.losses()
        self.frame_count = self._pictures.frame_count
        if count:
            last = self.frame_count
            self.losses.append(
                f"{self._file.path.name}: {count} detections from frame {first} on come"
                f" after the last picture ({last} pictures) and were left out"
            )

    def sample(self, count: int) -> Iterator[Image]:
        """As the pictures' own source."""
        return self._pictures.sample(count)

    def pairs(self, count: int, apart: int) -> Iterator[tuple[Image, Image]]:
        """About ``count`` pictures spread over the source, each with the one ``apart`` later."""
        return pairs_of(self._pictures, count, apart)

    def digests(self) -> list[tuple[str, str]]:
        """Of the pictures, then of the detections' files."""
        return [*self._pictures.digests(), *self._file.digests()]
