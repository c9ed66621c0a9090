"""Time travel over every scripted scene: a state taken anywhere goes on as the straight run did.

The scenes are small here and have two frames a second, so that their whole stories fit into few
frames; `tests/benchmarks/bench_trust.py travel` sweeps every frame of whole scenes.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fixtures.logs import write_scene_log
from fixtures.scenes import SCRIPTS, GeneratedScene, generate
from recorders.annotated.checkpoint import decode_state, encode_state
from recorders.log import LogReader
from recorders.scene import SceneLog
from replay import annotated_writer
from replay.configuration import replay_config
from replay.engine import Engine
from replay.run import ReplayOptions
from replay.trackers.catalogue import TRACKERS
from replay.verification import verify, verify_chain
from tests.examples import examples

FPS = 2
MOST_FRAMES = 20
PASS_BY_FRAMES = 16
AHEAD = 2
SPAN_FRAMES = 30


@pytest.fixture(scope="session")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every script as a scene log of few frames."""
    folder = tmp_path_factory.mktemp("travel")
    for name, script in SCRIPTS.items():
        frames = min(round(script.seconds * FPS), MOST_FRAMES)
        scene = GeneratedScene(name, replace(script, fps=FPS), 3, (96, 72), frames)
        write_scene_log(scene, folder / f"{name}.mcap", style="merged")
    return folder


@pytest.mark.parametrize("tracker", TRACKERS)
@pytest.mark.parametrize("script", SCRIPTS)
def test_save_and_restore_at_every_frame(scenes: Path, script: str, tracker: str) -> None:
    with SceneLog(scenes / f"{script}.mcap") as scene:
        straight = Engine(scene, tracker)
        states, results = [], []
        for found in straight.run():
            states.append(encode_state(straight.state()))
            results.append((found.targets, found.annotation))
        assert results
        for k, state in enumerate(states):
            other = Engine(scene, tracker)
            other.restore(decode_state(state))
            assert encode_state(other.state()) == state
            for expected in results[k + 1 : k + 1 + AHEAD]:
                again = other.step()
                assert again is not None
                assert (again.targets, again.annotation) == expected, (
                    f"{script}: restored after frame {k}"
                )
                if again.frame.index == k + AHEAD:
                    assert encode_state(other.state()) == states[k + AHEAD]


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, bool], Path]:
    """One scene's full replays with a checkpoint at every frame, by tracker and whether hindsight
    is on.
    """
    folder = tmp_path_factory.mktemp("whole")
    scene = generate("three_way_group", seed=4, size=(96, 72), frames=SPAN_FRAMES)
    write_scene_log(scene, folder / "scene.mcap", style="merged")
    found = {}
    for tracker in TRACKERS:
        for hindsight in (True, False):
            out = folder / f"{tracker}-{hindsight}.mcap"
            annotated_writer.replay(
                folder / "scene.mcap", out, _options(tracker, hindsight, checkpoint_ns=1)
            )
            found[tracker, hindsight] = out
    return found


def _options(tracker: str, hindsight: bool, **more: Any) -> ReplayOptions:
    config = replay_config(
        tracker, assignments=[f"{tracker}.hindsight={str(hindsight).lower()}"]
    )
    return ReplayOptions(tracker=tracker, config=config, force=True, **more)


def _messages(
    path: Path, first_ns: int = 0, end_ns: int = 1 << 62
) -> list[tuple[str, int, int, int, bytes]]:
    """Recorded and annotated, all of them."""
    with LogReader(path) as log:
        found = [
            (m.topic, m.log_time_ns, m.publish_time_ns, m.sequence, m.data)
            for m in log.messages(None, first_ns, end_ns)
        ]
    # Topics share one time in whatever order they lie in the file.
    return sorted(found, key=lambda m: (m[1], m[0]))


@pytest.mark.parametrize("hindsight", [True, False], ids=["hindsight", "forward"])
@pytest.mark.parametrize("tracker", TRACKERS)
def test_from_every_frame_gives_the_messages_of_the_whole(
    whole: dict[tuple[str, bool], Path], tmp_path: Path, tracker: str, hindsight: bool
) -> None:
    full = whole[tracker, hindsight]
    scene = full.with_name("scene.mcap")
    with SceneLog(scene) as log:
        times = list(log.frame_times())
    for k in range(SPAN_FRAMES):
        end_ns = times[k + 2] if k + 2 < SPAN_FRAMES else times[-1] + 1
        span = {"from_ns": times[k], "to_ns": end_ns, "checkpoints": full}
        annotated_writer.replay(
            scene, tmp_path / "span.mcap", _options(tracker, hindsight, **span)
        )
        assert _messages(tmp_path / "span.mcap", times[k]) == _messages(
            full, times[k], end_ns
        ), f"from frame {k}"
        assert verify_chain(tmp_path / "span.mcap").identical, f"from frame {k}"
        if k % 10 == 3:
            assert verify(tmp_path / "span.mcap", scene).identical, f"from frame {k}"


@settings(
    max_examples=examples(6),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    where=st.lists(st.integers(0, PASS_BY_FRAMES - 1), min_size=2, max_size=5),
    keep_every=st.integers(1, 9),
)
@pytest.mark.parametrize("tracker", TRACKERS)
def test_seeking_in_any_order_gives_the_frames_of_a_straight_run(
    scenes: Path, tracker: str, where: list[int], keep_every: int
) -> None:
    with SceneLog(scenes / "pass_by.mcap") as scene:
        straight = [found.annotation for found in Engine(scene, tracker).run()]
        engine = Engine(scene, tracker, keep_every=keep_every)
        for k in where:
            assert engine.seek(k).annotation == straight[k]
