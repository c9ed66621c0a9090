"""The manifest: which files belong to a case, what they are, and the SHA-256 of each."""

from __future__ import annotations

import hashlib
import os
import re
import stat
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from recorders.annotated.provenance import METADATA
from recorders.errors import RecordingError, SceneTraceError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogReader
from replay.export.output import whole_file

FORMAT: Literal["scenetrace manifest"] = "scenetrace manifest"
VERSION: Literal[1] = 1
_MAGIC = b"\x89MCAP0\r\n"
_BLOCK = 1 << 20
_MOST_OF_A_KEY = 64 << 10
_PRIVATE = re.compile(rb"-----BEGIN ([A-Z]+ )?PRIVATE KEY-----")
_MOST_BYTES = 64 << 20
_RECORDING = "scenetrace.recording"
MOST_ADDED = 1000
"""Entries of a sealed folder, besides what was sealed in it, that are looked at."""
Role = Literal["source", "scene", "annotated", "file"]
Hex64 = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]


class Entry(Struct, frozen=True, forbid_unknown_fields=True):
    """One file.

    Attributes:
        name: its path relative to the manifest's folder, with ``/``.
        role: ``annotated``: a replay's log, ``scene``: a scene log, ``source``: what a scene log
            here was recorded from, ``file``: anything else (an exported answer, a report).
        bytes: its size.
        sha256: of its bytes.
        facts: what a log says of itself: tracker, input and output digest, source digest.
    """

    name: Annotated[str, Meta(min_length=1)]
    role: Role
    bytes: Annotated[int, Meta(ge=0)]
    sha256: Hex64
    facts: dict[str, str] = {}


class Signature(Struct, frozen=True, forbid_unknown_fields=True):
    """A signature over the manifest's canonical bytes; key and signature in hexadecimal."""

    algorithm: Literal["Ed25519"]
    public_key: Hex64
    signature: Annotated[str, Meta(pattern="^[0-9a-f]{128}$")]


