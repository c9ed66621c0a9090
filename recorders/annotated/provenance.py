"""What an annotated log says of its own making: the metadata record `scenetrace`, written and
strictly read.

Everything that can change a result is in it: tracker, configuration in full, package versions,
OpenCV's build, Python, the input's digest. Each fact has a digest of its own beside it, so that
an edited one is named. (Who can write the file can write both: what holds against that is a
sealed manifest, see `replay.sealing`.)
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from recorders import channels
from recorders.annotated.checkpoint import PREFIX
from recorders.corrections import Corrections, parse_corrections
from recorders.errors import RecordingError, SourceError
from recorders.format_version import check_version
from recorders.log import Attachment, LogReader
from recorders.messages import Regions

METADATA = "scenetrace"
KIND = "annotated"
GOLDEN = "scenetrace.golden"
DIGESTS = "fact_digests"
CORRECTIONS = "corrections"
T = TypeVar("T")


def canonical(value: Any) -> str:
    """JSON with sorted keys, the same text for the same value."""
    return msgspec.json.encode(value, order="deterministic").decode()


def sha256(data: bytes) -> str:
    """SHA-256, hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def with_fact_digests(facts: Mapping[str, str]) -> dict[str, str]:
    """The facts with a digest of each beside them."""
    return {
        **facts,
        DIGESTS: canonical({name: sha256(facts[name].encode()) for name in sorted(facts)}),
    }


def extras(
    attachments: Iterable[Attachment], records: Iterable[tuple[str, Mapping[str, str]]]
) -> dict[str, str]:
    """What a log holds besides messages, checkpoints and its own facts: name to a SHA-256 over
    all of it.
    """
    parts: dict[str, list[str]] = {}
    for attachment in attachments:
        if not attachment.name.startswith(f"{PREFIX}/"):
            head = canonical(
                [attachment.media_type, attachment.log_time_ns, attachment.create_time_ns]
            ).encode()
            parts.setdefault(f"attachment {attachment.name}", []).append(
                sha256(head + attachment.data)
            )
    for name, values in records:
        if name != METADATA:
            parts.setdefault(f"metadata record {name}", []).append(
                sha256(canonical(values).encode())
            )
    return {
        name: sha256("".join(digests).encode()) for name, digests in sorted(parts.items())
    }


class AlteredFactsError(RecordingError):
    """What a log says of its own making is not what any replay writes.

    Attributes:
        fact: which one, empty for the record as a whole.
    """

    def __init__(self, reason: str, path: Path, fact: str = "") -> None:
        super().__init__(reason, path)
        self.fact = fact


@dataclass(frozen=True)
class Provenance:
    """The facts of one annotated log.

    Attributes:
        path: the log.
        values: as they are in the file.
        tracker, camera: names.
        tracker_version: of the code of a tracker that is not scenetrace's, else empty.
        configuration: section to parameter to value.
        packages: package to version.
        opencv_build: the build facts, by name.
        python, machine: interpreter and processor architecture, empty in logs that do not say.
        scene: the scene log's file name.
        input_digest: the input chain's link after ``input_frames`` frames.
        output_digest: the output chain's last link; ``link_before`` is the one before
            ``first_frame``.
        frames: how many annotated frames there are.
        annotations_only: the recorded messages were left out.
        from_ns, to_ns: the span that was asked for.
        checkpoint_ns: time between checkpoints, None without.
        checkpoints: name of each checkpoint to the SHA-256 of its bytes; None in logs that do not
            say.
        extras: what `extras` gives: the recording's own attachments and metadata; None in logs
            that do not say.
        regions: those that the replay was given in place of the recorded ones.
        corrections: a person's, that were applied to the tracks.
    """

    path: Path
    values: dict[str, str]
    tracker: str
    tracker_version: str
    camera: str
    configuration: dict[str, dict[str, Any]]
    packages: dict[str, str]
    opencv_build: dict[str, str]
    python: str
    machine: str
    scene: str
    input_digest: str
    input_frames: int
    output_digest: str
    link_before: str
    first_frame: int
    frames: int
    annotations_only: bool
    from_ns: int | None
    to_ns: int | None
    checkpoint_ns: int | None
    checkpoints: dict[str, str] | None
    extras: dict[str, str] | None
    regions: Regions | None = None
    corrections: Corrections | None = None

    @property
    def whole(self) -> bool:
        """The log holds the recording from its first message to its last."""
        return not self.annotations_only and self.from_ns is None and self.to_ns is None

    def altered(self) -> dict[str, tuple[str, str]]:
        """The facts that are not what was written: name to the digest then and now, empty for
        what is not there.
        """
        if DIGESTS not in self.values:
            # Every replay writes them: without, any fact may have been altered.
            return {DIGESTS: ("a record", "")}
        then = _json(self.path, self.values, DIGESTS, dict[str, str])
        now = {
            name: sha256(value.encode())
            for name, value in self.values.items()
            if name != DIGESTS
        }
        names = sorted({*now, *then})
        return {
            name: (then.get(name, ""), now.get(name, ""))
            for name in names
            if now.get(name) != then.get(name)
        }


