"""What a batch goes through: the words of its command line become sources."""

from __future__ import annotations

import glob
import shlex
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from recorders.errors import UsageError
from recorders.stores import is_uri, open_store

PICTURES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff"})
SOURCES = frozenset(
    {
        ".avi", ".mp4", ".mkv", ".mov", ".webm", ".mpg", ".mpeg", ".m4v", ".ts", ".h264", ".dav",
        ".y4m", ".mcap", ".bag", ".db3", ".xml",
    }
)  # fmt: skip
"""What a folder is searched for. Other kinds (tables of detections) are named themselves."""
_BAG = "metadata.yaml"
_WANTED = "video, log, bag or folder of pictures"


class Sources(NamedTuple):
    """What words name.

    Attributes:
        found: absolute paths and URIs (a folder's URI ends in ``/``), each with options of its
            own.
        left_out: one line for each folder that could not be searched.
    """

    found: list[tuple[str, list[str]]]
    left_out: list[str]


def sources_of(words: Sequence[str]) -> Sources:
    """Sources, each once in the order of their names within a word, and options of their own.

    A word is a file, a folder, a glob, ``@list.txt`` or a URI (of a file, a glob or, ending in
    ``/``, a folder). A folder that holds pictures, or a bag, is one source; another is searched for
    videos, logs, bags and folders of pictures. Each line of a list is a word, with options
    behind it if it has its own: ``cam4/12.mp4 --camera cam4 --start 2026-01-31T12:00:00Z``.

    Raises:
        UsageError: a word names nothing.
    """
    search = _Search()
    found: dict[str, list[str]] = {}
    for word in words:
        for source, own in search.expanded(word, []):
            found.setdefault(source, own)
    return Sources(list(found.items()), search.left_out)


class _Search:
    """Finds sources; remembers what it could not look into."""

    def __init__(self) -> None:
        self.left_out: list[str] = []

    def expanded(self, word: str, own: list[str]) -> list[tuple[str, list[str]]]:
        if word.startswith("@"):
            return self._listed(Path(word[1:]))
        if is_uri(word):
            return [(uri, own) for uri in _remote(word)]
        path = Path(word)
        try:
            is_folder, is_there = path.is_dir(), path.exists()
        except OSError as error:  # a name that is too long
            raise UsageError(f"{word[:60]}: cannot be read: {error.strerror}") from error
        if is_folder:
            found = [(str(some.absolute()), own) for some in self._below(path)]
            if not found:
                why = "; ".join(self.left_out[-1:]) or (
                    "name files of other kinds themselves"
                )
                raise UsageError(f"{word}: holds no {_WANTED}; {why}")
            return found
        if is_there:
            return [(str(path.absolute()), own)]
        matches = sorted(glob.glob(word, recursive=True)) if glob.has_magic(word) else []  # noqa: PTH207
        if not matches:
            raise UsageError(f"{word}: no such file, folder or pattern that fits a file")
        return [pair for match in matches for pair in self.expanded(match, own)]

    def _listed(self, path: Path) -> list[tuple[str, list[str]]]:
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(
                f"@{path}: cannot be read as a list of sources: {error}"
            ) from error
        found = []
        for number, line in enumerate(lines, 1):
            try:
                words = shlex.split(line, comments=True)
            except ValueError as error:
                raise UsageError(f"{path}:{number}: {error}") from error
            if not words:
                continue
            name = words[0]
            if not is_uri(name) and not Path(name).is_absolute():
                name = str(path.parent / name)
            try:
                found += self.expanded(name, words[1:])
            except UsageError as error:
                raise UsageError(f"{path}:{number}: {error.headline}") from error
        return found

    def _below(self, folder: Path, above: frozenset[Path] = frozenset()) -> list[Path]:
        """The sources in a folder; a link back to a folder above is not followed."""
        here = folder.resolve()
        if here in above:
            return []
        try:
            held = sorted(p for p in folder.iterdir() if not p.name.startswith("."))
            files = {path for path in held if not path.is_dir()}
        except OSError as error:
            self.left_out.append(f"{folder}: cannot be read: {error.strerror}")
            return []
        if _is_one_source(path.name for path in files):
            return [folder]
        found = []
        for path in held:
            if path not in files:
                found += self._below(path, above | {here})
            elif path.suffix.lower() in SOURCES:
                found.append(path)
        return found


def _is_one_source(names: Iterable[str]) -> bool:
    """Whether a folder of such files is a source itself: a bag, or pictures without videos."""
    held = list(names)
    kinds = {PurePosixPath(name).suffix.lower() for name in held}
    return _BAG in held or (not kinds & SOURCES and bool(kinds & PICTURES))


def _remote(uri: str) -> list[str]:
    """The sources that a URI names; one call of the store, none where it names a file."""
    if not uri.endswith("/") and not glob.has_magic(uri):
        return [uri]
    base = uri
    while glob.has_magic(base):
        base = base.rpartition("/")[0]
    base = base.rstrip("/")
    wanted = uri[len(base) :].strip("/")
    keys = [key for key in open_store(base).keys("") if not _is_hidden(key)]
    fits = _fitting(keys, wanted) if wanted else [""]
    files = set(keys)
    found = {
        f"{base}/{key}"
        for fit in fits
        for key in ([fit] if fit in files else _below_keys(keys, fit))
    }
    if not found:
        raise UsageError(f"{uri}: holds no {_WANTED}")
    return sorted(found)


def _is_hidden(key: str) -> bool:
    return any(name.startswith(".") for name in key.split("/"))


def _fitting(keys: Sequence[str], pattern: str) -> list[str]:
    """The files and folders that fit a pattern, as a shell's would (``**``: any folders)."""
    names = set(keys)
    for key in keys:
        names |= {str(folder) for folder in PurePosixPath(key).parents}
    wanted = pattern.split("/")
    return sorted(name for name in names if name != "." and _fits(name.split("/"), wanted))


def _fits(names: Sequence[str], wanted: Sequence[str]) -> bool:
    if not wanted:
        return not names
    if wanted[0] == "**":
        return any(_fits(names[k:], wanted[1:]) for k in range(len(names) + 1))
    return bool(names) and fnmatchcase(names[0], wanted[0]) and _fits(names[1:], wanted[1:])


def _below_keys(keys: Sequence[str], folder: str) -> list[str]:
    """The sources below a folder of a store; those that are folders end in ``/``."""
    inside = f"{folder}/" if folder else ""
    held: dict[str, list[str]] = {}
    for key in keys:
        if key.startswith(inside):
            where, _, name = key.rpartition("/")
            held.setdefault(where, []).append(name)
    whole: list[str] = []
    found = []
    for where in sorted(held, key=lambda name: name.split("/")):
        start = f"{where}/" if where else ""
        if start.startswith(tuple(whole)):
            continue  # part of a folder that is a source itself
        if _is_one_source(held[where]):
            whole.append(start)
        else:
            found += [
                f"{start}{name}"
                for name in held[where]
                if PurePosixPath(name).suffix.lower() in SOURCES
            ]
    return [*found, *whole]
