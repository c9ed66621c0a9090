"""The reasoner as a whole: what it answers, what it tells, where the papers disagree, and that it
continues.
"""

from __future__ import annotations

import json
from typing import Any

import msgspec
import pytest

from reasoning.reasoner import SECTIONS, Reasoner, SceneAnnotation
from recorders.messages import (
    EVENT_KINDS,
    GroupTrack,
    Notice,
    Regions,
    Target,
    Targets,
    Zone,
)
from recorders.parameters import configure


def person(
    i: int, x: int, blob: int | None = None, y: float = 100.0, **fields: Any
) -> Target:
    return Target(
        i, (float(x), y, 20.0, 50.0), blob=i + 100 if blob is None else blob, **fields
    )


def run(
    frames: list[list[Target]], config: dict[str, Any] | None = None, **targets: Any
) -> tuple[Reasoner, list[SceneAnnotation]]:
    reasoner = Reasoner(config, 640, 240)
    return reasoner, [
        reasoner.step(k, k * 10**8, Targets(k, t, **targets), None)
        for k, t in enumerate(frames)
    ]


def test_an_empty_frame() -> None:
    _, (answer,) = run([[]])
    assert (
        answer.tracks.tracks,
        answer.relations.relations,
        answer.groups.groups,
        answer.events,
    ) == ([], [], [], [])
    assert answer.graph is not None


def test_tracks_come_by_id_whatever_the_trackers_order() -> None:
    _, (answer,) = run([[person(7, 10), person(2, 300)]])
    assert [t.id for t in answer.tracks.tracks] == [2, 7]


def test_every_frame_answers_who_and_since_when() -> None:
    _, answers = run(
        [[person(1, 100), person(2, 130)]] * 2
        + [[person(1, 110, 7), person(2, 120, 7)]] * 3
    )
    relation = answers[-1].relations.relations[0]
    assert (
        relation.a,
        relation.b,
        relation.state,
        relation.since_frame,
        relation.since_ns,
    ) == (
        1,
        2,
        "JOINT",
        2,
        2 * 10**8,
    )
    assert relation.grouped
    assert not relation.grouping
    assert 0 < relation.shell_overlap < 1
    assert relation.rule == "SHELLS 2.3 case III"
    track = answers[-1].tracks.tracks[0]
    assert (track.grouped_partners, track.group, track.scene) == ([2], 1, "inside")
    group = answers[-1].groups.groups[0]
    assert (
        group.label,
        group.members,
        group.since_frame,
        group.observed,
        group.formed_from,
    ) == (
        1,
        [1, 2],
        2,
        True,
        [],
    )


def test_events_are_numbered_in_order_and_carry_their_evidence() -> None:
    _, answers = run([[person(1, 100), person(2, 300)], [person(1, 100), person(2, 140)]])
    events = [e for a in answers for e in a.events]
    assert [e.id for e in events] == list(range(1, len(events) + 1))
    started = events[-1]
    assert started.kind == "interaction_started"
    assert started.rule == "SHELLS 2.3 case II"
    assert started.evidence["distance_px"] == 40
    assert started.evidence["shell_gap_px"] == 40 - sum(started.evidence["shell_radii_px"])
    assert started.evidence["enter_margin"] == 0.0
    assert "same_blob" in started.evidence
    assert started.text == "Targets 1 and 2 started to interact: their shells meet."


def test_notices_become_events_and_are_not_told_twice() -> None:
    reasoner = Reasoner({}, 640, 240)
    n = Notice(
        "track_confirmed",
        [1],
        "EVENTS 2: three supporting observations",
        {"hits": 3},
        "Target 1 confirmed.",
    )
    answer = reasoner.step(
        0, 0, Targets(0, [person(1, 100), person(2, 300)], notices=[n]), None
    )
    confirmed = [e for e in answer.events if e.kind == "track_confirmed"]
    assert [(e.id, e.subjects, e.evidence.get("hits")) for e in confirmed] == [
        (1, [1], 3),
        (2, [2], None),
    ]


def test_the_order_of_events_within_a_frame() -> None:
    frames = [
        [person(1, 100), person(2, 125), person(3, 300), person(4, 500)],
        [
            person(1, 100, 7),
            person(2, 120, 7),
            person(3, 300),
            person(4, 500, mode="appearance"),
        ],
        [person(1, 100), person(2, 128), person(5, 300), person(4, 500)],
    ]
    _, answers = run(frames)
    assert [(e.kind, e.subjects) for e in answers[2].events] == [
        ("mode_changed", [4]),
        ("track_confirmed", [5]),
        ("track_removed", [3]),
        ("entering", [5]),
        ("separated", [1, 2]),
        ("splitting", [1, 2]),
    ]


