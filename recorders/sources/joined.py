"""Several videos as one recording: chapters of a camera, hours of a recorder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from recorders.pictures import Image
from recorders.sources.source import Source, SourceFrame, fitted, spread
from recorders.sources.video import VideoSource


class JoinedVideos:
    """Videos one after the other, each following the one before by one frame time.

    Pictures of another size than the first video's are scaled to it, which is told.

    Args:
        videos: in the order in which they were taken, two or more.
    """

    has_images = True
    stills = False
    has_detections = False

    def __init__(self, videos: Sequence[VideoSource]) -> None:
        self._videos: list[Source] = list(videos)
        first = videos[0]
        self.path: Path = first.path
        self.name = f"{len(videos)} videos"
        self.width, self.height = first.width, first.height
        self.frame_ns = first.frame_ns
        counts = [video.frame_count for video in videos]
        self.frame_count: int | None = (
            None if None in counts else sum(count or 0 for count in counts)
        )
        self.notes = self._notes()
        self.losses: list[str] = []

    def _notes(self) -> list[str]:
        names = [video.path.name for video in self._videos]
        found = [
            f"{len(names)} videos are one recording ({names[0]} to {names[-1]}): each follows"
            " the one before by one frame time"
        ]
        for video in self._videos:
            found += [f"{video.path.name}: {note}" for note in video.notes]
        return found

    def frames(self) -> Iterator[SourceFrame]:
        """All frames in order."""
        self.losses.clear()
        index, start, now = 0, 0, 0
        for number, video in enumerate(self._videos):
            start = now + self.frame_ns if number else 0
            scaled = (video.width, video.height) != (self.width, self.height)
            for frame in video.frames():
                now = start + frame.time_ns
                yield SourceFrame(index, now, partial(self._picture, frame))
                index += 1
            self.losses += [f"{video.path.name}: {loss}" for loss in video.losses]
            if scaled:
                self.losses.append(
                    f"{video.path.name}: its pictures of {video.width}x{video.height} were"
                    f" scaled to {self.width}x{self.height}"
                )
        self.notes[:] = self._notes()
        self.frame_count = index

    def _picture(self, frame: SourceFrame) -> Image:
        image = frame.image
        assert image is not None, "every frame of a video has a picture"
        return fitted(image, self.width, self.height)

    def sample(self, count: int) -> Iterator[Image]:
        """About ``count`` pictures spread over all videos."""
        each = max(1, -(-count // len(self._videos)))
        among = each * len(self._videos)
        index = 0
        for video in self._videos:
            for image in video.sample(each):
                if spread(index, count, max(among, count)):
                    yield fitted(image, self.width, self.height)
                index += 1

    def digests(self) -> list[tuple[str, str]]:
        """SHA-256 of each video."""
        return [digest for video in self._videos for digest in video.digests()]
