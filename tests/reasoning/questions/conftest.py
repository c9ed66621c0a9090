"""Small annotated logs written message by message, so that these tests need no tracker."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from fixtures.scenes import GeneratedScene, generate
from fixtures.targets import truth_targets
from reasoning.reasoner import Reasoner
from recorders import channels
from recorders.log import LogWriter
from recorders.messages import (
    Detections,
    Event,
    Group,
    Groups,
    Relation,
    Relations,
    RelationState,
    Track,
    Tracks,
)

FRAME_NS = 40_000_000
Box = tuple[float, float, float, float]


@dataclass
class Story:
    """What happens in a recording: all intervals are closed frames.

    ``tracks``: id to (first, last, box at first, velocity in px per frame); ``relations``: (a, b,
    state, first, last); ``groups``: (label, members, first, last, formed_from); ``events``:
    (kind, subjects, frame, groups, evidence); ``zones``: (track, zone, first, last); ``bits``:
    (track, bit, partners, first, last); ``hidden``: (track, part, first, last).
    """

    frames: int
    tracks: Mapping[int, tuple[int, int, Box, tuple[float, float]]] = field(
        default_factory=dict
    )
    relations: Sequence[tuple[int, int, RelationState, int, int]] = ()
    groups: Sequence[tuple[int, list[int], int, int, list[int]]] = ()
    events: Sequence[tuple[str, list[int], int, list[int], dict]] = ()
    zones: Sequence[tuple[int, str, int, int]] = ()
    bits: Sequence[tuple[int, str, list[int], int, int]] = ()
    hidden: Sequence[tuple[int, str, int, int]] = ()
    start_ns: int = 1_700_000_000_000_000_000
    camera: str = "camera"
    frame_ns: int = FRAME_NS

    def _track(self, i: int, n: int) -> Track:
        first, _, (x, y, w, h), (vx, vy) = self.tracks[i]
        bits = {b: p for t, b, p, s, e in self.bits if t == i and s <= n <= e}
        label = next((g for g, m, s, e, _ in self.groups if i in m and s <= n <= e), None)
        return Track(
            id=i, box=(x + vx * (n - first), y + vy * (n - first), w, h), ellipse=None, velocity=(vx * 25, vy * 25),
            shell_radius=h, mode="motion", confidence=0.9, present=True, observed=True, blob=-1,
            grouping="grouping" in bits, grouped="grouped" in bits, splitting="splitting" in bits,
            grouping_partners=bits.get("grouping", []), grouped_partners=bits.get("grouped", []),
            splitting_partners=bits.get("splitting", []), group=label, scene="inside",
            zones=[z for t, z, s, e in self.zones if t == i and s <= n <= e],
            hidden_parts=[p for t, p, s, e in self.hidden if t == i and s <= n <= e],
        )  # fmt: skip

    def frame(self, n: int) -> list[tuple[str, object]]:
        tracks = [
            self._track(i, n)
            for i, (s, e, *_) in sorted(self.tracks.items())
            if s <= n <= e
        ]
        relations = [
            Relation(
                a,
                b,
                state,
                s,
                self.start_ns + s * self.frame_ns,
                False,
                state == "JOINT",
                False,
                0.5,
                "SHELLS 2.3 II",
            )
            for a, b, state, s, e in sorted(self.relations)
            if s <= n <= e
        ]
        groups = [
            Group(g, m, True, s, self.start_ns + s * self.frame_ns, f)
            for g, m, s, e, f in sorted(self.groups)
            if s <= n <= e
        ]
        out: list[tuple[str, object]] = [
            ("detections", Detections(n, 640, 480)),
            ("tracks", Tracks(n, tracks)),
            ("relations", Relations(n, relations)),
            ("groups", Groups(n, groups)),
        ]
        for k, (kind, subjects, frame, labels, evidence) in enumerate(self.events, 1):
            if frame == n:
                time_ns = self.start_ns + n * self.frame_ns
                out.append(
                    (
                        "events",
                        Event(
                            k,
                            kind,
                            subjects,
                            n,
                            time_ns,
                            "EVENTS 3.1",
                            evidence,
                            f"{kind} {subjects}",
                            labels,
                        ),
                    )
                )
        return out


def write(story: Story, path: Path, first: int = 0) -> Path:
    with LogWriter(path) as log:
        names = ("detections", "tracks", "relations", "groups", "events")
        ids = {
            n: log.channel(
                channels.topic(story.camera, n),
                channels.schema(n),
                channels.message_encoding(n),
            )
            for n in names
        }
        for n in range(first, story.frames):
            for name, message in story.frame(n):
                log.write(
                    ids[name],
                    channels.encode(name, message),
                    story.start_ns + n * story.frame_ns,
                )
        log.metadata(
            "scenetrace", {"tracker": "events", "output_digest": f"digest-of-{path.stem}"}
        )
    return path


MEETING = Story(
    frames=300,
    tracks={
        1: (0, 299, (100.0, 100.0, 30.0, 80.0), (0.5, 0.0)),
        2: (10, 250, (340.0, 100.0, 30.0, 80.0), (-0.3, 0.0)),
        3: (50, 280, (300.0, 250.0, 30.0, 80.0), (0.0, 0.0)),
        4: (150, 299, (310.0, 330.0, 30.0, 80.0), (0.0, 0.0)),
    },
    relations=[
        (1, 2, "INTERACTION", 40, 99), (1, 2, "JOINT", 100, 149), (1, 2, "INTERACTION", 150, 179),
        (2, 3, "INTERACTION", 170, 200), (3, 4, "INTERACTION", 150, 169), (3, 4, "JOINT", 170, 240),
    ],
    groups=[(1, [1, 2], 100, 149, []), (2, [3, 4], 170, 200, []), (3, [2, 3, 4], 201, 240, [2])],
    events=[
        ("entered", [1], 5, [], {}), ("entered", [2], 20, [], {}),
        ("interaction_started", [1, 2], 40, [], {"overlap": 0.2}),
        ("joined", [1, 2], 100, [], {}), ("group_formed", [1, 2], 100, [1], {}), ("group_ended", [1, 2], 150, [1], {}),
        ("group_formed", [3, 4], 170, [2], {}), ("group_changed", [2, 3, 4], 201, [2, 3], {"old": [3, 4]}),
        ("group_ended", [2, 3, 4], 241, [3], {}), ("entered", [3], 60, [], {}), ("entered", [4], 155, [], {}),
        ("exited", [2], 250, [], {"outside": 1.0}), ("exited", [3], 280, [], {}),
    ],
    zones=[(1, "door", 0, 50), (3, "bench", 60, 279), (4, "bench", 160, 200), (1, "bench", 210, 215)],
    bits=[
        (2, "grouping", [1], 40, 99), (2, "grouped", [1], 100, 149), (2, "splitting", [1], 150, 179),
        (2, "grouping", [3], 170, 200),
    ],
    hidden=[(2, "left_legs", 110, 120), (2, "left_legs", 130, 131), (2, "head", 111, 111), (3, "head", 180, 190)],
)  # fmt: skip


@pytest.fixture(scope="session")
def story_type() -> type[Story]:
    return Story


@pytest.fixture(scope="session")
def write_story() -> Callable[..., Path]:
    return write


@pytest.fixture(scope="session")
def meeting_story() -> Story:
    return MEETING


@pytest.fixture(scope="session")
def meeting_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(MEETING, tmp_path_factory.mktemp("questions") / "meeting.mcap")


CHANNELS = ("regions", "tracks", "relations", "groups", "events")


def write_played(scene: GeneratedScene, path: Path) -> Path:
    reasoner = Reasoner({}, scene.width, scene.height)
    with LogWriter(path) as log:
        ids = {
            n: log.channel(
                channels.topic("camera", n),
                channels.schema(n),
                channels.message_encoding(n),
            )
            for n in CHANNELS
        }
        for targets in truth_targets(scene):
            ns = targets.frame * scene.frame_ns
            made = reasoner.step(targets.frame, ns, targets, scene.truth.regions)
            messages = [
                *([("regions", scene.truth.regions)] if targets.frame == 0 else []),
                ("tracks", made.tracks),
                ("relations", made.relations),
                ("groups", made.groups),
            ]
            for name, message in [*messages, *(("events", e) for e in made.events)]:
                log.write(ids[name], channels.encode(name, message), ns)
    return path


@pytest.fixture(scope="session")
def played(
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[[str], tuple[GeneratedScene, Path]]:
    """A scene and its annotated log by name, made once in whatever order the tests run."""
    folder = tmp_path_factory.mktemp("scripted")
    made: dict[str, tuple[GeneratedScene, Path]] = {}

    def play(name: str) -> tuple[GeneratedScene, Path]:
        if name not in made:
            scene = generate(name)
            made[name] = scene, write_played(scene, folder / f"{name}.mcap")
        return made[name]

    return play


@pytest.fixture(scope="session")
def write_scene() -> Callable[[GeneratedScene, Path], Path]:
    return write_played
