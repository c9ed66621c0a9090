"""Events and who they are about, in words: "group 5 (tracks 1 and 2) no longer splits"."""

from __future__ import annotations

from collections.abc import Sequence

# What one does, what several do.
VERBS = {
    "track_confirmed": ("is confirmed", "are confirmed"),
    "track_lost": ("is lost", "are lost"),
    "track_recovered": ("is recovered", "are recovered"),
    "track_removed": ("is removed", "are removed"),
    "entering": ("is entering", "are entering"),
    "entered": ("has entered", "have entered"),
    "exiting": ("is exiting", "are exiting"),
    "returned": ("returns", "return"),
    "exited": ("exits", "exit"),
    "interaction_started": ("begins to interact", "begin to interact"),
    "joined": ("joins", "join"),
    "separated": ("separates", "separate"),
    "interaction_ended": ("ends its interaction", "end their interaction"),
    "grouping": ("is grouping", "are grouping"),
    "grouped": ("is grouped", "are grouped"),
    "splitting": ("splits", "split"),
    "single": ("is single", "are single"),
    "group_formed": ("forms", "form"),
    "group_changed": ("changes", "change"),
    "group_ended": ("ends", "end"),
    "group_entered_scene": ("enters as a group", "enter as a group"),
    "mode_changed": ("changes its mode", "change their modes"),
    "disagreement": ("is judged differently by the two papers", "are judged differently by the two papers"),
    "anomaly": ("shows an anomaly", "show an anomaly"),
    "zone_entered": ("enters a zone", "enter a zone"),
    "zone_left": ("leaves a zone", "leave a zone"),
}


def listed(names: Sequence[str]) -> str:
    """Names as a list in a sentence.

    >>> listed(["1"]), listed(["1", "2", "B's 7"])
    ('1', "1, 2 and B's 7")
    """
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else "nobody"


def tracks(names: Sequence[str]) -> str:
    """Tracks by their names."""
    return f"track{'s' if len(names) != 1 else ''} {listed(names)}"


def group(label: str, members: Sequence[str]) -> str:
    """A group by its label and members.

    >>> group("5", ["1", "2"])
    'group 5 (tracks 1 and 2)'
    """
    return f"group {label} ({tracks(members)})"


def subject(names: Sequence[str], groups: Sequence[str]) -> tuple[str, bool]:
    """Who an event is about, and whether that is one: its group where it names exactly one, else its tracks."""
    if len(groups) == 1:
        return group(groups[0], names), True
    if not names:
        return "the scene", True
    return tracks(names), len(names) == 1


def verb(kind: str, one: bool) -> str:
    """What an event's subject does; of a kind that is not known, that it has such an event."""
    known = VERBS.get(kind)
    if known is None:
        return f"{'has' if one else 'have'} an event {kind}"
    return known[0] if one else known[1]
