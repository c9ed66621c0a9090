"""What detections say of the whole picture: its light, and how far it moved."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from recorders.limits import DEFAULT_LIMITS
from recorders.message_checks import check_detections
from recorders.messages import Detections
from recorders.scene_frame import Frame, SceneInfo
from replay.configuration import replay_config
from replay.protocol import make_tracker
from replay.trackers.choice import choose

SIZE = (320, 240)
SECOND = 10**9


def frame(index: int, said: Detections, picture: np.ndarray | None = None) -> Frame:
    return Frame(
        index,
        index * SECOND // 25,
        said,
        load_image=None if picture is None else lambda: picture,
    )


def test_a_picture_is_looked_at_in_its_backgrounds_light() -> None:
    rng = np.random.default_rng(0)
    usual = rng.integers(20, 200, (24, 32, 3), np.uint8)
    dark = np.rint(usual * np.array([0.5, 0.4, 0.3])).astype(np.uint8)
    seen = frame(0, Detections(0, 32, 24, light=[0.5, 0.4, 0.3]), dark).evenly_lit
    assert seen is not None
    assert np.abs(seen.astype(int) - usual).max() <= 2
    assert frame(0, Detections(0, 32, 24), usual).evenly_lit is usual
    assert frame(0, Detections(0, 32, 24, light=[0.5, 0.4, 0.3])).evenly_lit is None


@pytest.mark.parametrize("tracker", ["events", "shells", "parts"])
def test_trackers_expect_everybody_where_the_picture_went(tracker: str) -> None:
    """Someone who walks, while the camera leaps by more than he is wide."""
    info = SceneInfo(*SIZE, SECOND // 25, has_images=False, has_masks=False)
    made = make_tracker(choose(tracker), info, replay_config(tracker))
    camera, ids = 0, []
    for k in range(60):
        leap = 45 if k == 40 else 0
        camera += leap
        said = Detections(
            k,
            *SIZE,
            boxes=[(40.0 + k + camera, 80.0, 20.0, 50.0)],
            scores=[1.0],
            moved=[leap, 0] if leap else [],
        )
        ids.append([target.id for target in made.step(frame(k, said)).targets])
    assert ids[39] == ids[-1] == ids[41]
    assert len(ids[-1]) == 1


@pytest.mark.parametrize(
    "said",
    [
        {"light": [1.0]},
        {"light": [0.0, 1.0, 1.0]},
        {"light": [1.0, 1.0, float("nan")]},
        {"moved": [1]},
        {"moved": [0, 321]},
    ],
)
def test_what_no_picture_can_be_is_refused(said: dict[str, list[float]]) -> None:
    good = Detections(7, *SIZE, light=[0.5, 1.0, 2.0], moved=[-3, 4])
    check_detections(good, DEFAULT_LIMITS)
    with pytest.raises(ValueError, match="frame 7: the"):
        check_detections(msgspec.structs.replace(good, **said), DEFAULT_LIMITS)
