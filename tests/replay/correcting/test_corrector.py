"""Corrections of made-up answers: who is called what, and what is refused."""

from __future__ import annotations

import random
from dataclasses import replace as changed

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from recorders.corrections import (
    Correction,
    Corrections,
    CorrectionsHeader,
    begun,
    parse_corrections,
)
from recorders.errors import SceneTraceError, SourceError, UsageError
from recorders.messages import GroupTrack, Notice, Target, Targets
from replay.correcting import Book, Corrector, Wish, add, take_back
from replay.correcting.book import Presence
from replay.correcting.names import Names

HEAD = CorrectionsHeader("corrections", 1, "a.mcap", "camera", "events")
FRAMES = 30


def target(identity: int, frame: int, **facts: object) -> Target:
    box = (10.0 * identity + frame, 50.0, 8.0, 20.0)
    return replace(Target(identity, box), **facts)


def scene(lives: dict[int, tuple[int, int]]) -> list[Targets]:
    """Targets that are there from frame to frame (both included)."""
    return [
        Targets(
            f,
            [
                target(i, f, newborn=f == first)
                for i, (first, last) in sorted(lives.items())
                if first <= f <= last
            ],
        )
        for f in range(FRAMES)
    ]


def book(answers: list[Targets]) -> Book:
    made = Book({a.frame: a.frame / 10 for a in answers})
    for a in answers:
        for t in a.targets:
            if t.present:
                made.tracks.setdefault(t.id, Presence()).add(a.frame, t.observed, t.box)
    return made


def corrected(answers: list[Targets], corrections: Corrections) -> list[Targets]:
    corrector = Corrector(corrections)
    known: set[int] = set()
    out = []
    for answer in answers:
        out.append(corrector.step(answer, known).targets)
        known |= {t.id for t in out[-1].targets}
    return out


def wish(do: str, *words: str, at: float | None = None, until: float | None = None) -> Wish:
    return Wish(do, words, "Jo", "looked at it", at, until)  # type: ignore[arg-type]


def made(answers: list[Targets], *wishes: Wish) -> Corrections:
    corrections = begun(HEAD)
    for one in wishes:
        corrections = add(book(answers), corrections, one)
    return corrections


def lives(answers: list[Targets]) -> dict[int, list[int]]:
    found: dict[int, list[int]] = {}
    for a in answers:
        for t in a.targets:
            found.setdefault(t.id, []).append(a.frame)
    return found


THREE = {1: (0, 9), 2: (12, 29), 3: (0, 29)}


def test_merge_joins_and_the_second_begins_no_life() -> None:
    answers = scene(THREE)
    out = corrected(answers, made(answers, wish("merge", "1", "2")))
    assert lives(out) == {1: [*range(10), *range(12, 30)], 3: list(range(30))}
    assert [a.frame for a in out for t in a.targets if t.id == 1 and t.newborn] == [0]


def test_split_swap_rename_delete_label() -> None:
    answers = scene(THREE)
    out = corrected(answers, made(answers, wish("split", "3", at=1.5)))
    assert lives(out)[3] == list(range(15))
    assert lives(out)[4] == list(range(15, 30))
    out = corrected(answers, made(answers, wish("swap", "2", "3", at=1.5)))
    assert [t.box for t in out[15].targets if t.id == 2] == [target(3, 15).box]
    assert [t.box for t in out[14].targets if t.id == 2] == [target(2, 14).box]
    assert set(lives(corrected(answers, made(answers, wish("rename", "3", "30"))))) == {
        1,
        2,
        30,
    }
    out = corrected(answers, made(answers, wish("delete", "3", at=1.0, until=2.0)))
    assert lives(out)[3] == [*range(10), *range(20, 30)]
    labelled = Corrector(made(answers, wish("label", "3", "red coat", at=1.0)))
    assert [dict(labelled.step(a, ()).labels) for a in (answers[9], answers[10])] == [
        {},
        {3: "red coat"},
    ]


