"""``replay --init``: targets started by hand, checked against the recording before and after."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from recorders.errors import UsageError
from recorders.parameters import Config

if TYPE_CHECKING:
    from recorders.scene import SceneLog
    from replay.annotated_writer import ReplaySummary


def check_starts(config: Config, scene: SceneLog, frames: int | None) -> list[int]:
    """Refuse starts that the recording cannot hold.

    Args:
        config: the configuration; ``parts.init`` holds the starts.
        scene: the recording.
        frames: how many frames it has, if known.

    Returns:
        The frames in which a target is started by hand.

    Raises:
        UsageError: a start after the last frame, or of a box that is no body in this picture.
    """
    parts = config.get("parts")
    if parts is None:
        return []
    from replay.trackers.parts.parameters import PartsParameters

    if not isinstance(parts, PartsParameters):
        return []
    from replay.trackers.parts.beginning import parse_init

    width, height = scene.info.width, scene.info.height
    starts = parse_init(parts.init)
    for start in starts:
        x, y, w, h = start.box
        words = f"--init frame:{start.frame}:{x:g},{y:g},{w:g},{h:g}"
        if frames is not None and start.frame >= frames:
            held = f"frames 0 to {frames - 1}" if frames else "no frames"
            raise UsageError(f"{words}: the recording has {held}")
        if not (0 <= x + w / 2 < width and 0 <= y + h / 2 < height):
            raise UsageError(
                f"{words}: its middle lies outside of the picture of {width}x{height}"
                " pixels"
            )
        if w < 2 or h < 4 or w > 2 * width or h > 2 * height:
            raise UsageError(
                f"{words}: not the size of anybody in a picture of {width}x{height} pixels"
            )
    return [start.frame for start in starts]


def missed(starts: Sequence[int], done: ReplaySummary) -> str:
    """What to say of starts that were never found; empty if there is nothing to say.

    Args:
        starts: the frames of the targets started by hand.
        done: the replay, whatever span of it was written.
    """
    before = -1 if done.resumed is None else done.resumed
    # Who starts in the very last frame cannot have been found after it.
    asked = sum(before < frame < before + done.computed for frame in starts)
    if done.found >= asked:
        return ""
    found = "none" if not done.found else f"{done.found}"
    return (
        f"{found} of {asked} targets started by hand were found: is somebody in each box in"
        " its very frame?"
    )