class Manifest(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The files by name, and who vouches for them.

    Attributes:
        folders: those that were sealed as a whole, relative like the files: what else is in them
            was added later.
        examiner, date: who sealed it and when, as they were given; no clock is asked.
        tool: what sealed it, with its version.
    """

    format: Literal["scenetrace manifest"]
    version: Literal[1]
    files: list[Entry]
    note: str = ""
    folders: list[str] = []
    signature: Signature | None = None
    examiner: str = ""
    date: str = ""
    tool: str = ""

    def canonical(self) -> bytes:
        """What is signed: everything but the signature, JSON with sorted keys and no white space."""
        return msgspec.json.encode(
            msgspec.structs.replace(self, signature=None), order="sorted"
        )

    def encode(self) -> bytes:
        """The file's bytes: sorted keys, two spaces, a line break at the end."""
        return (
            msgspec.json.format(msgspec.json.encode(self, order="sorted"), indent=2) + b"\n"
        )


def seal(
    paths: Iterable[str | Path],
    out: str | Path,
    *,
    note: str = "",
    examiner: str = "",
    date: str = "",
    limits: Limits = DEFAULT_LIMITS,
) -> Manifest:
    """The manifest of a case's files, to be written to ``out``; folders stand for all files in
    them.

    A link to a file is sealed under its own name by what it leads to. Of a folder in which the
    manifest will be, the manifest is left out, and so are others beside it (`manifests_beside`):
    each can be written again without a word from the others. Who names one seals it.

    Args:
        paths: source, scene log, annotated logs, exported answers: whatever belongs to the case.
        out: where the manifest will be: names are relative to its folder.
        note: a text that is sealed with the files.
        examiner: who seals it.
        date: when, as a text.
        limits: what a log may ask for.

    Raises:
        UsageError: no files, one that is not there, or the manifest among them; a folder holds
            what is no file: a link to a folder or to nothing, whose content would be left out.
        RecordingError: a log is damaged: it is not sealed as if it were whole; a pipe or a device.
    """
    out = Path(out)
    given = [Path(path) for path in paths]
    files = sorted(_files(given, out))
    if not files:
        raise UsageError("nothing to seal: give the case's files")
    for file in files:
        if file.resolve() == out.resolve():
            raise UsageError(f"{file}: the manifest cannot seal itself")
    folder = out.parent.resolve()
    entries = {
        _relative(file, folder): _entry(file, _relative(file, folder), limits)
        for file in files
    }
    known = {digest for entry, digests in entries.values() for digest in digests}
    made = [
        (
            msgspec.structs.replace(entry, role="source")
            if entry.role == "file" and entry.sha256 in known
            else entry
        )
        for entry, _ in entries.values()
    ]
    folders = sorted({_relative(p.resolve(), folder) for p in given if p.is_dir()})
    return Manifest(
        FORMAT,
        VERSION,
        sorted(made, key=lambda e: e.name),
        note,
        folders,
        examiner=examiner,
        date=date,
        tool=f"scenetrace {version('scenetrace')}",
    )


def added_files(manifest: Manifest, path: str | Path) -> list[str]:
    """Files in the folders that were sealed as a whole that the manifest at ``path`` does not
    list, by name.

    A manifest is untrusted: folders in which nothing that it lists lies are not looked into, and
    a folder that has grown by more than `MOST_ADDED` entries is not listed to its end.

    Raises:
        RecordingError: a folder cannot be one.
    """
    path = Path(path)
    listed = {entry.name for entry in manifest.files}
    here = path.parent.resolve()
    found = {}
    for folder in manifest.folders:
        if folder != "." and not any(name.startswith(f"{folder}/") for name in listed):
            continue
        try:
            for file in _inside(path.parent / folder, 2 * len(listed) + MOST_ADDED):
                found[_relative(file, here)] = file
        except (OSError, ValueError) as error:
            raise RecordingError(
                f"lists a folder that cannot be looked into: {folder[:80]!r}", path
            ) from error
    new = found.keys() - listed - {path.name}
    return sorted(name for name in new if "/" in name or not _is_manifest(found[name]))


def manifests_beside(paths: Iterable[str | Path], out: str | Path) -> list[Path]:
    """Other manifests where ``out`` will be that `seal` leaves out: their folder was given, and
    they were not.
    """
    out = Path(out)
    here, given = out.parent.resolve(), [Path(path) for path in paths]
    named = {_own(path) for path in given}
    if not any(path.is_dir() and here.is_relative_to(path.resolve()) for path in given):
        return []
    return sorted(
        p
        for p in out.parent.iterdir()
        if _own(p) not in {*named, _own(out)} and _is_manifest(p)
    )


def write_manifest(manifest: Manifest, out: str | Path, *, force: bool = False) -> None:
    """Write it, whole or not at all.

    Raises:
        OutputExistsError: it exists and ``force`` is not set.
    """
    with whole_file(out, force=force) as file:
        file.write(manifest.encode())


def private_keys(manifest: Manifest, folder: Path) -> list[str]:
    """The files of a manifest that are private keys in PEM: they do not belong into a case."""
    small = [
        entry.name
        for entry in manifest.files
        if entry.role == "file" and entry.bytes <= _MOST_OF_A_KEY
    ]
    return [name for name in small if _PRIVATE.search((folder / name).read_bytes())]


def read_manifest(path: str | Path) -> Manifest:
    """Read a manifest.

    Raises:
        RecordingError: it is none.
    """
    path = Path(path)
    if path.is_dir():
        raise RecordingError(
            f"a folder; give the manifest in it, like {path / 'manifest.json'}", path
        )
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise RecordingError(f"over {_MOST_BYTES} bytes: not a manifest", path)
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"cannot be read: {error.strerror}", path) from error
    try:
        found = msgspec.json.decode(data, type=Manifest)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        raise RecordingError(
            f"not a manifest of `scenetrace seal`: {error}", path
        ) from error
    names = [entry.name for entry in found.files]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise RecordingError(f"lists {twice!r} twice: altered", path)
    return found


