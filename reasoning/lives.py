"""Events of the tracks' own life: confirmed, lost, found again, by what they are tracked, removed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from reasoning.events import BY, EventLog, life
from reasoning.target_columns import TargetColumns
from recorders.messages import Target


@dataclass(frozen=True)
class Before:
    """What was before a frame.

    Attributes:
        last: the targets of the frame before, by id.
        known: the ids of all targets until then.
        removed: who is not in this frame any more.
        leaving: who of these stays for one frame more.
    """

    last: Mapping[int, Target]
    known: Collection[int]
    removed: Sequence[int]
    leaving: Collection[int]


def tell_life(
    log: EventLog, rows: TargetColumns, before_now: Before, told: set[tuple[str, int]]
) -> None:
    """Events of the tracks' own life that the tracker has not told: ``told`` has kinds and
    subjects of its notices.
    """
    for target in rows.targets:
        if target.id in before_now.leaving:
            continue
        before = before_now.last.get(target.id)
        if before is None:
            kind = "track_recovered" if target.id in before_now.known else "track_confirmed"
            if (kind, target.id) not in told:
                text = (
                    f"Target {target.id} is tracked again."
                    if target.id in before_now.known
                    else f"Target {target.id} is confirmed."
                )
                life(
                    log,
                    kind,
                    target,
                    {"born_of_split": target.born_of_split},
                    text,
                )
            continue
        if target.present != before.present:
            kind, words = (
                ("track_recovered", "is found again")
                if target.present
                else ("track_lost", "is lost")
            )
            if (kind, target.id) not in told:
                life(
                    log,
                    kind,
                    target,
                    {"blob": target.blob},
                    f"Target {target.id} {words}.",
                )
        if target.mode != before.mode and ("mode_changed", target.id) not in told:
            text = f"Target {target.id} is tracked by {BY[target.mode]}."
            life(log, "mode_changed", target, {"mode_before": before.mode}, text)
    for i in sorted(before_now.removed):
        if ("track_removed", i) not in told:
            life(
                log,
                "track_removed",
                before_now.last[i],
                {},
                f"Target {i} is not tracked any more.",
            )
