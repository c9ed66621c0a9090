"""Inputs after what people hit: each script beside the project makes one, run in place."""

from __future__ import annotations

import gc
import importlib.util
import os
import runpy
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

_SHARED = Path(__file__).resolve().parents[3] / "shared"
CASES = Path(os.environ.get("SCENETRACE_DATA", _SHARED / "data")).parent / "cases"
Case = Callable[..., Path]


def _run(script: Path, out: Path, *words: str) -> Path:
    if script.suffix == ".sh":
        environment = {
            **os.environ,
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        }
        environment["PYTHONDONTWRITEBYTECODE"] = "1"
        subprocess.run(
            ["sh", str(script), str(out), *words],
            check=True,
            env=environment,
            cwd=script.parent,
        )
        return out
    argv, path, flag = sys.argv, list(sys.path), sys.dont_write_bytecode
    before = set(sys.modules)
    shared = _shared(script.parent)
    sys.modules.update(shared)
    sys.argv = [script.name, str(out), *words]
    sys.path.insert(0, str(script.parent))
    sys.dont_write_bytecode = True
    try:
        # The scripts leave their files to the end of the process.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            runpy.run_path(str(script), run_name="__main__")
            gc.collect()
    except SystemExit as e:
        if e.code:
            raise RuntimeError(f"{script}: {e.code}") from e
    finally:
        sys.argv, sys.path[:], sys.dont_write_bytecode = argv, path, flag
        for name in set(sys.modules) - before:
            if name in ("_lib", "scene", "v_codec"):
                del sys.modules[name]
    return out


@cache
def _shared(folder: Path) -> dict[str, ModuleType]:
    """What all scripts of logs share, loaded once: each draws the same sixty pictures."""
    place = folder / "_lib.py"
    if not place.exists():
        return {}
    spec = importlib.util.spec_from_file_location("_lib", place)
    assert spec is not None
    assert spec.loader is not None
    library: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(library)
    library.jpeg = cache(library.jpeg)
    return {"_lib": library}


@pytest.fixture(scope="session")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """Makes the input of a case: ``case("mcap/base")``, ``case("video/f_folder", "exif")``."""
    made: dict[tuple[str, ...], Path] = {}

    def make(name: str, *words: str, suffix: str = "") -> Path:
        key = (name, *words, suffix)
        if key in made:
            return made[key]
        kind, script = name.split("/")
        found = [CASES / kind / f"{script}{end}" for end in (".py", ".sh")]
        there = [p for p in found if p.exists()]
        if not there:
            pytest.skip(f"the case {name} is not beside the project ({CASES})")
        if kind == "video" and shutil.which("ffmpeg") is None:
            pytest.skip("the command ffmpeg is not installed: it makes the case")
        folder = tmp_path_factory.mktemp(script)
        suffix = suffix or (".mcap" if kind == "mcap" else "")
        made[key] = _run(there[0], folder / f"{script}{suffix}", *words)
        return made[key]

    return make
