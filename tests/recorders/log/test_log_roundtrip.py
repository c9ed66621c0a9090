"""What is written is read back: order, topics, times, latched, both ways with the `mcap` package."""

from __future__ import annotations

import itertools
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import mcap.writer
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from recorders.errors import LimitError
from recorders.limits import Limits
from recorders.log import LogReader, LogWriter, Message, Schema
from recorders.log.content_digest import content_digest
from recorders.log.info import examine
from tests.examples import examples

SCHEMA = Schema("scenetrace.Test", "jsonschema", b'{"type": "object"}')
Written = tuple[int, bytes, int, int, int]


def plain(message: Message) -> Written:
    return (
        message.channel.id,
        message.data,
        message.log_time_ns,
        message.publish_time_ns,
        message.sequence,
    )


def write_log(path: Path, messages: list[Written], **options: object) -> None:
    """Three channels: 1 pictures, 2 and 3 small."""
    with LogWriter(path, force=True, picture_topics={"/image"}, **options) as log:  # type: ignore[arg-type]
        log.channel("/image", None, "jpeg")
        log.channel("/small", SCHEMA, "json", {"b": "2", "a": "1"})
        log.channel("/other", SCHEMA, "json")
        for channel, data, log_time, publish_time, sequence in messages:
            log.write(channel, data, log_time, publish_time, sequence)


times = st.one_of(st.integers(0, 20), st.integers(0, 5 * 10**9), st.integers(0, 2**64 - 1))
message_lists = st.lists(
    st.tuples(
        st.integers(1, 3), st.binary(max_size=60), times, times, st.integers(0, 2**32 - 1)
    ),
    max_size=60,
)
folder_is_shared = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    max_examples=examples(60),
    deadline=None,
)


@folder_is_shared
@given(
    message_lists,
    st.sampled_from(["", "lz4", "zstd"]),
    st.sampled_from([1, 100, 4 << 20]),
    st.data(),
)
def test_any_messages_come_back_in_the_total_order(
    tmp_path: Path,
    messages: list[Written],
    compression: str,
    chunk_bytes: int,
    data: st.DataObject,
) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, messages, compression=compression, chunk_bytes=chunk_bytes)
    with LogReader(path) as log:
        got = list(log.messages())
        assert sorted(map(plain, got)) == sorted(messages)
        orders = [message.order for message in got]
        assert orders == sorted(set(orders))
        assert [order[0] for order in orders] == [message.log_time_ns for message in got]
        for channel in (1, 2, 3):
            written = [m for m in messages if m[0] == channel]
            assert [plain(m) for m in got if m.channel.id == channel] == sorted(
                written, key=lambda m: m[2]
            )
        assert list(log.messages(reverse=True)) == got[::-1]
        start, end = sorted((data.draw(times), data.draw(times)))
        topics = data.draw(
            st.lists(st.sampled_from(["/image", "/small", "/other", "/none"]), unique=True)
        )
        for reverse in (False, True):
            part = list(log.messages(topics, start, end, reverse))
            wanted = [m for m in got if m.topic in topics and start <= m.log_time_ns < end]
            assert part == (wanted[::-1] if reverse else wanted)
        before = [m for m in got if m.topic == "/small" and m.log_time_ns <= start]
        assert log.latched("/small", start) == (before[-1] if before else None)
    assert examine(path) == [] or all(
        "goes back" in finding.text for finding in examine(path)
    )


@folder_is_shared
@given(message_lists)
def test_the_layout_does_not_change_the_digest(
    tmp_path: Path, messages: list[Written]
) -> None:
    write_log(tmp_path / "a.mcap", messages)
    write_log(
        tmp_path / "b.mcap",
        messages,
        compression="lz4",
        chunk_bytes=50,
        flush_interval_ns=3,
    )
    assert content_digest(tmp_path / "a.mcap") == content_digest(tmp_path / "b.mcap")


def test_every_part_of_a_message_changes_the_digest(tmp_path: Path) -> None:
    base: Written = (2, b"data", 5, 6, 7)
    variants: list[Written] = [
        base, (3, b"data", 5, 6, 7), (2, b"datb", 5, 6, 7), (2, b"data", 4, 6, 7), (2, b"data", 5, 5, 7),
        (2, b"data", 5, 6, 8),
    ]  # fmt: skip
    digests = set()
    for variant in variants:
        write_log(tmp_path / "log.mcap", [variant])
        digests.add(content_digest(tmp_path / "log.mcap"))
    assert len(digests) == len(variants)


