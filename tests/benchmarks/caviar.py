"""CAVIAR hand-labelled XML as histories (the input) and pair intervals (the truth), and the
scores between them.

The labels of groups, contexts and situations are read for the truth alone. Frame intervals are
closed.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from defusedxml.ElementTree import iterparse

from reasoning.encounters import History

FPS = 25.0


@dataclass(frozen=True)
class Interval:
    """A labelled pair a < b, closed frames, with the group's context and situation runs."""

    a: int
    b: int
    start: int
    end: int
    situations: tuple[tuple[int, int, str, str], ...] = ()


@dataclass(frozen=True)
class Sequence:
    """One recording: histories by labelled id (people and things), truth intervals, things,
    labels per frame.
    """

    name: str
    frames: int
    histories: dict[int, History]
    things: frozenset[int]
    together: list[Interval]
    leaving: list[Interval]

    def people(self) -> dict[int, History]:
        return {i: h for i, h in self.histories.items() if i not in self.things}


def _text(node: Any, tag: str) -> str:
    return (node.findtext(".//" + tag) or "").strip()


def read(path: Path) -> Sequence:
    """Read one CVML file."""
    boxes: dict[int, list[tuple[int, float, float, float, float]]] = defaultdict(list)
    active: set[int] = set()
    pairs: dict[tuple[int, int], dict[int, tuple[str, str]]] = defaultdict(dict)
    last = 0
    for _, node in iterparse(str(path), events=("end",)):
        if node.tag != "frame":
            continue
        last = int(node.get("number"))
        for item in node.iterfind("objectlist/object"):
            box = item.find("box")
            w, h, xc, yc = (float(box.get(k)) for k in ("w", "h", "xc", "yc"))
            boxes[int(item.get("id"))].append((last, xc - w / 2, yc - h / 2, w, h))
            if (
                _text(item, "movement") != "inactive"
                or _text(item, "role") != "leaving object"
            ):
                active.add(int(item.get("id")))
        for group in node.iterfind("grouplist/group"):
            members = sorted(int(m) for m in group.findtext("members").split(","))
            for pair in itertools.combinations(members, 2):
                pairs[pair][last] = (_text(group, "context"), _text(group, "situation"))
        node.clear()
    histories = {i: _history(rows) for i, rows in sorted(boxes.items())}
    things = frozenset(set(boxes) - active)
    together, leaving = _intervals(pairs, things)
    return Sequence(path.stem, last + 1, histories, things, together, leaving)


def _history(rows: list[tuple[int, float, float, float, float]]) -> History:
    table = np.array(rows, np.float64)
    frames = table[:, 0].astype(np.int64)
    return History(frames, frames / FPS, table[:, 1:])


def _intervals(
    pairs: Mapping[tuple[int, int], Any], things: frozenset[int]
) -> tuple[list[Interval], list[Interval]]:
    together: list[Interval] = []
    leaving: list[Interval] = []
    for (a, b), labels in sorted(pairs.items()):
        kinds = {n: c == "leaving" or bool({a, b} & things) for n, (c, _) in labels.items()}
        for start, end, is_leaving in _runs(sorted(kinds.items())):
            inside = _runs([(n, labels[n]) for n in range(start, end + 1)])
            row = Interval(a, b, start, end, tuple((s, e, *v) for s, e, v in inside))
            (leaving if is_leaving else together).append(row)
    return together, leaving


def _runs(items: Iterable[tuple[int, Any]]) -> list[tuple[int, int, Any]]:
    out: list[list[Any]] = []
    for n, value in items:
        if out and out[-1][1] == n - 1 and out[-1][2] == value:
            out[-1][1] = n
        else:
            out.append([n, n, value])
    return [(start, end, value) for start, end, value in out]


def counts(found: list[Interval], truth: list[Interval]) -> np.ndarray:
    """(3, 3) int64: frame, interval (IoU >= 0.5), onset (within 1 s) x true, false positive,
    missed.
    """
    out = np.zeros((3, 3), np.int64)
    keys = sorted({(x.a, x.b) for x in [*found, *truth]})
    for key in keys:
        f = {n for x in found if (x.a, x.b) == key for n in range(x.start, x.end + 1)}
        t = {n for x in truth if (x.a, x.b) == key for n in range(x.start, x.end + 1)}
        out[0] += (len(f & t), len(f - t), len(t - f))
    for row, same in ((1, _overlaps), (2, _start_together)):
        hits = _matched(found, truth, same)
        out[row] = (hits, len(found) - hits, len(truth) - hits)
    return out


def _start_together(f: Interval, t: Interval) -> bool:
    return abs(f.start - t.start) <= FPS


def _overlaps(f: Interval, t: Interval) -> bool:
    shared = min(f.end, t.end) - max(f.start, t.start) + 1
    return shared > 0 and shared / (max(f.end, t.end) - min(f.start, t.start) + 1) >= 0.5


def _matched(
    found: list[Interval],
    truth: list[Interval],
    same: Callable[[Interval, Interval], bool],
) -> int:
    used: set[int] = set()
    for t in truth:
        for k, f in enumerate(found):
            if k not in used and (f.a, f.b) == (t.a, t.b) and same(f, t):
                used.add(k)
                break
    return len(used)


def f1(table: np.ndarray) -> np.ndarray:
    """(..., 3, 3) counts to (..., 3) F1; nothing to find and nothing found is 1."""
    tp, fp, fn = (table[..., k].astype(np.float64) for k in range(3))
    whole = 2 * tp + fp + fn
    return np.where(whole > 0, 2 * tp / np.where(whole > 0, whole, 1.0), 1.0)
