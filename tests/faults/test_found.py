"""What the long runs found, each once."""

from __future__ import annotations

import struct
from pathlib import Path

from recorders.log import LogReader, LogWriter, Schema
from recorders.log.recovery import recover


def records(data: bytes) -> list[tuple[int, int]]:
    """Opcode and place of each record of a log."""
    found, place = [], 8
    while place < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, place)
        found.append((opcode, place))
        place += 9 + length
    return found


def test_a_record_of_the_summary_that_reads_as_a_message_is_none(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        schema = Schema("x.Y", "jsonschema", b"{}")
        channel = log.channel("/camera/a-topic-of-some-length", schema, "json")
        log.write(channel, b"{}", 7)
    data = path.read_bytes()
    (place,) = [p for opcode, p in records(data) if opcode == 4]
    path.write_bytes(data[:place] + b"\x05" + data[place + 1 :])
    report = recover(path, tmp_path / "recovered.mcap")
    assert not report.is_complete
    with LogReader(tmp_path / "recovered.mcap") as log:
        assert [(m.log_time_ns, m.data) for m in log.messages()] == [(7, b"{}")]
