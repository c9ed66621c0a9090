"""How likely detections are somebody: any scale of scores, in any order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorders.messages import Detections, Target, Targets
from replay.trackers.belief import DetectionScores, stamped

BOX = (10.0, 10.0, 20.0, 40.0)
scores_of_a_frame = st.lists(st.floats(0.0, 1.0), max_size=12)


def seen(scores: list[float]) -> Detections:
    """As many detections as there are scores."""
    return Detections(0, 640, 480, [BOX] * len(scores), scores)


@given(before=st.lists(scores_of_a_frame, max_size=5), now=scores_of_a_frame)
def test_a_higher_score_is_never_less_likely(
    before: list[list[float]], now: list[float]
) -> None:
    book = DetectionScores()
    for frame in before:
        book.take(seen(frame))
    likely = book.take(seen(now))
    assert likely.shape == (len(now),)
    assert np.all((likely > 0) & (likely < 1))
    order = np.argsort(now, kind="stable")
    assert np.all(np.diff(likely[order]) >= 0)


@given(score=st.floats(0.0, 1.0), count=st.integers(1, 20))
def test_scores_that_are_all_the_same_say_that_all_are_somebody(
    score: float, count: int
) -> None:
    assert np.all(DetectionScores().take(seen([score] * count)) > 0.9)


def test_detections_without_scores_are_somebody() -> None:
    assert DetectionScores().take(
        Detections(0, 640, 480, [BOX, BOX])
    ).tolist() == pytest.approx([0.947] * 2, abs=0.001)
    assert len(DetectionScores().take(Detections(0, 640, 480))) == 0


@pytest.mark.parametrize(
    ("best", "half"), [([0.98, 0.99, 0.995], 0.91), ([0.8, 0.83, 0.86], 0.68)]
)
def test_half_as_likely_depends_on_what_the_detector_gives_its_best(
    best: list[float], half: float
) -> None:
    book = DetectionScores()
    for _ in range(30):
        book.take(seen([*best, 0.3, 0.4]))
    likely = book.take(seen([half, *best]))
    assert likely[0] == pytest.approx(0.5, abs=0.08)
    assert np.all(likely[1:] > 0.75)


@given(
    frames=st.lists(scores_of_a_frame, min_size=1, max_size=6), rubbish=st.integers(0, 50)
)
def test_a_restored_book_goes_on_as_the_one_that_was_saved(
    frames: list[list[float]], rubbish: int
) -> None:
    first, second = DetectionScores(), DetectionScores()
    for frame in [*frames, [0.05] * rubbish]:
        first.take(seen(frame))
    second.restore(first.state())
    assert second.take(seen([0.3, 0.9])).tolist() == first.take(seen([0.3, 0.9])).tolist()


def test_rubbish_does_not_make_the_rest_likelier() -> None:
    """A detector that is asked for lower scores, too, gives more rubbish; the best stay the best."""
    little, much = DetectionScores(), DetectionScores()
    for _ in range(50):
        little.take(seen([0.9, 0.85, 0.5]))
        much.take(seen([0.9, 0.85, 0.5, *[0.02] * 30]))
    assert much.best == pytest.approx(little.best, abs=0.3)


def test_a_target_is_as_likely_as_the_detection_it_was_observed_in() -> None:
    far = (200.0, 10.0, 20.0, 40.0)
    targets = [
        Target(1, BOX, measured=BOX),
        Target(2, far, measured=far),
        Target(3, BOX, observed=False),
    ]
    answer = stamped(Targets(0, targets), np.array([BOX]), np.array([0.8]))
    assert [t.likely for t in answer.targets] == [0.8, None, None]
