"""Versions of installed packages, held against the library's."""

from __future__ import annotations

import sys
from importlib import metadata
from pathlib import Path

import pytest

from recorders import installed


@pytest.fixture(autouse=True)
def _forgotten() -> None:
    installed.version_of.cache_clear()
    installed._folders.cache_clear()


def test_every_package_has_the_version_that_the_library_tells() -> None:
    names = sorted({found.name for found in metadata.distributions()})
    assert "numpy" in names
    assert {name: installed.version_of(name) for name in names} == {
        name: metadata.version(name) for name in names
    }


def test_a_name_may_be_written_in_any_way() -> None:
    assert installed.version_of("OpenCV_Python.headless") == metadata.version(
        "opencv-python-headless"
    )


def test_what_is_not_installed_is_absent() -> None:
    assert installed.version_of("no-such-package") == installed.ABSENT


@pytest.mark.parametrize("header", [None, "Name: odd\n\nVersion: 9.9\n"])
def test_a_folder_that_does_not_say_is_asked_of_the_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, header: str | None
) -> None:
    folder = tmp_path / "odd-1.2.dist-info"
    folder.mkdir()
    if header is not None:
        (folder / "METADATA").write_text(header)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(metadata, "version", {"odd": "7.7"}.__getitem__)
    assert installed.version_of("odd") == "7.7"


def test_the_first_on_the_path_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for place, version in (("a", "1.0"), ("b", "2.0")):
        folder = tmp_path / place / f"odd-{version}.dist-info"
        folder.mkdir(parents=True)
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nVersion: {version}\n\n")
    paths = [str(tmp_path / "none"), str(tmp_path / "b"), str(tmp_path / "a")]
    monkeypatch.setattr(sys, "path", paths + sys.path)
    assert installed.version_of("odd") == "2.0"
