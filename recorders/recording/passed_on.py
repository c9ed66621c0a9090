"""What a log of others holds beside pictures and detections: passed on as it is."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from recorders import channels
from recorders.left_out import LeftOut
from recorders.log import LogWriter, Message
from recorders.recording.scene_writer import OWN_RECORDS
from recorders.sources.source import LoggedSource, Source


class Others:
    """Messages of other topics, byte for byte, with their times and sequence numbers; then
    attachments and metadata records.
    """

    def __init__(self, log: LogWriter, source: Source, cameras: Collection[str]) -> None:
        self._log = log
        self._reserved = {
            channels.topic(camera, name)
            for camera in cameras
            for name in (*channels.RECORDED, *channels.ANNOTATED)
        }
        self._left_out = LeftOut()
        self._source = source if isinstance(source, LoggedSource) else None
        self._messages: Iterator[Message] | None = None
        self._ahead: Message | None = None
        self._ids: dict[str, int] = {}

    def write_until(self, time_ns: int) -> None:
        """Everything up to a log time."""
        if self._source is None:
            return
        if self._messages is None:
            self._messages = self._source.others()
            self._ahead = next(self._messages, None)
        while self._ahead is not None and self._ahead.log_time_ns <= time_ns:
            self._write(self._ahead)
            self._ahead = next(self._messages, None)

    def write_rest(self) -> None:
        """Everything that is left."""
        if self._source is None:
            return
        self.write_until(1 << 64)
        for attachment in self._source.attachments():
            if attachment.name not in OWN_RECORDS:
                self._log.attach(
                    attachment.name,
                    attachment.media_type,
                    attachment.data,
                    attachment.log_time_ns,
                    attachment.create_time_ns,
                )
        for name, values in self._source.metadata():
            if name not in OWN_RECORDS:
                self._log.metadata(name, values)

    def _write(self, message: Message) -> None:
        channel = message.channel
        if channel.topic in self._reserved:
            self._left_out.note(
                f"a message of {channel.topic}, a topic of the recording's own (--camera names it)",
                f"{message.log_time_ns} ns",
            )
            return
        key = repr(
            (
                channel.topic,
                channel.schema,
                channel.message_encoding,
                sorted(channel.metadata.items()),
            )
        )
        if key not in self._ids:
            self._ids[key] = self._log.channel(
                channel.topic,
                channel.schema,
                channel.message_encoding,
                channel.metadata,
                picture=_is_large(message),
            )
        self._log.write(
            self._ids[key],
            message.data,
            message.log_time_ns,
            message.publish_time_ns,
            message.sequence,
        )

    def losses(self) -> list[str]:
        """What was not passed on though it should have been."""
        return self._left_out.lines()

    def close(self) -> None:
        """Give back what is open."""
        close = getattr(self._messages, "close", None)
        if close is not None:
            close()


_LARGE_BYTES = 1 << 14


def _is_large(message: Message) -> bool:
    """Whether a channel goes with the pictures, out of the way of those who read detections."""
    return len(message.data) > _LARGE_BYTES