def disagreements(answers: list[SceneAnnotation]) -> list[tuple[int, object, object]]:
    """In which frame what was told to disagree with what."""
    return [
        (k, e.evidence["interaction"], e.evidence["relation"])
        for k, a in enumerate(answers)
        for e in a.events
        if e.kind == "disagreement"
    ]


def test_a_disagreement_is_told_once_per_episode() -> None:
    config = configure(SECTIONS, assignments=["interactions.safety_margin=3"])
    near, far = [person(1, 100), person(2, 200)], [person(1, 100), person(2, 600)]
    _, answers = run([near, near, near, far, near, near], config)
    assert disagreements(answers) == [
        (1, "grouping", "INDEPENDENT"),
        (4, "grouping", "INDEPENDENT"),
    ]
    assert answers[2].relations.relations == []  # recorded, never mended
    assert answers[2].tracks.tracks[0].grouping


def test_a_dispute_that_changes_kind_is_told_again() -> None:
    """The pair goes from grouping to grouped while its shells stay apart."""
    config = configure(
        SECTIONS, assignments=["interactions.safety_margin=3", "shell_model.k_s=0"]
    )
    apart = [person(1, 100), person(2, 200)]
    shared = [person(1, 100, 7), person(2, 200, 7)]
    _, answers = run([apart, apart, shared, shared], config)
    assert disagreements(answers) == [
        (1, "grouping", "INDEPENDENT"),
        (2, "grouped", "INDEPENDENT"),
    ]


def test_who_is_lost_out_of_a_group_is_told_as_the_reason_of_the_split() -> None:
    """EVENTS 3.1's own rule is cited where the group has no observation, and nowhere else."""
    both = [person(1, 100, 7), person(2, 110, 7)]
    lost = [person(1, 100, 7), person(2, 118, present=False, observed=False)]
    apart = [person(1, 100, 7), person(2, 110, 8)]
    texts = []
    for last in (lost, apart):
        _, answers = run([both, both, both, last])
        texts += [(e.rule, e.text) for e in answers[3].events if e.kind == "splitting"]
    assert texts == [
        (
            "EVENTS 3.1, ours: no group is observed over who is lost",
            "Targets 1 and 2 are splitting: 2 is lost, so that no group is seen over them.",
        ),
        (
            "EVENTS 3.1 splitting",
            "Targets 1 and 2 are splitting: their group is not observed any more.",
        ),
    ]


def test_torn_pairs_are_anomalies() -> None:
    _, answers = run(
        [[person(1, 100, 7), person(2, 110, 7)]] * 3
        + [[person(1, 100), person(2, 500)]] * 2
    )
    told = [
        (k, e.kind, e.evidence.get("case"))
        for k, a in enumerate(answers)
        for e in a.events
        if k >= 3
    ]
    assert told == [
        (3, "separated", "torn"),
        (3, "splitting", None),
        (3, "anomaly", None),
        (3, "anomaly", None),
        (4, "interaction_ended", "V"),
        (4, "single", None),
        (4, "single", None),
        (4, "group_ended", None),
    ]


def test_one_who_disappears_out_of_a_group_stays_for_one_frame() -> None:
    _, answers = run([[person(1, 100, 7), person(2, 110, 7)]] * 2 + [[person(1, 100)]] * 2)
    ghost = answers[2].tracks.tracks[1]
    assert (ghost.id, ghost.present, ghost.observed, ghost.mode, ghost.splitting) == (
        2,
        False,
        False,
        "predicted",
        True,
    )
    assert ghost.splitting_partners == [1]
    assert answers[2].relations.relations[0].state == "INTERACTION"
    assert [t.id for t in answers[3].tracks.tracks] == [1]
    gone = next(e for e in answers[3].events if e.kind == "interaction_ended")
    assert gone.evidence["gone"] == [2]
    assert "disappears" in gone.rule


def test_one_who_comes_back_in_the_next_frame_is_recovered() -> None:
    pair = [person(1, 100, 7), person(2, 110, 7)]
    _, answers = run([pair, pair, pair[:1], pair, pair])
    assert [e.kind for e in answers[3].events][:2] == ["track_recovered", "mode_changed"]
    assert answers[4].relations.relations[0].state == "JOINT"


