"""What the long runs found, each once."""

from __future__ import annotations

import gc
import struct
import time
import tracemalloc
import zlib
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import pytest

from recorders.clock import Clock, nominal_ns
from recorders.errors import ConfigError, RecordingError, SceneTraceError, SourceError
from recorders.formats.opening import open_rows
from recorders.log import LogReader, LogWriter, Schema
from recorders.log.info import examine, inspect
from recorders.log.recovery import recover
from recorders.parameters import configure
from recorders.recording import SECTIONS
from replay.annotated_writer import AnnotatedWriter, ReplaySummary
from replay.cases.case_file import read_case
from replay.run import Run
from tests.faults.small import WORDS, boxes, run


def records(data: bytes | bytearray) -> list[tuple[int, int]]:
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


def counted(path: Path, numbers: range, *, checked: bool = True) -> bytes:
    """A log of messages that hold these numbers; without the data section's CRC if not `checked`."""
    with LogWriter(path) as log:
        channel = log.channel("/camera/a", Schema("x.Y", "jsonschema", b"{}"), "json")
        for number in numbers:
            log.write(channel, b"%d" % number, number)
    data = bytearray(path.read_bytes())
    if not checked:
        (place,) = [p for opcode, p in records(data) if opcode == 15]
        data[place + 9 : place + 13] = bytes(4)
    return bytes(data)


def recovered(path: Path, data: bytes) -> list[int]:
    path.write_bytes(data)
    recover(path, path.with_name("recovered.mcap"), force=True)
    with LogReader(path.with_name("recovered.mcap")) as log:
        return [int(m.data) for m in log.messages()]


@pytest.mark.parametrize("checked", [True, False])
@pytest.mark.parametrize("between", [b"\n\n", b"\0" * 100, b"\x89MCAP"])
def test_logs_joined_with_something_between_are_recovered(
    tmp_path: Path, between: bytes, checked: bool
) -> None:
    path = tmp_path / "log.mcap"
    first = counted(tmp_path / "a.mcap", range(5), checked=checked)
    second = counted(tmp_path / "b.mcap", range(5, 9), checked=checked)
    assert recovered(path, first + between + second) == list(range(9))
    assert recovered(path, first[:-20] + second) == list(range(9))


