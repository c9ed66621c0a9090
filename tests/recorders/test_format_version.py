"""A log of another version is refused with what to do; a log that says none is read."""

from __future__ import annotations

from pathlib import Path

import pytest

from recorders.errors import RecordingError
from recorders.format_version import FORMAT_VERSION, check_version

LOG = Path("scene.mcap")


@pytest.mark.parametrize("record", ["scenetrace", "scenetrace.started"])
def test_another_version_is_refused(record: str) -> None:
    with pytest.raises(RecordingError, match=r"format '99'.*reads '1': read it with"):
        check_version([(record, {"format_version": "99"})], LOG)


def test_this_version_and_logs_by_others_are_read() -> None:
    check_version([("scenetrace", {"format_version": FORMAT_VERSION})], LOG)
    check_version([("rosbag2", {"format_version": "99"}), ("scenetrace", {})], LOG)
