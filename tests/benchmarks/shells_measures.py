"""What the SHELLS benchmark measures: identities at the ends of interactions, real pairs, pixels,
relations.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plain_sort import PlainSort

from fixtures.crowds import school
from fixtures.scenes import GeneratedScene
from fixtures.scripts import Cast, Casting, Script
from fixtures.truth import STATIC, FrameTruth, SceneTruth
from reasoning.reasoner import Reasoner
from recorders import channels
from recorders.annotated.membership import decode_labels, value_of
from recorders.messages import NO_BLOB, Box, Target, Targets
from recorders.scene import SceneLog
from replay.configuration import replay_config
from replay.engine import Forward
from replay.evaluate import MotTable
from replay.trackers.association import assign, iou
from replay.trackers.catalogue import TRACKERS

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SCENETRACE_DATA", ROOT.parent / "shared" / "data"))
AFTER = 10
"""Frames after an interaction's end at which identities are compared."""
Boxes = list[dict[int, Box]]
Labels = NDArray[np.uint16]


def follow(
    path: Path, tracker: str, settings: Sequence[str] = ()
) -> tuple[Boxes, list[Labels]]:
    """A tracker's present boxes per frame without hindsight, and its label images; ``sort``:
    plain SORT.
    """
    boxes: Boxes = []
    labels: list[Labels] = []
    with SceneLog(path) as scene:
        if tracker == "sort":
            sort = PlainSort()
            return [dict(sort.step(frame.boxes)) for frame in scene.frames()], []
        config = replay_config(tracker, assignments=settings)
        for step in Forward(scene, TRACKERS[tracker], config).steps():
            boxes.append({t.id: t.box for t in step.targets.targets if t.present})
            for name, data in step.extra:
                if name == "membership":
                    labels.append(decode_labels(channels.decode("membership", data).data))
    return boxes, labels


def matched(
    true: Mapping[int, Box], said: Mapping[int, Box], gate: float
) -> dict[int, int]:
    """True id -> track by the nearest centres overall, none further than ``gate`` pixels."""
    if not true or not said:
        return {}
    a = np.array([(b[0] + b[2] / 2, b[1] + b[3] / 2) for b in true.values()])
    b = np.array([(b[0] + b[2] / 2, b[1] + b[3] / 2) for b in said.values()])
    gap = np.sqrt(((a[:, None] - b[None]) ** 2).sum(axis=2))
    ids, tracks = list(true), list(said)
    return {ids[i]: tracks[j] for i, j in assign(np.minimum(gap, 900.0), gap <= gate)}


@dataclass(frozen=True)
class TankResult:
    """``asked``: (interaction, fish) pairs; ``lost``: those whose identity was another than
    before.
    """

    asked: int
    lost: int
    errors_px: list[float]


def _species(cast: Cast, outfits: Sequence[str]) -> Cast:
    return tuple(replace(a, outfit=o) for a, o in zip(cast, outfits, strict=True))


def _tank(
    title: str, cast: Casting, size: tuple[int, int] = (320, 240), fps: int = 25
) -> Script:
    whole = (0.0, 0.0, 1.0, 1.0)
    return Script(
        title, 14.0, cast, kind="fish", roi=whole, border=whole, size=size, fps=fps
    )


TANKS: dict[str, Script] = {
    "eight": _tank(
        "Eight fish, two pairs of a species each, four meet", lambda rng: school(rng, 8, 4)
    ),
    "small": _tank(
        "Six fish of 60 % of the size",
        lambda rng: tuple(replace(a, tall=0.6 * a.tall) for a in school(rng, 6, 4)),
    ),
    "large": _tank(
        "Three fish of 150 % of the size",
        lambda rng: tuple(replace(a, tall=1.5 * a.tall) for a in school(rng, 3, 3)),
    ),
    "480x360": _tank(
        "Six fish in a larger picture", lambda rng: school(rng, 6, 4), (480, 360)
    ),
    "12 fps": _tank(
        "Six fish at half the frame rate: turns are twice as abrupt",
        lambda rng: school(rng, 6, 4),
        fps=12,
    ),
    "twins": _tank(
        "Three fish that meet, two of one species",
        lambda rng: _species(school(rng, 3, 3), ("orange", "orange", "blue")),
    ),
    "triplets": _tank(
        "Three fish of one species", lambda rng: _species(school(rng, 3, 3), ("white",) * 3)
    ),
}
"""Tanks that nothing was devised on."""


