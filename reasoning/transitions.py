"""The 8 x 8 table of a target's interaction states (EVENTS 3.1, Figures 2 and 3): code,
documentation and test.

A target's state is three bits, written in this order: grouping, grouped, splitting; 000 is
*single*. The bits are the union of what holds between the target and each of its partners, so a
transition is feasible exactly when the pairs' own transitions can add up to it. Between two
targets (none, grouping, grouped, splitting):

- grouped goes to grouped or splitting, never to none or grouping: one frame of splitting lies
  between;
- splitting begins only where the two were grouped or splitting before, or where one of them is
  born of a split;
- grouping never follows grouped or splitting directly;
- a new partner (none to grouping, none to grouped) is possible at any time.

``python -m reasoning.transitions`` prints docs/transitions.md.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from typing import Any, Literal

GROUPING, GROUPED, SPLITTING = 4, 2, 1
SINGLE = 0
STATES = 8

Verdict = Literal["stay", "allowed", "by birth", "forbidden"]

_NAMES = {GROUPING: "grouping", GROUPED: "grouped", SPLITTING: "splitting"}


def code(state: int) -> str:
    """The three bits as the paper writes them.

    >>> code(GROUPING | SPLITTING)
    '101'
    """
    return format(state, "03b")


def name(state: int) -> str:
    """The state in words.

    >>> name(GROUPING | SPLITTING), name(SINGLE)
    ('grouping + splitting', 'single')
    """
    return " + ".join(word for bit, word in _NAMES.items() if state & bit) or "single"


@dataclasses.dataclass(frozen=True, slots=True)
class Rule:
    """Whether a target may go from one state to another in one frame, and why."""

    verdict: Verdict
    why: str


def rule(before: int, after: int) -> Rule:
    """The rule for one transition, derived from what two partners can do (module docstring)."""
    if before & GROUPED and not after & (GROUPED | SPLITTING):
        if after:
            return Rule(
                "forbidden",
                "a grouped target must split before it groups with others alone",
            )
        return Rule(
            "forbidden",
            "grouped never goes straight to single: a frame of splitting lies between",
        )
    if after & SPLITTING and not before & (GROUPED | SPLITTING):
        return Rule(
            "by birth",
            "nobody to split from, unless the partner is born of a split in this frame",
        )
    return Rule("stay" if before == after else "allowed", _reason(before, after))


def _reason(before: int, after: int) -> str:
    if before == after:
        return "no change, or a change of partners alone"
    reasons: list[str] = []
    if after & GROUPED and not before & GROUPED:
        reasons.append("a group is observed over colliding targets")
    if after & SPLITTING and not before & SPLITTING:
        reasons.append("the group has no observation, the targets still collide")
    if after & GROUPING and not before & GROUPING:
        reasons.append("a new partner collides")
    if before & GROUPING and not after & GROUPING:
        reasons.append("grouping partners part or merge")
    if before & GROUPED and not after & GROUPED:
        reasons.append("every grouped partner is splitting now")
    if before & SPLITTING and not after & SPLITTING:
        reasons.append("splitting partners part or merge again")
    return "; ".join(reasons)


TABLE: Mapping[tuple[int, int], Rule] = {
    (index, b): rule(index, b) for index in range(STATES) for b in range(STATES)
}


class TransitionCounter:
    """Checks every target's transition at every frame; counts visited states and exercised
    transitions.
    """

    def __init__(self) -> None:
        self.visited = [0] * STATES
        self.exercised = [[0] * STATES for _ in range(STATES)]
        self.forbidden = 0

    def begin(self, state: int) -> None:
        """A target is seen for the first time, in this state."""
        self.visited[state] += 1

    def move(self, before: int, after: int, by_birth: bool) -> bool:
        """Count a transition; False if it is forbidden (``by_birth``: a partner is born of a
        split in this frame).
        """
        self.visited[after] += 1
        self.exercised[before][after] += 1
        if before == after:
            return True
        verdict = TABLE[before, after].verdict
        legal = verdict in ("stay", "allowed") or (verdict == "by birth" and by_birth)
        self.forbidden += not legal
        return legal

    def summary(self) -> dict[str, Any]:
        """Visited states and exercised transitions (changes of state alone) by their bits,
        forbidden ones counted.
        """
        moves = {
            f"{code(index)}>{code(b)}": self.exercised[index][b]
            for index in range(STATES)
            for b in range(STATES)
            if index != b and self.exercised[index][b]
        }
        visited = {
            code(index): self.visited[index]
            for index in range(STATES)
            if self.visited[index]
        }
        return {"visited": visited, "exercised": moves, "forbidden": self.forbidden}

    def state(self) -> dict[str, Any]:
        """The counts as plain data."""
        return {
            "visited": list(self.visited),
            "exercised": [list(row) for row in self.exercised],
            "forbidden": self.forbidden,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self.visited = [int(n) for n in state["visited"]]
        self.exercised = [[int(n) for n in row] for row in state["exercised"]]
        self.forbidden = int(state["forbidden"])


def markdown() -> str:
    """The table as docs/transitions.md has it."""
    signs = {"stay": "·", "allowed": "yes", "by birth": "birth", "forbidden": "**no**"}
    lines = [
        "# Interaction states: which transition is possible, which is not, and why",
        "",
        (
            "Generated by `python -m reasoning.transitions`; a test fails when this page"
            " and the code differ."
        ),
        "",
        (
            "A target's state is three bits: grouping, grouped, splitting (*On Reasoning"
            " over Tracking"
        ),
        (
            "Events*, section 3.1). Rows: the state in a frame; columns: the state in the"
            " next one. `yes` possible;"
        ),
        (
            "`birth` only in the frame in which a partner is born of a split; `no`"
            " forbidden; `·` no change of state."
        ),
        "",
        "| from \\ to | " + " | ".join(code(index) for index in range(STATES)) + " |",
        "|---|" + "---|" * STATES,
    ]
    for a in range(STATES):
        cells = " | ".join(signs[TABLE[a, index].verdict] for index in range(STATES))
        lines.append(f"| {code(a)} {name(a)} | {cells} |")
    count = {
        sign: sum(r.verdict == sign for (a, b), r in TABLE.items() if a != b)
        for sign in signs
    }
    lines += [
        "",
        (
            f"Of the 56 transitions between different states {count['allowed']} are"
            f" possible, {count['by birth']} only by a birth, and {count['forbidden']} are"
            " forbidden."
        ),
        "",
        *_GROUP_TRACKER,
        "",
        "## Why",
        "",
        "| from | to | | why |",
        "|---|---|---|---|",
    ]
    for (a, b), r in TABLE.items():
        if a != b:
            lines.append(
                f"| {code(a)} {name(a)} | {code(b)} {name(b)} | {r.verdict} | {r.why} |"
            )
    return "\n".join(lines) + "\n"


_GROUP_TRACKER = [
    "## The ninth state: a group tracker",
    "",
    (
        "A tracker is of a target or of a group for its whole life, so no transition leads"
        " from the eight states to the"
    ),
    "ninth or back. A group has a label, a list of members and an observation or none:",
    "",
    "| from | to | when |",
    "|---|---|---|",
    "| - | observed | a region of pixels lies over colliding targets |",
    "| - | not observed | a target is born of a split: the group had entered as one |",
    "| observed | not observed | the region has come apart, the members are splitting |",
    "| not observed | observed | the same members share a region again |",
    (
        "| observed, not observed | ended, another begins | the members of the region"
        " change: nobody joins a group |"
    ),
    "| not observed | ended | no two members are splitting any more |",
]


if __name__ == "__main__":
    sys.stdout.write(markdown())
