"""Recovering damaged logs: what is kept, what is said to be lost."""

from __future__ import annotations

import re
import struct
import zlib
from pathlib import Path
from random import Random
from time import process_time

import mcap.writer
import pytest

from recorders.errors import OutputExistsError, RecordingError
from recorders.log import LogReader, LogWriter, Schema
from recorders.log.content_digest import content_digest
from recorders.log.info import examine, inspect
from recorders.log.recovery import recover

Said = tuple[str, int, int, bytes]


def make(path: Path, compression: str = "zstd") -> bytes:
    random = Random(3)
    with LogWriter(
        path, compression=compression, picture_topics={"/image"}, profile="test"
    ) as log:
        image = log.channel(
            "/image", Schema("foxglove.CompressedImage", "protobuf", b"x"), "protobuf"
        )
        small = log.channel("/small", Schema("s", "jsonschema", b"{}"), "json", {"a": "b"})
        for k in range(300):
            log.write(image, random.randbytes(200), k * 40_000_000)
            log.write(small, b'{"frame": %d}' % k, k * 40_000_000)
        log.attach("notes", "text/plain", b"hello" * 20, 1)
        log.metadata("scenetrace", {"tracker": "events"})
    return path.read_bytes()


def said(path: Path) -> list[Said]:
    with LogReader(path) as log:
        return [(m.topic, m.log_time_ns, m.sequence, m.data) for m in log.messages()]


