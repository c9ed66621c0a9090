"""Differences by meaning: numbers of tracks are none, what happens otherwise is told in words."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from fixtures.planted_differences import copy_log
from recorders import channels
from recorders.errors import RecordingError
from recorders.log import LogReader
from replay.cli import main
from replay.compare import CompareOptions, compare, words
from replay.compare.activity import nearest
from replay.compare.difference import Difference
from replay.compare.matching import TrackPair
from replay.compare.semantic import _how_far
from replay.compare.weight import weightiest

SHIFT = 7
_TRACK_FIELDS = ("id", "a", "b")
_LISTS = (
    "subjects",
    "members",
    "grouping_partners",
    "grouped_partners",
    "splitting_partners",
    "partners_before",
)


def renumbered(value: Any, number: Callable[[int], int]) -> Any:
    """A JSON message with every track's number changed, and groups' labels by 100, as another
    replay numbers them.
    """
    if isinstance(value, list):
        return [renumbered(v, number) for v in value]
    if not isinstance(value, dict):
        return value
    out: dict[str, Any] = {}
    for key, v in value.items():
        if key in _TRACK_FIELDS and isinstance(v, int) and "kind" not in value:
            out[key] = number(v)
        elif key in _LISTS:
            out[key] = sorted(number(i) for i in v)
        elif key in ("group", "label") and isinstance(v, int):
            out[key] = v + 100
        elif key == "groups" and v and isinstance(v[0], int):
            out[key] = [i + 100 for i in v]
        elif key == "text":
            out[key] = re.sub(r"\d+", lambda m: str(number(int(m[0]))), v)
        else:
            out[key] = renumbered(v, number)
    return out


def write_renumbered(source: Path, out: Path, number: Callable[[int], int]) -> Path:
    def edit(message: Any) -> bytes:
        name = channels.split(message.topic)[1]
        if name not in ("tracks", "relations", "groups", "events"):
            return message.data
        made = renumbered(msgspec.json.decode(message.data), number)
        if name == "tracks":
            made["tracks"].sort(key=lambda t: t["id"])
        for edge in made.get("relations", []):
            edge["a"], edge["b"] = sorted((edge["a"], edge["b"]))
        return msgspec.json.encode(made)

    copy_log(source, out, edit)
    return out


@pytest.mark.parametrize("number", [lambda i: i + SHIFT, lambda i: 50 - i, lambda i: {1: 2, 2: 3, 3: 1}.get(i, i)],
                         ids=["shifted", "reversed", "permuted"])  # fmt: skip
def test_other_numbers_are_no_difference(
    trusted: Path, tmp_path: Path, number: Callable[[int], int]
) -> None:
    a = trusted / "annotated.mcap"
    found = compare(a, write_renumbered(a, tmp_path / "b.mcap", number))
    assert not found.identical
    assert found.equal, found.lines()
    assert found.tracks == {1: number(1), 2: number(2), 3: number(3)}
    assert "equal in meaning" in found.lines()[0]


def test_identities_swapped_on_the_way_are_one_difference_each(
    trusted: Path, tmp_path: Path
) -> None:
    """From frame 40 on tracks 1 and 2 change their names: who they are differs, what happens does
    not.
    """
    swap = {1: 2, 2: 1}

    def edit(message: Any) -> bytes:
        name = channels.split(message.topic)[1]
        value = (
            msgspec.json.decode(message.data)
            if name in ("tracks", "relations", "groups", "events")
            else {}
        )
        if value.get("frame", 0) < 40:
            return message.data
        made = renumbered(value, lambda i: swap.get(i, i))
        if name == "tracks":
            made["tracks"].sort(key=lambda t: t["id"])
        for edge in made.get("relations", []):
            edge["a"], edge["b"] = sorted((edge["a"], edge["b"]))
        return msgspec.json.encode(made)

    copy_log(trusted / "annotated.mcap", tmp_path / "b.mcap", edit)
    found = compare(trusted / "annotated.mcap", tmp_path / "b.mcap", CompareOptions(0.5))
    identities = [d for d in found.differences if d.what == "identity"]
    assert [(d.frame, d.subjects, d.text) for d in identities] == [
        (40, [1], "track 1 is B's track 2 from 1.6 s on, B's track 1 before"),
        (40, [2], "track 2 is B's track 1 from 1.6 s on, B's track 2 before"),
    ]
    assert {d.what for d in found.differences} <= {"identity", "track"}, found.lines()


def test_a_track_that_is_cut_in_two_is_a_change_of_identity(
    trusted: Path, tmp_path: Path
) -> None:
    a = trusted / "annotated.mcap"

    def cut(message: Any) -> bytes:
        name = channels.split(message.topic)[1]
        value = (
            msgspec.json.decode(message.data)
            if name in ("tracks", "relations", "groups", "events")
            else {}
        )
        if value.get("frame", 0) < 60:
            return message.data
        return msgspec.json.encode(renumbered(value, lambda i: 30 if i == 2 else i))

    copy_log(a, tmp_path / "b.mcap", cut)
    there = compare(a, tmp_path / "b.mcap", CompareOptions(0.5))
    texts = [d.text for d in there.differences if d.what == "identity"]
    assert texts == ["track 2 is B's track 30 from 2.4 s on, B's track 2 before"]
    assert not [d for d in there.differences if d.what in ("event", "group", "relation")], (
        there.lines()
    )
    back = compare(tmp_path / "b.mcap", a, CompareOptions(0.5))
    texts = [d.text for d in back.differences if d.what == "identity"]
    assert texts == ["B's track 2 is track 30 from 2.4 s on, track 2 before"]


def renamed_tracks(source: Path, out: Path, first: int, names: dict[int, int]) -> Path:
    """The same log, its tracks under other numbers from a frame on, and nothing else."""

    def edit(message: Any) -> bytes:
        if channels.split(message.topic)[1] != "tracks":
            return message.data
        value = msgspec.json.decode(message.data)
        if value["frame"] >= first:
            for track in value["tracks"]:
                track["id"] = names.get(track["id"], track["id"])
            value["tracks"].sort(key=lambda track: track["id"])
        return msgspec.json.encode(value)

    copy_log(source, out, edit)
    return out


@pytest.mark.parametrize("tolerance", [0.0, 1.0])
def test_who_is_called_otherwise_from_a_frame_on_has_not_vanished(
    trusted: Path, tmp_path: Path, tolerance: float
) -> None:
    """The longer part of the story may have the new number: partners are who they are for most of
    the time.
    """
    a = trusted / "annotated.mcap"
    for first in (30, 60, 170):
        found = compare(
            a,
            renamed_tracks(a, tmp_path / "b.mcap", first, {1: 9}),
            CompareOptions(tolerance),
        )
        told = [
            (d.what, d.frame, d.subjects)
            for d in found.differences
            if d.what in ("track", "identity")
        ]
        assert told == [("identity", first, [1])], found.lines()
    found = compare(
        a,
        renamed_tracks(a, tmp_path / "b.mcap", 60, {1: 2, 2: 1}),
        CompareOptions(tolerance),
    )
    told = [
        (d.what, d.frame, d.subjects)
        for d in found.differences
        if d.what in ("track", "identity")
    ]
    assert told == [("identity", 60, [1]), ("identity", 60, [2])], found.lines()


def test_what_is_elsewhere_under_another_number_is_told(
    trusted: Path, tmp_path: Path
) -> None:
    a = trusted / "annotated.mcap"
    renamed_tracks(a, tmp_path / "b.mcap", 60, {1: 9})

    def moved(message: Any) -> bytes:
        value = (
            msgspec.json.decode(message.data)
            if channels.split(message.topic)[1] == "tracks"
            else {}
        )
        for track in value.get("tracks", []):
            if value["frame"] == 80 and track["id"] == 9:
                track["box"][0] += 0.6
            if value["frame"] in (90, 91) and track["id"] == 9:
                track["box"][0] += 300.0
        return msgspec.json.encode(value) if value else message.data

    copy_log(tmp_path / "b.mcap", tmp_path / "c.mcap", moved)
    found = compare(a, tmp_path / "c.mcap", CompareOptions(0.3))
    (told,) = [d for d in found.differences if d.what == "track"]
    assert (told.frame, told.details["frames"], told.details["frames_apart"]) == (80, 3, 2)
    assert "lies elsewhere in 3 of" in told.text


@pytest.fixture(scope="module")
def other(trusted: Path, told: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same scene with wider safety areas: grouping begins earlier, splits end later."""
    out = tmp_path_factory.mktemp("other") / "other.mcap"
    return told(trusted / "scene.mcap", out, "interactions.safety_margin=0.6")