def provenance_of(log: LogReader) -> Provenance:
    """What an annotated log says of itself.

    Raises:
        AlteredFactsError: a fact is missing or not readable, or the record is not there once;
            names it.
        RecordingError: it is not an annotated log, or one of another format.
    """
    found = [
        values
        for name, values in log.metadata()
        if name == METADATA and values.get("kind") == KIND
    ]
    if len(found) > 1:
        raise AlteredFactsError(
            f"{len(found)} metadata records {METADATA!r} say how it was made, there can be"
            " one: altered",
            log.path,
        )
    if found:
        return _parsed(log.path, found[0])
    if any(channels.split(channel.topic)[1] == "digest" for channel in log.channels):
        raise AlteredFactsError(
            f"the metadata record {METADATA!r}, which every replay writes, is not there:"
            " altered, or written by another program",
            log.path,
        )
    raise RecordingError(
        "not an annotated log (no metadata `scenetrace` of a replay); make one with"
        " `scenetrace replay`",
        log.path,
    )


def _parsed(path: Path, v: dict[str, str]) -> Provenance:
    check_version([(METADATA, {"format_version": "unknown", **v})], path)
    return Provenance(
        path=path,
        values=v,
        tracker=_text(path, v, "tracker"),
        tracker_version=v.get("tracker_version", ""),
        camera=_text(path, v, "camera"),
        configuration=_json(path, v, "configuration", dict[str, dict[str, Any]]),
        packages=_json(path, v, "packages", dict[str, str]),
        opencv_build=build_facts(v.get("opencv_build", "")),
        python=v.get("python", ""),
        machine=v.get("machine", ""),
        scene=_text(path, v, "scene"),
        input_digest=_text(path, v, "input_digest"),
        input_frames=_number(path, v, "input_frames"),
        output_digest=_text(path, v, "output_digest"),
        link_before=_text(path, v, "link_before"),
        first_frame=_number(path, v, "first_frame"),
        frames=_number(path, v, "frames"),
        annotations_only=_text(path, v, "annotations_only") == "true",
        from_ns=_optional(path, v, "from_ns"),
        to_ns=_optional(path, v, "to_ns"),
        checkpoint_ns=_optional(path, v, "checkpoint_ns"),
        checkpoints=(
            _json(path, v, "checkpoints", dict[str, str]) if "checkpoints" in v else None
        ),
        extras=_json(path, v, "extras", dict[str, str]) if "extras" in v else None,
        regions=_json(path, v, "regions", Regions) if "regions" in v else None,
        corrections=_corrections(path, v),
    )


def _corrections(path: Path, values: Mapping[str, str]) -> Corrections | None:
    """The file of corrections, whole as it was: its digest is the fact's."""
    if CORRECTIONS not in values:
        return None
    try:
        return parse_corrections(values[CORRECTIONS], path)
    except SourceError as error:
        raise AlteredFactsError(
            f"the metadata's {CORRECTIONS} cannot be read: {error.reason}: altered",
            path,
            CORRECTIONS,
        ) from error


def _text(path: Path, values: Mapping[str, str], name: str) -> str:
    if name not in values:
        raise AlteredFactsError(
            f"the metadata record lacks {name!r}: written by another program, or altered",
            path,
            name,
        )
    return values[name]


def _number(path: Path, values: Mapping[str, str], name: str) -> int:
    text = _text(path, values, name)
    # int() takes more than what we write, and texts of any length.
    if (
        len(text) > 20
        or not text.removeprefix("-").isascii()
        or not text.removeprefix("-").isdigit()
    ):
        raise AlteredFactsError(
            f"the metadata's {name} is {text[:40]!r}, not a number: altered", path, name
        )
    return int(text)


def _optional(path: Path, values: Mapping[str, str], name: str) -> int | None:
    return _number(path, values, name) if values.get(name) else None


def _json(path: Path, values: Mapping[str, str], name: str, kind: type[T]) -> T:
    try:
        return msgspec.json.decode(_text(path, values, name).encode(), type=kind)
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        raise AlteredFactsError(
            f"the metadata's {name} cannot be read: {error}: altered", path, name
        ) from error


def build_facts(text: str) -> dict[str, str]:
    """OpenCV's build facts by name, from the line in the metadata."""
    pairs = (part.partition(": ") for part in text.split("; ") if part)
    return {name: value for name, _, value in pairs}
