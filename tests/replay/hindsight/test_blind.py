"""Who is not seen because nobody could look goes on under his own identity."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fixtures.disturbed import picture, place
from recorders.annotated.reader import AnnotatedLog
from recorders.evidence import unlike
from recorders.messages import Notice, SceneChange, Target, Targets
from recorders.parameters import configure
from recorders.recording import RecordOptions, record
from recorders.scene import SceneInfo
from recorders.sources import open_source
from recorders.vision import cv2
from replay.annotated_writer import replay
from replay.evaluate.track_table import read_tracks
from replay.hindsight import SECTIONS, rewrite
from replay.hindsight.blind import Blind, blind_times, blind_within, seen_until
from replay.run import ReplayOptions

FRAME_NS = 100_000_000
SCENE = SceneInfo(640, 480, FRAME_NS, has_images=False, has_masks=False)
RED, BLUE = [100, 0, 0, 50], [0, 80, 70, 0]
DARK = range(30, 130)
FRAMES = 160
TIMES = [k * FRAME_NS for k in range(FRAMES)]
BLACK = Blind(DARK.start * FRAME_NS, DARK.stop * FRAME_NS, moved=False)
TURNED = Blind(DARK.start * FRAME_NS, DARK.stop * FRAME_NS, moved=True)


def told(frame: int, kind: str, since: int, **evidence: Any) -> tuple[int, SceneChange]:
    return frame * FRAME_NS, SceneChange(frame, kind, {"since_frame": since, **evidence})


def target(identity: int, x: float, colours: list[int]) -> Target:
    box = (x, 200.0, 20.0, 40.0)
    return Target(identity, box, (0.0, 0.0), measured=box, signature=colours)


def street(
    shift: float = 0.0, *, swapped: bool = False, leaving: bool = False
) -> list[Targets]:
    """A red and a blue one stand 100 px apart; after the dark they have new ids, and stand, if it is
    said so, where the other one stood, or elsewhere.
    """
    frames = []
    for k in range(FRAMES):
        here, notices = [], []
        if k < DARK.start:
            here = [target(1, 100.0, RED), target(2, 200.0, BLUE)]
        elif k >= DARK.stop:
            red, blue = (200.0, 100.0) if swapped else (100.0, 200.0)
            here = [target(3, red + shift, RED), target(4, blue + shift, BLUE)]
        elif k == DARK.start + 10 and leaving:
            notices = [
                Notice("track_removed", [n], "EVENTS", {"unseen_s": 1.0}, left_scene=True)
                for n in (1, 2)
            ]
        frames.append(Targets(k, here, None, notices))
    return frames


def identities(frames: list[Targets], *blind: Blind) -> dict[str, list[int]]:
    """The ids that each colour has, in order."""
    found: dict[str, list[int]] = {"red": [], "blue": []}
    forward = {k: {t.box[0]: t.signature for t in f.targets} for k, f in enumerate(frames)}
    config = configure(SECTIONS)
    for answer in rewrite(lambda: iter(frames), SCENE, TIMES, config, blind=lambda: blind):
        for t in answer.targets:
            x = min(forward[answer.frame], key=lambda v: abs(v - t.box[0]), default=None)
            if x is not None:
                name = "red" if forward[answer.frame][x] == RED else "blue"
                if t.id not in found[name]:
                    found[name].append(t.id)
    return found


def test_a_lost_signal_and_a_camera_that_turns_away_are_blind_times() -> None:
    changes = [
        told(32, "signal_lost", 30),
        told(40, "light", 38),
        told(62, "signal_back", 60, lost_s=3.0),
        told(72, "panned", 70, view=None, view_before=0),
        told(92, "panned", 90, view=1, view_before=None),
        told(102, "panned", 100, view=None, view_before=1),
        told(112, "panned", 110, view=1, view_before=None),
        told(122, "signal_back", 120),
        told(132, "signal_lost", 130),
    ]
    assert blind_times(changes, TIMES) == [
        Blind(30 * FRAME_NS, 60 * FRAME_NS, moved=False),
        Blind(70 * FRAME_NS, 90 * FRAME_NS, moved=True),
        Blind(100 * FRAME_NS, 110 * FRAME_NS, moved=False),
    ]


@pytest.mark.parametrize("evidence", [{}, {"since_frame": "x"}, {"since_frame": -500}])
def test_changes_that_say_nothing_of_when_they_began_are_passed_over(
    evidence: dict[str, Any],
) -> None:
    changes = [
        (32 * FRAME_NS, SceneChange(32, "signal_lost", evidence)),
        told(62, "signal_back", 60),
    ]
    assert blind_times(changes, TIMES) == []


def test_seconds_that_were_watched_are_counted() -> None:
    second = 10**9
    assert blind_within([BLACK], 2 * second, 14 * second) == (pytest.approx(10.0), False)
    assert blind_within([TURNED], 5 * second, 6 * second) == (pytest.approx(1.0), True)
    assert blind_within([BLACK], 0, 2 * second) == (0.0, False)
    assert seen_until([BLACK], 2 * second, 3.0) == 15 * second
    assert seen_until([BLACK], 14 * second, 3.0) == 17 * second


@pytest.mark.parametrize("leaving", [False, True])
def test_over_a_lost_signal_everybody_goes_on(leaving: bool) -> None:
    frames = street(shift=40.0, leaving=leaving)
    assert identities(frames, BLACK) == {"red": [1], "blue": [2]}
    assert identities(frames) == {"red": [1, 3], "blue": [2, 4]}


def test_a_join_says_how_long_nobody_could_look() -> None:
    frames = street()
    config = configure(SECTIONS)
    notices = [
        n
        for f in rewrite(lambda: iter(frames), SCENE, TIMES, config, blind=lambda: [BLACK])
        for n in f.notices
        if n.kind == "track_recovered"
    ]
    assert [n.subjects for n in notices if "fragment" in n.evidence] == [[1], [2]]
    for n in notices:
        assert not unlike(n.kind, n.evidence)
        if "fragment" in n.evidence:
            assert n.evidence["gap_s"] == pytest.approx(10.1)
            assert n.evidence["watched_s"] == pytest.approx(0.1)
            assert n.evidence["watched_s"] <= n.evidence["watched_s_at_most"] == 5.0


def test_colours_say_who_is_who_where_two_changed_sides_in_the_dark() -> None:
    assert identities(street(swapped=True), BLACK) == {"red": [1], "blue": [2]}


def test_in_another_view_places_say_nothing() -> None:
    frames = street(shift=350.0)
    assert identities(frames, TURNED) == {"red": [1], "blue": [2]}
    assert identities(frames, BLACK)["red"] == [1, 3]


def test_somebody_of_other_colours_is_somebody_else() -> None:
    frames = street()
    strangers = [
        Targets(f.frame, [target(t.id, t.box[0], [50, 0, 70, 90]) for t in f.targets])
        if f.frame >= DARK.stop
        else f
        for f in frames
    ]
    ids = {
        t.id
        for f in rewrite(
            lambda: iter(strangers),
            SCENE,
            TIMES,
            configure(SECTIONS),
            blind=lambda: [TURNED],
        )
        for t in f.targets
    }
    assert ids == {1, 2, 3, 4}


def test_a_replay_reads_from_the_log_when_nobody_could_be_seen(tmp_path: Path) -> None:
    """One walks on while the picture is black for longer than anybody is looked for."""
    black = range(60, 115)
    (tmp_path / "pictures").mkdir()
    ground = place()
    for k in range(150):
        shown = picture(ground, k // 2)
        shown = np.zeros_like(shown) if k in black else shown
        cv2.imwrite(str(tmp_path / "pictures" / f"{k:03d}.png"), shown)
    scene, out = tmp_path / "scene.mcap", tmp_path / "annotated.mcap"
    record(open_source(tmp_path / "pictures", fps=10), scene, RecordOptions())
    replay(scene, out, ReplayOptions(tracker="events"))
    with AnnotatedLog(out) as log:
        table = read_tracks(log).table
    assert set(table.ids.tolist()) == {1}
    seen = set(table.frames.tolist())
    assert {0, black.start - 1, black.stop, 149} <= seen
    assert black.start + 30 not in seen, "nothing is told while nothing is seen"