def test_one_who_comes_back_later_is_recovered_under_its_id() -> None:
    _, answers = run([[person(1, 100)], [], [], [person(1, 120)]])
    assert [[e.kind for e in a.events] for a in answers] == [
        ["track_confirmed", "entering"],
        ["track_removed"],
        [],
        ["track_recovered"],
    ], "it had not left the scene, so it does not enter anew"


def test_one_who_left_enters_anew() -> None:
    _, answers = run(
        [[person(1, 100)], [person(1, 100)], [person(1, -8)], [], [person(1, 120)]]
    )
    assert [[e.kind for e in a.events] for a in answers] == [
        ["track_confirmed", "entering"],
        ["entered"],
        ["exiting"],
        ["track_removed", "exited"],
        ["track_recovered", "entering"],
    ]


def test_one_who_leaves_from_within_a_group_exits_in_the_frame_of_its_end() -> None:
    pair = [person(1, -4, 7), person(2, 8, 7)]
    inside = [person(1, 10, 7), person(2, 22, 7)]
    _, answers = run([inside, inside, pair, pair[1:], pair[1:]])
    assert [(e.kind, e.subjects) for e in answers[3].events][:3] == [
        ("track_removed", [1]),
        ("exited", [1]),
        ("separated", [1, 2]),
    ]
    assert [e.kind for e in answers[4].events] == [
        "interaction_ended",
        "single",
        "group_ended",
    ]


def test_who_appears_beside_another_within_the_scene_is_born_of_a_split() -> None:
    _, answers = run(
        [
            [person(1, 100)],
            [person(1, 100)],
            [person(1, 100), person(2, 118)],
            [person(1, 90), person(2, 126)],
        ]
    )
    told = {e.kind: e for e in answers[2].events}
    assert set(told) == {
        "track_confirmed",
        "interaction_started",
        "splitting",
        "group_entered_scene",
    }
    assert told["splitting"].evidence["inferred"]
    group = answers[2].groups.groups[0]
    assert (group.members, group.entered_as_one, group.formed_from) == ([1, 2], True, [])


def entered_as_one(answers: list[SceneAnnotation]) -> list[list[int]]:
    return [
        e.subjects for a in answers for e in a.events if e.kind == "group_entered_scene"
    ]


def test_who_splits_from_two_who_came_apart_has_come_with_nobody_known() -> None:
    apart, two = [person(1, 100), person(2, 300)], [person(1, 200), person(2, 212)]
    three = [*two, person(3, 206)]
    _, answers = run([apart, apart, two, three])
    assert entered_as_one(answers) == []
    # Who had come as one with another has come with a third as well.
    _, answers = run([[person(1, 200)], [person(1, 200)], two, three])
    assert entered_as_one(answers) == [[1, 2], [1, 2, 3]]


def test_who_may_be_a_partner_whom_nobody_sees_has_entered_with_nobody() -> None:
    met = [person(1, 200, 7), person(2, 212, 7)]
    told = []
    for observed in (True, False):
        hidden = person(2, 300, -1, observed=observed, mode="predicted")
        beside = [person(1, 200, 7), hidden, person(3, 214, 8)]
        _, answers = run([met, met, [person(1, 200, 7), hidden], beside])
        told.append(entered_as_one(answers))
    assert told == [[[1, 3]], []]


def test_a_group_names_whom_the_ones_before_it_had() -> None:
    def three(b: int, c: int) -> list[Target]:
        return [person(1, 100, 7), person(2, 112, b), person(3, 124, c)]

    _, answers = run([three(8, 9), three(7, 9), three(7, 7)])
    group = answers[2].groups.groups[0]
    assert (group.members, group.formed_from, group.former_members) == (
        [1, 2, 3],
        [1],
        [[1, 2]],
    )


def test_a_relation_says_since_when_they_have_met_and_been_partners() -> None:
    pairs = [(100, 160), (100, 150), (110, 140), (110, 138), (112, 126)]
    frames = [[person(1, a), person(2, b)] for a, b in pairs]
    frames[4] = [person(1, 112, 7), person(2, 126, 7)]
    _, answers = run(frames)
    rows = [
        [
            (r.state, r.since_frame, r.met_frame, r.partners_since_frame)
            for r in a.relations.relations
        ]
        for a in answers
    ]
    assert rows == [
        [],
        [("INTERACTION", 1, 1, None)],
        [("INTERACTION", 1, 1, 2)],
        [("INTERACTION", 1, 1, 2)],
        [("JOINT", 4, 1, 4)],
    ]


