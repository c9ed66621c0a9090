"""Corrections, applied to a tracker's answers frame by frame, before the reasoning sees them.

A pure function of the corrections, the frame's answer and the ids that the reasoning knows
already: nothing is remembered, so a replay that starts from a checkpoint goes on the same.
"""

from __future__ import annotations

import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

from msgspec.structs import replace

from recorders.annotated.membership import rename_labels
from recorders.corrections import CorrectedSighting, Correction, Corrections
from recorders.errors import SceneTraceError
from recorders.messages import Box, GroupTrack, Notice, Target, Targets
from replay.correcting.names import NamedStretch, Names

_TARGET = re.compile(r"(?<=[Tt]arget )\d{1,10}")
_SAME_PLACE = 0.5
"""Intersection over union at which a target is where it was seen as it was corrected."""


@dataclass(frozen=True)
class Corrected:
    """A frame's answer after corrections.

    Attributes:
        targets: the answer.
        names: for every id of the uncorrected answer, the id that it has now; without those that
            are nobody any more.
        labels: what targets are called, by their ids now.
    """

    targets: Targets
    names: Mapping[int, int]
    labels: Mapping[int, str]

    def payloads(
        self, extra: tuple[tuple[str, bytes], ...], before: Targets
    ) -> tuple[tuple[str, bytes], ...]:
        """What the tracker wrote besides, under the ids as they are now."""
        ids = [target.id for target in before.targets]
        return tuple(
            (n, rename_labels(data, self.names, ids) if n == "membership" else data)
            for n, data in extra
        )


class Corrector:
    """Applies a file's corrections.

    Attributes:
        apart: pairs of fragments of the forward pass that hindsight may not join into one life.
    """

    def __init__(self, corrections: Corrections) -> None:
        rows = corrections.in_force
        self._names = Names(rows)
        self._touched = self._names.touched
        self._witnesses: dict[int, list[tuple[Correction, Names, CorrectedSighting]]] = {}
        for k, row in enumerate(rows):
            before = Names(rows[:k])
            for seen in row.seen:
                self._witnesses.setdefault(seen.frame, []).append((row, before, seen))
        self.apart = [(r.tracks[0], r.tracks[1]) for r in rows if r.do == "not-same"]

    def step(self, answer: Targets, known: Container[int]) -> Corrected:
        """A frame's answer as it is after the corrections.

        Args:
            answer: of the tracker, or of hindsight.
            known: the ids that the reasoning has met in earlier frames.

        Raises:
            SceneTraceError: who was corrected is not where he was seen then, or two who are both
                seen would be one.
        """
        self._check(answer)
        called = {t.id: self._names.at(t.id, answer.frame) for t in answer.targets}
        names = {i: s.name for i, s in called.items() if s.name is not None}
        labels = {
            s.name: s.label for s in called.values() if s.name is not None and s.label
        }
        if not self._touched:
            return Corrected(answer, names, labels)
        kept = [
            self._turned(t, called[t.id], known) for t in answer.targets if t.id in names
        ]
        here = _one_each(kept, answer.frame)
        targets = replace(
            answer,
            targets=here,
            group_tracks=_groups(answer.group_tracks, names),
            notices=self._notices(answer, known, [t.id for t in here if t.present]),
        )
        return Corrected(targets, names, labels)

    def _turned(
        self, target: Target, called: NamedStretch, known: Container[int]
    ) -> Target:
        assert called.name is not None
        if called.name not in self._touched:
            return target
        begins = called.name not in known
        return replace(
            target,
            id=called.name,
            newborn=begins,
            born_of_split=begins and target.born_of_split,
        )

    def _notices(
        self, answer: Targets, known: Container[int], present: Sequence[int]
    ) -> list[Notice]:
        """The tracker's notices under the ids as they are now.

        Beginnings and ends that are none any more are left out; those that are new, the reasoning
        tells by itself.
        """
        kept: list[Notice] = []
        for notice in answer.notices:
            called = [self._names.at(i, answer.frame).name for i in notice.subjects]
            subjects = [i for i in called if i is not None]
            if (notice.subjects and not subjects) or (
                self._touched.intersection(subjects)
                and not _holds(notice.kind, subjects[0], known, present)
            ):
                continue
            text = _TARGET.sub(lambda m: self._renamed(m[0], answer.frame), notice.text)
            kept.append(replace(notice, subjects=subjects, text=text))
        return kept

    def _renamed(self, number: str, frame: int) -> str:
        name = self._names.at(int(number), frame).name
        return "nobody" if name is None else str(name)

    def _check(self, answer: Targets) -> None:
        for row, before, seen in self._witnesses.get(answer.frame, ()):
            there = [
                t
                for t in answer.targets
                if before.at(t.id, answer.frame).name == seen.track
            ]
            if not any(
                overlap(t.box, (seen.x, seen.y, seen.w, seen.h)) >= _SAME_PLACE
                for t in there
            ):
                where = f"at ({seen.x:g}, {seen.y:g})"
                now = (
                    f"at ({there[0].box[0]:.1f}, {there[0].box[1]:.1f})"
                    if there
                    else "nowhere"
                )
                raise SceneTraceError(
                    f"correction {row.correction} ({row.told()}): target {seen.track} was"
                    f" {where} in frame {seen.frame} and is {now} now: it was made for"
                    " another recording, tracker, configuration or version; make the"
                    " corrections anew on a replay of this one"
                )


def _holds(kind: str, track: int, known: Container[int], present: Sequence[int]) -> bool:
    """Whether what is told of a life's course is so of the track as it is now."""
    if kind == "track_confirmed":
        return track not in known
    if kind == "track_recovered":
        return track in known and track in present
    return kind not in ("track_lost", "track_removed") or (
        track in known and track not in present
    )


def overlap(a: Box, b: Box) -> float:
    """Intersection over union of two boxes (x, y, w, h).

    >>> overlap((0, 0, 2, 2), (0, 1, 2, 2))
    0.3333333333333333
    """
    w = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    h = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    shared = max(0.0, w) * max(0.0, h)
    return shared / max(a[2] * a[3] + b[2] * b[3] - shared, 1e-9)


def _one_each(targets: list[Target], frame: int) -> list[Target]:
    """One target of each id, by id: of two the one that is seen.

    Raises:
        SceneTraceError: both are.
    """
    chosen: dict[int, Target] = {}
    for target in targets:
        other = chosen.get(target.id)
        if other is not None and target.observed and other.observed:
            raise SceneTraceError(
                f"frame {frame}: two targets that are both seen would be target"
                f" {target.id} after the corrections: they were made for another replay"
            )
        if other is None or target.observed:
            chosen[target.id] = target
    return [chosen[i] for i in sorted(chosen)]


def _groups(
    groups: list[GroupTrack] | None, names: Mapping[int, int]
) -> list[GroupTrack] | None:
    """The group tracks under the members' ids as they are now; one with fewer than two members
    left is none.
    """
    if groups is None:
        return None
    turned = [
        replace(g, members=sorted({names[i] for i in g.members if i in names}))
        for g in groups
    ]
    return [
        now
        for was, now in zip(groups, turned, strict=True)
        if not was.members or len(now.members) >= 2
    ]