def interactions(truth: SceneTruth, gap: int = 3) -> list[tuple[int, int, set[int]]]:
    """Occlusions among actors that follow one another without a pause, merged: start, end, who."""
    merged: list[tuple[int, int, set[int]]] = []
    for o in sorted(
        (o for o in truth.occlusions if o.front != STATIC), key=lambda o: (o.start, o.end)
    ):
        for k, (start, end, who) in enumerate(merged):
            if o.start <= end + gap and who & {o.front, o.behind}:
                merged[k] = (start, max(end, o.end), who | {o.front, o.behind})
                break
        else:
            merged.append((o.start, o.end, {o.front, o.behind}))
    return merged


def judge_tank(scene: GeneratedScene, boxes: Boxes, gate: float = 20.0) -> TankResult:
    """Identities shortly after the end of every interaction against those that the fish began
    with.
    """
    frames = [{a.id: a.full_box for a in f.actors} for f in scene.truth.frames]
    owner: dict[int, int] = {}
    for k in range(10, 31):
        seen = {a.id for a in scene.truth.frames[k].actors if a.visibility > 0.95}
        for actor, track in matched(frames[k], boxes[k], gate).items():
            if actor in seen:
                owner.setdefault(actor, track)
    asked = lost = 0
    for _, end, who in interactions(scene.truth):
        if end >= len(frames):
            continue  # not over when the recording ends
        k = min(len(frames) - 1, end + AFTER)
        now = matched(frames[k], boxes[k], gate)
        present = sorted(a for a in who if a in frames[k])
        asked += len(present)
        lost += sum(now.get(a) != owner.get(a) for a in present)
    errors = []
    for true, said in zip(frames[12:], boxes[12:], strict=True):
        for actor, b in true.items():
            t = said.get(owner.get(actor, -1))
            if t is not None:
                dx, dy = (
                    t[0] + t[2] / 2 - b[0] - b[2] / 2,
                    t[1] + t[3] / 2 - b[1] - b[3] / 2,
                )
                errors.append(float(np.hypot(dx, dy)))
    return TankResult(asked, lost, errors)


@dataclass
class OrderResult:
    """Verdicts on who is behind whom: right, the wrong way round, about two of whom neither hides
    the other.

    Attributes:
        occluded: true occlusions of at least a fifth of an actor.
        told: those of them during which the truth, and nothing but, was told.
    """

    right: int = 0
    wrong: int = 0
    neither: int = 0
    occluded: int = 0
    told: int = 0


def judge_order(
    scene: GeneratedScene, log: Path, settings: Sequence[str] = (), gate: float = 25.0
) -> OrderResult:
    """Hold the tracker's `occluded` events against the truth of the last 10 frames."""
    result = OrderResult()
    said: list[tuple[int, int, int]] = []
    frames = scene.truth.frames
    with SceneLog(log) as recorded:
        for step in Forward(
            recorded, TRACKERS["shells"], replay_config("shells", assignments=settings)
        ).steps():
            k = step.frame.index
            events = [n.subjects for n in step.targets.notices if n.kind == "occluded"]
            if not events:
                continue
            boxes = {t.id: t.box for t in step.targets.targets if t.present}
            actors = matched({a.id: a.full_box for a in frames[k].actors}, boxes, gate)
            names = {track: actor for actor, track in actors.items()}
            for behind, front in events:
                a, b = names.get(behind), names.get(front)
                if a is None or b is None:
                    result.neither += 1
                    continue
                lately = frames[max(0, k - 9) : k + 1]
                balance = sum(_hides(f, b, a) - _hides(f, a, b) for f in lately)
                result.right += balance > 0
                result.wrong += balance < 0
                result.neither += balance == 0
                said.append((k, a, b))
    for o in scene.truth.occlusions:
        if o.front == STATIC or o.worst < 0.2:
            continue
        result.occluded += 1
        about = {
            (a, b)
            for k, a, b in said
            if o.start <= k < o.end + 5 and {a, b} == {o.front, o.behind}
        }
        result.told += about == {(o.behind, o.front)}
    return result


def _hides(frame: FrameTruth, front: int, behind: int) -> float:
    actor = frame.actor(behind)
    return 0.0 if actor is None else dict(actor.hidden_by).get(front, 0.0)


@dataclass(frozen=True)
class Pair:
    """Two true identities whose boxes overlap from ``start`` to ``end`` (last frame, included)."""

    a: int
    b: int
    start: int
    end: int


