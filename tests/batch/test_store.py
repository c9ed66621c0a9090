"""Sources and case in an object store that is cut off in the middle."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from recorders.stores import open_store
from replay.batch.nursery import Nursery
from replay.cli import main
from tests.batch.conftest import WORDS
from tests.batch.files import digests
from tests.batch.s3 import bucket, s3_server

for _needed in ("moto", "flask_cors", "s3fs"):
    pytest.importorskip(_needed, reason=f"{_needed} is not installed")
pytestmark = pytest.mark.slow


def test_a_store_that_is_cut_off_is_waited_for(
    sources: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pattern = "*/*.txt"
    assert main(["batch", str(sources / pattern), "-o", str(tmp_path / "a"), *WORDS]) == 0
    # Those that are lent to tests know nothing of the environment that is set here.
    monkeypatch.setattr("replay.batch.engines.Nursery", Nursery)
    with s3_server(tmp_path) as (door, environment):
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        files = bucket(environment, "unit")
        files.put(f"{sources}/", "unit/in/", recursive=True)

        def cut() -> None:
            while not files.glob("unit/case/annotated/*.mcap"):
                pass
            door.shut()
            threading.Timer(3.0, door.open).start()

        cutting = threading.Thread(target=cut)
        cutting.start()
        words = ["-o", "s3://unit/case", *WORDS, "--workers", "1"]
        assert main(["batch", f"s3://unit/in/{pattern}", *words]) == 0
        cutting.join()
        assert door.refused > 0
        keys = open_store("s3://unit/case").keys("tables")
        files.get("unit/case/", f"{tmp_path / 'b'}/", recursive=True)
    remote, local = (digests(tmp_path / name, statuses=False) for name in ("b", "a"))
    assert remote == local
    assert len(keys) == len([key for key in local if key.startswith("tables")])
