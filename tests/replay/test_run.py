"""Replays: the recording passes through untouched, spans equal the whole, time travel changes
nothing.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace as changed
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from recorders import channels
from recorders.annotated.checkpoint import PREFIX
from recorders.errors import OutputExistsError, RecordingError, SceneTraceError, UsageError
from recorders.log import LogReader, LogWriter
from recorders.messages import Target, Targets
from recorders.scene import Frame, SceneLog
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.configuration import sections as replay_sections
from replay.engine import Engine
from replay.run import ReplayOptions
from replay.trackers.catalogue import TRACKERS
from replay.verification import verify, verify_chain

FRAMES = 60
ANNOTATED = [channels.topic("camera", name) for name in channels.ANNOTATED]
Messages = list[tuple[str, int, int, int, bytes]]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three people, a group that changes: from frame 0, with pictures and masks, blobs merged."""
    return write_scene_log(
        generate("three_way_group", seed=1, size=(160, 120), frames=FRAMES),
        tmp_path_factory.mktemp("scene") / "scene.mcap",
        style="merged",
    )


def options(tracker: Any, assignments: tuple[str, ...] = (), **more: Any) -> ReplayOptions:
    return ReplayOptions(
        tracker=tracker, config=replay_config(tracker, assignments=assignments), **more
    )


def messages(
    path: Path, keep: Callable[[int], bool] = lambda _: True, annotated: bool | None = None
) -> Messages:
    with LogReader(path) as log:
        return [
            (m.topic, m.log_time_ns, m.publish_time_ns, m.sequence, m.data)
            for m in log.messages()
            if keep(m.log_time_ns)
            and (annotated is None or (m.topic in ANNOTATED) == annotated)
        ]


def assert_carried(span: Path, start_ns: int) -> None:
    """What is there from before a span still holds in it: the regions, said once."""
    before = messages(span, lambda t: t < start_ns)
    assert {m[0] for m in before} <= {"/camera/regions"}
    assert len(before) == (1 if start_ns else 0)


def hindsight(tracker: str, on: bool) -> tuple[str, ...]:
    return (f"{tracker}.hindsight={str(on).lower()}",)


@pytest.mark.parametrize("tracker", TRACKERS)
def test_recorded_messages_pass_byte_for_byte(
    scene: Path, tmp_path: Path, tracker: str
) -> None:
    replay(scene, tmp_path / "a.mcap", options(tracker))
    assert messages(tmp_path / "a.mcap", annotated=False) == messages(scene)
    with LogReader(tmp_path / "a.mcap") as log:
        topics = {c.topic for c in log.channels}
    assert {t for t in ANNOTATED if not t.endswith("membership")} <= topics


@pytest.mark.parametrize("on", [True, False], ids=["hindsight", "forward"])
@pytest.mark.parametrize("tracker", TRACKERS)
def test_a_span_equals_the_same_span_of_the_whole(
    scene: Path, tmp_path: Path, tracker: str, on: bool
) -> None:
    whole = options(tracker, hindsight(tracker, on), checkpoint_ns=400_000_000)
    replay(scene, tmp_path / "whole.mcap", whole)
    with SceneLog(scene) as log:
        times = list(log.frame_times())
    for first, end in ((0, 5), (11, 12), (30, 47), (59, 60)):
        start_ns = times[first]
        end_ns = times[end] if end < FRAMES else None

        def within(t: int, a: int = start_ns, b: int | None = end_ns) -> bool:
            return a <= t and (b is None or t < b)

        expected = messages(tmp_path / "whole.mcap", within)
        span = {"from_ns": start_ns, "to_ns": end_ns, "force": True}
        replay(
            scene, tmp_path / "span.mcap", options(tracker, hindsight(tracker, on), **span)
        )
        assert messages(tmp_path / "span.mcap", within) == expected
        assert_carried(tmp_path / "span.mcap", start_ns)
        with_checkpoints = options(
            tracker, hindsight(tracker, on), checkpoints=tmp_path / "whole.mcap", **span
        )
        done = replay(scene, tmp_path / "span.mcap", with_checkpoints)
        assert messages(tmp_path / "span.mcap", within) == expected
        assert_carried(tmp_path / "span.mcap", start_ns)
        if first >= 11 and not on:
            assert done.computed < end, "a checkpoint was to save work"