def file_digest(path: Path) -> tuple[int, str]:
    """Size and SHA-256 of a regular file's bytes, read in blocks.

    Raises:
        RecordingError: it cannot be read, or is a device, a pipe, a folder.
    """
    digest = hashlib.sha256()
    size = 0
    try:
        # Without O_NONBLOCK a pipe in a file's place would make us wait for ever.
        descriptor = os.open(
            path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        )
        with os.fdopen(descriptor, "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise RecordingError("not a regular file", path)
            while block := file.read(_BLOCK):
                digest.update(block)
                size += len(block)
    except OSError as error:
        raise RecordingError(f"cannot be read: {error.strerror}", path) from error
    return size, digest.hexdigest()


def _inside(folder: Path, most: int | None = None) -> Iterator[Path]:
    """What is below a folder and no folder itself, of its first ``most`` entries: one walk to
    seal and to check.

    Links are not followed: one to a folder is a thing of its own.
    """
    return (
        file
        for file in islice(folder.rglob("*"), most)
        if file.is_symlink() or not file.is_dir()
    )


def _files(paths: Iterable[Path], out: Path) -> Iterator[Path]:
    manifest = _own(out)
    for path in paths:
        if path.is_dir():
            for file in sorted(_inside(path)):
                own = _own(file)
                if own == manifest or (
                    own.parent == manifest.parent and _is_manifest(file)
                ):
                    continue
                if file.is_symlink() and not file.is_file():
                    folder = "a folder: take it away and give that folder itself"
                    raise UsageError(
                        f"{file}: a link to"
                        f" {folder if file.is_dir() else 'nothing: take it away'}"
                    )
                yield file
        elif path.exists():
            yield path
        else:
            raise UsageError(f"{path}: is not there")


def _is_manifest(file: Path) -> bool:
    """Whether a file is a manifest, by the whole of its content."""
    if file.is_symlink() or not file.is_file():
        return False
    try:
        with file.open("rb") as f:
            if not f.read(64).lstrip().startswith(b"{"):
                return False
        read_manifest(file)
    except (OSError, RecordingError):
        return False
    return True


def _own(path: Path) -> Path:
    """The absolute path of a file or link itself: only its folder's links are resolved."""
    return path.parent.resolve() / path.name


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(_own(path), folder)).as_posix()


def _entry(file: Path, name: str, limits: Limits) -> tuple[Entry, Sequence[str]]:
    """A file's entry, and the digests of the sources that it names."""
    size, digest = file_digest(file)
    role, facts, sources = _log_facts(file, limits)
    return Entry(name, role, size, digest, facts), sources


def _log_facts(file: Path, limits: Limits) -> tuple[Role, dict[str, str], Sequence[str]]:
    with file.open("rb") as f:
        if f.read(len(_MAGIC)) != _MAGIC:
            return "file", {}, ()
    try:
        with LogReader(file, limits) as log:
            records = dict(log.metadata())
            lists = [
                attachment.data
                for attachment in log.attachments()
                if attachment.media_type == "text/plain"
            ]
    except SceneTraceError as error:
        raise RecordingError(
            f"a damaged log is not sealed (see `scenetrace doctor`): {error}", file
        ) from error
    own = records.get(METADATA, {})
    recording = records.get(_RECORDING, own)
    names = (
        ("tracker", "input_digest", "output_digest", "scene")
        if own.get("kind") == "annotated"
        else ()
    )
    facts = {name: own[name] for name in names if name in own}
    facts |= {
        name: recording[name] for name in ("source", "source_digest") if name in recording
    }
    role: Role = (
        "annotated" if own.get("kind") == "annotated" else "scene" if own else "file"
    )
    return (
        role,
        facts,
        [
            line[:64]
            for data in lists
            for line in data.decode("utf-8", "replace").splitlines()
        ],
    )
