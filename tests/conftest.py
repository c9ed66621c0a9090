"""Fixtures that every test may use."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# A test may take longer on a busy machine without being wrong: no property test is timed.
settings.register_profile(
    "scenetrace", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("scenetrace")

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real recordings: $SCENETRACE_DATA, or `shared/data` beside the project."""
    folder = Path(os.environ.get("SCENETRACE_DATA", ROOT.parent / "shared" / "data"))
    if not (folder / "SOURCES.md").exists():
        pytest.skip(
            f"real recordings are not at {folder}; set SCENETRACE_DATA to their folder"
        )
    return folder