@pytest.mark.parametrize("tracker", TRACKERS)
def test_checkpoints_of_another_configuration_or_recording_are_refused(
    scene: Path, tmp_path: Path, tracker: str
) -> None:
    replay(scene, tmp_path / "a.mcap", options(tracker, checkpoint_ns=400_000_000))
    late: dict[str, Any] = {"checkpoints": tmp_path / "a.mcap", "from_ns": 1_500_000_000}
    with pytest.raises(UsageError, match="another configuration or package"):
        replay(
            scene, tmp_path / "b.mcap", options(tracker, ("shell_model.k_s=0.11",), **late)
        )
    other = write_scene_log(
        generate("pass_by", size=(160, 120), frames=FRAMES), tmp_path / "other.mcap"
    )
    with pytest.raises(UsageError, match="another recording"):
        replay(other, tmp_path / "b.mcap", options(tracker, **late))
    assert not (tmp_path / "b.mcap").exists()


@pytest.mark.parametrize("tracker", TRACKERS)
def test_save_and_restore_at_every_frame(scene: Path, tracker: str) -> None:
    config = replay_config(tracker)
    with SceneLog(scene) as log:
        engine = Engine(log, tracker, config)
        states, results = [], []
        for found in engine.run():
            states.append(engine.state())
            results.append((found.targets, found.annotation))
        assert len(results) == FRAMES
        for k in range(0, FRAMES - 1, 3):
            engine.restore(states[k])
            for expected in results[k + 1 : k + 6]:
                again = engine.step()
                assert again is not None
                assert (again.targets, again.annotation) == expected


def test_seeking_anywhere_gives_the_frame_of_a_straight_run(scene: Path) -> None:
    with SceneLog(scene) as log:
        straight = {found.frame.index: found.annotation for found in Engine(log).run()}
        engine = Engine(log, keep_every=7)
        for k in (40, 3, 41, 59, 0, 22, 21, 23):
            assert engine.seek(k).annotation == straight[k]
        assert engine.step().frame.index == 24
        with pytest.raises(IndexError, match="ends at frame 59"):
            engine.seek(60)


def test_other_processes_hash_seeds_threads_and_kernels_give_the_same_digest(
    scene: Path, tmp_path: Path
) -> None:
    program = (
        "import sys; from replay.cli import main; from recorders.vision import cv2;"
        " cv2.setNumThreads(int(sys.argv[1])); sys.exit(max(main(['replay', sys.argv[2], '-o',"
        " f'{sys.argv[3]}-{tracker}.mcap', '--tracker', tracker]) for tracker in sys.argv[4:]))"
    )
    digests = set()
    for k, (seed, threads, kernel) in enumerate(
        (("0", "1", "Haswell"), ("1", "2", "Nehalem"), ("77", "4", "Prescott"))
    ):
        out = tmp_path / f"{k}"
        subprocess.run(
            [sys.executable, "-c", program, threads, str(scene), str(out), *TRACKERS],
            check=True,
            env={
                **os.environ,
                "PYTHONHASHSEED": seed,
                "OPENBLAS_CORETYPE": kernel,
                "OPENBLAS_NUM_THREADS": threads,
            },
            capture_output=True,
        )
        digests |= {
            (tracker, verify_chain(tmp_path / f"{k}-{tracker}.mcap").output_digest)
            for tracker in TRACKERS
        }
    assert len(digests) == len(TRACKERS)


@pytest.mark.parametrize("tracker", TRACKERS)
def test_verify_says_identical(scene: Path, tmp_path: Path, tracker: str) -> None:
    done = replay(scene, tmp_path / "a.mcap", options(tracker))
    verdict = verify(tmp_path / "a.mcap")
    assert verdict.identical
    assert (verdict.frames, verdict.output_digest) == (FRAMES, done.output_digest)


def test_verify_of_a_span_finds_its_scene_beside_it(scene: Path, tmp_path: Path) -> None:
    with SceneLog(scene) as log:
        times = list(log.frame_times())
    span = tmp_path / "span.mcap"
    replay(
        scene,
        span,
        options("events", from_ns=times[20], to_ns=times[40], annotations_only=True),
    )
    with pytest.raises(UsageError, match=r"--scene SCENE\.mcap"):
        verify(span)
    verdict = verify(span, scene)
    assert verdict.identical
    assert verdict.frames == 20


