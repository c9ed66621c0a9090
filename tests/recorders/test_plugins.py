"""Somebody else's code by name: entry points of packages, and ``module:Class``."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from recorders import plugins
from recorders.errors import SceneTraceError, UsageError

CODE = "class Found:\n    pass\n\n\nclass Outer:\n    class Inner:\n        pass\n"


def install(folder: Path, name: str, version: str, entries: str, **modules: str) -> Path:
    """What `pip install` leaves behind: modules, and a folder that describes the package."""
    about = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
    )
    (about / "entry_points.txt").write_text(entries)
    for module, code in modules.items():
        (folder / f"{module}.py").write_text(code)
    return folder


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of packages, forgotten afterwards."""
    before = set(sys.modules)
    monkeypatch.syspath_prepend(tmp_path / "site")
    yield tmp_path / "site"
    for name in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


def test_an_entry_point_is_found_with_its_package(site: Path) -> None:
    install(
        site,
        "found-tools",
        "1.2",
        "[scenetrace.trackers]\nfound = plug_a:Found\n",
        plug_a=CODE,
    )
    assert "found" in plugins.names(plugins.TRACKERS)
    assert "found" not in plugins.names(plugins.DETECTORS)
    plugin = plugins.load(plugins.TRACKERS, "found")
    assert (plugin.name, plugin.value.__name__) == ("found", "Found")
    package, version, digest = plugin.version.split(" ")
    assert (package, version) == ("found-tools", "1.2")
    assert digest.startswith("sha256:")
    assert len(digest) == len("sha256:") + 64


def test_an_unknown_name_lists_what_there_is(site: Path) -> None:
    install(
        site,
        "found-tools",
        "1.2",
        "[scenetrace.trackers]\nfound = plug_b:Found\n",
        plug_b=CODE,
    )
    with pytest.raises(
        UsageError, match=r"unknown tracker 'fund'.*events, found.*module:Class"
    ):
        plugins.load(plugins.TRACKERS, "fund", ("events",))


def test_two_packages_of_one_name_are_told_apart_by_their_modules(site: Path) -> None:
    for package, module in (("one", "plug_one"), ("two", "plug_two")):
        entries = f"[scenetrace.trackers]\nfound = {module}:Found\n"
        install(site, package, "1", entries, **{module: CODE})
    with pytest.raises(UsageError, match="plug_one:Found, plug_two:Found"):
        plugins.load(plugins.TRACKERS, "found")
    assert plugins.load(plugins.TRACKERS, "plug_two:Found").value.__module__ == "plug_two"


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import not_there_at_all\n", "not_there_at_all"),
        ("1 / 0\n", "ZeroDivisionError"),
        ("def broken(:\n", "SyntaxError"),
    ],
)
def test_a_plug_in_that_cannot_be_imported_is_named(
    site: Path, code: str, said: str
) -> None:
    module = f"plug_bad_{len(code)}"
    entries = f"[scenetrace.trackers]\nbad = {module}:Found\n"
    install(site, "bad", "1", entries, **{module: code})
    for name in ("bad", f"{module}:Found"):
        with pytest.raises(SceneTraceError, match=f"{name}.*{said}") as told:
            plugins.load(plugins.TRACKERS, name)
        assert "\n" not in str(told.value)


def test_a_module_of_the_working_folder_is_found_where_it_was_asked_for_by_hand(
    tmp_path: Path, site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "plug_here.py").write_text(CODE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [p for p in sys.path if p not in ("", str(tmp_path))])
    with pytest.raises(UsageError, match="no module 'plug_here' among the installed"):
        plugins.load(plugins.TRACKERS, "plug_here:Found", beside=False)
    plugin = plugins.load(plugins.TRACKERS, "plug_here:Outer.Inner")
    assert plugin.name == "plug_here:Outer.Inner"
    with pytest.raises(UsageError, match="plug_here has no 'Nothing'"):
        plugins.load(plugins.TRACKERS, "plug_here:Nothing")


def test_addresses_lead_back() -> None:
    assert plugins.address_of(Path) == f"{Path.__module__}:Path"
    assert plugins.address_of(lambda: 0) is None
    assert plugins.address_of(partial(Path, "a")) is None

    class Inside:
        pass

    assert plugins.address_of(Inside) is None


def test_the_version_follows_the_source_of_the_whole_package(site: Path) -> None:
    def made(helper: str) -> str:
        package = site / "plug_package"
        (package / "deep").mkdir(parents=True, exist_ok=True)
        (package / "__init__.py").write_text("")
        (package / "main.py").write_text(CODE)
        (package / "deep" / "helper.py").write_text(helper)
        plugins._digest.cache_clear()
        return plugins.load(plugins.TRACKERS, "plug_package.main:Found").version

    first = made("SPEED = 1\n")
    assert first.startswith("sha256:")
    assert made("SPEED = 1\n") == first
    assert made("SPEED = 2\n") != first