def test_another_configuration_is_told_in_words(trusted: Path, other: Path) -> None:
    found = compare(trusted / "annotated.mcap", other)
    assert found.made == ["parameter: interactions.safety_margin = 0.6, not 0.25"]
    lines = "\n".join(found.lines())
    assert re.search(
        r"event +moved +tracks 1 and 2 are grouping at \d\.\d\d s, no longer at \d\.\d\d s",
        lines,
    ), lines
    assert found.tracks == {t: t for t in found.tracks}
    assert {d.what for d in found.differences} <= {"event", "track", "relation", "group"}
    assert [d.frame for d in found.differences] == sorted(
        d.frame for d in found.differences
    )
    back = compare(other, trusted / "annotated.mcap")
    assert len(back.differences) == len(found.differences)


def test_an_event_that_is_gone_and_one_that_is_new(trusted: Path, tmp_path: Path) -> None:
    a = trusted / "annotated.mcap"

    def edit(message: Any) -> bytes | None:
        return (
            None
            if channels.split(message.topic)[1] == "events"
            and b'"splitting"' in message.data
            else message.data
        )

    copy_log(a, tmp_path / "b.mcap", edit)
    gone = compare(a, tmp_path / "b.mcap", CompareOptions(1.0))
    assert {(d.what, d.change) for d in gone.differences} == {("event", "vanished")}
    assert re.fullmatch(
        r"group \d+ \(tracks \d and \d\) no longer splits at \d+\.\d s",
        gone.differences[0].text,
    )
    new = compare(tmp_path / "b.mcap", a, CompareOptions(1.0))
    assert re.fullmatch(
        r"group \d+ of B \(tracks \d and \d\) now splits at \d+\.\d s",
        new.differences[0].text,
    )


