"""Where targets stood on the ground, in metres, for 3D panels: foxglove.SceneUpdate in a log."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from reasoning.questions import Case
from reasoning.questions.metres import GroundPlane
from recorders import channels
from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.log import LogWriter
from replay.palette import track_colour

FRAME = "ground"
"""The coordinate frame: X and Y as the points say, Z upwards, in metres."""
_BODY_M, _WIDE_M = 1.7, 0.5
_LINE_M, _LETTERS_M = 0.05, 0.4
Places = dict[int, tuple[float, float]]


def write_scene3d(
    log: AnnotatedLog, out: str | Path, ground: GroundPlane, *, force: bool = False
) -> int:
    """Write a log with ``/<camera>/ground``: a cylinder with its id for each present target, lines
    between those that are related, each frame in place of the one before. Returns the frames.

    Args:
        log: the annotated log.
        out: the log to write.
        ground: how pixels become metres.
        force: overwrite an existing output.

    Raises:
        UsageError: the points say nothing, or too few people are seen to tell a scale by.
        OutputExistsError: ``out`` exists and ``force`` is not set.
    """
    places = _places(log, ground)
    body = ground.height_m or _BODY_M
    count = 0
    with LogWriter(out, force=force) as writer:
        schema = channels.protobuf_schema(SceneUpdate)
        topic = channels.topic(log.camera, FRAME)
        channel = writer.channel(topic, schema, "protobuf")
        for frame in log.frames(("tracks", "relations")):
            update = _update(frame, places.get(frame.index, {}), body)
            data = update.SerializeToString(deterministic=True)
            writer.write(channel, data, frame.time_ns)
            count += 1
    return count


def _places(log: AnnotatedLog, ground: GroundPlane) -> dict[int, Places]:
    """X and Y of each target by frame."""
    found: dict[int, Places] = defaultdict(dict)
    with Case([log.path], ground=ground, log_limits=log.limits) as case:
        rows: Sequence[tuple[Any, ...]] = case.rows(
            "SELECT m.frame, m.track, m.x_m, m.y_m FROM metres m"
            " JOIN recordings r USING (recording) WHERE r.camera = ? AND m.x_m IS NOT NULL"
            " ORDER BY m.frame, m.track",
            [log.camera],
        )
        for frame, track, x, y in rows:
            found[frame][track] = x, y
    return found


def _update(frame: AnnotatedFrame, places: Places, body: float) -> SceneUpdate:
    update = SceneUpdate()
    entity = update.entities.add()
    entity.timestamp.FromNanoseconds(frame.time_ns)
    entity.frame_id, entity.id = FRAME, "targets"
    for track, (x, y) in _present(frame, places):
        red, green, blue = track_colour(track)
        cylinder = entity.cylinders.add(top_scale=1, bottom_scale=1)
        cylinder.pose.position.x, cylinder.pose.position.y = x, y
        cylinder.pose.position.z = body / 2
        cylinder.pose.orientation.w = 1
        size = cylinder.size
        size.x, size.y, size.z = _WIDE_M, _WIDE_M, body
        _paint(cylinder.color, red, green, blue, 0.8)
        text = entity.texts.add(billboard=True, font_size=_LETTERS_M, text=str(track))
        text.pose.position.x, text.pose.position.y = x, y
        text.pose.position.z = body + _LETTERS_M
        text.pose.orientation.w = 1
        _paint(text.color, red, green, blue, 1)
    for relation in frame.relations:
        ends = [places.get(one) for one in (relation.a, relation.b)]
        line = entity.lines.add(type=0, thickness=_LINE_M)
        line.pose.orientation.w = 1
        joint = relation.state == "JOINT"
        _paint(line.color, 1.0, 0.2 if joint else 0.7, 0.2, 1)
        for end in ends:
            if end is not None:
                line.points.add(x=end[0], y=end[1], z=body / 2)
        if len(line.points) < 2:
            del entity.lines[-1]
    return update


def _present(
    frame: AnnotatedFrame, places: Places
) -> Iterator[tuple[int, tuple[float, float]]]:
    for track in frame.tracks:
        if track.present and track.id in places:
            yield track.id, places[track.id]


def _paint(colour: Any, red: float, green: float, blue: float, alpha: float) -> None:
    colour.r, colour.g, colour.b, colour.a = red, green, blue, alpha
