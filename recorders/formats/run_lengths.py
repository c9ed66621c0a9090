"""COCO's run-length masks: the box around what they cover."""

from __future__ import annotations

from typing import Any

_MOST_RUNS = 10_000_000


def box_of_runs(mask: dict[str, Any]) -> tuple[float, float, float, float]:
    """x, y, w, h of the pixels that a mask covers. Runs go down the columns, background first; they
    are a list, or packed as text (five bits a letter from ``0`` on, each run from the third on as
    the difference from the one before the last).

    Raises:
        ValueError, TypeError, KeyError: no such mask, or an empty one.

    >>> box_of_runs({"size": [4, 5], "counts": [5, 2, 2, 2, 9]})
    (1.0, 1.0, 2.0, 2.0)
    >>> box_of_runs({"size": [4, 5], "counts": "52207"})
    (1.0, 1.0, 2.0, 2.0)
    """
    height, width = (int(value) for value in mask["size"])
    counts = mask["counts"]
    runs = _unpacked(counts) if isinstance(counts, str) else [int(n) for n in counts]
    if height < 1 or width < 1 or len(runs) > _MOST_RUNS or sum(runs) != height * width:
        raise ValueError("a mask whose runs do not fill its size")
    if min(runs, default=0) < 0:
        raise ValueError("a mask with a negative run")
    left, right, top, bottom = width, -1, height, -1
    at = 0
    for k, run in enumerate(runs):
        if k % 2 and run:
            last = at + run - 1
            left, right = min(left, at // height), max(right, last // height)
            whole = at // height != last // height
            top = min(top, 0 if whole else at % height)
            bottom = max(bottom, height - 1 if whole else last % height)
        at += run
    if right < 0:
        raise ValueError("an empty mask")
    return float(left), float(top), float(right - left + 1), float(bottom - top + 1)


def _unpacked(text: str) -> list[int]:
    runs: list[int] = []
    value = shift = 0
    for letter in text:
        bits = ord(letter) - 48
        if not 0 <= bits < 64:
            raise ValueError("a mask that is packed in another way")
        value |= (bits & 31) << shift
        shift += 5
        if bits & 32:
            continue
        if bits & 16:
            value -= 1 << shift
        runs.append(value + runs[-2] if len(runs) > 2 else value)
        value = shift = 0
    return runs