def without_frame(source: Path, out: Path, frame: int, late: bool) -> Path:
    """A log that lacks a frame; what happened in it happens in the next one, where ``late``, or
    not at all.
    """
    gone, after = (round(k * 1e9 / 25) for k in (frame, frame + 1))

    def edit(message: Any) -> bytes | None:
        if message.log_time_ns != gone:
            return message.data
        if channels.split(message.topic)[1] != "events" or not late:
            return None
        value = msgspec.json.decode(message.data)
        return msgspec.json.encode({**value, "frame": frame + 1, "time_ns": after})

    def time_ns(message: Any) -> int:
        return after if message.log_time_ns == gone else message.log_time_ns

    copy_log(source, out, edit, time_ns=time_ns)
    return out


def grouping_frames(log: Path) -> list[int]:
    """The frames in which somebody is grouping."""
    with LogReader(log) as reader:
        events = [
            m
            for m in reader.messages()
            if channels.split(m.topic)[1] == "events" and b'"grouping"' in m.data
        ]
    return [round(m.log_time_ns * 25 / 1e9) for m in events]


def test_what_happens_in_a_frame_that_the_other_log_lacks(
    trusted: Path, tmp_path: Path
) -> None:
    a, frame = trusted / "annotated.mcap", grouping_frames(trusted / "annotated.mcap")[0]
    late = without_frame(a, tmp_path / "late.mcap", frame, late=True)
    for pair, change, counted in (
        ((a, late), "vanished", frame),
        ((late, a), "appeared", frame + 1),
    ):
        found = compare(*pair, CompareOptions(1.0)).differences
        assert {(d.what, d.change) for d in found} == {
            ("frames", change),
            ("event", "moved"),
        }
        assert {d.frame for d in found if d.what == "event"} == {counted}, "as A counts"
    never = without_frame(a, tmp_path / "never.mcap", frame, late=False)
    for pair, change in (((a, never), "vanished"), ((never, a), "appeared")):
        found = compare(*pair, CompareOptions(1.0)).differences
        assert {(d.what, d.change) for d in found} == {
            ("frames", change),
            ("event", change),
        }
        assert any("grouping" in d.text for d in found)


