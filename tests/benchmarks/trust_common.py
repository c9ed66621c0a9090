"""What the parts of `bench_trust` share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from replay.configuration import replay_config
from replay.run import ReplayOptions

SECOND = 1_000_000_000


def options(tracker: str, *assignments: str, **more: Any) -> ReplayOptions:
    config = replay_config(tracker, assignments=assignments)
    return ReplayOptions(
        tracker=tracker, config=config, annotations_only=True, force=True, **more
    )


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    widths = [max(len(str(row[k])) for row in [head, *rows]) for k in range(len(head))]
    for row in [head, *rows]:
        print(
            "  "
            + "  ".join(
                str(cell).ljust(width) for cell, width in zip(row, widths, strict=True)
            ).rstrip()
        )
