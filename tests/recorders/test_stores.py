"""Folders and object stores: whole or not at all, and patient."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from recorders.errors import UsageError
from recorders.stores import FolderStore, RemoteStore, Store, StoreError, open_store

fsspec = pytest.importorskip("fsspec")


@pytest.fixture(params=["folder", "file", "memory"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Store:
    """A store of each kind, empty."""
    place = {
        "folder": str(tmp_path / "s"),
        "file": f"file://{tmp_path}/s",
        "memory": f"memory://{tmp_path.name}",
    }[request.param]
    return open_store(place)


def test_what_is_written_is_read(store: Store, tmp_path: Path) -> None:
    store.write("a/b.json", b"1")
    (tmp_path / "local").write_bytes(b"2")
    store.put(tmp_path / "local", "a/c.json")
    assert store.keys("a") == ["a/b.json", "a/c.json"]
    assert list(store.read_many(["a/c.json", "a/b.json"])) == [b"2", b"1"]
    assert store.exists("a/b.json")
    store.fetch("a/b.json", tmp_path / "copy")
    assert (tmp_path / "copy").read_bytes() == b"1"
    store.delete("a/b.json")
    store.delete("a/b.json")
    assert store.keys("") == ["a/c.json"]


def test_what_is_not_there_is_named(store: Store) -> None:
    assert store.keys("nothing") == []
    assert not store.exists("nothing")
    with pytest.raises(StoreError, match="nothing"):
        store.read("nothing")


def test_a_folder_is_a_folder(tmp_path: Path) -> None:
    assert isinstance(open_store(tmp_path), FolderStore)
    with pytest.raises(UsageError, match="nosuch://"):
        open_store("nosuch://x")


def test_a_store_that_is_away_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: list[float] = []
    monkeypatch.setattr(time, "sleep", waits.append)
    store = RemoteStore(f"memory://{tmp_path.name}", patience_s=20.0)
    store.write("a", b"1")
    sound, left = store._files.cat_file, [3]

    def away(*args: object, **more: object) -> object:
        left[0] -= 1
        if left[0] >= 0:
            raise ConnectionError("no route")
        return sound(*args, **more)

    monkeypatch.setattr(store._files, "cat_file", away)
    assert store.read("a") == b"1"
    assert waits == [0.5, 1.0, 2.0]
    left[0] = 1000
    with pytest.raises(StoreError, match=r"cannot be reached.*no route"):
        store.read("a")
