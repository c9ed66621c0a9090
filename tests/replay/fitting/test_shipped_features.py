"""The part features that are shipped can be made again."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from recorders.parameters import to_toml
from replay.trackers.parts.scoring import SHIPPED, PartFeatures

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def script() -> ModuleType:
    path = ROOT / "tests" / "benchmarks" / "fit_features.py"
    spec = importlib.util.spec_from_file_location("fit_features", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_defaults_are_the_shipped_file() -> None:
    assert to_toml({"part_features": PartFeatures()}).encode() == SHIPPED.read_bytes()


def test_a_fit_is_the_same_byte_for_byte(script: ModuleType, tmp_path: Path) -> None:
    made = []
    for turn in ("a", "b"):
        pair = script.generated("fight", 1, tmp_path / turn, frames=70)
        made.append(script.fitted([pair]))
    assert made[0] == made[1]
    assert b"fight-1.mcap with fight-1.txt" in made[0]


@pytest.mark.real
@pytest.mark.slow
@pytest.mark.long
def test_the_shipped_fit_is_made_again_byte_for_byte(
    script: ModuleType, tmp_path: Path
) -> None:
    if not script.TUD.exists():
        pytest.skip(f"{script.TUD} is not there")
    pairs = [script.generated(*scene, tmp_path) for scene in script.SCENES]
    assert script.fitted([*pairs, script.campus(tmp_path)]) == SHIPPED.read_bytes()
