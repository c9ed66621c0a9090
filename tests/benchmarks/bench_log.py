"""Log writing and reading against the `mcap` package's own writer and reader, paired in one
process.

Run: ``python tests/benchmarks/bench_log.py``
"""

from __future__ import annotations

import gc
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from random import Random

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from recorders.log import LogReader, LogWriter, Schema

SMALL = 200_000
PICTURES = 600
ROUNDS = 3
PICTURE_BYTES = 100_000


def payloads() -> tuple[list[bytes], list[bytes]]:
    """Small messages of 100 bytes that compress, pictures that do not."""
    random = Random(1)
    pictures = [random.randbytes(PICTURE_BYTES) for _ in range(PICTURES)]
    return [(b'{"frame": %d, "boxes": []}' % k).ljust(100) for k in range(SMALL)], pictures


def write_ours(path: Path, small: list[bytes], pictures: list[bytes]) -> None:
    every = len(small) // max(len(pictures), 1)
    with LogWriter(path, force=True, picture_topics={"/camera/image"}) as log:
        picture = log.channel("/camera/image", None, "jpeg")
        detections = log.channel(
            "/camera/detections", Schema("d", "jsonschema", b"{}"), "json"
        )
        for k, data in enumerate(small):
            if pictures and k % every == 0 and k // every < len(pictures):
                log.write(picture, pictures[k // every], k * 100_000)
            log.write(detections, data, k * 100_000)


def write_peer(path: Path, small: list[bytes], pictures: list[bytes]) -> None:
    every = len(small) // max(len(pictures), 1)
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start()
        schema = writer.register_schema("d", "jsonschema", b"{}")
        picture = writer.register_channel("/camera/image", "jpeg", 0)
        detections = writer.register_channel("/camera/detections", "json", schema)
        for k, data in enumerate(small):
            if pictures and k % every == 0 and k // every < len(pictures):
                writer.add_message(
                    picture, k * 100_000, pictures[k // every], k * 100_000, k
                )
            writer.add_message(detections, k * 100_000, data, k * 100_000, k)
        writer.finish()


def read_ours(path: Path, topics: list[str] | None = None) -> int:
    with LogReader(path) as log:
        return sum(1 for _ in log.messages(topics))


def read_peer(path: Path, topics: list[str] | None = None) -> int:
    with path.open("rb") as stream:
        return sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages(topics))


def seconds(call: Callable[[], object]) -> float:
    """Of processor, over all threads: other load disturbs the clock."""
    gc.collect()
    start = time.process_time()
    call()
    return time.process_time() - start


def compare(
    name: str, count: int, ours: Callable[[], object], peer: Callable[[], object]
) -> None:
    """Best of some rounds each, taken in turns."""
    times = [(seconds(ours), seconds(peer)) for _ in range(ROUNDS)]
    mine, theirs = min(t[0] for t in times), min(t[1] for t in times)
    print(
        f"{name:44} {count / mine:12,.0f}/s   mcap {count / theirs:12,.0f}/s   ratio"
        f" {theirs / mine:6.2f}"
    )


def main() -> None:
    """Print messages per second and the ratio to the peer (above 1: faster)."""
    small, pictures = payloads()
    with tempfile.TemporaryDirectory() as folder:
        ours, peer = Path(folder, "ours.mcap"), Path(folder, "peer.mcap")
        compare(
            "write small",
            SMALL,
            lambda: write_ours(ours, small, []),
            lambda: write_peer(peer, small, []),
        )
        compare("read small", SMALL, lambda: read_ours(ours), lambda: read_peer(peer))
        compare(
            "read small, file of the peer",
            SMALL,
            lambda: read_ours(peer),
            lambda: read_peer(peer),
        )
        total = SMALL + PICTURES
        compare(
            "write with pictures", total, lambda: write_ours(ours, small, pictures),
            lambda: write_peer(peer, small, pictures),
        )  # fmt: skip
        compare(
            "read all, with pictures",
            total,
            lambda: read_ours(ours),
            lambda: read_peer(peer),
        )
        only = ["/camera/detections"]
        compare(
            "read detections beside pictures",
            SMALL,
            lambda: read_ours(ours, only),
            lambda: read_peer(peer, only),
        )
        print(f"file sizes: {ours.stat().st_size:,} against {peer.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