@pytest.mark.parametrize("on", [True, False], ids=["hindsight", "forward"])
@pytest.mark.parametrize("tracker", TRACKERS)
def test_verify_of_a_span_that_was_written_from_a_checkpoint(
    scene: Path, tmp_path: Path, tracker: str, on: bool
) -> None:
    """Its chain goes on from the checkpoint, also where the first frame computed is the first one
    written.
    """
    replay(
        scene,
        tmp_path / "whole.mcap",
        options(tracker, hindsight(tracker, on), checkpoint_ns=400_000_000),
    )
    with SceneLog(scene) as log:
        times = list(log.frame_times())
    for first, end in ((10, 12), (11, 14), (25, 28), (59, 60)):
        more = {"from_ns": times[first], "to_ns": times[end] if end < FRAMES else None}
        whole = options(tracker, hindsight(tracker, on), **more)
        spans = []
        for name, checkpoints in (
            ("from-0", None),
            ("from-checkpoint", tmp_path / "whole.mcap"),
        ):
            span = tmp_path / f"{name}-{first}.mcap"
            replay(scene, span, changed(whole, checkpoints=checkpoints))
            assert verify_chain(span).identical
            assert verify(span, scene).identical
            with LogReader(span) as log:
                spans.append(log.metadata())
        assert spans[0] == spans[1]


def altered(source: Path, out: Path, change: Callable[[str, int, bytes], bytes]) -> Path:
    """The same log with payloads changed by ``change(topic, sequence, data)``; metadata and
    attachments as before.
    """
    with LogReader(source) as log, LogWriter(out) as writer:
        ids = {
            c.id: writer.channel(c.topic, c.schema, c.message_encoding, c.metadata)
            for c in log.channels
        }
        for m in log.messages():
            data = change(m.topic, m.sequence, m.data)
            writer.write(
                ids[m.channel.id], data, m.log_time_ns, m.publish_time_ns, m.sequence
            )
        for name, values in log.metadata():
            writer.metadata(name, values)
    return out


def test_an_edited_event_is_found_at_its_frame(scene: Path, tmp_path: Path) -> None:
    replay(scene, tmp_path / "a.mcap", options("events"))
    edited_frames: list[int] = []

    def edit(topic: str, sequence: int, data: bytes) -> bytes:
        if topic.endswith("/events") and sequence > 5 and not edited_frames:
            edited_frames.append(sequence)
            return data.replace(b'"frame":', b'"frame":1', 1)
        return data

    out = altered(tmp_path / "a.mcap", tmp_path / "b.mcap", edit)
    quick = verify_chain(out)
    assert not quick.identical
    assert (quick.difference.frame, quick.difference.channel) == (
        edited_frames[0],
        "events",
    )
    full = verify(out)
    assert not full.identical
    assert full.difference.frame == edited_frames[0]
    assert any("altered" in reason for reason in full.reasons)


def test_a_changed_recording_is_named_as_the_reason(scene: Path, tmp_path: Path) -> None:
    replay(scene, tmp_path / "a.mcap", options("events"))

    def shift(topic: str, sequence: int, data: bytes) -> bytes:
        if topic == "/camera/detections" and sequence == 33:
            d = channels.decode("detections", data)
            x, y, w, h = d.boxes[0]
            moved = type(d)(d.frame, d.width, d.height, [(x + 1, y, w, h), *d.boxes[1:]], d.scores, d.labels,
                            d.ellipses, d.blobs, d.components)  # fmt: skip
            return channels.encode("detections", moved)
        return data

    verdict = verify(altered(tmp_path / "a.mcap", tmp_path / "b.mcap", shift))
    assert not verdict.identical
    assert (verdict.difference.frame, verdict.difference.channel) == (
        33,
        "recorded messages",
    )


