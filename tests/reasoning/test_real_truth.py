"""The reasoning over the labelled people of real recordings: no forbidden transition, true groups
interact.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest
from defusedxml.ElementTree import parse

from reasoning.reasoner import Reasoner, SceneAnnotation
from recorders.messages import Box, Target, Targets

pytestmark = pytest.mark.real

CAVIAR = ("Meet_WalkTogether1", "Meet_WalkSplit", "Meet_Crowd", "Fight_RunAway1", "Walk3")


def blobs(boxes: Mapping[int, Box]) -> dict[int, int]:
    """Boxes that overlap or nearly touch (4 px) stand for one blob, numbered by its lowest
    member.
    """
    root = {i: i for i in boxes}
    for i, a in boxes.items():
        for j, b in boxes.items():
            wide = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0]) > -4
            if i < j and wide and min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1]) > -4:
                low, high = sorted((root[i], root[j]))
                root = {k: low if v == high else v for k, v in root.items()}
    return root


def reason(
    frames: Sequence[Mapping[int, Box]], width: int, height: int, frame_ns: int
) -> tuple[Reasoner, list[SceneAnnotation]]:
    """Feed true boxes with velocities over half a second; the reasoner and all annotations."""
    reasoner = Reasoner({}, width, height)
    paths: dict[int, list[tuple[int, float, float]]] = defaultdict(list)
    answers = []
    back = max(1, 500_000_000 // frame_ns)
    for k, boxes in enumerate(frames):
        shared, targets = blobs(boxes), []
        for i, (x, y, w, h) in sorted(boxes.items()):
            paths[i].append((k, x + w / 2, y + h / 2))
            k0, x0, y0 = next(p for p in paths[i] if p[0] >= k - back)
            dt = (k - k0) * frame_ns / 1e9
            v = ((x + w / 2 - x0) / dt, (y + h / 2 - y0) / dt) if dt else (0.0, 0.0)
            targets.append(Target(i, (x, y, w, h), v, blob=shared[i]))
            paths[i] = paths[i][-back:]
        answers.append(reasoner.step(k, k * frame_ns, Targets(k, targets), None))
    return reasoner, answers


def test_pets(real_data: Path) -> None:
    frames: dict[int, dict[int, Box]] = defaultdict(dict)
    for line in (real_data / "pets09-s2l1" / "gt.txt").read_text().splitlines():
        f, i, x, y, w, h, conf = (float(v) for v in line.split(",")[:7])
        if conf:
            frames[int(f) - 1][int(i)] = (x, y, w, h)
    reasoner, answers = reason([frames[k] for k in range(795)], 768, 576, 10**9 // 7)
    summary = reasoner.counter.summary()
    assert summary["forbidden"] == 0
    assert len(summary["visited"]) == 8, "every state occurs on this recording"
    assert len(summary["exercised"]) >= 20
    kinds = Counter(e.kind for a in answers for e in a.events)
    assert kinds["disagreement"] <= 12
    assert kinds["grouped"] >= 50
    assert 0 <= kinds["grouped"] - kinds["splitting"] <= 5, (
        "who grouped splits, unless the recording ends"
    )


@pytest.mark.parametrize("name", CAVIAR)
def test_caviar_true_groups_interact(real_data: Path, name: str) -> None:
    frames, groups = [], []
    for f in parse(real_data / "caviar" / f"{name}.xml").getroot().iter("frame"):
        boxes = {}
        for o in f.find("objectlist"):
            x, y, w, h = (float(o.find("box").get(k)) for k in ("xc", "yc", "w", "h"))
            boxes[int(o.get("id"))] = (x - w / 2, y - h / 2, w, h)
        frames.append(boxes)
        groups.append(
            [[int(i) for i in g.find("members").text.split(",")] for g in f.iter("group")]
        )
    reasoner, answers = reason(frames, 384, 288, 40_000_000)
    assert reasoner.counter.forbidden == 0
    related = {(r.a, r.b) for a in answers for r in a.relations.relations}
    for k, here in enumerate(groups):
        for members in here:
            alive = sorted(i for i in members if i in frames[k])
            assert all(
                (a, b) in related for n, a in enumerate(alive) for b in alive[n + 1 :]
            ), (k, members)