def longest_pairs(
    truth: MotTable, count: int = 10, least: float = 0.05, margin: int = 5
) -> list[Pair]:
    """The pairs whose boxes overlap longest at a stretch, each pair once, both there for a while
    before and after.
    """
    by_frame: dict[int, dict[int, Box]] = {}
    for f, i, b in zip(
        truth.frames.tolist(), truth.ids.tolist(), truth.boxes.tolist(), strict=True
    ):
        by_frame.setdefault(f, {})[i] = tuple(b)
    stretches: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for f in sorted(by_frame):
        ids = sorted(by_frame[f])
        overlap = iou(*(np.array([by_frame[f][i] for i in ids]),) * 2)
        for i, j in np.argwhere(np.triu(overlap > least, 1)).tolist():
            runs = stretches.setdefault((ids[i], ids[j]), [])
            if runs and f - runs[-1][1] <= margin:
                runs[-1] = (runs[-1][0], f)
            else:
                runs.append((f, f))
    found = []
    for (a, b), runs in stretches.items():
        whole = [r for r in runs if _present(by_frame, (a, b), r, margin)]
        if whole:
            start, end = max(whole, key=lambda r: (r[1] - r[0], -r[0]))
            found.append(Pair(a, b, start, end))
    return sorted(found, key=lambda p: (p.start - p.end, p.a, p.b))[:count]


def _present(
    by_frame: Mapping[int, Mapping[int, Box]],
    pair: tuple[int, int],
    run: tuple[int, int],
    n: int,
) -> bool:
    return all(i in by_frame.get(f, {}) for i in pair for f in (run[0] - n, run[1] + n))


def kept(truth: MotTable, result: MotTable, pair: Pair, frames: int = 20) -> bool:
    """Whether both of a pair have after their overlap the track that they had before, by most
    matches at IoU 0.5.
    """
    before = _names(truth, result, range(pair.start - frames, pair.start), (pair.a, pair.b))
    after = _names(
        truth, result, range(pair.end + 1, pair.end + 1 + frames), (pair.a, pair.b)
    )
    return before == after and None not in before


def _names(
    truth: MotTable, result: MotTable, span: range, who: tuple[int, int]
) -> tuple[int | None, ...]:
    votes: dict[int, dict[int, int]] = {i: {} for i in who}
    for f in span:
        rows, columns = truth.frames == f, result.frames == f
        a, b = truth.boxes[rows], result.boxes[columns]
        overlap = iou(a, b)
        for i, j in assign(1 - overlap, overlap >= 0.5):
            true, said = int(truth.ids[rows][i]), int(result.ids[columns][j])
            if true in votes:
                votes[true][said] = votes[true].get(said, 0) + 1
    return tuple(max(v, key=lambda k: (v[k], -k)) if v else None for v in votes.values())


def pixel_accuracy(
    scene: GeneratedScene, boxes: Boxes, labels: Sequence[Labels]
) -> tuple[int, float, float]:
    """Share of right pixels where a blob holds several actors: by membership, and by the nearest
    track's centre.

    Tracks and actors are matched once, over the whole scene, by the pixels that they have in
    common.

    Returns:
        The number of pixels that were judged, and the two shares.
    """
    truths = [scene.labels(k) for k in range(scene.frame_count)]
    top = max(int(image.max(initial=0)) for image in labels) + 1
    common = np.zeros((256, top))
    for true, said in zip(truths, labels, strict=True):
        common += np.bincount(
            true.ravel().astype(np.int64) * top + said.ravel(), minlength=256 * top
        ).reshape(256, top)
    common[0] = common[STATIC] = 0
    common[:, 0] = 0
    worth = common / max(1.0, float(common.max()))
    names = dict(assign(1 - worth, common > 0))
    pixels = right = near = 0
    from fixtures.logs import foreground
    from recorders.segmentation.blobs import components

    for k, (true, said) in enumerate(zip(truths, labels, strict=True)):
        _, parts, _ = components(foreground(true), 12.0)
        shared = _shared(true, parts)
        ys, xs = np.nonzero(shared)
        if not len(ys) or not boxes[k]:
            continue
        table = np.array([value_of(names[a]) if a in names else -1 for a in range(256)])
        wanted = table[true[ys, xs]]
        ids = list(boxes[k])
        centres = np.array([(b[0] + b[2] / 2, b[1] + b[3] / 2) for b in boxes[k].values()])
        away = (xs[:, None] + 0.5 - centres[:, 0]) ** 2 + (
            ys[:, None] + 0.5 - centres[:, 1]
        ) ** 2
        nearest = np.array([value_of(i) for i in ids])[np.argmin(away, axis=1)]
        pixels += len(ys)
        right += int(np.count_nonzero(said[ys, xs] == wanted))
        near += int(np.count_nonzero(nearest == wanted))
    return pixels, right / max(1, pixels), near / max(1, pixels)


