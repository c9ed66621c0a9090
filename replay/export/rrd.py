"""A Rerun recording (``.rrd``): pictures, boxes with ids and classes, trails, edges, regions, events.

Written by ``rerun-sdk`` (the extra ``rerun``). Time lines: ``frame``, ``time`` (since the
recording's start) and ``capture_time``.
"""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

from msgspec import UNSET

from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.channels import NANOS
from recorders.messages import EVENT_LEVELS, Track
from replay.export.extras import needed
from replay.export.output import whole_file
from replay.export.pictures import StoredPicture, StoredPictures
from replay.image_annotations import label
from replay.palette import track_bgr

TRAIL_FRAMES = 50
_CODECS = {"h264": "H264", "hevc": "H265", "av1": "AV1"}
_YELLOW, _RED, _GREEN, _BLUE, _ORANGE = (
    (255, 217, 51),
    (255, 64, 51),
    (77, 230, 102),
    (77, 179, 255),
    (242, 153, 51),
)


def write_rrd(
    log: AnnotatedLog, out: str | Path, *, force: bool = False
) -> tuple[int, int]:
    """Write a recording that Rerun opens; returns how many frames it has, and how many pictures
    were left out because they are stored as no format that Rerun takes.

    Raises:
        OutputExistsError: ``out`` exists and ``force`` is not set.
        SceneTraceError: ``rerun-sdk`` is not installed.
    """
    rr = needed("rerun", "rerun-sdk", "rerun", "--to rrd")
    with whole_file(out, force=force) as file:
        # The same log gives the same recording's id: opened twice, it is there once.
        identity = f"{log.path.stem}-{log.facts.get('output_digest', '')[:16]}"
        recording = rr.RecordingStream("scenetrace", recording_id=identity)
        # Times of the export itself are of no use, and would make each one another file.
        recording.set_log_time_enabled(False)
        recording.set_log_tick_enabled(False)
        recording.save(str(file.part))
        scene = _RerunScene(rr, recording, log)
        pictures = StoredPictures(log)
        waiting = iter(pictures)
        picture = next(waiting, None)
        frames = early = 0
        for frame in log.frames(("events", "relations", "regions")):
            # Packets that the first picture needs have numbers of their own, too.
            early = early if frames else pictures.before(frame.time_ns)
            while picture is not None and picture.time_ns <= frame.time_ns:
                scene.picture(picture, frame.index - early)
                early = max(0, early - 1)
                picture = next(waiting, None)
            scene.frame(frame)
            frames += 1
        recording.flush()
        recording.disconnect()
        return frames, pictures.left_out + scene.left_out


