"""The ready questions on every scripted scene, against what the generator knows to be true.

The targets are the truth's, through the reasoning; so what is tested is what the questions make
of it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import pytest

from fixtures.scenes import SCRIPTS, GeneratedScene
from reasoning.questions import Case
from reasoning.questions.literals import Moment, zone_reference
from reasoning.questions.ready_questions import DEFAULT_CERTAINTY, Options, question
from recorders import channels
from recorders.log import LogReader
from recorders.messages import Event, Groups, Relations, Tracks

CHANNELS = ("tracks", "relations", "groups", "events")


@pytest.fixture(params=[n for n in SCRIPTS if n != "empty_scene"])
def asked(
    request: pytest.FixtureRequest, played: Callable[..., Any]
) -> Iterator[tuple[GeneratedScene, Case]]:
    scene, path = played(request.param)
    with Case([path]) as case:
        yield scene, case


def ask(case: Case, name: str, *words: object, **options: Any) -> list[dict]:
    answer = case.sql(question(name).sure_sql([str(w) for w in words], Options(**options)))
    return [dict(zip(answer.columns, row, strict=True)) for row in answer.rows]


def present(scene: GeneratedScene, frame: int) -> set[int]:
    """Who is tracked: from the first time partly in the region of interest to the time wholly
    beyond the border.
    """
    found = set()
    for actor in {s.actor for s in scene.truth.region_stays}:
        here = False
        for stay in sorted(
            (s for s in scene.truth.region_stays if s.actor == actor), key=lambda s: s.start
        ):
            if stay.start > frame:
                break
            here = stay.status != "outside" and (
                here or stay.status in ("inside", "partly")
            )
            if stay.end <= frame:
                gone = all(
                    s.start != stay.end
                    for s in scene.truth.region_stays
                    if s.actor == actor
                )
                here = here and not gone
        if here:
            found.add(actor)
    return found


def test_who_was_in_the_scene(asked: tuple[GeneratedScene, Case]) -> None:
    scene, case = asked
    for frame in range(0, scene.frame_count, max(1, scene.frame_count // 12)):
        rows = ask(case, "who-was-in", "scene", at=Moment(frame=frame))
        assert {r["track"] for r in rows} == present(scene, frame), frame


def test_who_was_in_a_zone_and_who_loitered(asked: tuple[GeneratedScene, Case]) -> None:
    scene, case = asked
    for visit in scene.truth.zone_visits:
        middle = (visit.start + visit.end) // 2
        rows = ask(case, "who-was-in", visit.zone, at=Moment(frame=middle))
        wanted = {
            v.actor
            for v in scene.truth.zone_visits
            if v.zone == visit.zone and v.start <= middle < v.end
        }
        assert {r["track"] for r in rows} == wanted
    for zone in {v.zone for v in scene.truth.zone_visits}:
        for least in (1.0, 5.0, 20.0):
            rows = ask(case, "loitered", zone, least_s=least, gap_s=0.0)
            stays = [
                (v.actor, v.start, v.end - 1)
                for v in scene.truth.zone_visits
                if v.zone == zone
            ]
            # The middle of a box's lower edge is where one stands to within a stride: two frames
            # at these paces.
            slack = 2 / scene.fps
            found = {r["track"]: (r["start_frame"], r["end_frame"]) for r in rows}
            assert {a for a, s, e in stays if (e - s) / scene.fps >= least + slack} <= set(
                found
            )
            assert set(found) <= {
                a for a, s, e in stays if (e - s) / scene.fps >= least - slack
            }
            for actor, start, end in stays:
                if actor in found:
                    assert abs(found[actor][0] - start) <= 2
                    assert abs(found[actor][1] - end) <= 2


def test_who_never_left(asked: tuple[GeneratedScene, Case]) -> None:
    scene, case = asked
    last = scene.frame_count - 1
    away = {
        a.id: [n for n in range(last + 1) if a.id not in present(scene, n)]
        for a in scene.truth.actors
    }
    wanted = {a for a, frames in away.items() if frames and last not in frames}
    rows = ask(case, "entered-never-left")
    assert {r["track"] for r in rows} == wanted
    for row in rows:
        assert row["there_at_the_end"]
        assert row["entered_frame"] == max(away[row["track"]]) + 1


CROWDED = ("crowd", "three_fish", "six_fish")
"""Scenes whose scripts say nothing of who is together: everybody keeps close to everybody."""


def test_together(asked: tuple[GeneratedScene, Case]) -> None:
    """Who was together and when, as the script says it, within a second where
    one comes or goes, or as far as the two are tracked.
    """
    scene, case = asked
    if scene.name in CROWDED:
        return
    slack = round(1.0 * scene.fps)
    for a, b in combinations([x.id for x in scene.truth.actors], 2):
        rows = ask(case, "together", b, a, certainty=DEFAULT_CERTAINTY)
        meant = [t for t in scene.truth.together if (t.a, t.b) == (a, b)]
        assert len(rows) == bool(meant), (scene.name, a, b, rows)
        if not meant:
            continue
        (row,) = rows
        tracked = [n for n in range(scene.frame_count) if {a, b} <= present(scene, n)]
        start = max(min(t.start for t in meant), tracked[0])
        end = min(max(t.end for t in meant), tracked[-1])
        assert abs(row["start_frame"] - start) <= slack, (scene.name, a, b)
        assert abs(row["end_frame"] - end) <= slack, (scene.name, a, b)


def test_phases_lead_up_to_and_out_of_the_time_together(
    asked: tuple[GeneratedScene, Case],
) -> None:
    _, case = asked
    order = {"approach": 0, "together": 1, "parting": 2}
    for a, b, first, last in case.rows(
        "SELECT a, b, start_frame, end_frame FROM encounters"
    ):
        parts = case.rows(
            "SELECT phase, start_frame, end_frame FROM phases WHERE a = ? AND b = ? AND"
            " start_frame <= ? AND end_frame >= ? ORDER BY start_frame",
            [a, b, last + 1, first - 1],
        )
        names = [order[name] for name, _, _ in parts]
        assert names == sorted(names)
        inside = [(s, e) for name, s, e in parts if name == "together"]
        assert (inside[0][0], inside[-1][1]) == (first, last)


@pytest.mark.parametrize(
    "name",
    ["pass_by", "full_occlusion", "leave_and_come_back", "stand_on_edge", "single_walker"],
)
def test_nobody_together(name: str, played: Callable[..., Any]) -> None:
    with Case([played(name)[1]]) as case:
        assert case.rows("SELECT * FROM encounters") == []


# From here on against the log's own messages, read one by one.


@dataclass
class Raw:
    """What the messages say: frames of relations, groups, presence, zones and bits; events."""

    events: list[Event] = field(default_factory=list)
    relations: dict[tuple[int, int, str, int], list[int]] = field(
        default_factory=lambda: defaultdict(list)
    )
    groups: dict[int, list[int]] = field(default_factory=lambda: defaultdict(list))
    members: dict[int, list[list[int]]] = field(default_factory=dict)
    parents: dict[int, list[int]] = field(default_factory=dict)
    presence: dict[int, list[int]] = field(default_factory=lambda: defaultdict(list))
    zones: dict[tuple[int, str], list[int]] = field(
        default_factory=lambda: defaultdict(list)
    )
    both: dict[tuple[int, tuple[int, ...], tuple[int, ...]], list[int]] = field(
        default_factory=lambda: defaultdict(list)
    )

    def intervals(self) -> list[tuple[int, int, str, int, int]]:
        """(a, b, state, first, last) of relations."""
        return [
            (a, b, state, s, e)
            for (a, b, state, _), n in self.relations.items()
            for s, e in runs(n)
        ]


def runs(frames: list[int]) -> list[tuple[int, int]]:
    """Runs of successive frames."""
    out: list[tuple[int, int]] = []
    for n in sorted(set(frames)):
        out = (
            [*out[:-1], (out[-1][0], n)] if out and out[-1][1] == n - 1 else [*out, (n, n)]
        )
    return out


@pytest.fixture
def raw(asked: tuple[GeneratedScene, Case]) -> Raw:
    _, case = asked
    told = Raw()
    with LogReader(case.inputs[0]) as log:
        for message in log.messages([channels.topic("camera", n) for n in CHANNELS]):
            name = channels.split(message.topic)[1]
            take(told, channels.decode(name, message.data, path=str(case.inputs[0])))
    return told


def take(told: Raw, message: object) -> None:
    if isinstance(message, Event):
        told.events.append(message)
    elif isinstance(message, Relations):
        for r in message.relations:
            told.relations[r.a, r.b, r.state, r.since_frame].append(message.frame)
    elif isinstance(message, Groups):
        for g in message.groups:
            told.groups[g.label].append(message.frame)
            # Who leaves a splitting group begins another row of the table.
            rows = told.members.setdefault(g.label, [])
            if sorted(g.members) not in rows:
                rows.append(sorted(g.members))
            told.parents[g.label] = list(g.formed_from)
    elif isinstance(message, Tracks):
        for t in (t for t in message.tracks if t.present):
            told.presence[t.id].append(message.frame)
            for zone in t.zones:
                told.zones[t.id, zone].append(message.frame)
            if t.grouping and t.splitting:
                partners = (
                    tuple(sorted(t.grouping_partners)),
                    tuple(sorted(t.splitting_partners)),
                )
                told.both[t.id, *partners].append(message.frame)


def within_a_second(spans: Iterable[tuple[int, int]], fps: float) -> list[tuple[int, int]]:
    """Spans of frames, those that follow one another within a second as one."""
    merged: list[tuple[int, int]] = []
    for start, end in spans:
        if merged and round((start - merged[-1][1]) / fps, 3) <= 1.0:
            merged[-1] = merged[-1][0], end
        else:
            merged.append((start, end))
    return merged


def test_met(asked: tuple[GeneratedScene, Case], raw: Raw) -> None:
    scene, case = asked
    for a in (x.id for x in scene.truth.actors):
        frames: dict[int, list[int]] = defaultdict(list)
        for (one, two, _, _), n in raw.relations.items():
            if a in (one, two):
                frames[one + two - a] += n
        wanted = sorted(
            (other, s, e)
            for other, n in frames.items()
            for s, e in within_a_second(runs(n), scene.fps)
        )
        rows = ask(case, "met", a)
        assert (
            sorted((r["other"], r["start_frame"], r["end_frame"]) for r in rows) == wanted
        )
        for row in rows:
            assert row["seconds"] == pytest.approx(
                (row["end_frame"] - row["start_frame"]) / scene.fps, abs=0.002
            )
            both = [
                x
                for x in ask(case, "met", a, row["other"])
                if x["start_frame"] == row["start_frame"]
            ]
            assert both == [row]


def test_contacts(asked: tuple[GeneratedScene, Case], raw: Raw) -> None:
    """The earliest arrival over at most so many contacts, contact by contact."""
    scene, case = asked
    for a in [x.id for x in scene.truth.actors][:4]:
        reached = {a: (-1, 0)}
        wanted: dict[int, tuple[int, int]] = {}
        for hops in (1, 2, 3):
            step: dict[int, tuple[int, int]] = {}
            for one, two, _, s, e in raw.intervals():
                for giver, taker in ((one, two), (two, one)):
                    if giver in reached and taker != a and e >= reached[giver][0]:
                        step[taker] = min(
                            step.get(taker, (10**9, 0)), (max(s, reached[giver][0]), hops)
                        )
            for taker, arrival in step.items():
                wanted[taker] = min(wanted.get(taker, arrival), arrival)
            reached = {a: (-1, 0), **wanted}
        rows = ask(case, "contacts", a, depth=3)
        assert {
            r["track"]: (round(r["reached_t"] * scene.fps), r["contacts"]) for r in rows
        } == wanted


def test_who_left_with_whom(asked: tuple[GeneratedScene, Case], raw: Raw) -> None:
    scene, case = asked
    last = scene.frame_count - 1
    exits = {e.subjects[0]: e.frame for e in raw.events if e.kind == "exited"}
    left = {
        t: exits.get(t, max(n))
        for t, n in raw.presence.items()
        if t in exits or max(n) < last
    }
    phases = case.rows("SELECT a, b, start_frame, end_frame FROM encounters")
    touched = [(a, b, s, e) for a, b, _, s, e in raw.intervals()] + phases
    slack = round(1.0 * scene.fps)
    for a in raw.presence:
        wanted = set()
        for b in left.keys() - {a} if a in left else ():
            until = min(left[a], left[b])
            near = any(
                {x, y} == {a, b} and s <= until and e >= until - slack
                for x, y, s, e in touched
            )
            if near and abs(left[a] - left[b]) <= round(5.0 * scene.fps):
                wanted.add(b)
        assert {r["other"] for r in ask(case, "left-with", a)} == wanted, a


def test_who_was_near_before(asked: tuple[GeneratedScene, Case], raw: Raw) -> None:
    scene, case = asked
    met = case.rows(
        "SELECT a, b, 'together: ' || kind, start_frame, end_frame FROM encounters"
    )
    chosen = [e for e in raw.events if e.subjects and e.kind != "mode_changed"]
    for event in chosen[:: max(1, len(chosen) // 12)]:
        wanted = {
            (subject, a + b - subject, how, s)
            for subject in event.subjects
            for a, b, how, s, e in [*raw.intervals(), *met]
            if subject in (a, b)
            and s < event.frame
            and event.frame - e <= round(3.0 * scene.fps)
        }
        rows = ask(case, "before", event.id, within_s=3.0)
        found = {
            (
                r["subject"],
                r["other"],
                r["how"],
                int(r["explain"].split()[0].rpartition("@")[2]),
            )
            for r in rows
        }
        assert found == wanted
        assert all(r["until_t"] <= event.frame / scene.fps + 1e-6 for r in rows)


def test_who_groups_and_splits(asked: tuple[GeneratedScene, Case], raw: Raw) -> None:
    _, case = asked
    wanted = sorted(
        (t, s, e, list(g), list(p)) for (t, g, p), n in raw.both.items() for s, e in runs(n)
    )
    found = [
        (
            r["track"],
            r["start_frame"],
            r["end_frame"],
            r["grouping_with"],
            r["splitting_from"],
        )
        for r in ask(case, "grouping-and-splitting")
    ]
    assert sorted(found) == wanted


def test_histories_of_groups(asked: tuple[GeneratedScene, Case], raw: Raw) -> None:
    _, case = asked
    for label in raw.groups:
        older, younger = {label}, {label}
        for _ in raw.groups:
            older |= {p for g in older for p in raw.parents.get(g, ())}
            younger |= {g for g, parents in raw.parents.items() if younger & set(parents)}
        found: dict[str, set[int]] = defaultdict(set)
        for row in ask(case, "group-history", label):
            found[row["is"]].add(row["group_id"])
            assert row["members"] in raw.members[row["group_id"]]
        assert found["itself"] == {label}
        assert found["ancestor"] == (older - {label}) & set(raw.groups)
        assert found["descendant"] == younger - {label}


def test_timelines_hold_everything_and_nothing_else(
    asked: tuple[GeneratedScene, Case], raw: Raw
) -> None:
    _, case = asked
    met = case.rows("SELECT a, b, start_frame FROM encounters")
    for track in raw.presence:
        wanted = [f"event:{e.id}" for e in raw.events if track in e.subjects]
        wanted += [
            f"relation:{a}-{b}@{s}" for a, b, _, s, _ in raw.intervals() if track in (a, b)
        ]
        wanted += [
            f"group:{g}"
            for g, rows in raw.members.items()
            for members in rows
            if track in members
        ]
        wanted += [f"track:{track}@{s}" for s, _ in runs(raw.presence[track])]
        wanted += [
            zone_reference(track, s, z)
            for (t, z), n in raw.zones.items()
            if t == track
            for s, _ in runs(n)
        ]
        wanted += [f"encounter:{a}-{b}@{s}" for a, b, s in met if track in (a, b)]
        rows = ask(case, "timeline", track)
        assert sorted(r["explain"] for r in rows) == sorted(wanted)
        assert [r["start_t"] for r in rows] == sorted(r["start_t"] for r in rows)


def test_two_leave_together_in_the_demo(played: Callable[..., Any]) -> None:
    with Case([played("demo")[1]]) as case:
        assert [r["other"] for r in ask(case, "left-with", 1)] == [3]
        assert [r["other"] for r in ask(case, "left-with", 3)] == [1]
        assert ask(case, "left-with", 4) == []
