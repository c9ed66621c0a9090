"""The scene log: frames, and what the log says of itself."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from recorders import channels
from recorders.errors import SourceError
from recorders.format_version import FORMAT_VERSION
from recorders.installed import version_of
from recorders.log import LogWriter
from recorders.machine import machine, opencv_build, python_version
from recorders.message_checks import check_detections
from recorders.messages import Detections, Regions, SceneChange
from recorders.names import utf8
from recorders.parameters import as_plain
from recorders.quality import QUALITY
from recorders.recording.options import RecordOptions
from recorders.recording.stages import Encoded
from recorders.sources import Source

METADATA = "scenetrace"
METADATA_AT_START = "scenetrace.started"
DIGESTS_ATTACHMENT = "source.sha256"
OWN_RECORDS = frozenset(
    {METADATA, METADATA_AT_START, DIGESTS_ATTACHMENT, "scenetrace.recording"}
)
"""Attachments and metadata records that say how a log of ours came about."""
_PACKAGES = ("av", "numpy", "opencv-python-headless", "scenetrace")


@dataclass(frozen=True)
class RecordSummary:
    """What was recorded.

    Attributes:
        path: the log.
        frames, detections: how many.
        width, height: of the pictures, in pixels.
        duration_ns: from the first frame to the last.
        detect, codec: as decided, ``none`` where there is nothing.
        source_digest: SHA-256 of the source's file, or of its files' list of digests.
        notes: what had to be assumed.
        losses: what had to be left out; a caller should not pass over it.
        begin_ns, end_ns: times of the first and the last frame since the source's first.
        logs: the logs, where there are several.
    """

    path: Path
    frames: int
    detections: int
    width: int
    height: int
    duration_ns: int
    detect: str
    codec: str
    source_digest: str
    notes: tuple[str, ...]
    losses: tuple[str, ...]
    begin_ns: int = 0
    end_ns: int = 0
    logs: tuple[Path, ...] = ()


class SceneWriter:
    """Writes frames and what the log says of itself."""

    def __init__(
        self,
        log: LogWriter,
        source: Source,
        options: RecordOptions,
        regions: Regions | None,
        detector: Mapping[str, str] | None = None,
    ) -> None:
        self._log = log
        self._source = source
        self._options = options
        self._regions = regions
        self._start_ns = options.start_ns or 0
        self._channels: dict[str, int] = {}
        self.frames = 0
        self._detections = 0
        self._first_ns = self._last_ns = self._first_number = 0
        self._facts = _known_at_start(source, options)
        self._told = {} if detector is None else detector
        found = dict(self._told)
        quality = found.pop(QUALITY, None)
        if quality is not None:
            self._facts[QUALITY] = quality
        if found:
            self._facts["detector"] = _json(found)

    def _put(self, name: str, data: bytes, now: int, schema: str | None = None) -> None:
        if name not in self._channels:
            topic = channels.topic(self._options.camera, name)
            kind = schema or name
            self._channels[name] = self._log.channel(
                topic, channels.schema(kind), channels.message_encoding(kind), {}
            )
        self._log.write(self._channels[name], data, now)

    def _begin(self, now: int) -> None:
        # An interrupted recording has this much to say of itself.
        self._log.metadata(METADATA_AT_START, self._facts)
        if self._regions is not None:
            self._put("regions", channels.encode("regions", self._regions), now)

    def write(self, frame: Encoded) -> None:
        """Write one frame: regions before the first, then picture, mask, detections."""
        now = self._start_ns + frame.time_ns
        self._check(frame.detections)
        camera = self._options.camera
        if not self.frames:
            self._first_ns = frame.time_ns
            if self._options.segment_ns is not None:
                self._first_number = frame.detections.frame
                self._facts["start_ns"] = str(now)
            self._begin(now)
        if frame.picture is not None:
            data, kind = frame.picture
            picture = channels.compressed_image(data, kind, now, camera)
            self._put("image", picture, now, "video" if kind == "h264" else None)
        if frame.mask is not None:
            self._put(
                "foreground", channels.compressed_image(frame.mask, "png", now, camera), now
            )
        detections, changes = frame.detections, frame.changes
        if self._first_number:  # each of several logs counts its frames from 0
            number = detections.frame - self._first_number
            detections = msgspec.structs.replace(detections, frame=number)
            changes = tuple(_counted_from(self._first_number, c) for c in changes)
        for change in changes:
            self._put("changes", channels.encode("changes", change), now)
        self._put("detections", channels.encode("detections", detections), now)
        self.frames += 1
        self._detections += len(frame.detections.boxes)
        self._last_ns = frame.time_ns

    def _check(self, detections: Detections) -> None:
        """Never record what no replay would take."""
        try:
            check_detections(detections, self._options.limits)
        except ValueError as error:
            raise SourceError(str(error), self._source.path) from error

    def finish(self, out: Path) -> RecordSummary:
        """Write what the log says of itself."""
        source, options = self._source, self._options
        digests = source.digests()
        listing = "".join(f"{digest}  {utf8(name)}\n" for name, digest in digests)
        digest = (
            digests[0][1]
            if len(digests) == 1
            else hashlib.sha256(listing.encode()).hexdigest()
        )
        if QUALITY in self._told:
            self._facts[QUALITY] = self._told[QUALITY]
        facts = {
            **self._facts,
            "source_digest": f"sha256:{digest}",
            "source_files": str(len(digests)),
            "frames": str(self.frames),
            "notes": _json([utf8(note) for note in source.notes]),
            "losses": _json([utf8(loss) for loss in source.losses]),
        }
        self._log.attach(DIGESTS_ATTACHMENT, "text/plain", listing.encode(), self._start_ns)
        self._log.metadata(METADATA, facts)
        return RecordSummary(
            path=out,
            frames=self.frames,
            detections=self._detections,
            width=source.width,
            height=source.height,
            duration_ns=self._last_ns - self._first_ns,
            detect=str(options.detect),
            codec=self._facts["codec"],
            source_digest=digest,
            notes=tuple(source.notes),
            losses=tuple(source.losses),
            begin_ns=self._first_ns,
            end_ns=self._last_ns,
            logs=(out,),
        )


def _known_at_start(source: Source, options: RecordOptions) -> dict[str, str]:
    codec = options.codec or (
        "none" if not source.has_images else "as is" if source.stills else "jpeg"
    )
    return {
        "format_version": FORMAT_VERSION,
        "kind": "scene",
        "camera": options.camera,
        "configuration": _json(as_plain(options.config)),
        "packages": _json({name: version_of(name) for name in _PACKAGES}),
        "python": python_version(),
        "machine": machine(),
        "opencv_build": opencv_build(),
        "source": utf8(source.path.name),
        "source_kind": source.name,
        "width": str(source.width),
        "height": str(source.height),
        "frame_ns": str(source.frame_ns),
        "start_ns": str(options.start_ns or 0),
        "codec": codec,
        "detect": str(options.detect),
    }


def _counted_from(first: int, change: SceneChange) -> SceneChange:
    """A change in a log whose frames count from another one's number on."""
    evidence = dict(change.evidence)
    if "since_frame" in evidence:
        evidence["since_frame"] = max(0, evidence["since_frame"] - first)
    return msgspec.structs.replace(change, frame=change.frame - first, evidence=evidence)


def _json(value: object) -> str:
    return msgspec.json.encode(value, order="deterministic").decode()
