"""Where files of a fleet lie: a folder, or a place of an object store named by a URI.

A folder needs nothing further. A URI (``s3://``, ``gs://``, ``az://``, ``hdfs://``, ``sftp://`` ...)
is opened by fsspec, which needs the package of its kind (s3fs, gcsfs, adlfs, pyarrow, paramiko).
What is written appears whole or not at all, under its key.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar

from recorders.errors import SceneTraceError, UsageError

T = TypeVar("T")
_WHOLE = frozenset({"s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "memory"})
"""Kinds of store whose objects appear when they are complete."""
_PATIENCE_S = 120.0
_LONGEST_WAIT_S = 15.0
_PARTS = ".parts"
_FETCHERS = 8


def is_uri(word: str) -> bool:
    """Whether a word names a place of an object store.

    >>> is_uri("s3://unit/case"), is_uri("case/1")
    (True, False)
    """
    return re.match(r"[a-z][a-z0-9+.-]+://", word) is not None


def load_package(uri: str) -> None:
    """Import what opens a kind of store, so that processes forked from this one have it."""
    try:
        from fsspec import get_filesystem_class

        get_filesystem_class(uri.partition("://")[0])
    except (ImportError, ValueError):
        return  # told when it is opened


class StoreError(SceneTraceError):
    """A store cannot be read or written: which, which key, why."""


class NoSuchKeyError(StoreError):
    """A store has no such file."""


class Store(Protocol):
    """Files by key: names with slashes, relative to the store's root.

    Attributes:
        uri: the folder's path or the place's URI.
    """

    uri: str

    def exists(self, key: str) -> bool:
        """Whether a file is there, whole."""
        ...

    def keys(self, prefix: str) -> list[str]:
        """The keys of all files below a folder, sorted."""
        ...

    def read(self, key: str) -> bytes:
        """A file's bytes."""
        ...

    def read_many(self, keys: Iterable[str]) -> Iterator[bytes]:
        """Several files' bytes, in order."""
        ...

    def write(self, key: str, data: bytes) -> None:
        """Put bytes under a key, in place of what was there."""
        ...

    def put(self, path: Path, key: str) -> None:
        """Put a local file under a key; the file may be moved."""
        ...

    def fetch(self, key: str, path: Path) -> None:
        """Copy a file to a local path."""
        ...

    def delete(self, key: str) -> None:
        """Remove a file; one that is not there is no error."""
        ...

    def workplace(self) -> Path | None:
        """A folder for work from which `put` need not copy; None: any will do."""
        ...


class FolderStore:
    """A local (or mounted) folder.

    Attributes:
        folder: it.
        parts: where work goes on that is not whole yet.
    """

    def __init__(self, folder: Path) -> None:
        self.uri = str(folder)
        self.folder = folder
        self.parts = folder / _PARTS

    def exists(self, key: str) -> bool:
        """See `Store`."""
        return (self.folder / key).is_file()

    def keys(self, prefix: str) -> list[str]:
        """See `Store`."""
        found = []
        for root, folders, files in os.walk(self.folder / prefix):
            folders.sort()
            base = Path(root).relative_to(self.folder)
            found += [(base / name).as_posix() for name in files]
        return sorted(found)

    def read(self, key: str) -> bytes:
        """See `Store`."""
        try:
            return (self.folder / key).read_bytes()
        except OSError as error:
            raise StoreError(
                f"{self.folder / key}: cannot be read: {error.strerror}"
            ) from error

    def read_many(self, keys: Iterable[str]) -> Iterator[bytes]:
        """See `Store`."""
        return map(self.read, keys)

    def write(self, key: str, data: bytes) -> None:
        """See `Store`."""
        place = self.workplace() / f"{secrets.token_hex(8)}.part"
        try:
            place.write_bytes(data)
            self.put(place, key)
        finally:
            place.unlink(missing_ok=True)

    def put(self, path: Path, key: str) -> None:
        """See `Store`."""
        out = self.folder / key
        try:
            out.parent.mkdir(parents=True, exist_ok=True)
            if path.stat().st_dev != out.parent.stat().st_dev:
                place = self.workplace() / f"{secrets.token_hex(8)}.part"
                shutil.copyfile(path, place)
                path = place
            with path.open("rb+") as file:
                os.fsync(file.fileno())
            path.replace(out)
        except OSError as error:
            raise StoreError(f"{out}: cannot be written: {error.strerror}") from error

    def fetch(self, key: str, path: Path) -> None:
        """See `Store`."""
        try:
            shutil.copyfile(self.folder / key, path)
        except OSError as error:
            raise StoreError(
                f"{self.folder / key}: cannot be read: {error.strerror}"
            ) from error

    def delete(self, key: str) -> None:
        """See `Store`."""
        (self.folder / key).unlink(missing_ok=True)

    def workplace(self) -> Path:
        """See `Store`."""
        try:
            self.parts.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(
                f"{self.parts}: cannot be written: {error.strerror}"
            ) from error
        return self.parts