def test_a_joined_log_has_one_error_for_each_joint(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    one = counted(path, range(5))
    path.write_bytes(one * 3)
    texts = [finding.text for finding in examine(path)]
    assert [text for text in texts if "CRC of the data section" in text] == []
    assert sum("another log begins here" in text for text in texts) == 2


def test_a_summary_that_lies_of_times_is_told_by_info(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    data = bytearray(counted(path, range(5)))
    (place,) = [p for opcode, p in records(data) if opcode == 8]
    struct.pack_into("<QQ", data, place + 9, 10**18, 10**18 + 1)
    (end,) = [p for opcode, p in records(data) if opcode == 2]
    (start,) = struct.unpack_from("<Q", data, end + 9)
    struct.pack_into("<I", data, end + 25, zlib.crc32(bytes(data[start : end + 25])))
    path.write_bytes(data)
    with pytest.raises(RecordingError, match="index in the summary differ"):
        inspect(path)


def test_a_header_that_reads_as_the_end_ends_nothing(tmp_path: Path) -> None:
    data = bytearray(counted(tmp_path / "log.mcap", range(5)))
    opcode, length = struct.unpack_from("<BQ", data, 8)
    assert opcode == 1
    # A header of a footer's length, as other writers' names of 12 letters make it.
    other = struct.pack("<BQI", 1, 20, 0) + struct.pack("<I", 12) + b"somebody 1.0"
    shifted = data[:8] + bytes([2]) + other[1:] + data[8 + 9 + length :]
    assert recovered(tmp_path / "log.mcap", bytes(shifted)) == list(range(5))


def test_a_header_that_reaches_over_a_chunk_hides_nothing(tmp_path: Path) -> None:
    data = bytearray(counted(tmp_path / "log.mcap", range(2000)))
    data[10] ^= 1 << 2
    assert recovered(tmp_path / "log.mcap", bytes(data)) == list(range(2000))


def test_a_log_that_counted_too_few_lost_nothing(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    data = bytearray(counted(path, range(5)))
    (place,) = [p for opcode, p in records(data) if opcode == 11]
    struct.pack_into("<Q", data, place + 9, 2)
    (end,) = [p for opcode, p in records(data) if opcode == 2]
    struct.pack_into("<I", data, end + 9 + 16, 0)
    path.write_bytes(data)
    report = recover(path, tmp_path / "recovered.mcap")
    assert report.is_complete
    assert report.messages == 5
    assert "counted 2 messages" in report.notes[-1].reason


@pytest.mark.parametrize("alike", [1, 2, 5, 25])
def test_stamps_of_a_clock_that_counts_coarsely_keep_their_length(alike: int) -> None:
    stamps = [frame // alike * alike * 40 for frame in range(200)]
    frame_ns = nominal_ns(stamps)
    assert frame_ns == 40
    clock: Clock[None] = Clock(frame_ns)
    times = [time for time, _ in clock.times((stamp, None) for stamp in stamps)]
    assert all(a < b for a, b in pairwise(times))
    assert abs(times[-1] - 199 * 40) <= 40
    assert clock.joined == 0


def test_an_index_that_reads_as_a_message_is_none(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    data = bytearray(counted(path, range(1)))
    (place,) = [p for opcode, p in records(data) if opcode == 7]
    data[place] = 5
    assert recovered(path, bytes(data)) == [0]


@pytest.mark.parametrize("number", ["1e999", "-1e999", "nan", "9" * 400])
@pytest.mark.parametrize("name", ["det.txt", "named.csv", "lines.jsonl"])
def test_a_number_beyond_all_others_is_told_or_left_out(
    tmp_path: Path, name: str, number: str
) -> None:
    path = tmp_path / name
    for frame, identity in ((number, "1"), ("1", number)):
        path.write_text(
            {
                "det.txt": f"1,1,10,20,30,40,1\n{frame},{identity},10,20,30,40,1\n",
                "named.csv": f"frame,id,x,y,w,h\n1,1,1,2,3,4\n{frame},{identity},1,2,3,4\n",
                "lines.jsonl": f'{{"frame": {frame}, "id": {identity}, "x": 1, "y": 2, "w": 3, "h": 4}}\n',
            }[name]
        )
        with suppress(SceneTraceError):
            assert all(
                0 <= row.frame < 10**6 for row in open_rows(path).rows(lambda *_: None)
            )


@pytest.mark.parametrize(
    "text",
    [
        ".".join("a" * 100_000) + " = 1\n",
        f"[{'.'.join('a' * 100_000)}]\n",
        f"a = {{{'.'.join('a' * 100_000)} = 1}}\n",
        "#" * 2_000_000,
    ],
)
def test_toml_that_takes_the_square_of_its_length_is_refused_at_once(
    tmp_path: Path, text: str
) -> None:
    path = tmp_path / "case.toml"
    path.write_text(text)
    begun = time.process_time()
    with pytest.raises(SourceError, match="not a case"):
        read_case(path)
    with pytest.raises(ConfigError, match="not TOML"):
        configure(SECTIONS, path)
    assert time.process_time() - begun < 1


def test_an_open_log_takes_little_memory_for_each_chunk(tmp_path: Path) -> None:
    """A recording of a day has a hundred thousand."""
    path, chunks = tmp_path / "log.mcap", 5000
    with LogWriter(path, flush_interval_ns=1) as log:
        a, b = log.channel("/a", None, "raw"), log.channel("/b", None, "raw")
        for k in range(chunks):
            log.write(a, b"a", k * 1_000_000_007)
            log.write(b, b"b", k * 1_000_000_007)
    tracemalloc.start()
    try:
        with LogReader(path) as opened:
            assert len(opened.index.blocks) == chunks
            held = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert held < 500 * chunks


def test_a_replay_keeps_one_index_of_its_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    boxes(tmp_path / "det.txt")
    scene, found = tmp_path / "scene.mcap", []
    assert run("record", str(tmp_path / "det.txt"), "-o", str(scene), *WORDS)[0] == 0
    finish = AnnotatedWriter.finish

    def counted(self: AnnotatedWriter, done: Run) -> ReplaySummary:
        gc.collect()
        held = [o for o in gc.get_objects() if isinstance(o, LogReader)]
        found.append(sum(log.path == scene for log in held))
        return finish(self, done)

    monkeypatch.setattr(AnnotatedWriter, "finish", counted)
    assert run("replay", str(scene), "-o", str(tmp_path / "made.mcap"))[0] == 0
    assert found == [1]
