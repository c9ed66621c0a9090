"""The questions that an investigator asks: who crossed a line, how many, how long, who followed
whom, what happened then, who left a thing and who took it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from string import Template

from reasoning.questions import desk_statements as sql
from reasoning.questions import statements
from reasoning.questions.literals import literal, moment, zone_word
from reasoning.questions.question import Options, Question, track_of
from recorders.errors import UsageError

DIRECTIONS = ("left", "right", "up", "down")
SETTLED_S = 1.0
"""Who is first seen so soon after the recording's start was there when it started."""
_GAP_S = 2.0
HEATMAP_CELL = 8
"""Pixels."""
_TOLD = (
    "entered", "exited", "returned", "group_formed", "group_changed", "group_entered_scene",
    "scene_changed",
)  # fmt: skip
"""Events that a person calls a happening; the rest are states of trackers and relations."""


def stays_of(words: Sequence[str]) -> Mapping[str, str]:
    """The SQL of the stays in a zone, or in the scene; what they are, to be explained."""
    if words[0] == "scene":
        return {"stays": statements.SCENE_STAYS, "what": "track", "which": ""}
    stays = Template(statements.ZONE_STAYS).substitute(zone=literal(words[0]))
    return {"stays": stays, "what": "zone", "which": f":{zone_word(words[0])}"}


def _crossed(words: Sequence[str], options: Options) -> Mapping[str, str]:
    way = options.direction
    if way is not None and way not in DIRECTIONS:
        raise UsageError(f"--direction {way}: must be one of {', '.join(DIRECTIONS)}")
    which = "" if way is None else f" AND direction = {literal(way)}"
    return {"line": literal(words[0]), "which": which}


def _dwell(words: Sequence[str], options: Options) -> Mapping[str, str]:
    return {**stays_of(words), "gap": repr(_or(options.gap_s, _GAP_S))}


def _count(words: Sequence[str], options: Options) -> Mapping[str, str]:
    every = _or(options.every_s, 3600.0)
    if every < 0.1:
        raise UsageError(f"--every {every:g}s: must be at least 0.1 s")
    return {
        **_dwell(words, options),
        "name": literal(words[0]),
        "every": repr(every),
        "settled": repr(SETTLED_S),
        "sure": repr(options.certainty or 0.0),
    }


def _followed(words: Sequence[str], options: Options) -> Mapping[str, str]:
    return {
        "a": str(track_of(words[0])),
        "whom": f" AND b.track = {track_of(words[1])}" if len(words) > 1 else "",
        "shortest": "0.6",
        "within": repr(_or(options.within_s, 10.0)),
        "least": repr(_or(options.least_s, 3.0)),
    }


def _one(words: Sequence[str], _: Options) -> Mapping[str, str]:
    return {"a": str(track_of(words[0]))}


def _between(words: Sequence[str], options: Options) -> Mapping[str, str]:
    first, last = (moment(word, options.timezone) for word in words)
    return {
        "t1": first.sql("r"),
        "t2": last.sql("r"),
        "told": ", ".join(map(literal, _TOLD)),
    }


def _thing(words: Sequence[str], *, first: bool) -> Mapping[str, str]:
    """Of a thing that was there from the start nobody can be seen to leave it, of one that is
    there at the end nobody to take it.
    """
    whose = f"s.track = {track_of(words[0])}" if words else "true"
    return {
        "whose": f"{whose} AND {'s.first_t > ' + repr(SETTLED_S) if first else 's.last_t < r.seconds'}",
        "named": str(bool(words)).lower(),
        "end": "first" if first else "last",
    }


def _left(words: Sequence[str], _: Options) -> Mapping[str, str]:
    return _thing(words, first=True)


def _took(words: Sequence[str], _: Options) -> Mapping[str, str]:
    return _thing(words, first=False)


def _anybody(words: Sequence[str], _: Options) -> Mapping[str, str]:
    whose = f"track = {track_of(words[0])}" if words else "true"
    return {"whose": whose, "cell": str(HEATMAP_CELL)}


def _apart(words: Sequence[str], _: Options) -> Mapping[str, str]:
    a, b = (track_of(word) for word in words)
    if a == b:
        raise UsageError(f"--ask apart {a} {b}: two different targets are wanted")
    return {"a": str(a), "b": str(b)}


def _or(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value


DESK: Sequence[Question] = (
    Question("crossed", "LINE [--direction left]", "who crossed a line (--line NAME=x1,y1,x2,y2), when, which way",
             sql.CROSSED, _crossed,
             "nobody's feet crossed line LINE; draw it where people walk, a line's ends count", ("direction",),
             few_from=1),
    Question("count", "ZONE|LINE --every 1h", "how many came into and went out of a zone, or crossed a line, by spans",
             sql.COUNT, _count, "", ("every_s", "gap_s"), certain=True),
    Question("dwell", "ZONE", "how long each one stayed in a zone, all stays together (gaps up to --gap 2s closed)",
             sql.DWELL, _dwell, "nobody stood in ZONE; a target stands where its box ends below", ("gap_s",)),
    Question("followed", "A [B]", "who walked the way that A walked, at most --within 10s behind, for --min 3s",
             sql.FOLLOWED, _followed,
             "nobody walked where target A had walked, for so long and so near; widen --within, lower --min",
             ("within_s", "least_s"), few_from=1),
    Question("first-last", "A", "where and when A was seen first and last", sql.FIRST_LAST, _one, few_from=1),
    Question("between", "T1 T2", "what happened from T1 to T2: who came, went, met, grouped, stood where", sql.BETWEEN,
             _between, "nothing happened from T1 to T2 that the rules know of", few_from=2),
    Question("left", "[OBJECT]", "who was nearest where a thing (small, still) was first seen, and when he went away",
             sql.LEFT_BEHIND, _left,
             "nothing small and still was first seen near anybody; `left ID` asks of a target that is no such thing"),
    Question("took", "[OBJECT]", "who was nearest when a thing (small, still) was last seen in its place", sql.TOOK,
             _took, "nothing small and still was last seen near anybody; what is there at the end was not taken"),
    Question("moved", "[A]", "how far and how fast in metres, with their errors (--homography or --height)",
             sql.MOVED, _anybody, "nobody has metres: give --homography points.csv or --height 1.75"),
    Question("apart", "A B", "how near A and B came in metres, with its error (--homography or --height)", sql.APART,
             _apart, "the two were never there at one time, or have no metres: give --homography or --height"),
    Question("heatmap", "[A]", "where people's feet were for how long, by squares; -o FILE.png draws it", sql.HEATMAP,
             _anybody, certain=False),
)  # fmt: skip
