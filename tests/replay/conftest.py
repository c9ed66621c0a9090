"""Small annotated logs, written message by message, so that readers are tested without a replay."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recorders import channels
from recorders.log import LogWriter
from recorders.messages import (
    Detections,
    Event,
    Group,
    Groups,
    Regions,
    Relation,
    Relations,
    RelationState,
    Track,
    Tracks,
    Zone,
)
from recorders.pictures import encode_jpeg, encode_mask

SIZE = (160, 120)
FRAME_NS = 100_000_000
START_NS = 5_000_000_000
FRAMES = 30

Writer = Callable[..., Path]


def track(identity: int, x: float, y: float, **facts: Any) -> Track:
    """A track of 20 x 40 pixels, single and plain unless told."""
    plain: dict[str, Any] = {
        "ellipse": None, "velocity": (10.0, 0.0), "shell_radius": 24.0, "mode": "motion", "confidence": 0.9,
        "present": True, "observed": True, "blob": -1, "grouping": False, "grouped": False, "splitting": False,
        "grouping_partners": [], "grouped_partners": [], "splitting_partners": [], "group": None, "scene": "inside",
    }  # fmt: skip
    return Track(id=identity, box=(x, y, 20.0, 40.0), **{**plain, **facts})


def scene_of(frame: int) -> dict[str, Any]:
    """Two people who meet: 1 from the left, 2 from the right, JOINT in frames 12 to 17; 3 is
    never present.
    """
    near, joint = 8 <= frame < 22, 12 <= frame < 18
    tracks = [
        track(1, 10.0 + 2 * frame, 40.0),
        track(2, 130.0 - 2 * frame, 42.5, group=7 if joint else None),
    ]
    if frame >= 20:
        tracks.append(track(3, 5.0, 5.0, present=False, mode="predicted"))
    state: RelationState = "JOINT" if joint else "INTERACTION"
    since = 12 if joint else (8 if frame < 12 else 18)
    edges = (
        [
            Relation(
                1,
                2,
                state,
                since,
                START_NS + since * FRAME_NS,
                not joint,
                joint,
                False,
                0.5,
            )
        ]
        if near
        else []
    )
    groups = [Group(7, [1, 2], True, 12, START_NS + 12 * FRAME_NS)] if joint else []
    events = []
    if frame in (8, 12):
        kind = "interaction_started" if frame == 8 else "joined"
        now = START_NS + frame * FRAME_NS
        events = [
            Event(
                1 + (frame == 12),
                kind,
                [1, 2],
                frame,
                now,
                "SHELLS III",
                {"overlap": 0.5},
                f"1 and 2: {kind}",
            )
        ]
    return {"tracks": tracks, "relations": edges, "groups": groups, "events": events}


@pytest.fixture
def write_annotated(tmp_path: Path) -> Writer:
    """Write an annotated log of `scene_of`."""

    def write(
        name: str = "annotated.mcap",
        frames: range = range(FRAMES),
        pictures: bool = True,
        recorded: bool = True,
        membership: bool = False,
        cameras: tuple[str, ...] = ("camera",),
    ) -> Path:
        path = tmp_path / name
        with LogWriter(path) as log:
            for camera in cameras:
                _write_camera(log, camera, frames, pictures, recorded, membership)
            log.metadata(
                "scenetrace",
                {"tracker": "events", "camera": cameras[0], "output_digest": "ab" * 32},
            )
        return path

    return write


def _write_camera(
    log: LogWriter,
    camera: str,
    frames: range,
    pictures: bool,
    recorded: bool,
    membership: bool,
) -> None:
    names = ["tracks", "relations", "groups", "events"]
    names += ["detections", "regions"] if recorded else []
    names += ["image"] if pictures and recorded else []
    names += ["membership"] if membership else []
    ids = {
        n: log.channel(
            channels.topic(camera, n), channels.schema(n), channels.message_encoding(n)
        )
        for n in names
    }
    w, h = SIZE

    def put(name: str, payload: bytes, now: int) -> None:
        if name in ids:
            log.write(ids[name], payload, now)

    for frame in frames:
        now = START_NS + frame * FRAME_NS
        if frame == frames[0]:
            square = [(20.0, 20.0), (140.0, 20.0), (140.0, 100.0), (20.0, 100.0)]
            outer = [(10.0, 10.0), (150.0, 10.0), (150.0, 110.0), (10.0, 110.0)]
            put(
                "regions",
                channels.encode(
                    "regions", Regions(w, h, [square], [outer], [Zone("door", square)])
                ),
                now,
            )
        picture = np.full((h, w, 3), 60 + 4 * frame, np.uint8)
        put(
            "image",
            channels.compressed_image(encode_jpeg(picture), "jpeg", now, camera),
            now,
        )
        put("detections", channels.encode("detections", Detections(frame, w, h)), now)
        scene = scene_of(frame)
        put("tracks", channels.encode("tracks", Tracks(frame, scene["tracks"])), now)
        put(
            "relations",
            channels.encode("relations", Relations(frame, scene["relations"])),
            now,
        )
        put("groups", channels.encode("groups", Groups(frame, scene["groups"])), now)
        for event in scene["events"]:
            put("events", channels.encode("events", event), now)
        owned = np.zeros((h, w), np.uint8)
        owned[40:80, 10 + 2 * frame : 30 + 2 * frame] = 2
        put(
            "membership",
            channels.compressed_image(encode_mask(owned), "png", now, camera),
            now,
        )
