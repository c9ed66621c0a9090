"""Which camera of a log is read as a scene."""

from __future__ import annotations

from recorders import channels
from recorders.errors import RecordingError, UsageError
from recorders.log import ChannelInfo, LogReader


def _may_be_ours(channel: ChannelInfo) -> bool:
    return channel.message_encoding in ("json", "")


def choose_camera(log: LogReader, wanted: str | None) -> str:
    """The camera that is wanted, else the only one.

    Raises:
        RecordingError: no detections.
        UsageError: no such camera, or several to choose from.
    """
    cameras = sorted(
        {
            c
            for c, name in (
                channels.split(channel.topic)
                for channel in log.channels
                if _may_be_ours(channel)
            )
            if c and name == "detections"
        }
    )
    if wanted is not None:
        if wanted not in cameras:
            raise UsageError(
                f"{log.path}: no camera {wanted!r}; it has: {', '.join(cameras) or 'none'}"
            )
        return wanted
    if not cameras:
        topics = (
            ", ".join(channel.topic[:60] for channel in log.channels[:6])
            or "no channels at all"
        )
        raise RecordingError(
            "no detections to replay (a channel /<camera>/detections in JSON); it holds"
            f" {topics}. Make a scene log of a video, or of another log's pictures and"
            " detections, with `scenetrace record SOURCE -o scene.mcap`",
            log.path,
        )
    if len(cameras) > 1:
        raise UsageError(
            f"{log.path}: several cameras ({', '.join(cameras)}); choose one with --camera"
        )
    return cameras[0]
