"""The module `scenetrace`: light, complete, typed, and at home beside other people's folders."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import scenetrace
from fixtures.logs import write_scene_log
from fixtures.scenes import generate

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("recorders", "reasoning", "replay", "fixtures")


def python(
    *words: str, folder: Path = ROOT, path: tuple[Path, ...] = ()
) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (*path, ROOT)))},
    )
    return done.returncode, done.stdout + done.stderr


def test_importing_it_is_quick_and_imports_nothing_heavy() -> None:
    code = (
        "import sys; before = set(sys.modules); import scenetrace;"
        "print(*sorted(set(sys.modules) - before))"
    )
    status, said = python("-c", code)
    assert status == 0, said
    new = set(said.split())
    assert not new & {"cv2", "numpy", "msgspec", "networkx", "duckdb", "typing", *ROOMS}
    times = []
    for _ in range(4):  # the first one compiles it; a busy machine slows some down
        _, lines = python("-X", "importtime", "-c", "import scenetrace")
        last = lines.strip().splitlines()[-1]
        assert "scenetrace" in last
        times.append(int(last.split("|")[1]))
    assert min(times) < 50_000, times


def test_every_public_name_is_there_and_typed() -> None:
    for name in scenetrace.__all__:
        assert getattr(scenetrace, name) is not None
    assert set(scenetrace.__all__) <= set(dir(scenetrace))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        scenetrace.nothing  # noqa: B018
    text = (ROOT / "scenetrace.py").read_text()
    typed = text[text.index("if TYPE_CHECKING") : text.index("__all__ = [")]
    for name in scenetrace.__all__:
        assert re.search(rf"\b{name}\b", typed), f"{name} is not known to a type checker"


def test_command_and_plug_in_come_through_it() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["project"]["scripts"]["scenetrace"] == "scenetrace:main"
    entries = project["project"]["entry-points"]["pytest11"]
    assert entries == {"scenetrace": "scenetrace:pytest_plugin"}
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert set(wheel["only-include"]) == {"scenetrace.py", *ROOMS}


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A user's project with folders of the rooms' names, and the plug-in installed."""
    folder = tmp_path / "project"
    for room in ("replay", "fixtures", "reasoning"):
        (folder / room).mkdir(parents=True)
        (folder / room / "__init__.py").write_text(f"MINE = {room!r}\n")
    (folder / "test_mine.py").write_text(
        "import fixtures, reasoning, replay\n\n\n"
        "def test_mine():\n"
        "    assert (replay.MINE, fixtures.MINE) == ('replay', 'fixtures')\n"
        "    assert reasoning.MINE == 'reasoning'\n"
    )
    about = tmp_path / "site" / "plug_in_under_test-1.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: plug-in-under-test\nVersion: 1\n"
    )
    (about / "entry_points.txt").write_text(
        "[pytest11]\nscenetrace = scenetrace:pytest_plugin\n"
    )
    return folder


def test_a_project_with_folders_of_the_rooms_names_runs_its_tests(project: Path) -> None:
    words = ("-m", "pytest", "-q", "-p", "no:randomly", "-p", "no:cacheprovider")
    site = (project.parent / "site",)
    status, said = python(*words, folder=project, path=site)
    assert status == 0, said
    assert "1 passed" in said
    (project / "test_golden.py").write_text("def test_it(golden_scene):\n    pass\n")
    status, said = python(*words, folder=project, path=site)
    assert status == 1, said
    assert "1 passed, 1 error" in said
    assert f"{project / 'replay'} hides the package 'replay' of scenetrace" in said
    assert "Traceback" not in said


def test_the_library_names_what_hides_it(project: Path) -> None:
    code = "import scenetrace; print(scenetrace.__version__); scenetrace.Engine"
    status, said = python("-c", code, folder=project, path=(project,))
    assert status == 1
    assert f"ImportError: scenetrace: {project / 'reasoning'} hides" in said
    assert f"{project / 'replay'} hides" in said
    assert "fixtures" not in said.splitlines()[-1]


def test_the_command_works_where_a_project_hides_its_rooms(project: Path) -> None:
    (project / "recorders.py").write_text("raise SystemExit('mine')\n")
    code = "import sys, scenetrace; sys.exit(scenetrace.main())"
    run = ("-c", code, "demo", "--help")
    status, said = python(*run, folder=project, path=(project,))
    assert status == 0, said
    scene = write_scene_log(
        generate("pass_by", size=(160, 120), frames=20),
        project / "scene.mcap",
        pictures="none",
    )
    out = project / "annotated.mcap"
    words = ("-c", code, "replay", str(scene), "-o", str(out))
    status, said = python(*words, folder=project, path=(project,))
    assert status == 0, said
    (project / "demo-out").mkdir()
    (project / "demo-out" / "scene.mp4").write_text("mine")
    status, said = python("-c", code, "demo", folder=project, path=(project,))
    assert status == 1, said
    assert "scene.mp4 exists already" in said  # so its own fixtures were there


def test_a_program_of_somebody_that_calls_the_command_is_told(project: Path) -> None:
    code = "import replay, scenetrace; scenetrace.main(['--version'])"
    status, said = python("-c", code, folder=project, path=(project,))
    assert status == 1
    assert f"{project / 'replay'} hides the package 'replay'" in said