def test_a_sound_log_loses_nothing(tmp_path: Path) -> None:
    make(tmp_path / "log.mcap")
    report = recover(tmp_path / "log.mcap", tmp_path / "out.mcap")
    assert (report.is_complete, report.messages, report.channels) == (True, 600, 2)
    assert (report.metadata, report.attachments, report.messages_expected) == (1, 1, 600)
    assert said(tmp_path / "out.mcap") == said(tmp_path / "log.mcap")
    assert content_digest(tmp_path / "out.mcap") == content_digest(tmp_path / "log.mcap")
    assert inspect(tmp_path / "out.mcap").profile == "test"
    assert examine(tmp_path / "out.mcap") == []


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_a_log_cut_anywhere_gives_its_beginning(tmp_path: Path, compression: str) -> None:
    path, cut, out = tmp_path / "log.mcap", tmp_path / "cut.mcap", tmp_path / "out.mcap"
    whole = make(path, compression)
    original = said(path)
    with LogReader(path) as log:
        blocks = log.index.blocks
    kept = []
    for length in sorted(
        {*range(8, len(whole), len(whole) // 40), len(whole) - 1, blocks[5].offset + 1}
    ):
        cut.write_bytes(whole[:length])
        report = recover(cut, out, force=True)
        got = said(out)
        ended = sum(1 for b in blocks if b.offset + b.length <= length)
        assert set(got) <= set(original)
        assert len(got) == report.messages
        assert report.messages >= 25 * ended - 24
        assert not report.is_complete
        assert all(loss.offset <= length for loss in report.losses)
        assert (
            "cut short" in report.losses[0].reason
            or "ends within" in report.losses[0].reason
        )
        kept.append(report.messages)
    assert kept == sorted(kept)
    assert kept[-1] == 600


def test_a_damaged_chunk_is_left_out_and_said(tmp_path: Path) -> None:
    whole = bytearray(make(tmp_path / "log.mcap"))
    with LogReader(tmp_path / "log.mcap") as log:
        block = log.index.blocks[4]
    whole[block.offset + block.length // 2] ^= 0x10
    (tmp_path / "bad.mcap").write_bytes(whole)
    report = recover(tmp_path / "bad.mcap", tmp_path / "out.mcap")
    assert report.messages == 600 - 25
    assert [(loss.offset, loss.record) for loss in report.losses] == [
        (block.offset, "Chunk"),
        (len(whole), "Statistics"),
    ]
    assert set(said(tmp_path / "out.mcap")) < set(said(tmp_path / "log.mcap"))


@pytest.mark.parametrize("with_summary", [True, False])
def test_a_damaged_head_loses_one_chunk_only(tmp_path: Path, with_summary: bool) -> None:
    whole = bytearray(make(tmp_path / "log.mcap"))
    with LogReader(tmp_path / "log.mcap") as log:
        block, end = log.index.blocks[4], log.index.data_end.offset
    whole[block.offset] ^= 0xF0
    whole[block.offset + 4] ^= 0xFF
    (tmp_path / "bad.mcap").write_bytes(whole if with_summary else whole[:end])
    report = recover(tmp_path / "bad.mcap", tmp_path / "out.mcap")
    assert report.messages == 600 - 25
    assert any(loss.offset == block.offset for loss in report.losses)


@pytest.mark.parametrize("with_summary", [True, False])
@pytest.mark.parametrize("place", range(9))
@pytest.mark.parametrize("bit", range(8))
def test_a_chunk_with_a_damaged_opcode_or_length_is_kept(
    tmp_path: Path, with_summary: bool, place: int, bit: int
) -> None:
    whole = bytearray(make(tmp_path / "log.mcap"))
    with LogReader(tmp_path / "log.mcap") as log:
        block, end = log.index.blocks[4], log.index.data_end.offset
    whole[block.offset + place] ^= 1 << bit
    (tmp_path / "bad.mcap").write_bytes(whole if with_summary else whole[:end])
    report = recover(tmp_path / "bad.mcap", tmp_path / "out.mcap")
    assert report.messages == 600
    assert any("which is damaged" in note.reason for note in report.notes)
    assert any("which is damaged" in f.text for f in examine(tmp_path / "bad.mcap"))


def test_heads_of_chunks_without_end_are_not_unpacked_again_and_again(
    tmp_path: Path,
) -> None:
    many, body = 1000, 40_000_000
    # Each says, with a wrong length of its record, that its data end where a record begins.
    packed = many * 49 + body
    head = struct.pack("<BQQQQIIQ", 6, 40, 0, 0, packed, 1, 0, packed)
    tail = struct.pack("<BQ", 7, len(head) - 9) + bytes(len(head) - 9)
    data = b"\x89MCAP0\r\n" + struct.pack("<BQII", 1, 8, 0, 0)
    path = tmp_path / "log.mcap"
    path.write_bytes(data + head * many + bytes(body) + tail * many)
    begun = process_time()
    recover(path, tmp_path / "out.mcap")
    assert process_time() - begun < 4


def test_a_first_chunk_lost_does_not_lose_the_channels(tmp_path: Path) -> None:
    whole = bytearray(make(tmp_path / "log.mcap"))
    with LogReader(tmp_path / "log.mcap") as log:
        first, second = log.index.blocks[:2]
        end = log.index.data_end.offset
    whole[first.offset + first.length - 5] ^= 1
    whole[second.offset + second.length - 5] ^= 1
    (tmp_path / "bad.mcap").write_bytes(whole)
    assert recover(tmp_path / "bad.mcap", tmp_path / "out.mcap").messages == 550
    (tmp_path / "worse.mcap").write_bytes(whole[:end])
    report = recover(tmp_path / "worse.mcap", tmp_path / "worse-out.mcap")
    assert report.messages == 0
    assert [loss.reason for loss in report.losses if loss.record == "Message"] == [
        "275 messages of channel 1, whose Channel record is lost",
        "275 messages of channel 2, whose Channel record is lost",
    ]


def test_messages_without_chunks_are_found_again_after_damage(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as stream:
        writer = mcap.writer.Writer(stream, use_chunking=False, enable_data_crcs=True)
        writer.start()
        channel = writer.register_channel("/a", "raw", 0)
        for k in range(100):
            writer.add_message(channel, k, b"%04d" % k * 10, k, k)
        writer.finish()
    whole = bytearray(path.read_bytes())
    place = whole.index(b"0050" * 10)
    whole[place - 25] = 0xEE  # in the length of message 50
    (tmp_path / "bad.mcap").write_bytes(whole)
    report = recover(tmp_path / "bad.mcap", tmp_path / "out.mcap")
    assert [m[1] for m in said(tmp_path / "out.mcap")] == [k for k in range(100) if k != 50]
    assert not report.is_complete
    whole = bytearray(path.read_bytes())
    whole[place] ^= 1
    (tmp_path / "wrong.mcap").write_bytes(whole)
    report = recover(tmp_path / "wrong.mcap", tmp_path / "out.mcap", force=True)
    assert report.messages == 100
    assert "CRC of the data section differs" in report.losses[0].reason


def test_flipped_bits_never_come_through_unsaid(tmp_path: Path) -> None:
    whole = make(tmp_path / "log.mcap")
    original = said(tmp_path / "log.mcap")
    random = Random(5)
    bad, out = tmp_path / "bad.mcap", tmp_path / "out.mcap"
    for _ in range(150):
        damaged = bytearray(whole)
        place = random.randrange(8, len(whole))
        damaged[place] ^= 1 << random.randrange(8)
        bad.write_bytes(damaged)
        report = recover(bad, out, force=True)
        got = said(out)
        assert set(got) <= set(original), place
        assert got == original or not report.is_complete, place
        assert len(got) >= len(original) - 25, place


def test_the_output_is_kept_and_is_never_the_input(tmp_path: Path) -> None:
    make(tmp_path / "log.mcap")
    (tmp_path / "out.mcap").write_text("precious")
    with pytest.raises(OutputExistsError):
        recover(tmp_path / "log.mcap", tmp_path / "out.mcap")
    with pytest.raises(RecordingError, match="never writes over the log that it reads"):
        recover(tmp_path / "log.mcap", tmp_path / "log.mcap", force=True)


@pytest.mark.parametrize("content", [b"", b"not a log at all, only text\n"])
def test_what_is_no_log_cannot_be_recovered(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad").write_bytes(content)
    with pytest.raises(RecordingError, match="nothing to recover"):
        recover(tmp_path / "bad", tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_doctor_names_what_is_wrong(tmp_path: Path) -> None:
    whole = make(tmp_path / "log.mcap")
    with LogReader(tmp_path / "log.mcap") as log:
        block, data_end = log.index.blocks[2], log.index.data_end
        attachment, metadata = log.index.attachments[0], log.index.metadata[0]
    places = {
        block.offset + block.length - 3: ("Chunk", "CRC|unpack"),
        block.offset + 9: ("Chunk", "states log times"),
        block.offset + block.length + 30: ("MessageIndex", "does not list"),
        attachment.offset + 60: ("Attachment", "CRC"),
        metadata.offset + 9: ("Metadata", "past the end of the record"),
        data_end.offset + 10: ("DataEnd", "CRC of the data section differs"),
        data_end.offset + 30: ("Footer", "summary's CRC"),
        8 + 9: ("Header", "past the end of the record"),
    }
    for place, (record, text) in places.items():
        damaged = bytearray(whole)
        damaged[place] ^= 0x40
        (tmp_path / "bad.mcap").write_bytes(damaged)
        found = examine(tmp_path / "bad.mcap")
        errors = [f for f in found if f.severity == "error" and f.record == record]
        assert errors, (place, record, found)
        assert any(re.search(text, f.text) for f in errors), (record, errors)
    (tmp_path / "bad.mcap").write_bytes(whole[:-20])
    assert any("cut short" in f.text for f in examine(tmp_path / "bad.mcap"))


def test_doctor_counts_what_goes_back_in_time(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as log:
        channel = log.channel("/a", None, "raw")
        for time in (5, 3, 7, 6):
            log.write(channel, b"", time)
    (finding,) = examine(tmp_path / "log.mcap")
    assert str(finding).startswith("warning: byte ")
    assert finding.text == "log time goes back 2 times on /a, here first"


def test_info_gives_sizes_and_counts(tmp_path: Path) -> None:
    whole = make(tmp_path / "log.mcap")
    info = inspect(tmp_path / "log.mcap")
    assert (info.size_bytes, info.message_count, info.is_indexed) == (len(whole), 600, True)
    assert (info.start_ns, info.end_ns, info.duration_ns) == (
        0,
        299 * 40_000_000,
        299 * 40_000_000,
    )
    assert [(c.topic, c.message_count) for c in info.channels] == [
        ("/image", 300),
        ("/small", 300),
    ]
    assert [(a.name, a.size_bytes, a.log_time_ns) for a in info.attachments] == [
        ("notes", 100, 1)
    ]
    assert info.metadata == [("scenetrace", {"tracker": "events"})]
    plain, zstd = sorted(info.compression, key=lambda c: c.compression)
    assert (plain.compression, plain.chunks, zstd.compression, zstd.chunks) == (
        "",
        12,
        "zstd",
        12,
    )
    assert plain.stored_bytes == plain.unpacked_bytes
    assert zstd.stored_bytes < zstd.unpacked_bytes
    assert plain.unpacked_bytes + zstd.unpacked_bytes > 300 * 231


def test_a_wrong_count_in_the_statistics_is_noticed(tmp_path: Path) -> None:
    """Statistics and their CRC made wrong on purpose: reading everything notices it."""
    whole = bytearray(make(tmp_path / "log.mcap"))
    with LogReader(tmp_path / "log.mcap") as log:
        start, footer = log.index.footer.summary_start, log.index.footer_offset
    place = whole.index(struct.pack("<QHI", 600, 2, 2), start)
    whole[place : place + 8] = struct.pack("<Q", 601)
    counts = whole.index(struct.pack("<HQ", 1, 300), place)
    whole[counts + 2 : counts + 10] = struct.pack("<Q", 301)
    whole[footer + 25 : footer + 29] = struct.pack(
        "<I", zlib.crc32(whole[start : footer + 25])
    )
    (tmp_path / "bad.mcap").write_bytes(whole)
    with (
        LogReader(tmp_path / "bad.mcap") as log,
        pytest.raises(RecordingError, match=r"count 601 .* holds 600"),
    ):
        list(log.messages())
    assert [f.record for f in examine(tmp_path / "bad.mcap") if f.severity == "error"] == [
        "Statistics"
    ] * 2
