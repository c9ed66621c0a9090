"""A small scene and what is made of it: two people who walk past each other, as boxes."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

from recorders.log import LogReader, LogWriter, Schema
from replay.cli import main

WORDS = ("--fps", "25", "--size", "640x480")


def memory() -> str | None:
    """A folder in memory for temporary files, where the system has one: nothing waits for a disk."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None


def run(*words: str) -> tuple[int, str]:
    """A command's exit code and what it said on stderr."""
    said = StringIO()
    with redirect_stderr(said), redirect_stdout(StringIO()):
        code = main([str(word) for word in words])
    return code, said.getvalue()


def boxes(path: Path, frames: int = 12) -> Path:
    """Detections of two people."""
    step = max(1, min(12, 144 // frames))
    lines = [
        f"{frame},-1,{x + speed * frame},200,40,100,1,-1,-1,-1"
        for frame in range(1, frames + 1)
        for x, speed in ((150, step), (400, -step))
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


def annotated(
    folder: Path,
    compression: str = "zstd",
    frames: int = 12,
    chunk_ns: int = 1_000_000_000,
    settings: Sequence[str] = (),
    *,
    bare: bool = False,
) -> Path:
    """An annotated log with this compression of its chunks, each of which spans `chunk_ns`.

    Bare, without the text of its schemas, it is half as large, and read alike.
    """
    det, scene, made = folder / "det.txt", folder / "scene.mcap", folder / "made.mcap"
    boxes(det, frames)
    assert run("record", str(det), "-o", str(scene), *WORDS, "--force")[0] == 0
    words = [word for setting in settings for word in ("--set", setting)]
    assert run("replay", str(scene), "-o", str(made), "--force", *words)[0] == 0
    out = folder / f"annotated-{compression or 'plain'}.mcap"
    with (
        LogReader(made) as log,
        LogWriter(out, compression=compression, flush_interval_ns=chunk_ns) as writer,
    ):
        channels = {
            channel.id: writer.channel(
                channel.topic,
                _named(channel.schema) if bare else channel.schema,
                channel.message_encoding,
                channel.metadata,
            )
            for channel in log.channels
        }
        for m in log.messages():
            writer.write(
                channels[m.channel.id], m.data, m.log_time_ns, m.publish_time_ns, m.sequence
            )
        for extra in log.attachments():
            writer.attach(
                extra.name,
                extra.media_type,
                extra.data,
                extra.log_time_ns,
                extra.create_time_ns,
            )
        for name, values in log.metadata():
            writer.metadata(name, values)
    return out


def _named(schema: Schema | None) -> Schema | None:
    return None if schema is None else Schema(schema.name, schema.encoding, b"{}")


def said(*words: str) -> tuple[int, str]:
    """A command's exit code and what it answered on stdout."""
    answer = StringIO()
    with redirect_stderr(StringIO()), redirect_stdout(answer):
        code = main([str(word) for word in words])
    return code, answer.getvalue()
