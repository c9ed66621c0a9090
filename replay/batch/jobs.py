"""What a batch has to do: one job a source, known by the digest of its source and configuration."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath

import msgspec
from msgspec import Struct

from recorders.errors import SourceError
from recorders.files import sha256
from recorders.stores import RemoteStore, is_uri, open_store


class Limit(Struct, frozen=True):
    """What one job may take.

    Attributes:
        memory_mib: address space of its process; 0: as much as there is.
        seconds: time from start to end; 0: as long as it needs.
    """

    memory_mib: int = 4096
    seconds: float = 6 * 3600.0


class Job(Struct, frozen=True):
    """One source and what is done with it.

    Attributes:
        source: absolute path or URI.
        case: the case's folder or URI.
        record: words after ``record SOURCE -o FILE``.
        replay: words after ``replay SCENE -o FILE``.
        configuration: digest of those words, of the files that they name, and of scenetrace.
        keep: ``all``, ``annotated`` (no scene log), or ``tables`` (no logs).
        limit: what it may take.
        paths: folders with code of the user's own (trackers, detectors).
        again: do it although its status says that it failed.
    """

    source: str
    case: str
    record: list[str]
    replay: list[str]
    configuration: str
    keep: str = "all"
    limit: Limit = Limit()
    paths: list[str] = []
    again: bool = False


class Status(Struct, frozen=True):
    """How a job ended: ``status/<digest>.json``.

    Attributes:
        state: ``done`` or ``failed``.
        digest: of source and configuration.
        source: path or URI.
        stamp: what changes when the source does, cheap to read: size and time of change.
        configuration: as in `Job`.
        recordings: names in the tables.
        outputs: key in the case to SHA-256.
        frames: recorded.
        left_out: something was left out of it (exit code 3); ``said`` tells what.
        reason: why it failed, in one line.
        step: where: ``source``, ``record``, ``replay``, ``tables``, ``publish``.
        tries: how often it was tried.
        said: the messages of the commands.
    """

    state: str
    digest: str
    source: str
    stamp: str = ""
    configuration: str = ""
    recordings: list[str] = []
    outputs: dict[str, str] = {}
    frames: int = 0
    left_out: bool = False
    reason: str = ""
    step: str = ""
    tries: int = 1
    said: list[str] = []

    @property
    def key(self) -> str:
        """Where it lies in the case."""
        return f"status/{self.digest}.json"


class Outcome(Struct, frozen=True):
    """What a worker says of a job.

    Attributes:
        status: how it ended.
        known: it had been done before.
        again: trying again may help: the store or the worker failed, not the source.
        seconds: how long it took, by the worker's clock.
    """

    status: Status
    known: bool = False
    again: bool = False
    seconds: float = 0.0


def configuration_digest(words: Mapping[str, Sequence[str]], version: str) -> str:
    """Names a configuration: its words (a file's by its bytes) and the version that reads them."""
    plain = {name: list(some) for name, some in sorted(words.items())}
    return hashlib.sha256(msgspec.json.encode([plain, version])).hexdigest()


def digest_of(source: str, configuration: str) -> str:
    """A job's digest from that of its source."""
    return hashlib.sha256(f"{source} {configuration}".encode()).hexdigest()[:32]


def source_digest(path: Path) -> str:
    """SHA-256 of a file; of a folder, of its files' names and digests.

    Raises:
        SourceError: it cannot be read.
    """
    try:
        if path.is_file():
            return sha256(path)
        if path.exists() and not path.is_dir():
            raise SourceError(
                "neither a file nor a folder (a pipe, a device, a socket): save it as a"
                " file first",
                path,
            )
        if not path.is_dir():
            raise SourceError("no such file", path)
        found = hashlib.sha256()
        for file in sorted(p for p in path.rglob("*") if p.is_file()):
            found.update(f"{file.relative_to(path).as_posix()} {sha256(file)}\n".encode())
        return found.hexdigest()
    except FileNotFoundError:
        raise SourceError("no such file", path) from None
    except OSError as error:
        raise SourceError(f"cannot be read: {error.strerror}", path) from error


def stamp_of(source: str) -> str:
    """Size and time of change (or entity tag) of a source; empty where they cannot be told."""
    if is_uri(source):
        parent, name = split_uri(source)
        store = open_store(parent)
        return store.stamp(name) if isinstance(store, RemoteStore) else ""
    path = Path(source)
    try:
        files = (
            [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
        )
        facts = [(str(file), file.stat()) for file in files]
    except OSError:
        return ""
    text = "".join(f"{name} {f.st_size} {f.st_mtime_ns}\n" for name, f in facts)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def split_uri(source: str) -> tuple[str, str]:
    """A URI's place and key in it; the key of a folder is empty.

    >>> split_uri("s3://unit/cam4/12.mp4"), split_uri("s3://unit/pictures/")
    (('s3://unit/cam4', '12.mp4'), ('s3://unit/pictures', ''))
    """
    parent, _, name = source.rpartition("/")
    return parent, name


def filled(words: Sequence[str], source: str) -> list[str]:
    """Words with ``{stem}``, ``{name}``, ``{folder}`` (the folder's name) and ``{dir}`` (its
    path) of a source put in.

    >>> filled(["--camera", "{folder}"], "/data/cam4/12.mp4")
    ['--camera', 'cam4']
    """
    path = PurePosixPath(source.partition("://")[2] if is_uri(source) else source)
    parent = source.rstrip("/").rpartition("/")[0]
    places = {
        "{stem}": path.stem,
        "{name}": path.name,
        "{folder}": path.parent.name,
        "{dir}": parent,
    }
    out = []
    for word in words:
        for mark, value in places.items():
            word = word.replace(mark, value)  # noqa: PLW2901
        out.append(word)
    return out
