"""A log's messages moment by moment: what belongs to one frame has one log time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from recorders.errors import LimitError
from recorders.limits import Limits
from recorders.log.model import Message


def by_time(
    messages: Iterable[Message], limits: Limits, path: Path
) -> Iterator[tuple[int, list[Message]]]:
    """Log time in ns and the messages of that time, in the order in which they come.

    Raises:
        LimitError: more messages at one time than the limits allow.
    """
    group: list[Message] = []
    for message in messages:
        if group and message.log_time_ns != group[0].log_time_ns:
            yield group[0].log_time_ns, group
            group = []
        group.append(message)
        if len(group) > limits.max_messages_per_frame:
            raise LimitError(
                f"over {limits.max_messages_per_frame} messages at {message.log_time_ns} ns;"
                f" --limit max_messages_per_frame={10 * limits.max_messages_per_frame}"
                " allows more",
                path,
            )
    if group:
        yield group[0].log_time_ns, group