@pytest.mark.parametrize("chunk_bytes", [1, 300, 4 << 20])
def test_ties_are_pictures_first_then_as_written(tmp_path: Path, chunk_bytes: int) -> None:
    messages = [
        (channel, bytes([frame, place]), frame * 40_000_000, frame * 40_000_000, frame)
        for frame in range(60)
        for place, channel in enumerate((2, 1, 3, 1))
    ]
    write_log(
        tmp_path / "log.mcap",
        messages,
        chunk_bytes=chunk_bytes,
        flush_interval_ns=200_000_000,
    )
    with LogReader(tmp_path / "log.mcap") as log:
        for _, frame in itertools.groupby(log.messages(), key=lambda m: m.log_time_ns):
            assert [m.data[1] for m in frame] == [1, 3, 0, 2]


def test_the_same_calls_give_the_same_bytes(tmp_path: Path) -> None:
    messages: list[Written] = [(1 + k % 3, b"x" * k, k * 10**8, k, k) for k in range(100)]
    write_log(tmp_path / "a.mcap", messages)
    write_log(tmp_path / "b.mcap", messages)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_publish_time_and_sequence_have_defaults(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as log:
        channel = log.channel("/a", None, "raw")
        log.write(channel, b"", 10)
        log.write(channel, b"", 20)
        log.write(channel, b"", 30, 31, 40)
        log.write(channel, b"", 40)
    with LogReader(tmp_path / "log.mcap") as log:
        assert [(m.publish_time_ns, m.sequence) for m in log.messages()] == [
            (10, 0),
            (20, 1),
            (31, 40),
            (40, 41),
        ]


def test_metadata_and_attachments_come_back(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as log:
        log.metadata("scenetrace", {"z": "1", "a": "2"})
        log.attach("notes.txt", "text/plain", b"hello", 5, 6)
        log.attach("other.bin", "application/octet-stream", bytes(1000))
        log.metadata("scenetrace", {})
    with LogReader(tmp_path / "log.mcap") as log:
        assert log.metadata() == [("scenetrace", {"a": "2", "z": "1"}), ("scenetrace", {})]
        assert list(log.metadata()[0][1]) == ["a", "z"]
        assert [a.data for a in log.attachments(["notes.txt"])] == [b"hello"]
        assert [(a.name, a.log_time_ns, a.create_time_ns) for a in log.attachments()] == [
            ("notes.txt", 5, 6),
            ("other.bin", 0, 0),
        ]
        assert (log.start_ns, log.end_ns, log.message_count) == (None, None, 0)
        assert (log.header.profile, log.header.library) == ("", "scenetrace")


def test_the_mcap_package_reads_ours(tmp_path: Path) -> None:
    messages: list[Written] = [
        (1 + k % 3, bytes([k]) * k, k * 10**8, k, k) for k in range(100)
    ]
    path = tmp_path / "log.mcap"
    write_log(path, messages)
    with LogWriter(tmp_path / "extra.mcap") as log:
        log.metadata("m", {"k": "v"})
        log.attach("a", "text/plain", b"data")
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        got = [
            (c.id, m.data, m.log_time, m.publish_time, m.sequence)
            for _, c, m in reader.iter_messages()
        ]
        summary = reader.get_summary()
    assert got == messages
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.channel_message_counts == {1: 34, 2: 33, 3: 33}
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 2
    assert {c.topic for c in summary.channels.values()} == {"/image", "/small", "/other"}
    with path.open("rb") as stream:
        assert sum(1 for _ in StreamReader(stream, validate_crcs=True).records) > 100
    with (tmp_path / "extra.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert [m.metadata for m in reader.iter_metadata()] == [{"k": "v"}]
        assert [a.data for a in reader.iter_attachments()] == [b"data"]


def peer_options() -> list[dict[str, object]]:
    kinds = mcap.writer.IndexType
    options: list[dict[str, object]] = [
        {"compression": c} for c in mcap.writer.CompressionType
    ]
    options += [
        {"use_chunking": False},
        {"index_types": kinds.NONE},
        {"index_types": kinds.CHUNK},
    ]
    options += [
        {"repeat_channels": False},
        {"repeat_schemas": False},
        {"use_statistics": False},
    ]
    options += [
        {"use_summary_offsets": False},
        {"enable_crcs": False},
        {"enable_data_crcs": True, "chunk_size": 200},
    ]
    return options


@pytest.mark.parametrize("options", peer_options(), ids=str)
def test_ours_reads_the_mcap_package(tmp_path: Path, options: dict[str, object]) -> None:
    path = tmp_path / "log.mcap"
    messages = [
        (1 + k % 2, bytes([k % 256]) * (k % 50), (k * 7919) % 1000, k, k)
        for k in range(500)
    ]
    with path.open("wb") as stream:
        writer = mcap.writer.Writer(stream, **{"chunk_size": 1000, **options})  # type: ignore[arg-type]
        writer.start("profile", "library")
        schema = writer.register_schema("s", "jsonschema", b"{}")
        for topic in ("/a", "/b"):
            writer.register_channel(topic, "json", schema)
        for channel, data, log_time, publish_time, sequence in messages:
            writer.add_message(channel, log_time, data, publish_time, sequence)
        writer.add_attachment(3, 4, "name", "type", b"data")
        writer.add_metadata("m", {"k": "v"})
        writer.finish()
    with LogReader(path) as log:
        got = list(log.messages())
        assert [plain(m) for m in got] == [
            (c, d, t, p, s) for c, d, t, p, s in sorted(messages, key=lambda m: m[2])
        ]
        assert list(log.messages(reverse=True)) == got[::-1]
        assert [plain(m) for m in log.messages(["/b"], 100, 200)] == [
            plain(m) for m in got if m.topic == "/b" and 100 <= m.log_time_ns < 200
        ]
        assert log.metadata() == [("m", {"k": "v"})]
        assert [a.data for a in log.attachments(["name"])] == [b"data"]
        assert log.header.profile == "profile"
        assert log.message_count == 500


def test_pictures_are_not_unpacked_for_detections(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages: list[Written] = [(1 + k % 2, b"x" * 100, k * 10**8, k, k) for k in range(200)]
    write_log(tmp_path / "log.mcap", messages)
    with LogReader(tmp_path / "log.mcap") as log:
        small = {
            block.offset for block in log.index.blocks if block.channels == frozenset({2})
        }
        pictures = {
            block.offset for block in log.index.blocks if block.channels == frozenset({1})
        }
        assert small
        assert pictures
        opened: list[int] = []
        unpack = log._file.unpack

        def watch(raw: object, head: object) -> bytes:
            opened.append(raw.offset)  # type: ignore[attr-defined]
            return unpack(raw, head)  # type: ignore[arg-type]

        monkeypatch.setattr(log._file, "unpack", watch)
        assert sum(1 for _ in log.messages(["/small"])) == 100
        assert set(opened) == small
        opened.clear()
        next(log.messages())
        assert len(opened) == 1
        assert log.latched("/small", 10**10) is not None
        assert len(opened) == 2


def test_overlapping_chunks_are_merged_within_bounded_memory(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as stream:
        writer = mcap.writer.Writer(stream, chunk_size=5000)
        writer.start()
        channel = writer.register_channel("/a", "raw", 0)
        for k in range(4000):  # every chunk spans the whole time
            writer.add_message(channel, (k % 40) * 1000 + k // 40, bytes(100), 0, k)
        writer.finish()
    with LogReader(path) as log, LogReader(path, Limits(max_open_bytes=20_000)) as bounded:
        got = list(log.messages())
        assert [m.log_time_ns for m in got] == sorted(m.log_time_ns for m in got)
        assert list(bounded.messages()) == got
        assert list(bounded.messages(reverse=True)) == got[::-1]


def test_a_reader_can_be_asked_twice_at_once(tmp_path: Path) -> None:
    write_log(
        tmp_path / "log.mcap",
        [(2, bytes([k]), k, k, k) for k in range(50)],
        chunk_bytes=100,
    )
    with LogReader(tmp_path / "log.mcap") as log:
        for first, second in zip(log.messages(), log.messages(), strict=True):
            assert first == second


@pytest.mark.parametrize(
    ("limits", "call"),
    [
        (Limits(max_message_bytes=10), lambda log: log.write(1, bytes(11), 0)),
        (Limits(max_attachment_bytes=10), lambda log: log.attach("a", "b", bytes(11))),
        (Limits(max_channels=1), lambda log: log.channel("/b", None, "raw")),
        (Limits(max_chunk_bytes=1000), lambda log: log.write(1, bytes(1000), 0)),
    ],
)
def test_nothing_is_written_that_could_not_be_read(
    tmp_path: Path, limits: Limits, call: Callable[[LogWriter], object]
) -> None:
    log = LogWriter(tmp_path / "log.mcap", limits=limits)
    log.channel("/a", None, "raw")
    with pytest.raises(LimitError, match=r"over the limit max_\w+ = \d+"):
        call(log)
    log.abort()


def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    def peak(count: int) -> tuple[int, int]:
        path = tmp_path / "log.mcap"
        picture = bytes(range(256)) * 200
        tracemalloc.start()
        try:
            with LogWriter(
                path, force=True, picture_topics={"/image"}, chunk_bytes=1 << 20
            ) as log:
                image, small = (
                    log.channel("/image", None, "jpeg"),
                    log.channel("/small", SCHEMA, "json"),
                )
                for k in range(count):
                    log.write(image, picture, k * 40_000_000)
                    log.write(small, b"%d" % k, k * 40_000_000)
            writing = tracemalloc.get_traced_memory()[1]
            tracemalloc.reset_peak()
            with LogReader(path) as log:
                assert sum(1 for _ in log.messages()) == 2 * count
            return writing, tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    short, long = peak(100), peak(1000)
    assert long[0] < short[0] + 1_000_000
    assert long[1] < short[1] + 1_000_000
