"""Outputs where calls fail once, where a server of files loses its answers, where somebody puts
links in the way.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from recorders.errors import RecordingError, SceneTraceError, UsageError
from recorders.log import LogReader, LogWriter
from recorders.log.output import PartFile
from replay.export.output import whole_file, whole_folder


def once(call: Callable[..., Any], error: int) -> Callable[..., Any]:
    """The call, which fails the first time."""
    calls: list[int] = []

    def failing(*args: Any, **words: Any) -> Any:
        calls.append(0)
        if len(calls) == 1:
            raise OSError(error, os.strerror(error))
        return call(*args, **words)

    return failing


def after(call: Callable[..., Any], error: int) -> Callable[..., Any]:
    """The call, which does what it shall and says that it has failed, as a server of files does
    whose answer got lost.
    """

    def failing(*args: Any, **words: Any) -> Any:
        call(*args, **words)
        raise OSError(error, os.strerror(error))

    return failing


@pytest.mark.parametrize("call", ["fstat", "ftruncate", "write"])
def test_a_call_that_fails_once_leaves_no_part_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    place = f"recorders.log.output.os.{call}"
    monkeypatch.setattr(place, once(getattr(os, call), errno.EIO))
    with pytest.raises(RecordingError, match="cannot be written"):
        LogWriter(tmp_path / "log.mcap")
    assert list(tmp_path.iterdir()) == []


def test_a_call_that_fails_once_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = tmp_path / "a.txt.part"
    part.write_bytes(b"of an interrupted run")
    monkeypatch.setattr("recorders.log.output.os.ftruncate", once(os.ftruncate, errno.EIO))
    with pytest.raises(RecordingError, match="cannot be written"):
        PartFile(tmp_path / "a.txt", force=True)
    assert part.read_bytes() == b"of an interrupted run"


@pytest.mark.parametrize("error", [errno.EEXIST, errno.EIO])
@pytest.mark.parametrize("force", [False, True])
def test_a_rename_that_is_done_though_it_is_told_to_have_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: int, force: bool
) -> None:
    path = tmp_path / "log.mcap"
    monkeypatch.setattr("recorders.log.output.os.link", after(os.link, error))
    monkeypatch.setattr("pathlib.os.replace", after(os.replace, errno.ENOENT))
    with LogWriter(path, force=force) as log:
        log.write(log.channel("/a", None, "raw"), b"data", 0)
    with LogReader(path) as opened:
        assert opened.message_count == 1
    with whole_folder(tmp_path / "folder", None) as folder:
        (folder / "a").write_text("a")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["folder", "log.mcap"]
    assert (tmp_path / "folder" / "a").read_text() == "a"


@pytest.mark.parametrize("error", [errno.ESTALE, errno.EPERM, errno.EOPNOTSUPP])
def test_without_hard_links_outputs_are_renamed_and_nothing_is_written_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: int
) -> None:
    def refused(*_: object) -> None:
        raise OSError(error, os.strerror(error))

    monkeypatch.setattr("recorders.log.output.os.link", refused)
    path = tmp_path / "a.txt"
    with whole_file(path, force=False) as file:
        file.write(b"a")
    assert path.read_bytes() == b"a"
    with (
        pytest.raises(SceneTraceError, match="exists already"),
        whole_file(tmp_path / "b.txt", force=False),
    ):
        (tmp_path / "b.txt").write_text("of another")
    assert (tmp_path / "b.txt").read_text() == "of another"
    monkeypatch.setattr("pathlib.os.replace", refused)
    with (
        pytest.raises(RecordingError, match="cannot be written"),
        whole_file(tmp_path / "c.txt", force=False) as file,
    ):
        file.write(b"c")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.txt", "b.txt"]


def test_two_writers_of_one_folder(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with whole_folder(out, None) as folder:
        for force in (False, True):
            with (
                pytest.raises(RecordingError, match="another"),
                whole_folder(out, None, force=force),
            ):
                pass
        (folder / "a").write_text("a")
    assert (out / "a").read_text() == "a"
    assert list(tmp_path.iterdir()) == [out]


def test_a_folder_that_happens_to_be_called_so_is_kept(tmp_path: Path) -> None:
    own = tmp_path / "out.part"
    own.mkdir()
    (own / "precious").write_text("precious")
    with (
        pytest.raises(RecordingError, match="exists already"),
        whole_folder(tmp_path / "out", None),
    ):
        pass
    assert (own / "precious").read_text() == "precious"
    with whole_folder(tmp_path / "out", None, force=True) as folder:
        (folder / "a").write_text("a")
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["a"]


def test_a_link_put_in_the_way_while_files_are_moved_leads_nowhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    elsewhere.mkdir()
    (out / "inner").mkdir(parents=True)
    real, moved = os.replace, list[Any]()

    def racing(source: Any, to: Any, **words: Any) -> None:
        if not moved:  # all is checked; now somebody is quicker
            (out / "inner").rename(tmp_path / "was-inner")
            (out / "inner").symlink_to(elsewhere)
        moved.append(to)
        real(source, to, **words)

    monkeypatch.setattr("pathlib.os.replace", racing)
    with whole_folder(out, None, force=True) as folder:
        (folder / "inner").mkdir()
        (folder / "inner" / "a").write_text("a")
    assert moved
    assert list(elsewhere.iterdir()) == []
    assert (tmp_path / "was-inner" / "a").read_text() == "a"


def test_a_link_put_in_the_way_while_files_are_removed_leads_nowhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    for folder in (elsewhere, out / "inner"):
        folder.mkdir(parents=True)
        (folder / "old").write_text("old")
    real, removed = os.unlink, list[Any]()

    def racing(path: Any, **words: Any) -> None:
        if not removed:
            (out / "inner").rename(tmp_path / "was-inner")
            (out / "inner").symlink_to(elsewhere)
        removed.append(path)
        real(path, **words)

    with whole_folder(out, None, force=True, stale=["inner/old"]) as folder:
        (folder / "a").write_text("a")
        monkeypatch.setattr("pathlib.os.unlink", racing)
    assert removed
    assert (elsewhere / "old").read_text() == "old"


@pytest.mark.parametrize(
    "name", ["../precious", "inner/../../precious", "/precious", "", ".", "a\0b", "link/x"]
)
def test_what_is_stale_is_removed_below_the_folder_alone(tmp_path: Path, name: str) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    for folder in (out / "inner", elsewhere):
        folder.mkdir(parents=True)
    for file in (tmp_path / "precious", elsewhere / "x", out / "kept"):
        file.write_text("precious")
    (out / "link").symlink_to(elsewhere)
    if name == "/precious":
        name = str(tmp_path / "precious")
    with whole_folder(out, None, force=True, stale=[name]) as folder:
        (folder / "a").write_text("a")
    for file in (tmp_path / "precious", elsewhere / "x", out / "kept"):
        assert file.read_text() == "precious"


def test_a_folder_that_is_exchanged_while_it_is_written_is_told(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()

    def exchanged(folder: Path) -> None:
        folder.rename(tmp_path / "was")
        folder.symlink_to(elsewhere)

    with (
        pytest.raises(UsageError, match="something else was put in its place"),
        whole_folder(tmp_path / "out", None) as folder,
    ):
        exchanged(folder)
    assert not (tmp_path / "out").exists()