@given(st.data())
def test_split_takes_a_merge_back(data: st.DataObject) -> None:
    end = data.draw(st.integers(0, FRAMES - 3))
    begin = data.draw(st.integers(end + 1, FRAMES - 2))
    answers = scene({1: (0, end), 2: (begin, FRAMES - 1), 3: (0, FRAMES - 1)})
    corrections = made(
        answers, wish("merge", "1", "2"), wish("split", "1", "2", at=begin / 10)
    )
    out = corrected(answers, corrections)
    assert [a.targets for a in out] == [a.targets for a in answers]
    undone = take_back(take_back(corrections, 2, "Jo", "no"), 1, "Jo", "no")
    assert corrected(answers, undone) == answers
    assert not Names(undone.in_force).changed


@given(st.integers(0, 10_000))
def test_any_corrections_keep_ids_apart_and_do_not_depend_on_order_of_asking(
    seed: int,
) -> None:
    rng = random.Random(seed)
    answers = scene(
        {i: tuple(sorted(rng.sample(range(FRAMES), 2))) for i in range(1, 6)}  # type: ignore[misc]
    )
    corrections = begun(HEAD)
    for _ in range(6):
        a, b = rng.sample(range(1, 9), 2)
        one = rng.choice([
            wish("merge", str(a), str(b), at=rng.choice([None, rng.random() * 3])),
            wish("split", str(a), at=rng.random() * 3),
            wish("swap", str(a), str(b), at=rng.random() * 3),
            wish("rename", str(a), str(b + 10)),
            wish("delete", str(a), at=rng.random() * 3),
        ])  # fmt: skip
        try:
            corrections = add(book(answers), corrections, one)
        except UsageError:
            continue
    out = corrected(answers, corrections)
    for answer in out:
        ids = [t.id for t in answer.targets]
        assert ids == sorted(set(ids))
    assert parse_corrections(corrections.text, "c.jsonl") == corrections
    # A frame's answer depends on that frame alone, but for who is new.
    corrector = Corrector(corrections)
    for frame in reversed(range(FRAMES)):
        alone = corrector.step(answers[frame], set(range(100))).targets
        assert [(t.id, t.box) for t in alone.targets] == [
            (t.id, t.box) for t in out[frame].targets
        ]
    # What the book makes of them is what the corrector makes of the answers.
    told = book(answers).under(Names(corrections.in_force)).tracks
    assert {i: p.frames for i, p in told.items()} == lives(out)


def test_notices_and_groups_follow_the_names() -> None:
    answers = scene(THREE)
    answers[12] = changed_answer(answers[12])
    out = corrected(answers, made(answers, wish("merge", "1", "2")))
    kinds = [(n.kind, n.subjects, n.text) for n in out[12].notices]
    assert kinds == [("identity", [1], "Target 1 is seen again."), ("anomaly", [3], "")]
    assert out[12].group_tracks == [GroupTrack(0, (0, 0, 1, 1), True, members=[1, 3])]
    gone = corrected(answers, made(answers, wish("delete", "2")))
    assert [n.kind for n in gone[12].notices] == ["anomaly"]
    assert gone[12].group_tracks == []