class RemoteStore:
    """A place of an object store, by fsspec; a store that cannot be reached is waited for, up to
    two minutes.
    """

    def __init__(self, uri: str, patience_s: float = _PATIENCE_S) -> None:
        self.uri = uri.rstrip("/")
        self._patience_s = patience_s
        try:
            from fsspec.core import url_to_fs
        except ImportError as error:
            raise UsageError(
                f"{uri}: object stores need fsspec: pip install 'scenetrace[s3]' (or gs, az,"
                " sftp)"
            ) from error
        kind = uri.partition("://")[0]
        try:
            self._files, root = url_to_fs(self.uri, use_listings_cache=False)
        except ImportError as error:
            raise UsageError(f"{uri}: {str(error).splitlines()[0]}") from error
        except ValueError as error:
            raise UsageError(
                f"{uri}: no kind of store that fsspec knows: {error}"
            ) from error
        self._root = str(root).rstrip("/")
        self._is_whole = kind in _WHOLE

    def _place(self, key: str) -> str:
        return f"{self._root}/{key}" if key else self._root

    def exists(self, key: str) -> bool:
        """See `Store`."""

        def there() -> bool:
            # fsspec's own `isfile` says no where the store cannot be reached, too.
            try:
                return bool(self._files.info(self._place(key))["type"] == "file")
            except FileNotFoundError:
                return False

        return self._patiently(key, there)

    def keys(self, prefix: str) -> list[str]:
        """See `Store`."""

        def listed() -> list[str]:
            try:
                return list(self._files.find(self._place(prefix)))
            except FileNotFoundError:
                return []

        cut = len(self._root) + 1
        return sorted(str(name)[cut:] for name in self._patiently(prefix, listed))

    def read(self, key: str) -> bytes:
        """See `Store`."""
        return bytes(self._patiently(key, lambda: self._files.cat_file(self._place(key))))

    def read_many(self, keys: Iterable[str]) -> Iterator[bytes]:
        """See `Store`."""
        places = [self._place(key) for key in keys]
        for start in range(0, len(places), 500):
            some = places[start : start + 500]
            found = self._patiently("", partial(self._files.cat, some))
            yield from (found[place] for place in some)

    def write(self, key: str, data: bytes) -> None:
        """See `Store`."""
        self._whole(key, lambda place: self._files.pipe_file(place, data))

    def put(self, path: Path, key: str) -> None:
        """See `Store`."""
        self._whole(key, lambda place: self._files.put_file(str(path), place))

    def _whole(self, key: str, send: Callable[[str], Any]) -> None:
        def sent() -> None:
            if self._is_whole:
                send(self._place(key))
                return
            part = f"{self._place(key)}.{secrets.token_hex(8)}.part"
            self._files.makedirs(part.rpartition("/")[0], exist_ok=True)
            send(part)
            self._files.mv(part, self._place(key))

        self._patiently(key, sent)

    def fetch(self, key: str, path: Path) -> None:
        """See `Store`."""
        self._patiently(key, lambda: self._files.get_file(self._place(key), str(path)))

    def delete(self, key: str) -> None:
        """See `Store`."""

        def gone() -> None:
            try:
                self._files.rm_file(self._place(key))
            except FileNotFoundError:
                return

        self._patiently(key, gone)

    def stamp(self, key: str) -> str:
        """What changes when a file does: its size, and its entity tag or time; of all files where
        the key is empty.
        """
        if key:
            return _stamp(self._patiently(key, lambda: self._files.info(self._place(key))))
        found = self._patiently("", lambda: self._files.find(self._root, detail=True))
        lines = [f"{name} {_stamp(facts)}\n" for name, facts in sorted(found.items())]
        return hashlib.sha256("".join(lines).encode()).hexdigest()[:32]

    def fetch_all(self, folder: Path) -> None:
        """Copy all files to a local folder, several at a time.

        Raises:
            StoreError: it cannot be read, or a file's name leads out of the folder.
        """
        keys = self.keys("")
        if not keys:
            raise NoSuchKeyError(f"{self.uri}/: there is no file in it")
        outside = next((key for key in keys if ".." in key.split("/")), None)
        if outside is not None:
            raise StoreError(f"{self.uri}/{outside}: its name leads out of the folder")
        for parent in {(folder / key).parent for key in keys}:
            parent.mkdir(parents=True, exist_ok=True)
        # brings logging with it, and most commands read no store
        from concurrent.futures import ThreadPoolExecutor

        with ThreadPoolExecutor(_FETCHERS) as pool:
            for _ in pool.map(lambda key: self.fetch(key, folder / key), keys):
                pass

    def workplace(self) -> Path | None:
        """See `Store`."""
        return None

    def _patiently(self, key: str, act: Callable[[], T]) -> T:
        """Do it, again and again while the store cannot be reached."""
        wait, waited = 0.5, 0.0
        while True:
            try:
                return act()
            except FileNotFoundError as error:
                raise NoSuchKeyError(f"{self.uri}/{key}: there is no such file") from error
            except PermissionError as error:
                raise StoreError(
                    f"{self.uri}/{key}: may not be touched: {error}"
                ) from error
            except Exception as error:  # every kind of store has errors of its own
                if "Credential" in type(error).__name__:
                    raise StoreError(f"{self.uri}: {error}") from error
                if waited >= self._patience_s:
                    text = (str(error) or type(error).__name__).splitlines()[0]
                    raise StoreError(
                        f"{self.uri}/{key}: cannot be reached for {waited:.0f} s: {text}"
                    ) from error
            time.sleep(wait)
            waited += wait
            wait = min(2 * wait, _LONGEST_WAIT_S)


def _stamp(facts: Mapping[str, Any]) -> str:
    names = ("ETag", "etag", "md5Hash", "content_md5", "mtime", "LastModified")
    told = next((facts[name] for name in names if facts.get(name)), "")
    return f"{facts.get('size')} {told}"


def open_store(place: str | Path, patience_s: float = _PATIENCE_S) -> Store:
    """The store of a path or URI.

    Raises:
        UsageError: no such kind of store, or its package is not installed.
    """
    if is_uri(str(place)):
        return RemoteStore(str(place), patience_s)
    return FolderStore(Path(place))
