"""Events and who they are about, in words: "group 5 (tracks 1 and 2) no longer splits"."""

from __future__ import annotations

from collections.abc import Sequence

from recorders.messages import EVENT_WORDS
from replay.plurals import count_of

_THEIRS = "B's "


def listed(names: Sequence[str]) -> str:
    """Names as a list in a sentence.

    >>> listed(["1"]), listed(["1", "2", "B's 7"])
    ('1', "1, 2 and B's 7")
    """
    return (
        names[0]
        if len(names) == 1
        else f"{', '.join(names[:-1])} and {names[-1]}"
        if names
        else "nobody"
    )


def tracks(names: Sequence[str]) -> str:
    """Tracks by their names, A's and then B's.

    >>> tracks(["1", "2"]), tracks(["1", "B's 7"])
    ('tracks 1 and 2', "track 1 and B's track 7")
    """
    ours = [name for name in names if not name.startswith(_THEIRS)]
    theirs = [name.removeprefix(_THEIRS) for name in names if name.startswith(_THEIRS)]
    sides = [("", ours)] * bool(ours or not theirs) + [(_THEIRS, theirs)] * bool(theirs)
    return " and ".join(
        f"{of}track{'s' if len(side) != 1 else ''} {listed(side)}" for of, side in sides
    )


def intervals(spans: Sequence[tuple[int, int]], most: int) -> str:
    """Numbers from ... to ..., the first ``most`` intervals of them.

    >>> intervals([(0, 249), (300, 300)], 3), intervals([(1, 1), (3, 3), (5, 5)], 2)
    ('0 to 249 and 300', '1, 3 and 1 more interval')
    """
    told = [
        f"{first} to {last}" if last > first else f"{first}" for first, last in spans[:most]
    ]
    return listed(
        told + ([count_of(len(spans) - most, "more interval")] if len(spans) > most else [])
    )


def group(label: str, members: Sequence[str]) -> str:
    """A group by its label and members.

    >>> group("5", ["1", "2"])
    'group 5 (tracks 1 and 2)'
    """
    return f"group {label} ({tracks(members)})"


def subject(names: Sequence[str], groups: Sequence[str]) -> tuple[str, bool]:
    """Who an event is about, and whether that is one: its group where it names exactly one, else
    its tracks.
    """
    if len(groups) == 1:
        return group(groups[0], names), True
    if not names:
        return "the scene", True
    return tracks(names), len(names) == 1


def verb(kind: str, one: bool, adverb: str = "") -> str:
    """What an event's subject does; of a kind that is not known, that it has such an event.

    >>> verb("track_confirmed", True, "now"), verb("splitting", True, "no longer")
    ('is now confirmed', 'no longer splits')
    """
    known = EVENT_WORDS.get(kind)
    if known is None:
        return f"{adverb} {'has' if one else 'have'} an event {kind}".lstrip()
    said = known[0] if one else known[1]
    auxiliary, _, rest = said.partition(" ")
    if not adverb:
        return said
    return (
        f"{auxiliary} {adverb} {rest}"
        if auxiliary in ("is", "are", "has", "have")
        else f"{adverb} {said}"
    )