def changed_answer(answer: Targets) -> Targets:
    notices = [
        Notice("track_confirmed", [2], "ours"),
        Notice("identity", [2], "ours", text="Target 2 is seen again."),
        Notice("anomaly", [3], "ours"),
    ]
    groups = [GroupTrack(0, (0, 0, 1, 1), True, members=[2, 3])]
    return replace(answer, notices=notices, group_tracks=groups)


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (wish("merge", "1", "9"), "there is no target 9; there are 1, 2, 3"),
        (wish("merge", "1", "3"), "both seen in 10 frames, between 0.00 and 0.90 s"),
        (wish("merge", "1", "1"), "two different targets"),
        (wish("merge", "1"), "merge takes A B"),
        (wish("merge", "1", "x"), "'x': must be a target's number"),
        (wish("split", "3"), "needs a time: --at"),
        (wish("split", "3", at=0.0), "a split lies after its first frame"),
        (wish("split", "3", at=99.0), "the log's frames are from 0.00 to 2.90 s"),
        (wish("split", "1", at=1.5), "not there at or after 1.50 s (it is there from 0.00 to"),
        (wish("split", "3", "2", at=1.0), "2 is a target already; a free number is 4"),
        (wish("delete", "3", at=2.0, until=1.0), "--until 1 is not after --at"),
        (wish("label", "3", " "), "label needs a text"),
        (wish("same", "3", "monday"), "RECORDING:ID"),
        (wish("same", "3", "monday:4", at=1.0), "it takes no --at"),
        (wish("not-same", "3", "9"), "there is no target 9, and hindsight joined none"),
        (wish("rename", "3", "30", until=1.0), "--until is of delete alone"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line(one: Wish, said: str) -> None:
    with pytest.raises(UsageError) as error:
        made(scene(THREE), one)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_another_replay_is_found_out() -> None:
    answers = scene(THREE)
    corrections = made(answers, wish("merge", "1", "2"))
    others = [
        replace(
            a, targets=[replace(t, box=(t.box[0] + 100, *t.box[1:])) for t in a.targets]
        )
        for a in answers
    ]
    with pytest.raises(
        SceneTraceError, match=r"correction 1 .* made for another recording"
    ):
        corrected(others, corrections)
    without = [replace(a, targets=[t for t in a.targets if t.id != 2]) for a in answers]
    with pytest.raises(SceneTraceError, match="and is nowhere now"):
        corrected(without, corrections)


def test_only_the_last_word_about_a_target_is_taken_back() -> None:
    answers = scene(THREE)
    corrections = made(answers, wish("merge", "1", "2"), wish("rename", "1", "8"))
    with pytest.raises(UsageError, match="undo 2 first"):
        take_back(corrections, 1, "Jo", "no")
    with pytest.raises(UsageError, match="no such correction is in force; there are: 1, 2"):
        take_back(corrections, 7, "Jo", "no")
    back = take_back(corrections, 2, "Jo", "no")
    assert [r.correction for r in back.in_force] == [1]
    assert [r.do for r in back.rows] == ["merge", "rename", "undo"]


def test_a_log_of_earlier_corrections_takes_the_rest() -> None:
    answers = scene(THREE)
    first = made(answers, wish("merge", "1", "2"))
    after = book(corrected(answers, first))
    after.applied = first
    both = add(after, first, wish("rename", "1", "8"))
    assert set(lives(corrected(answers, both))) == {3, 8}
    # The uncorrected log, too: the earlier ones are reckoned in.
    assert add(book(answers), first, wish("rename", "1", "8")).text == both.text
    with pytest.raises(UsageError, match="made with other corrections"):
        add(changed(after, applied=both), first, wish("rename", "1", "9"))
    with pytest.raises(UsageError, match="replay it first"):
        add(after, take_back(first, 1, "Jo", "no"), wish("rename", "3", "9"))


@pytest.mark.parametrize(
    ("line", "how"),
    [
        (1, "out"),
        (2, "out"),
        (1, "other"),
        (2, "other"),
        (1, "cut"),
        (2, "cut"),
        (3, "cut"),
    ],
)
def test_an_altered_file_is_named_by_its_line(line: int, how: str) -> None:
    answers = scene(THREE)
    whole = made(
        answers, wish("merge", "1", "2"), wish("rename", "1", "8"), wish("label", "3", "x")
    ).text
    lines = whole.splitlines(keepends=True)
    if how == "out":
        altered = [*lines[:line], *lines[line + 1 :]]
    elif how == "other":
        altered = [*lines[:line], lines[line].replace("Jo", "Al"), *lines[line + 1 :]]
    else:
        altered = [*lines[:line], lines[line][:-2]]
    with pytest.raises(SourceError) as error:
        parse_corrections("".join(altered), "c.jsonl")
    assert "\n" not in str(error.value)


def test_words_for_people() -> None:
    row = Correction(1, "delete", [3], "Jo", "a bag", 5, 0.5, until_frame=9)
    assert row.told() == "target 3 is nobody from 0.50 s on until frame 9"
