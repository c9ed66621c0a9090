"""What a target is: the votes of its sightings."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from msgspec import UNSET

from reasoning.classes import ClassBook
from reasoning.reasoner import Reasoner
from recorders.messages import Detections, Target, Targets

PERSON, CAR = (10.0, 10.0, 20.0, 50.0), (100.0, 20.0, 80.0, 40.0)


def seen(
    boxes: list[tuple[float, float, float, float]],
    labels: list[str],
    scores: list[float] | None = None,
    frame: int = 0,
) -> Detections:
    return Detections(
        frame, 320, 240, list(boxes), scores or [1.0] * len(boxes), list(labels)
    )


def test_most_weight_wins_and_not_the_last_word() -> None:
    book = ClassBook()
    target = Target(1, PERSON)
    for label, score in (("person", 0.9), ("dog", 0.6), ("person", 0.5), ("dog", 0.7)):
        book.step([target], seen([PERSON], [label], [score]))
    assert book.of(1) == "person"
    book.step([target], seen([PERSON], ["dog"], [0.3]))
    assert book.of(1) == "dog"


def test_equal_votes_stay_with_the_first() -> None:
    book = ClassBook()
    book.step([Target(1, CAR)], seen([CAR], ["van"], [0.5]))
    book.step([Target(1, CAR)], seen([CAR], ["car"], [0.5]))
    assert book.of(1) == "van"


@pytest.mark.parametrize("label", ["", "object"])
def test_labels_that_tell_nothing_do_not_vote(label: str) -> None:
    book = ClassBook()
    book.step([Target(1, PERSON)], seen([PERSON], [label]))
    assert book.of(1) is None


@pytest.mark.parametrize("unseen", [{"observed": False}, {"present": False}])
def test_only_sightings_vote(unseen: dict[str, Any]) -> None:
    book = ClassBook()
    book.step([Target(1, PERSON, **unseen)], seen([PERSON], ["person"]))
    assert book.of(1) is None


def test_a_detection_votes_for_one_target_the_one_under_it() -> None:
    book = ClassBook()
    beside = (14.0, 10.0, 20.0, 50.0)
    book.step([Target(1, beside), Target(2, PERSON)], seen([PERSON], ["person"]))
    assert (book.of(1), book.of(2)) == (None, "person")


def test_far_detections_do_not_vote() -> None:
    book = ClassBook()
    book.step([Target(1, PERSON)], seen([CAR], ["car"]))
    assert book.of(1) is None


def test_votes_outlive_a_restart() -> None:
    book, twin = ClassBook(), ClassBook()
    book.step([Target(1, PERSON)], seen([PERSON], ["person"], [0.8]))
    twin.restore(msgspec.json.decode(msgspec.json.encode(book.state())))
    assert (twin.of(1), twin.state()) == ("person", book.state())


def test_tracks_carry_the_class_and_those_without_leave_it_out() -> None:
    reasoner = Reasoner({}, 320, 240)
    targets = Targets(0, [Target(1, PERSON, newborn=True), Target(2, CAR, newborn=True)])
    scene = reasoner.step(0, 0, targets, None, seen([PERSON], ["person"]))
    assert [t.label for t in scene.tracks.tracks] == ["person", UNSET]
    payload = msgspec.json.decode(msgspec.json.encode(scene.tracks))
    assert "label" not in payload["tracks"][1]
