"""What is installed, and what is handed on: exact versions with their digests, wheels that are the
same each time.
"""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).resolve().parents[1]
_PIN = re.compile(r"^([A-Za-z0-9][\w.-]*)==([^\s;]+)", re.MULTILINE)


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def pins(name: str) -> dict[str, str]:
    text = (ROOT / name).read_text()
    return {plain(package): version for package, version in _PIN.findall(text)}


def test_both_locks_name_the_same_versions() -> None:
    assert pins("requirements.lock") == pins("requirements.hashes.txt")


def test_every_locked_package_has_its_digests() -> None:
    text = (ROOT / "requirements.hashes.txt").read_text()
    blocks = re.split(r"^(?=[A-Za-z0-9])", text, flags=re.MULTILINE)[1:]
    assert len(blocks) == len(pins("requirements.lock"))
    for block in blocks:
        first, *rest = block.replace("\\\n", "\n").split("\n")
        digests = [line.strip() for line in rest if line.strip()]
        assert digests, first
        for digest in digests:
            assert re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", digest), (first, digest)


def test_what_the_project_names_is_locked() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    named = [
        *project["build-system"]["requires"],
        *project["project"]["dependencies"],
        *project["project"]["optional-dependencies"]["dev"],
    ]
    names = {plain(re.split(r"[^\w.-]", word)[0]) for word in named}
    assert names - set(pins("requirements.lock")) == set()


def test_two_builds_of_the_wheel_are_the_same(tmp_path: Path) -> None:
    pytest.importorskip("hatchling")
    digests = []
    for number in ("one", "two"):
        out = tmp_path / number
        subprocess.run(
            [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(out)],
            cwd=ROOT,
            env=os.environ | {"TZ": "UTC+9" if number == "one" else "UTC-9"},
            check=True,
            capture_output=True,
        )
        (wheel,) = out.glob("*.whl")
        digests.append(hashlib.sha256(wheel.read_bytes()).hexdigest())
    assert digests[0] == digests[1]
    with ZipFile(wheel) as held:
        names = held.namelist()
    assert "replay/cli/__init__.py" in names
    assert not [name for name in names if name.startswith(("tests/", "docs/"))]