def test_outputs_are_complete_or_absent(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.mcap"
    replay(scene, out, options("events"))
    before = out.read_bytes()
    with pytest.raises(OutputExistsError):
        replay(scene, out, options("events"))
    assert out.read_bytes() == before
    with pytest.raises(UsageError, match="is the recording itself"):
        replay(out, out, options("events", force=True))
    assert out.read_bytes() == before


class Broken:
    """A tracker that goes wrong at frame 10, in a way of its own."""

    def __init__(self, answer: Callable[[int], Targets]) -> None:
        self._answer = answer

    def step(self, frame: Frame) -> Targets:
        k = frame.index
        return Targets(k) if k < 10 else self._answer(k)

    def state(self) -> dict[str, int]:
        return {}

    def restore(self, state: object) -> None:
        pass


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda k: Targets(k + 1), "answered for frame 11 when asked for frame 10"),
        (
            lambda k: Targets(k, [Target(2, (0, 0, 1, 1)), Target(2, (0, 0, 1, 1))]),
            "target 2 after 2",
        ),
        (lambda k: Targets(k, [Target(2, (0, 0, 0, 1))]), "target 2 has the box"),
        (
            lambda k: Targets(k, [Target(2, (float("nan"), 0, 1, 1))]),
            "target 2 has the box",
        ),
        (
            lambda k: Targets(k, [Target(2, (0, 0, 1, 1), (float("inf"), 0))]),
            "velocity or confidence",
        ),
    ],
)
def test_a_tracker_is_held_to_its_protocol(
    scene: Path, tmp_path: Path, answer: Callable[[int], Targets], message: str
) -> None:
    with pytest.raises(SceneTraceError, match=message):
        replay(scene, tmp_path / "a.mcap", options(lambda *_: Broken(answer)))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("answer", [None, [], {"frame": 10}], ids=["none", "list", "dict"])
def test_an_answer_that_is_none_is_told(
    scene: Path, tmp_path: Path, answer: object
) -> None:
    factory = lambda *_: Broken(lambda _: answer)  # type: ignore[arg-type, return-value]  # noqa: E731
    with pytest.raises(
        SceneTraceError,
        match=r"frame 10: the tracker's step\(\) answered .*, must be .*Targets",
    ):
        replay(scene, tmp_path / "a.mcap", options(factory))


class Asking:
    """A tracker with parameters of its own."""

    SECTIONS = replay_sections("events")

    def __init__(self, scene: object, config: Mapping[str, object], more: int = 0) -> None:
        self.asked = config["events"]

    def step(self, frame: Frame) -> Targets:
        return Targets(frame.index)

    def state(self) -> dict[str, object]:
        return {"what": object()}

    def restore(self, state: object) -> None:
        pass


def test_how_a_factory_names_its_parameters(scene: Path) -> None:
    with SceneLog(scene) as log:
        assert Engine(log, partial(Asking, more=3)).name == "Asking"
        with pytest.raises(
            SceneTraceError,
            match=r"asks for the parameters 'events', .*an attribute SECTIONS",
        ):
            Engine(log, lambda info, config: Asking(info, config, more=3))
        with pytest.raises(
            SceneTraceError,
            match=r"the tracker .* lacks step\(\) and state\(\) and restore\(\)",
        ):
            Engine(log, lambda *_: object())  # type: ignore[arg-type]


def test_a_state_that_is_not_plain_is_told(scene: Path, tmp_path: Path) -> None:
    config = replay_config(Asking)
    with pytest.raises(SceneTraceError, match=r"the tracker's state\(\): .*object"):
        replay(
            scene,
            tmp_path / "a.mcap",
            ReplayOptions(Asking, config, checkpoint_ns=1),
        )


def test_an_annotated_log_is_replayed_like_its_scene(scene: Path, tmp_path: Path) -> None:
    first = replay(scene, tmp_path / "a.mcap", options("events", checkpoint_ns=500_000_000))
    second = replay(tmp_path / "a.mcap", tmp_path / "b.mcap", options("events"))
    assert first.output_digest == second.output_digest
    assert first.input_digest == second.input_digest
    with LogReader(tmp_path / "b.mcap") as log:
        assert not [a.name for a in log.attachments() if a.name.startswith(PREFIX)]


def test_what_a_log_lacks_is_said(tmp_path: Path, real_data: Path) -> None:
    with pytest.raises(RecordingError, match=r"no detections to replay.*scenetrace record"):
        replay(
            real_data / "mcap-recordings" / "talker.mcap",
            tmp_path / "a.mcap",
            options("events"),
        )
    assert list(tmp_path.iterdir()) == []
