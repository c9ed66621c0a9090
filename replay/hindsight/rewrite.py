"""The hindsight step: read the forward pass twice, write the tracks as they look once everything
is known.

The first reading gathers fragments (`fragments`) and joins them (`joining`); the second rewrites
the frames, block by block with a margin on both sides, so that memory does not grow with the
recording: gaps filled, paths smoothed (`smoothing`), births back-dated to the first sighting,
short and unsupported paths dropped. Only what the forward pass wrote is read, so the answer is as
deterministic as that was.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from recorders.messages import NO_BLOB, Box, GroupTrack, Notice, Target, Targets
from recorders.parameters import Config
from recorders.scene import SceneInfo
from replay.hindsight.blind import Blind
from replay.hindsight.crossings import Crossings, named, uncrossed
from replay.hindsight.doubles import Within
from replay.hindsight.exchanges import Exchange, exchanges_of, undone
from replay.hindsight.fragments import Fragment, gather
from replay.hindsight.joining import join
from replay.hindsight.left import BesideWhom
from replay.hindsight.lives import TrackLife, lives_of
from replay.hindsight.parameters import HindsightParameters
from replay.hindsight.passing import Passing
from replay.hindsight.smoothing import filtered
from replay.hindsight.verdicts import lessened, withheld
from replay.trackers.pace import paced, stretch

_BLOCK = 64
_CALM = ((1.0, 0.25), (1.0, 1.0), (1.0, 4.0), (1.0, 16.0), (1.0, 64.0))
"""Times the variances of measurement and acceleration."""
_LIVELY = ((1.0, 256.0), (1 / 4, 256.0), (1 / 16, 4096.0), (1 / 64, 65536.0))
"""The same of targets that dash and turn, and of boxes that follow limbs: none of the calm does
them justice.
"""
_MARGIN = 0.6
"""By so much likelier (log, by sighting) a place, or a size, has to be under one of those."""
_RULE = "EVENTS hindsight"
Floats = NDArray[np.float64]
Reading = Callable[[], Iterable[Targets]]


@dataclass
class _Row:
    """A stretch of one life without a gap too long to fill: its observations within the window."""

    life: TrackLife
    at: list[int]
    boxes: list[tuple[float, float, float, float]]


def rewrite(
    targets: Reading,
    scene: SceneInfo,
    times: Sequence[int],
    config: Config,
    names: dict[int, int] | None = None,
    apart: Sequence[tuple[int, int]] = (),
    blind: Callable[[], Sequence[Blind]] = tuple,
) -> Iterator[Targets]:
    """Rewrite a forward pass in hindsight.

    Args:
        targets: called twice, gives the forward pass's answers in order each time; a third time
            where the tracker found that identities had been exchanged. The first reading may
            make them.
        scene: what is known of the recording.
        times: capture time in ns of the k-th answer, there when that is read.
        config: section ``hindsight``.
        names: gets every kept forward id's final id before the first answer.
        apart: pairs of forward ids that a person says are two: never joined into one life.
        blind: tells when nobody could be seen, in order; asked once ``times`` are whole.

    Yields:
        One answer per frame, in order, with the forward pass's group tracks; notices of births,
        losses, joins, mode changes and ends are written anew, all others kept under their
        targets' final ids.
    """
    p = config["hindsight"]
    assert isinstance(p, HindsightParameters)
    p, second = paced(p, scene.frame_ns), stretch(scene.frame_ns)
    exchanges: list[Exchange] = []

    def read(stream: Iterable[Targets]) -> tuple[dict[int, Fragment], Within, BesideWhom]:
        within, beside = Within(), BesideWhom(scene.frame_ns * 1e-9 / second)
        stream = beside.watch(within.watch(stream))
        return gather(stream, times, second), within, beside

    crossings = Crossings(times, second)
    stream = _noting(targets(), exchanges)
    if not (scene.has_images or scene.has_masks):
        stream = crossings.watch(stream)  # else colours and regions tell who is who
    fragments, within, beside = read(stream)

    def mended() -> Iterator[Targets]:
        return uncrossed(undone(targets(), exchanges), crossings.found)

    if exchanges or any(c.exchanged for c in crossings.found):
        fragments, within, beside = read(mended())
    joins = join(fragments, p, apart, blind())
    met = named(crossings.found)
    lives, reasons = lives_of(fragments, joins, within, beside, p, scene, times, met)
    del fragments  # and with them those of dropped paths
    if names is not None:
        names.update((live, lives[live].id) for live in sorted(lives))
    yield from _Writer(lives, reasons, scene, times, p).run(mended())


def _noting(stream: Iterable[Targets], exchanges: list[Exchange]) -> Iterator[Targets]:
    for answer in stream:
        exchanges += exchanges_of(answer)
        yield answer


class _Writer:
    """The second reading, in blocks of `_BLOCK` frames with a margin before and after."""

    def __init__(
        self,
        lives: dict[int, TrackLife],
        reasons: dict[int, str],
        scene: SceneInfo,
        times: Sequence[int],
        p: HindsightParameters,
    ) -> None:
        self._lives = lives
        self._reasons = reasons
        self._p = p
        self._times = times
        self._has_masks = scene.has_masks
        self._passing = Passing(seeing=scene.has_images, masks=scene.has_masks)
        self._second = stretch(scene.frame_ns)
        self._frame_s = max(scene.frame_ns * 1e-9, 1e-6)
        self._fill = max(1, math.floor(p.fill_s / self._frame_s + 1e-6))
        self._margin = self._fill + max(8, round(1.0 / self._frame_s))
        # By the first frame, as they were chained; those who have begun and may still be spoken of.
        self._waiting = deque({id(live): live for live in lives.values()}.values())
        self._begun: list[TrackLife] = []

    def run(self, stream: Iterable[Targets]) -> Iterator[Targets]:
        """Write every frame once, in order."""
        source = iter(stream)
        window: list[Targets] = list(islice(source, _BLOCK + self._margin))
        start = 0  # stream position of window[0]
        block = 0  # stream position of the block's first frame
        while block < start + len(window):
            end = min(block + _BLOCK, start + len(window))
            yield from self._block(window, start, block, end)
            block = end
            window += islice(source, block + _BLOCK + self._margin - start - len(window))
            drop = max(0, block - self._margin - start)
            window = window[drop:]
            start += drop

    def _block(
        self, window: list[Targets], start: int, block: int, end: int
    ) -> Iterator[Targets]:
        self._go_on(start, start + len(window))
        rows = self._rows(window, start)
        rows = [r for r in rows if r.at[0] < end and r.at[-1] >= block]
        smoothed = self._smooth(rows, start, len(window))
        values, rates, blurred = (
            table[block - start : end - start].tolist() for table in smoothed[:3]
        )
        lively = smoothed[3].tolist()
        known = [
            {t.id: t for t in answer.targets}
            for answer in window[block - start : end - start]
        ]
        living = self._living(block, end, {row.life.id for row in rows})
        for at in range(block, end):
            index = at - block
            answer, forward = window[at - start], known[index]
            here: list[tuple[TrackLife, Target]] = []
            doubted = [n for life in living for n in life.go_on(at)]
            for k, row in enumerate(rows):
                if row.at[0] <= at <= row.at[-1] and not blurred[index][k]:
                    seen = row.life.of(forward)
                    value = values[index][k]
                    dashing = lively[k] or self._second > 1.0
                    if self._has_masks and dashing and seen is not None and seen.observed:
                        # Pixels say where who dashes about, or is filmed rarely, is better than
                        # any path through them.
                        x, y, w, h = seen.measured or seen.box
                        value = [x + w / 2, y + h / 2, w, h]
                    target = _target(row, at, seen, value, rates[index][k])
                    here.append((row.life, target))
            doubted += self._pass(here, at)
            out = [life.believed(target) for life, target in here]
            out += self._unseen(living, at, forward, {t.id for t in out})
            out.sort(key=lambda t: t.id)
            yield Targets(
                answer.frame,
                out,
                self._groups(answer, out),
                self._notices(living, answer, at, out) + doubted,
                withheld(answer, self._reasons),
            )

    def _pass(self, here: list[tuple[TrackLife, Target]], at: int) -> list[Notice]:
        """What passing one another leaves of identities, and what is to be told of it, by id."""
        here.sort(key=lambda pair: pair[0].id)
        now = self._times[at]
        dt = (now - self._times[at - 1]) * 1e-9 if at else self._frame_s
        found = self._passing.step([target for _, target in here], now, dt)
        notices: list[Notice] = []
        for life, _ in here:
            if life.id in found:
                odds, notice = found[life.id]
                life.identity = lessened(life.identity, odds)
                notices += [] if notice is None else [notice]
        return notices

    def _go_on(self, start: int, end: int) -> None:
        """Whoever begins within the window joins in, whoever ended before it and was said to have
        ended leaves.
        """
        while self._waiting and self._waiting[0].first_at < end:
            self._begun.append(self._waiting.popleft())
        self._begun = [
            life for life in self._begun if life.last_at + 1 >= start or life.present
        ]

    def _living(self, block: int, end: int, seen: set[int]) -> list[TrackLife]:
        """Those of whom something may have to be said in a block, by id: few of all that a long
        recording has.
        """
        living = [
            life
            for life in self._begun
            if (life.first_at < end and life.last_at + 1 >= block)
            or life.present
            or life.id in seen
        ]
        return sorted(living, key=lambda life: life.id)

    @staticmethod
    def _unseen(
        living: Sequence[TrackLife], at: int, forward: dict[int, Target], here: set[int]
    ) -> list[Target]:
        """Those in a gap that is too long to fill, as long as the forward pass expected them:
        they are not present.
        """
        out: list[Target] = []
        for life in living:
            if not life.first_at <= at <= life.last_at or life.id in here:
                continue
            known = life.of(forward)
            if known is not None:
                gone = replace(
                    known, id=life.id, mode="predicted", present=False, observed=False, newborn=False,
                    blob=NO_BLOB, measured=None, signature=[], likely=None,
                    identity=life.identity,
                )  # fmt: skip
                out.append(life.believed(gone))
        return out

    def _rows(self, window: list[Targets], start: int) -> list[_Row]:
        """Observations of every life within the window, cut at gaps that are too long to fill."""
        rows: list[_Row] = []
        open_rows: dict[int, _Row] = {}
        earlier: dict[int, list[tuple[TrackLife, Box]]] = {}
        for life in self._begun:
            for s in (s for fragment in life.fragments for s in fragment.earlier):
                earlier.setdefault(s.at, []).append((life, s.box))
        for at, answer in enumerate(window, start):
            found = list(earlier.get(at, ()))
            found += [
                (self._lives[target.id], target.measured or target.box)
                for target in answer.targets
                if target.observed and target.id in self._lives
            ]
            for life, box in found:
                row = open_rows.get(life.id)
                if row is None or at - row.at[-1] > self._fill:
                    row = open_rows[life.id] = _Row(life, [], [])
                    rows.append(row)
                if not row.at or row.at[-1] != at:
                    row.at.append(at)
                    row.boxes.append(box)
        return rows

    def _smooth(
        self, rows: list[_Row], start: int, frames: int
    ) -> tuple[Floats, Floats, NDArray[np.bool_], NDArray[np.bool_]]:
        p = self._p
        measured = np.zeros((frames, len(rows), 4))
        seen = np.zeros((frames, len(rows)), bool)
        size = np.ones(len(rows))
        for k, row in enumerate(rows):
            b = np.array(row.boxes, np.float64)
            index = np.array(row.at) - start
            measured[index, k] = np.stack(
                [b[:, 0] + b[:, 2] / 2, b[:, 1] + b[:, 3] / 2, b[:, 2], b[:, 3]], axis=1
            )
            seen[index, k] = True
            size[k] = np.sqrt(np.maximum(b[:, 2] * b[:, 3], 1.0)).mean()
        if not rows:
            return measured, measured, seen, np.zeros(0, bool)
        steps = (
            np.diff(np.array(self._times[start : start + frames], np.float64), prepend=0.0)
            * 1e-9
        )
        noise = np.array([p.place_noise, p.place_noise, p.size_noise, p.size_noise])
        agility = np.array([p.agility, p.agility, p.size_agility, p.size_agility])
        variance, acceleration = (
            (size[:, None] * noise) ** 2,
            (size[:, None] * agility) ** 2,
        )
        rate = (size[:, None] * np.array([1.5, 1.5, 0.2, 0.2]) / self._second) ** 2
        values, rates, doubt, lively = _smooth_lively(
            measured, seen, steps, (variance, acceleration, rate)
        )
        blurred = doubt[:, :, :2].max(axis=2) > (p.blur * size) ** 2
        return values, rates, blurred & ~seen, lively

    def _groups(self, answer: Targets, out: list[Target]) -> list[GroupTrack] | None:
        """The group tracks under the members' final ids; one with fewer than two members left is
        none.
        """
        if answer.group_tracks is None:
            return None
        here = {t.id for t in out}
        kept: list[GroupTrack] = []
        for group in answer.group_tracks:
            members = sorted(
                {
                    self._lives[member].id
                    for member in group.members
                    if member in self._lives
                }
                & here
            )
            if not group.members or len(members) >= 2:
                kept.append(replace(group, members=members))
        return kept

    def _notices(
        self, living: Sequence[TrackLife], answer: Targets, at: int, out: list[Target]
    ) -> list[Notice]:
        """The lifecycle as it now is, and everything else that the forward pass said, under the
        final ids.
        """
        notices: list[Notice] = []
        present = {t.id: t for t in out}
        for life in living:
            notices += self._life_notices(life, at, present.get(life.id))
        for notice in answer.notices:
            if not notice.kind.startswith("track_") and notice.kind != "mode_changed":
                ids = [
                    self._lives[subject].id
                    for subject in notice.subjects
                    if subject in self._lives
                ]
                if ids:
                    notices.append(replace(notice, subjects=ids))
        return notices

    def _life_notices(
        self, life: TrackLife, at: int, target: Target | None
    ) -> list[Notice]:
        if target is None or not target.present:
            was, life.present = life.present, False
            if at == life.last_at + 1:
                return [
                    Notice(
                        "track_removed",
                        [life.id],
                        f"{_RULE}: the last sighting",
                        {"last_frame": life.last_at},
                    )
                ]
            return (
                [
                    Notice(
                        "track_lost",
                        [life.id],
                        f"{_RULE}: a gap too long to fill, or its place is not known in it",
                        {"fill_s": self._p.fill_s},
                    )
                ]
                if was
                else []
            )
        notices: list[Notice] = []
        if at == life.first_at:
            evidence = {
                "sightings": sum(fragment.hits for fragment in life.fragments),
                "fragments": [fragment.id for fragment in life.fragments],
            }
            evidence |= life.why
            notices.append(
                Notice(
                    "track_confirmed", [life.id], f"{_RULE}: the first sighting", evidence
                )
            )
            life.mode = target.mode
        elif not life.present and all(
            fragment.first.at != at for fragment in life.fragments[1:]
        ):
            gap = (self._times[at] - self._times[life.seen_at]) * 1e-9
            waited, most = {"gap_s": gap}, self._fill * self._frame_s
            waited |= {"gap_s_over": most} if gap > most else {}
            notices.append(
                Notice("track_recovered", [life.id], f"{_RULE}: seen again", waited)
            )
        for j, f in zip(life.joins, life.fragments[1:], strict=True):
            if f.first.at == at:
                costs = {
                    "fragment": j.later,
                    "after": j.earlier,
                    "gap_s": j.gap_s,
                    "cost": j.cost,
                }
                watched = "watched_s" if j.unwatched_s else "gap_s"
                costs[watched] = j.gap_s - j.unwatched_s
                costs[f"{watched}_at_most"] = self._p.join_s
                costs["cost_under"] = self._p.join_cost
                costs |= {"motion": j.motion, "size": j.size}
                costs |= {} if j.appearance is None else {"appearance": j.appearance}
                notices.append(
                    Notice(
                        "track_recovered", [life.id], f"{_RULE}: fragments joined", costs
                    )
                )
        if target.mode != life.mode:
            change = {"from": life.mode, "to": target.mode}
            notices.append(
                Notice("mode_changed", [life.id], "EVENTS 2: matching case", change)
            )
            life.mode = target.mode
        life.present, life.seen_at = True, at
        return notices


def _smooth_lively(
    measured: Floats,
    seen: NDArray[np.bool_],
    steps: Floats,
    model: tuple[Floats, Floats, Floats],
) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]]:
    """Smooth paths (T, N, 4), each as lively or calm as is likeliest of it; values, rates,
    variances of the values, whose places are lively.

    Tried are `_CALM` and `_LIVELY`, and the likeliest is kept, one for the place and one for the
    size; of equals the calmer.
    """
    variance, acceleration, rate = model
    tried = (*_CALM, *_LIVELY)
    several = len(tried)
    # Components do not know of one another, so a path's four under every factor are filtered as
    # components of one.
    measured, rate = (np.concatenate([v] * several, axis=-1) for v in (measured, rate))
    variance = np.concatenate([variance * factor for factor, _ in tried], axis=-1)
    acceleration = np.concatenate([acceleration * factor for _, factor in tried], axis=-1)
    made = filtered(measured, seen, steps, variance, acceleration, rate)
    found = made.likelihood(measured, seen, variance).reshape(-1, several, 4)
    doubt = seen.sum(axis=0)[:, None] * np.repeat([0.0, 1.0], [len(_CALM), len(_LIVELY)])
    place = np.argmax(
        np.round((found[:, :, :2].sum(axis=2) - _MARGIN * doubt) * 2.0**20), axis=1
    )
    size = np.argmax(
        np.round((found[:, :, 2:].sum(axis=2) - _MARGIN * doubt) * 2.0**20), axis=1
    )
    chosen = np.concatenate(
        [4 * place[:, None] + [0, 1], 4 * size[:, None] + [2, 3]], axis=1
    )
    return *made.components(chosen).smoothed(), place >= len(_CALM)


def _target(
    row: _Row,
    at: int,
    forward: Target | None,
    value: Sequence[float],
    rate: Sequence[float],
) -> Target:
    """A target of the rewritten frame: smoothed place, everything else as the forward pass had
    it.
    """
    cx, cy, w, h = value
    w, h = max(w, 1.0), max(h, 1.0)
    box = (cx - w / 2, cy - h / 2, w, h)
    vx, vy = rate[:2]
    newborn = at == row.life.first_at
    if forward is None:
        sighted = at in row.at
        return Target(
            row.life.id,
            box,
            (vx, vy),
            "motion" if sighted else "predicted",
            1.0 if sighted else 0.5,
            observed=sighted,
            newborn=newborn,
            born_of_split=newborn and row.life.fragments[0].born_of_split,
        )
    return replace(
        forward,
        id=row.life.id,
        box=box,
        velocity=(vx, vy),
        present=True,
        newborn=newborn,
        measured=None,
        signature=[],
    )
