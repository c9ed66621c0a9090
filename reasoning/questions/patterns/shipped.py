"""Patterns that come with the tool: the four long-term activities of the CAVIAR rules (RTEC's
event description).

They are written over encounters and states that are found from boxes; RTEC's are written over
labelled activities.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Shipped:
    """A pattern with what it finds."""

    about: str
    text: str


SHIPPED: Mapping[str, Shipped] = {
    "meeting": Shipped("two people stand together", "meeting(a,b)[>1s]"),
    "moving": Shipped("two people walk together", "moving(a,b)[>1s]"),
    "fighting": Shipped(
        "two people abruptly against one another at touching distance", "abrupt(a,b)[>1s]"
    ),
    "leaving_object": Shipped(
        "a thing that stands still from its first sight, beside somebody who was there"
        " before and goes away from it",
        "still(thing) starts|equals present(thing)"
        " & present(owner) includes|overlaps|finished_by present(thing)"
        " started_by near(owner,thing)",
    ),
    "met_then_left": Shipped(
        "two were together, then both left within half a minute",
        "together(a,b) ; exited(a)[<30s] ; exited(b)[<30s]",
    ),
    "changed_company": Shipped(
        "one joins some while splitting from others", "is_splitting(a,b) & is_grouping(a,c)"
    ),
}