def centre_errors(
    scene: GeneratedScene, boxes: Boxes, gate: float = 30.0
) -> tuple[list[float], float]:
    """Distances (px) of each actor to the track that it has in most frames, while another touches
    it; share swapped.

    The share is that of the actors' frames in which the nearest track is not their own.
    """
    frames = [{a.id: a.full_box for a in f.actors} for f in scene.truth.frames]
    now = [matched(true, said, gate) for true, said in zip(frames, boxes, strict=True)]
    votes: dict[int, dict[int, int]] = {}
    for pairs in now:
        for actor, track in pairs.items():
            votes.setdefault(actor, {})[track] = (
                votes.setdefault(actor, {}).get(track, 0) + 1
            )
    own = {actor: max(v, key=lambda t: (v[t], -t)) for actor, v in votes.items()}
    errors, other, count = [], 0, 0
    for k, pairs in enumerate(now):
        hidden = {a.id for a in scene.truth.frames[k].actors if a.hidden_by}
        for actor, track in pairs.items():
            count += 1
            other += track != own[actor]
            said = boxes[k].get(own[actor])
            if actor in hidden and said is not None:
                b = frames[k][actor]
                dx, dy = (
                    said[0] + said[2] / 2 - b[0] - b[2] / 2,
                    said[1] + said[3] / 2 - b[1] - b[3] / 2,
                )
                errors.append(float(np.hypot(dx, dy)))
    return errors, other / max(1, count)


def _shared(true: NDArray[np.uint8], parts: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Pixels of actors in blobs that hold several of them."""
    top = int(parts.max(initial=0)) + 1
    holds = (
        np.bincount(
            parts.ravel().astype(np.int64) * 256 + true.ravel(), minlength=top * 256
        ).reshape(top, 256)
        > 0
    )
    holds[:, 0] = holds[:, STATIC] = False
    several = holds.sum(axis=1) > 1
    several[0] = False
    return np.asarray(several[parts] & (true > 0) & (true != STATIC))


def direct_steps(path: Path, tracker: str = "shells") -> tuple[int, int]:
    """Changes of relations in a replayed log, and those straight between INDEPENDENT and JOINT."""
    from recorders.annotated.reader import AnnotatedLog

    changes = direct = 0
    before: dict[tuple[int, int], str] = {}
    with AnnotatedLog(path) as log:
        for frame in log.frames(("relations",)):
            now = {(r.a, r.b): str(r.state) for r in frame.relations}
            for pair in before.keys() | now.keys():
                a, b = before.get(pair, "INDEPENDENT"), now.get(pair, "INDEPENDENT")
                changes += a != b
                direct += {a, b} == {"INDEPENDENT", "JOINT"}
            before = now
    return changes, direct


def random_steps(seed: int, frames: int = 12) -> tuple[int, int]:
    """The same over one random scene of jumping targets that share blobs, come, vanish and come
    back at random.

    What is counted is what the reasoning publishes.
    """
    rng = np.random.Generator(np.random.PCG64(seed))
    ids = range(1, int(rng.integers(3, 7)))
    reasoner = Reasoner(None, 100, 100)
    before: dict[tuple[int, int], str] = {}
    changes = direct = 0
    for k in range(frames):
        targets = []
        for i in ids:
            (x, y), size, blob = (
                rng.uniform(0, 100, 2),
                rng.uniform(5, 50),
                int(rng.integers(-1, 3)),
            )
            there, seen, present = (rng.random(3) < (0.8, 0.8, 0.9)).tolist()
            if there:
                box = (float(x - size / 2), float(y - size / 2), float(size), float(size))
                targets.append(
                    Target(
                        i,
                        box,
                        present=present,
                        observed=seen,
                        blob=blob if seen else NO_BLOB,
                        shell_radius=size,
                    )
                )
        said = reasoner.step(k, k * 40_000_000, Targets(k, targets), None)
        now = {(r.a, r.b): str(r.state) for r in said.relations.relations}
        for pair in before.keys() | now.keys():
            a, b = before.get(pair, "INDEPENDENT"), now.get(pair, "INDEPENDENT")
            changes += a != b
            direct += {a, b} == {"INDEPENDENT", "JOINT"}
        before = now
    return changes, direct