def test_deep_in_a_gap_nothing_can_be_known(trusted: Path, tmp_path: Path) -> None:
    a, frame = trusted / "annotated.mcap", grouping_frames(trusted / "annotated.mcap")[0]
    gap = range(frame - 10, frame + 11)

    def edit(message: Any) -> bytes | None:
        return None if round(message.log_time_ns * 25 / 1e9) in gap else message.data

    copy_log(a, tmp_path / "gap.mcap", edit)
    for tolerance_s, change in ((0.3, None), (0.5, "vanished")):
        found = compare(
            a, tmp_path / "gap.mcap", CompareOptions(1.0, tolerance_s)
        ).differences
        told = {d.change for d in found if d.what == "event" and d.frame == frame}
        assert told == ({change} if change else set())


def test_events_of_the_same_frames_at_another_time_are_the_same(
    trusted: Path, tmp_path: Path
) -> None:
    """Where no time is common, frames are held against each other by their numbers, and so is
    what happens in them.
    """
    a, hour = trusted / "annotated.mcap", 3600 * 1_000_000_000
    copy_log(a, tmp_path / "b.mcap", time_ns=lambda message: message.log_time_ns + hour)
    for pair in ((a, tmp_path / "b.mcap"), (tmp_path / "b.mcap", a)):
        found = compare(*pair, CompareOptions(1.0))
        assert not [
            d for d in found.differences if d.what in ("event", "relation", "group")
        ], found.lines()


def test_half_the_frames_are_no_other_story(trusted: Path, tmp_path: Path) -> None:
    """What happens in a frame that the other rate has not happens in its next one: moved, and
    nothing is made up.
    """
    a = trusted / "annotated.mcap"

    def time_ns(message: Any) -> int:
        k = round(message.log_time_ns * 25 / 1e9)
        return round((k + k % 2) * 1e9 / 25)

    def edit(message: Any) -> bytes | None:
        odd = round(message.log_time_ns * 25 / 1e9) % 2
        return (
            None if odd and channels.split(message.topic)[1] != "events" else message.data
        )

    copy_log(a, tmp_path / "half.mcap", edit, time_ns=time_ns)
    found = compare(a, tmp_path / "half.mcap", CompareOptions(1.0))
    assert {(d.what, d.change) for d in found.differences} == {
        ("frames", "vanished"),
        ("event", "moved"),
    }
    (text,) = [d.text for d in found.differences if d.what == "frames"]
    assert text == "100 frames are in A only: frames 1, 3, 5 and 97 more intervals"


def test_a_group_that_only_a_frame_that_the_other_log_lacks_knows(
    trusted: Path, tmp_path: Path
) -> None:
    a, frame = trusted / "annotated.mcap", 20
    never = without_frame(a, tmp_path / "never.mcap", frame, late=False)

    def grouped(message: Any) -> bytes:
        value = (
            msgspec.json.decode(message.data)
            if channels.split(message.topic)[1] == "groups"
            else {}
        )
        if value.get("frame") != frame:
            return message.data
        group = {
            "label": 77,
            "members": [1, 2],
            "observed": True,
            "since_frame": frame,
            "since_ns": 0,
        }
        return msgspec.json.encode({**value, "groups": [group]})

    copy_log(a, tmp_path / "more.mcap", grouped)
    found = compare(tmp_path / "more.mcap", never, CompareOptions(1.0)).differences
    assert [(d.what, d.change, d.subjects) for d in found if d.what == "group"] == [
        ("group", "vanished", [1, 2])
    ]


def test_a_span_against_the_whole(trusted: Path, told: Any, tmp_path: Path) -> None:
    span = {"from_ns": 1_000_000_000, "to_ns": 3_000_000_000, "annotations_only": True}
    told(trusted / "scene.mcap", tmp_path / "span.mcap", **span)
    found = compare(trusted / "annotated.mcap", tmp_path / "span.mcap")
    assert [(d.what, d.change, d.frame) for d in found.differences] == [
        ("frames", "vanished", 0),
    ], found.lines()
    assert found.differences[0].details == {"frames": 150}
    assert (
        found.differences[0].text
        == "150 frames are in A only: frames 0 to 24 and 75 to 199"
    )
    shared = compare(
        trusted / "annotated.mcap", tmp_path / "span.mcap", CompareOptions(only_shared=True)
    )
    assert shared.identical, "frames that only one of them has do not count"
    assert shared.lines() == ["identical: 50 frames"]