def test_one_who_is_not_in_the_picture_begins_nothing() -> None:
    _, answers = run(
        [
            [
                person(1, 100),
                person(2, 110, -1, present=False, observed=False, mode="predicted"),
            ]
        ]
        * 3
    )
    assert all(not a.relations.relations for a in answers)
    assert not answers[-1].tracks.tracks[0].grouping


def test_a_predicted_target_keeps_what_it_had_and_begins_nothing() -> None:
    seen = [person(1, 100), person(2, 110, -1)]
    lost = [person(1, 100), person(2, 110, -1, observed=False, mode="predicted")]
    _, answers = run([lost] * 2)
    assert all(not a.relations.relations for a in answers)
    assert not answers[1].tracks.tracks[1].grouping
    _, answers = run([seen, seen, lost])
    assert answers[2].relations.relations[0].state == "INTERACTION"
    assert answers[2].tracks.tracks[1].grouping


def test_group_tracks_of_the_tracker_are_used() -> None:
    frames = [[person(1, 100), person(2, 110)]] * 3
    _, answers = run(frames, group_tracks=[GroupTrack(4, (95, 95, 40, 60), True)])
    grouped = next(e for e in answers[1].events if e.kind == "grouped")
    assert grouped.evidence["region"] == "group track 4"
    formed = next(e for e in answers[1].events if e.kind == "group_formed")
    assert (formed.evidence["source"], formed.evidence["source_id"]) == ("group track", 4)


def test_regions_may_change_and_go_back_to_the_default() -> None:
    reasoner = Reasoner({}, 640, 240)
    square = [(10.0, 10.0), (630.0, 10.0), (630.0, 230.0), (10.0, 230.0)]
    given = Regions(640, 240, [square], [square], [Zone("shop", square)])
    assert (
        reasoner.step(0, 0, Targets(0, [person(1, 100)]), None).tracks.tracks[0].zones == []
    )
    assert reasoner.step(1, 1, Targets(1, [person(1, 100)]), given).tracks.tracks[
        0
    ].zones == ["shop"]
    assert reasoner.regions is given
    events = reasoner.step(2, 2, Targets(2, [person(1, 100)]), None).events
    assert [e.kind for e in events] == ["zone_left"]
    assert reasoner.regions.source == "default"


def test_everything_can_be_written_as_json() -> None:
    _, answers = run([[person(1, 100, 7), person(2, 110, 7)]] * 3 + [[]] * 2)
    for a in answers:
        plain = json.loads(msgspec.json.encode(a))
        assert set(plain) == {"tracks", "relations", "groups", "events", "graph"}
        assert all(e["kind"] in EVENT_KINDS for e in plain["events"])


def test_restoring_continues_as_if_nothing_had_happened() -> None:
    square = [(10.0, 10.0), (130.0, 10.0), (130.0, 230.0), (10.0, 230.0)]
    given = Regions(640, 240, [square], [square], [Zone("shop", square)])
    frames = [
        [
            person(1, 60 + 9 * f, 7 if 5 < f < 9 else 1),
            person(2, 150 - 5 * f, 7 if 5 < f < 9 else 2),
        ]
        for f in range(16)
    ]
    frames[8] = frames[8][:1]
    config = configure(SECTIONS, assignments=["relations.enter_duration_s=0.2"])
    for cut in range(1, 15):
        reasoner = Reasoner(config, 640, 240)
        for k in range(cut):
            reasoner.step(k, k * 10**8, Targets(k, frames[k]), given)
        twin = Reasoner(config, 640, 240)
        twin.restore(json.loads(json.dumps(reasoner.state())))
        for k in range(cut, 16):
            a, b = (
                r.step(k, k * 10**8, Targets(k, frames[k]), given) for r in (reasoner, twin)
            )
            assert msgspec.json.encode(a) == msgspec.json.encode(b)
        assert reasoner.state() == twin.state()


def test_a_section_of_the_wrong_kind_is_refused() -> None:
    with pytest.raises(TypeError, match="ShellParameters expected"):
        Reasoner({"shell_model": SECTIONS["regions"]()}, 640, 240)
