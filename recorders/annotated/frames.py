"""The annotated messages of a log moment by moment, not yet decoded: what every reading of an
annotated log begins with.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import NamedTuple

from recorders import channels
from recorders.log import LogReader, Message
from recorders.log.moments import by_time


class Instant(NamedTuple):
    """The messages of one log time.

    Attributes:
        time_ns: the log time.
        annotated: channel and message of the camera's annotation, in the log's order.
        recorded: the other messages, in the log's order; empty where they were not asked for.
    """

    time_ns: int
    annotated: list[tuple[str, Message]]
    recorded: list[Message]


def annotated_cameras(log: LogReader) -> list[str]:
    """The cameras that have tracks, sorted."""
    topics = [channels.split(channel.topic) for channel in log.channels]
    return sorted({camera for camera, name in topics if camera and name == "tracks"})


def instants(
    log: LogReader,
    camera: str,
    names: Collection[str] = channels.ANNOTATED,
    *,
    with_recorded: bool = False,
    start_ns: int | None = None,
    end_ns: int | None = None,
) -> Iterator[Instant]:
    """The moments of a log at which there is a message that was asked for, in order.

    Args:
        log: an annotated log.
        camera: whose annotation.
        names: the channels that count as annotated.
        with_recorded: give all other messages, too.
        start_ns: the first log time that is read.
        end_ns: the first one that no longer is.

    Raises:
        LimitError: more messages at one time than the limits allow.
    """
    named = {channels.topic(camera, name): name for name in names}
    wanted = [channel.topic for channel in log.channels if channel.topic in named]
    messages = log.messages(None if with_recorded else wanted, start_ns, end_ns)
    for time_ns, group in by_time(messages, log.limits, log.path):
        annotated = [(named[m.topic], m) for m in group if m.topic in named]
        recorded = [m for m in group if m.topic not in named]
        yield Instant(time_ns, annotated, recorded)
