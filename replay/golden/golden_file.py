"""A golden file: what an annotated log says happened, small enough to lie beside a test.

It is an annotated log with tracks, relations, groups and events alone: no recording, no pictures,
no digests.
"""

from __future__ import annotations

from pathlib import Path

from recorders import channels
from recorders.annotated.provenance import GOLDEN, METADATA, provenance_of
from recorders.log import LogReader, LogWriter

STORY = ("tracks", "relations", "groups", "events")


def write_story(annotated: str | Path, out: str | Path) -> None:
    """Write the story of an annotated log, over an older one.

    Raises:
        RecordingError: not an annotated log, or ``out`` cannot be written.
    """
    with LogReader(annotated) as log:
        facts = provenance_of(log)
        topics = [channels.topic(facts.camera, name) for name in STORY]
        # One chunk, if it fits: it compresses best.
        with LogWriter(
            out, force=True, flush_interval_ns=1 << 62, chunk_bytes=4 << 20
        ) as writer:
            ids = {
                channel.id: writer.channel(
                    channel.topic,
                    channel.schema,
                    channel.message_encoding,
                    channel.metadata,
                )
                for channel in log.channels
                if channel.topic in topics
            }
            for message in log.messages(topics):
                writer.write(
                    ids[message.channel.id],
                    message.data,
                    message.log_time_ns,
                    message.publish_time_ns,
                    message.sequence,
                )
            writer.metadata(METADATA, facts.values)
            writer.metadata(GOLDEN, {"channels": ",".join(STORY)})