def test_frames_between_those_of_the_other_log_are_one_interval(
    trusted: Path, tmp_path: Path
) -> None:
    """Of two logs some of whose frames alternate, each tells its own without a break."""

    def some(of: range, later_ns: int = 0) -> Path:
        out = tmp_path / f"{of.start}_{later_ns}.mcap"

        def kept(message: Any) -> bytes | None:
            return message.data if round(message.log_time_ns * 25 / 1e9) in of else None

        def time_ns(message: Any) -> int:
            return message.log_time_ns + later_ns * (message.log_time_ns >= 2_000_000_000)

        copy_log(trusted / "annotated.mcap", out, kept, time_ns=time_ns)
        return out

    found = compare(
        some(range(1, 61)), some(range(62), 10_000_000), CompareOptions(1.0)
    ).differences
    assert [(d.change, d.text) for d in found if d.what == "frames"] == [
        ("appeared", "13 frames are in B only: frames 0 and 50 to 61"),
        ("vanished", "11 frames are in A only: frames 50 to 60"),
    ]
    found = compare(some(range(1, 61)), some(range(2, 61)), CompareOptions(1.0)).differences
    assert [d.text for d in found if d.what == "frames"] == [
        "1 frame is in A only: frame 1"
    ]


def test_now_and_no_longer_stand_where_they_belong() -> None:
    assert words.verb("track_confirmed", True, "now") == "is now confirmed"
    assert words.verb("track_lost", False, "no longer") == "are no longer lost"
    assert words.verb("entered", True, "now") == "has now entered"
    assert words.verb("splitting", True, "no longer") == "no longer splits"
    assert words.verb("unheard_of", True, "now") == "now has an event unheard_of"
    assert words.tracks(["B's 1"]) == "B's track 1"
    assert words.tracks(["1", "2"]) == "tracks 1 and 2"
    assert words.tracks(["1", "2", "B's 7"]) == "tracks 1 and 2 and B's track 7"
    assert words.tracks(["4", "B's 7", "B's 9"]) == "track 4 and B's tracks 7 and 9"


def test_an_annotation_without_a_track(trusted: Path, tmp_path: Path) -> None:
    copy_log(
        trusted / "annotated.mcap",
        tmp_path / "empty.mcap",
        lambda m: (
            re.sub(rb'"tracks":\[.*\]', b'"tracks":[]', m.data)
            if m.topic.endswith("/tracks")
            else m.data
        ),
    )
    found = compare(trusted / "annotated.mcap", tmp_path / "empty.mcap")
    assert [d.subjects for d in found.differences if d.what == "track"] == [[1], [2], [3]]
    assert compare(tmp_path / "empty.mcap", tmp_path / "empty.mcap").identical
    back = compare(tmp_path / "empty.mcap", trusted / "annotated.mcap")
    assert {d.change for d in back.differences if d.what == "track"} == {"appeared"}


