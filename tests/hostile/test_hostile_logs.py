"""Logs that are damaged or lie: the answer is one clear error, or exactly what was written."""

from __future__ import annotations

import struct
import tracemalloc
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any

import lz4.frame
import mcap.writer
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from recorders.errors import LimitError, RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogReader, LogWriter, Schema
from recorders.log.info import examine, inspect
from recorders.log.recovery import recover
from tests.examples import examples

MAGIC = b"\x89MCAP0\r\n"

# Records built by hand, apart from the project's own serialisation.


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def string(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def header() -> bytes:
    return record(1, string("") + string("by hand"))


def channel(
    identity: int = 1, topic: str = "/a", schema: int = 0, metadata: bytes = b""
) -> bytes:
    fields = struct.pack("<HH", identity, schema) + string(topic) + string("raw")
    return record(4, fields + struct.pack("<I", len(metadata)) + metadata)


def message(
    time: int, data: bytes = b"data", identity: int = 1, sequence: int = 0
) -> bytes:
    return record(5, struct.pack("<HIQQ", identity, sequence, time, time) + data)


def chunk(
    records: bytes,
    times: tuple[int, int] = (0, 10),
    compression: str = "",
    declared: int | None = None,
    packed: bytes | None = None,
    crc: int | None = None,
) -> bytes:
    pack: dict[str, Callable[[bytes], bytes]] = {
        "zstd": zstandard.ZstdCompressor().compress,
        "lz4": lambda data: bytes(lz4.frame.compress(data)),
    }
    data = packed if packed is not None else pack.get(compression, bytes)(records)
    size = len(records) if declared is None else declared
    fields = struct.pack("<QQQI", *times, size, zlib.crc32(records) if crc is None else crc)
    return record(6, fields + string(compression) + struct.pack("<Q", len(data)) + data)


def log(*data: bytes, summary: bytes = b"", data_crc: int | None = None) -> bytes:
    body = MAGIC + header() + b"".join(data)
    body += record(
        15, struct.pack("<I", zlib.crc32(body) if data_crc is None else data_crc)
    )
    start = len(body) if summary else 0
    tail = summary + struct.pack("<BQQQ", 2, 20, start, 0)
    return body + tail + struct.pack("<I", zlib.crc32(tail) if summary else 0) + MAGIC


def said(path: Path, limits: Limits = DEFAULT_LIMITS) -> tuple[Sequence[object], ...]:
    """All that a log says."""
    with LogReader(path, limits) as reader:
        return (
            [
                (m.topic, m.channel, m.log_time_ns, m.publish_time_ns, m.sequence, m.data)
                for m in reader.messages()
            ],
            reader.channels,
            reader.metadata(),
            list(reader.attachments()),
            [reader.header, reader.start_ns, reader.end_ns, reader.message_count],
        )


def outcome(path: Path) -> object:
    """What the log says, or the error that it gives."""
    try:
        return said(path)
    except RecordingError as error:
        return error


def recover_if_possible(path: Path, out: Path) -> None:
    try:
        recover(path, out, force=True)
    except RecordingError as error:
        if "nothing to recover" not in error.reason:
            raise


def ours(path: Path, compression: str) -> None:
    with LogWriter(
        path, compression=compression, picture_topics={"/image"}, chunk_bytes=2000
    ) as writer:
        image = writer.channel("/image", None, "jpeg")
        small = writer.channel(
            "/small", Schema("s", "jsonschema", b"{}"), "json", {"k": "v"}
        )
        for k in range(40):
            writer.write(image, Random(k).randbytes(150), k * 10**8, k, 3 * k)
            writer.write(small, b'{"frame": %d}' % k, k * 10**8)
        writer.attach("notes", "text/plain", b"hello", 1, 2)
        writer.metadata("scenetrace", {"tracker": "events", "digest": "abc"})


def theirs(path: Path, **options: Any) -> None:
    with path.open("wb") as stream:
        writer = mcap.writer.Writer(
            stream, enable_data_crcs=True, **({"chunk_size": 500} | options)
        )
        writer.start()
        schema = writer.register_schema("s", "jsonschema", b"{}")
        first, second = (
            writer.register_channel(topic, "json", schema) for topic in ("/a", "/b")
        )
        for k in range(30):
            writer.add_message(first, k, b"data %d" % k, k, k)
            writer.add_message(second, 30 - k, b"more %d" % k, k, k)
        writer.add_attachment(1, 2, "notes", "text/plain", b"hello")
        writer.add_metadata("m", {"k": "v"})
        writer.finish()


KINDS: dict[str, Callable[[Path], None]] = {
    "ours zstd": lambda path: ours(path, "zstd"),
    "ours lz4": lambda path: ours(path, "lz4"),
    "ours plain": lambda path: ours(path, ""),
    "mcap zstd": theirs,
    "mcap without chunks": lambda path: theirs(path, use_chunking=False),
    "mcap without index": lambda path: theirs(path, index_types=mcap.writer.IndexType.NONE),
    "mcap without repeats": lambda path: theirs(
        path, repeat_channels=False, repeat_schemas=False
    ),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_flipped_bit_is_an_error_or_changes_nothing(tmp_path: Path, kind: str) -> None:
    path, bad = tmp_path / "log.mcap", tmp_path / "bad.mcap"
    KINDS[kind](path)
    whole, original = path.read_bytes(), said(path)
    random = Random(kind)
    places = [random.randrange(len(whole)) for _ in range(250)] + list(
        range(0, len(whole), 97)
    )
    errors = 0
    for place in places:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << random.randrange(8)
        bad.write_bytes(damaged)
        result = outcome(bad)
        if isinstance(result, RecordingError):
            errors += 1
            assert result.path == bad
            assert result.offset is None or 0 <= result.offset <= len(whole)
        else:
            assert result == original, place
        assert any(finding.severity == "error" for finding in examine(bad)), (
            f"doctor misses byte {place}"
        )
    assert errors > len(places) // 3


@pytest.mark.parametrize("kind", KINDS)
def test_several_damaged_bytes_never_give_wrong_data(tmp_path: Path, kind: str) -> None:
    path, bad, out = tmp_path / "log.mcap", tmp_path / "bad.mcap", tmp_path / "out.mcap"
    KINDS[kind](path)
    whole, original = path.read_bytes(), said(path)
    random = Random(kind)
    for _ in range(80):
        damaged = bytearray(whole)
        start = random.randrange(len(whole))
        length = random.choice((2, 8, 64, 500))
        damaged[start : start + length] = random.choice(
            (bytes(length), random.randbytes(length), b"\xff" * length, b"")
        )
        if damaged == whole:
            continue
        bad.write_bytes(damaged)
        result = outcome(bad)
        assert isinstance(result, RecordingError) or result == original
        assert examine(bad)
        recover_if_possible(bad, out)


@pytest.mark.parametrize("kind", KINDS)
def test_every_truncation_is_an_error(tmp_path: Path, kind: str) -> None:
    path, bad = tmp_path / "log.mcap", tmp_path / "bad.mcap"
    KINDS[kind](path)
    whole = path.read_bytes()
    with LogReader(path) as reader:
        boundaries = {raw.offset for raw in reader._file.walk(8, len(whole) - 8)}
    random = Random(kind)
    for length in sorted(boundaries | {random.randrange(len(whole)) for _ in range(100)}):
        bad.write_bytes(whole[:length])
        with pytest.raises(RecordingError):
            said(bad)
        assert "error" in {finding.severity for finding in examine(bad)}


@settings(
    max_examples=examples(150),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.binary(max_size=300), st.binary(max_size=100), st.booleans())
def test_garbage_is_an_error(
    tmp_path: Path, data: bytes, summary: bytes, framed: bool
) -> None:
    path = tmp_path / "garbage.mcap"
    path.write_bytes(log(data, summary=summary) if framed else data)
    assert framed or isinstance(outcome(path), RecordingError)
    outcome(path)
    examine(path)
    recover_if_possible(path, tmp_path / "out.mcap")


opcodes = st.sampled_from([*range(16), 0x81, 0xFF])


@settings(
    max_examples=examples(200),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    st.lists(st.tuples(opcodes, st.binary(max_size=60)), max_size=6),
    st.lists(st.tuples(opcodes, st.binary(max_size=60)), max_size=6),
)
def test_records_of_garbage_are_an_error(
    tmp_path: Path, data: list[tuple[int, bytes]], summary: list[tuple[int, bytes]]
) -> None:
    path = tmp_path / "garbage.mcap"
    path.write_bytes(
        log(*(record(*r) for r in data), summary=b"".join(record(*r) for r in summary))
    )
    if not isinstance(outcome(path), RecordingError):
        inspect(path)
    examine(path)
    recover(path, tmp_path / "out.mcap", force=True)


def test_a_log_built_by_hand_is_read(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    inner = channel() + message(5, b"b") + message(3, b"a") + record(0x90, b"unknown")
    path.write_bytes(
        log(
            chunk(inner, (3, 5), "lz4"),
            message(5, b"c"),
            record(0xF0, b""),
            message(4, b"x"),
        )
    )
    with LogReader(path) as reader:
        assert [m.data for m in reader.messages()] == [b"a", b"x", b"b", b"c"]
        assert [m.data for m in reader.messages(reverse=True)] == [b"c", b"b", b"x", b"a"]
        assert [m.order[0] for m in reader.messages()] == [3, 4, 5, 5]
    assert [f.text for f in examine(path) if f.severity == "error"] == []


CASES: dict[str, tuple[bytes, str]] = {
    "empty file": (b"", "the file is empty"),
    "a text file": (b"frame,id,x,y\n1,1,10,10\n", "not an MCAP file"),
    "a truncated log": (log(channel(), message(1))[:-9], "no end: it was cut short"),
    "no header": (
        MAGIC + record(15, bytes(4)) + record(2, bytes(20)) + MAGIC,
        "does not start with a Header",
    ),
    "record beyond the file": (log(struct.pack("<BQ", 6, 1 << 62)), "reaches past"),
    "record of 2^64 - 1": (log(struct.pack("<BQ", 5, (1 << 64) - 1)), "reaches past"),
    "message of unknown channel": (log(message(1)), "channel 1, which no Channel record"),
    "message of unknown channel in a chunk": (
        log(chunk(message(1))),
        "channel 1, which no Channel record",
    ),
    "short message": (log(channel(), record(5, bytes(21))), "shorter than its fields"),
    "short message in a chunk": (
        log(chunk(channel() + record(5, bytes(21)))),
        "shorter than its fields",
    ),
    "chunk that ends in a record": (log(chunk(channel() + message(1)[:-1])), "past its"),
    "unknown compression": (
        log(chunk(b"", compression="rar")),
        "compression 'rar' is unknown",
    ),
    "not zstd": (
        log(chunk(b"", compression="zstd", declared=5, packed=b"hello", crc=0)),
        "zstd cannot unpack it",
    ),
    "not lz4": (
        log(chunk(b"", compression="lz4", declared=5, packed=b"hello", crc=0)),
        "lz4 cannot unpack it",
    ),
    "chunk that gives less": (
        log(chunk(channel(), compression="zstd", declared=5000)),
        "declares 5000 bytes",
    ),
    "chunk with a wrong CRC": (log(chunk(channel(), crc=1)), "the chunk's CRC differs"),
    "wrong data CRC": (log(channel(), data_crc=1), "CRC of the data section differs"),
    "two meanings of a channel": (
        log(channel(), channel(topic="/b")),
        "defined a second time, differently",
    ),
    "channel of a missing schema": (log(channel(schema=7)), "names schema 7"),
    "schema 0": (log(record(3, bytes(20))), "schema id 0 is reserved"),
    "a map that overruns": (
        log(channel(metadata=struct.pack("<I", 99) + b"key")),
        "past the end of the record",
    ),
    "a key twice": (log(channel(metadata=2 * (string("k") + string("v")))), "stands twice"),
    "text that is not UTF-8": (
        log(record(4, struct.pack("<HHI", 1, 0, 2) + b"\xff\xfe" + bytes(8))),
        "not UTF-8",
    ),
    "no data end": (MAGIC + header() + record(2, bytes(20)) + MAGIC, "no DataEnd"),
    "summary after the footer": (
        MAGIC + header() + record(2, b"\xff" * 20) + MAGIC,
        "the summary after itself",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_wrong_is_said(tmp_path: Path, name: str) -> None:
    content, text = CASES[name]
    path = tmp_path / "bad.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError) as caught:
        said(path)
    assert text in caught.value.reason
    assert str(caught.value).startswith(str(path))
    assert any(finding.severity == "error" for finding in examine(path))


def test_files_that_cannot_be_opened_are_said(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="there is no such file"):
        LogReader(tmp_path / "none.mcap")
    with pytest.raises(RecordingError, match="this is a folder"):
        LogReader(tmp_path)


def bomb(compression: str, declared: int) -> bytes:
    zeros = bytes(64 << 20)
    packed = (
        zstandard.ZstdCompressor().compress(zeros)
        if compression == "zstd"
        else bytes(lz4.frame.compress(zeros))
    )
    return log(chunk(b"", compression=compression, declared=declared, packed=packed, crc=0))


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_that_unpacks_to_more_than_it_declares_stops_there(
    tmp_path: Path, compression: str
) -> None:
    path = tmp_path / "bomb.mcap"
    path.write_bytes(bomb(compression, 100))
    tracemalloc.start()
    try:
        with pytest.raises(
            LimitError, match="unpacks to more than the 100 bytes that it declares"
        ):
            LogReader(path)
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()
    assert any("more than the 100 bytes" in finding.text for finding in examine(path))
    assert recover(path, tmp_path / "out.mcap").messages == 0


def test_a_zstd_frame_without_its_size_is_bounded_too(tmp_path: Path) -> None:
    compressor = zstandard.ZstdCompressor(write_content_size=False)
    inner = channel() + message(1)
    path = tmp_path / "log.mcap"
    path.write_bytes(
        log(chunk(inner, compression="zstd", packed=compressor.compress(inner)))
    )
    assert len(said(path)[0]) == 1
    path.write_bytes(
        log(
            chunk(
                inner,
                compression="zstd",
                declared=99,
                packed=compressor.compress(bytes(1 << 24)),
            )
        )
    )
    with pytest.raises(LimitError, match="more than the 99 bytes"):
        LogReader(path)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_several_frames_in_a_chunk_are_read(tmp_path: Path, compression: str) -> None:
    first, second = channel() + message(1), message(2)
    pack = (
        zstandard.ZstdCompressor().compress if compression == "zstd" else lz4.frame.compress
    )
    path = tmp_path / "log.mcap"
    packed = bytes(pack(first)) + bytes(pack(second))
    path.write_bytes(log(chunk(first + second, compression=compression, packed=packed)))
    assert len(said(path)[0]) == 2


@pytest.mark.parametrize(
    ("content", "limits", "text"),
    [
        (log(chunk(channel(), declared=10**12)), Limits(), "max_chunk_bytes = 268435456"),
        (
            log(chunk(channel() + message(1, bytes(500)))),
            Limits(max_chunk_bytes=400),
            "over the limit max_chunk_bytes",
        ),
        (
            log(channel(), message(1, bytes(500))),
            Limits(max_message_bytes=499),
            "is 500, over the limit max_message",
        ),
        (
            log(chunk(channel() + message(1, bytes(500)))),
            Limits(max_message_bytes=499),
            "has 500 bytes, over the limit",
        ),
        (
            log(*(channel(k, f"/{k}") for k in range(12))),
            Limits(max_channels=11),
            "is 12, over the limit max_channels",
        ),
        (
            log(record(12, bytes(900))),
            Limits(max_record_bytes=800),
            "is 900, over the limit max_record_bytes = 800",
        ),
        (
            log(record(9, bytes(900))),
            Limits(max_attachment_bytes=800),
            "is 900, over the limit max_attachment_bytes",
        ),
        (
            log(summary=record(0x90, bytes(900))),
            Limits(max_summary_bytes=800),
            "over the limit max_summary_bytes",
        ),
        (
            log(chunk(channel() + b"".join(message(k) for k in range(9)))),
            Limits(max_messages_per_chunk=8),
            "over the limit max_messages_per_chunk = 8",
        ),
    ],
)
def test_limits_state_value_and_limit(
    tmp_path: Path, content: bytes, limits: Limits, text: str
) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(content)
    with pytest.raises(LimitError) as caught:
        said(path, limits)
    assert text in caught.value.reason


def indexed(index: Callable[[int, int], bytes]) -> bytes:
    """A chunk with a summary whose CRC is right, whatever it says."""
    inner = channel() + message(3) + message(5)
    body = chunk(inner, (3, 5))
    offset = len(MAGIC) + len(header())
    statistics = record(11, struct.pack("<QHIIIIQQI", 2, 0, 1, 0, 0, 1, 3, 5, 0))
    return log(body, summary=channel() + statistics + index(offset, len(body)))


def chunk_index(
    start: int, end: int, offset: int, length: int, size: int, index_length: int = 0
) -> bytes:
    fields = struct.pack("<QQQQI", start, end, offset, length, 0) + struct.pack(
        "<Q", index_length
    )
    return record(8, fields + string("") + struct.pack("<QQ", size, size))


SIZE = len(channel() + message(3) + message(5))


@pytest.mark.parametrize(
    "index",
    [
        lambda offset, length: chunk_index(3, 5, offset, length, SIZE),
        lambda offset, length: chunk_index(3, 5, offset, length + 50, SIZE),
        lambda offset, length: chunk_index(3, 5, offset + 1, length, SIZE),
        lambda offset, length: chunk_index(
            3, 5, (1 << 64) - 1, (1 << 64) - 1, SIZE, (1 << 64) - 1
        ),
        lambda offset, length: chunk_index(3, 4, offset, length, SIZE),
        lambda offset, length: chunk_index(3, 5, offset, length, SIZE + 1),
        lambda offset, length: 2 * chunk_index(3, 5, offset, length, SIZE),
        lambda offset, length: b"",
    ],
)
def test_an_index_that_lies_gives_an_error_or_the_truth(
    tmp_path: Path, index: Callable[[int, int], bytes]
) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(indexed(index))
    result = outcome(path)
    if isinstance(result, RecordingError):
        assert "differ" in result.reason
    else:
        assert len(said(path)[0]) == 2


def test_messages_outside_the_chunks_that_the_summary_lists_are_found(
    tmp_path: Path,
) -> None:
    inner = channel() + message(3)
    body = chunk(inner, (3, 3))
    offset = len(MAGIC) + len(header())
    statistics = record(11, struct.pack("<QHIIIIQQI", 1, 0, 1, 0, 0, 1, 3, 3, 0))
    entry = chunk_index(3, 3, offset, len(body), len(inner))
    path = tmp_path / "log.mcap"
    path.write_bytes(log(body, message(2), summary=channel() + statistics + entry))
    with LogReader(path) as reader:
        assert [m.log_time_ns for m in reader.messages()] == [2, 3]


def test_a_channel_that_the_index_hides_is_not_lost_in_silence(tmp_path: Path) -> None:
    """A chunk index that names channel 1 alone, over a chunk that holds messages of channel 2 as
    well.
    """
    inner = channel() + channel(2, "/b") + message(3) + message(3, b"hidden", identity=2)
    body = chunk(inner, (3, 3))
    index = record(
        7, struct.pack("<HIQQ", 1, 16, 3, len(channel()) + len(channel(2, "/b")))
    )
    offset = len(MAGIC) + len(header())
    statistics = record(11, struct.pack("<QHIIIIQQI", 2, 0, 2, 0, 0, 1, 3, 3, 0))
    fields = struct.pack("<QQQQI", 3, 3, offset, len(body), 10) + struct.pack(
        "<HQ", 1, offset + len(body)
    )
    entry = record(
        8,
        fields
        + struct.pack("<Q", len(index))
        + string("")
        + struct.pack("<QQ", len(inner), len(inner)),
    )
    path = tmp_path / "log.mcap"
    path.write_bytes(
        log(body, index, summary=channel() + channel(2, "/b") + statistics + entry)
    )
    with (
        LogReader(path) as reader,
        pytest.raises(RecordingError, match="index does not mention"),
    ):
        list(reader.messages())
    assert [f.record for f in examine(path) if f.severity == "error"] == [
        "ChunkIndex",
        "MessageIndex",
    ]


def test_a_file_that_shrinks_while_it_is_read_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as writer:
        identity = writer.channel("/a", None, "raw")
        for k in range(100):
            writer.write(identity, Random(k).randbytes(10_000), k * 10**8)
    with LogReader(path) as reader:
        messages = reader.messages()
        next(messages)
        with path.open("r+b") as stream:
            stream.truncate(200_000)
        with pytest.raises(RecordingError, match="became shorter"):
            list(messages)


def test_a_closed_reader_says_so(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    ours(path, "zstd")
    reader = LogReader(path)
    reader.close()
    with pytest.raises(RecordingError, match="closed"):
        list(reader.messages())