class _RerunScene:
    """One camera as entities below its name."""

    def __init__(self, rr: Any, recording: Any, log: AnnotatedLog) -> None:
        self._rr, self._recording = rr, recording
        self._start_ns = log.start_ns
        self._root = log.camera
        self._trails: dict[int, deque[tuple[float, float]]] = {}
        self._classes: dict[str, int] = {}
        self._drawn_regions: Any = None
        self._codec = ""
        self.left_out = 0

    def _at(self, time_ns: int, frame: int) -> None:
        set_time = self._recording.set_time
        set_time("frame", sequence=frame)
        set_time("time", duration=(time_ns - self._start_ns) / NANOS)
        set_time("capture_time", timestamp=time_ns / NANOS)

    def _log(self, path: str, *parts: Any, static: bool = False) -> None:
        self._recording.log(f"{self._root}/{path}", *parts, static=static)

    def picture(self, picture: StoredPicture, frame: int) -> None:
        self._at(picture.time_ns, frame)
        rr = self._rr
        if not picture.is_video:
            image = rr.EncodedImage(
                contents=picture.data, media_type=f"image/{picture.kind}"
            )
            self._log("image", image)
        elif picture.kind in _CODECS:
            if picture.kind != self._codec:
                codec = getattr(rr.VideoCodec, _CODECS[picture.kind])
                self._log("image", rr.VideoStream(codec=codec), static=True)
                self._codec = picture.kind
            self._log("image", rr.VideoStream.from_fields(sample=picture.data))
        else:
            self.left_out += 1

    def frame(self, frame: AnnotatedFrame) -> None:
        self._at(frame.time_ns, frame.index)
        rr = self._rr
        present = [track for track in frame.tracks if track.present]
        self._log(
            "image/tracks",
            rr.Boxes2D(
                array=[track.box for track in present] or None,
                array_format=rr.Box2DFormat.XYWH if present else None,
                labels=[_words(track) for track in present],
                colors=[_rgb(track.id) for track in present],
                class_ids=[self._class(track) for track in present],
            )
            if present
            else rr.Clear(recursive=False),
        )
        self._trail(present)
        self._edges(frame, {track.id: _centre(track) for track in present})
        self._regions(frame)
        for event in frame.events:
            level = {"DEBUG": "DEBUG", "WARNING": "WARN"}.get(
                EVENT_LEVELS.get(event.kind, ""), "INFO"
            )
            self._log("events", rr.TextLog(event.text, level=level))

    def _class(self, track: Track) -> int:
        name = "" if track.label is UNSET else track.label
        if name not in self._classes:
            self._classes[name] = len(self._classes)
            known = [(k, n or "object") for n, k in self._classes.items()]
            context = self._rr.AnnotationContext(known)
            self._log("image", context, static=True)
        return self._classes[name]

    def _trail(self, present: list[Track]) -> None:
        for track in present:
            own = self._trails.setdefault(track.id, deque(maxlen=TRAIL_FRAMES))
            x, y, w, h = track.box
            own.append((x + w / 2, y + h))
        ids = {t.id for t in present}
        for gone in [trail for trail in self._trails if trail not in ids]:
            del self._trails[gone]
        lines = [list(self._trails[t.id]) for t in present if len(self._trails[t.id]) > 1]
        colors = [_rgb(t.id) for t in present if len(self._trails[t.id]) > 1]
        shown = self._rr.LineStrips2D(lines, colors=colors) if lines else self._nothing()
        self._log("image/trails", shown)

    def _nothing(self) -> Any:
        return self._rr.Clear(recursive=False)

    def _edges(
        self, frame: AnnotatedFrame, centres: dict[int, tuple[float, float]]
    ) -> None:
        edges = [
            relation
            for relation in frame.relations
            if relation.a in centres and relation.b in centres
        ]
        if not edges:
            self._log("image/relations", self._nothing())
            return
        self._log(
            "image/relations",
            self._rr.LineStrips2D(
                [[centres[edge.a], centres[edge.b]] for edge in edges],
                colors=[_RED if edge.state == "JOINT" else _YELLOW for edge in edges],
                radii=[2.0 if edge.state == "JOINT" else 0.75 for edge in edges],
                labels=[edge.state for edge in edges],
            ),
        )

    def _regions(self, frame: AnnotatedFrame) -> None:
        found = frame.regions
        if found is None or found == self._drawn_regions:
            return
        self._drawn_regions = found
        named = [("border", _ORANGE, polygon) for polygon in found.border]
        named += [("region of interest", _GREEN, polygon) for polygon in found.roi]
        named += [(zone.name, _BLUE, zone.polygon) for zone in found.zones]
        self._log(
            "image/regions",
            self._rr.LineStrips2D(
                [[*polygon, polygon[0]] for _, _, polygon in named],
                colors=[colour for _, colour, _ in named],
                labels=[name for name, _, _ in named],
            ),
        )


def _words(track: Track) -> str:
    kind = "" if track.label is UNSET else track.label
    return f"{label(track)} {kind}".rstrip()


def _rgb(identity: int) -> tuple[int, int, int]:
    blue, green, red = track_bgr(identity)
    return red, green, blue


def _centre(track: Track) -> tuple[float, float]:
    x, y, w, h = track.box
    return x + w / 2, y + h / 2