def test_the_command(
    trusted: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = str(trusted / "annotated.mcap")
    assert main(["diff", a, a]) == 0
    assert capsys.readouterr().out == "identical: 200 frames\n"
    assert main(["diff", a, str(other), "--json"]) == 4
    plain = json.loads(capsys.readouterr().out)
    assert plain["equal"] is False
    assert plain["differences"][0].keys() == {
        "what",
        "change",
        "frame",
        "t",
        "subjects",
        "text",
        "details",
    }
    assert sum(plain["counts"].values()) == len(plain["differences"])
    page = tmp_path / "diff.html"
    assert main(["diff", a, str(other), "--html", str(page)]) == 4
    html = page.read_text(encoding="utf-8")
    assert html.count("data:image/jpeg;base64,") >= 4
    assert not re.search(r"""(src|href)=["'](?!data:)""", html), (
        "the page must open offline"
    )
    assert "interactions.safety_margin = 0.6, not 0.25" in html
    assert main(["diff", a, str(other), "--html", str(page)]) == 1
    assert "exists already" in capsys.readouterr().err
    assert main(["diff", a, a, "--tolerance", "-1"]) == 2
    assert main(["diff", a, a, "--time-tolerance", "nan"]) == 2


def test_replay_against(
    trusted: Path, by_events: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, a = str(trusted / "scene.mcap"), str(by_events)
    assert main(["replay", scene, "--against", a]) == 0
    assert "identical: 200 frames" in capsys.readouterr().out
    out = tmp_path / "b.mcap"
    words = [
        "replay",
        scene,
        "-o",
        str(out),
        "--against",
        a,
        "--set",
        "interactions.safety_margin=0.6",
    ]
    assert main(words) == 4
    said = capsys.readouterr().out
    assert "interactions.safety_margin = 0.6, not 0.25" in said
    assert "grouping" in said
    assert out.exists()
    # What was set for that log is the ground for the next comparison: only the new word differs.
    assert main(["replay", scene, "--against", str(out), "--from", "1", "--to", "2"]) == 0
    assert main(["replay", scene]) == 2


def test_the_file_and_the_frame_that_cannot_be_read_are_named(
    trusted: Path, tmp_path: Path
) -> None:
    a, b = trusted / "annotated.mcap", tmp_path / "b.mcap"
    for name in ("tracks", "events", "relations"):
        hit: list[int] = []

        def edit(message: Any, name: str = name, hit: list[int] = hit) -> bytes:
            if (
                channels.split(message.topic)[1] != name
                or message.log_time_ns < 1_600_000_000
                or hit
            ):
                return message.data
            hit.append(message.sequence)
            return b"{}"

        copy_log(a, b, edit)
        for pair in ((a, b), (b, a)):
            with pytest.raises(
                RecordingError, match=f"not an? {name} message.*after frame {hit[0] - 1}"
            ) as e:
                compare(*pair)
            assert e.value.path == b


def test_what_is_no_annotated_log(trusted: Path) -> None:
    with pytest.raises(RecordingError, match="not an annotated log"):
        compare(trusted / "scene.mcap", trusted / "annotated.mcap")


def test_nearest_pairs_are_found_first_and_ties_go_to_the_earlier() -> None:
    assert nearest([0, 10], [9, 30], 5) == ([(1, 0)], [0], [1])
    assert nearest([5], [0, 10], 5) == ([(0, 0)], [], [1])
    assert nearest([], [1], 5) == ([], [], [0])
    assert nearest([1, 2, 3], [1, 2, 3], 5) == ([(0, 0), (1, 1), (2, 2)], [], [])


def _difference(what: str, change: str, frame: int, **details: object) -> Difference:
    return Difference(
        what, change, frame, frame / 10, [1], f"{what} {frame}", dict(details)
    )


def test_what_matters_most_comes_first() -> None:
    values = [_difference("event", "changed", f) for f in range(20)]
    quiet = [_difference("event", "vanished", f, kind="mode_changed") for f in range(5)]
    swaps = [_difference("identity", "changed", f) for f in range(30, 36)]
    gone = [_difference("track", "vanished", f, frames=f) for f in (40, 50)]
    met = [_difference("encounter", "appeared", 60, b=[60, 90])]
    found = weightiest([*values, *quiet, *gone, *met, *swaps], 10)
    assert [(d.what, d.frame) for d in found] == [
        *(("identity", f) for f in range(30, 36)),
        ("track", 50),
        ("track", 40),
        ("encounter", 60),
        ("event", 0),
    ]
    assert found[-1].details == {"kind": "mode_changed"}
    assert [d.what for d in weightiest([*swaps, *met], 4)] == ["identity"] * 3 + [
        "encounter"
    ]


@pytest.mark.parametrize(
    ("pair", "apart", "said"),
    [
        (TrackPair(far=3, largest_px=4.5), 0, "by up to 4.5 px"),
        (TrackPair(disjoint=7), 7, "without overlap"),
        (TrackPair(far=2, disjoint=7), 7, "in 7 without overlap"),
        (TrackPair(disjoint=2), 7, "in 7 with less than half in common, in 2 without any"),
        (TrackPair(), 7, "in 7 with less than half in common"),
    ],
)
def test_without_overlap_is_said_where_it_is_so(
    pair: TrackPair, apart: int, said: str
) -> None:
    assert _how_far(pair, apart) == said
