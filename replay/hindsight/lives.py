"""The lives that a recording holds once fragments are joined: which of them are told, and why not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from msgspec.structs import replace

from recorders.messages import Notice, Target
from recorders.scene import SceneInfo
from replay.hindsight.crossings import Crossing
from replay.hindsight.doubles import Within
from replay.hindsight.fragments import Fragment
from replay.hindsight.joining import Join
from replay.hindsight.left import BesideWhom
from replay.hindsight.parameters import HindsightParameters
from replay.hindsight.verdicts import (
    CrossingDoubt,
    Doubt,
    Whole,
    confidence,
    doubts,
    lessened,
    mean_odds,
    moving_odds,
    told_crossing,
    told_doubt,
    whole,
    why_not,
)

_CUT_OFF = 0.5
"""Share of the least life that a path needs which a recording's start or end cut off."""


@dataclass
class TrackLife:
    """One identity after joining: its fragments in order, and what was said of it so far."""

    id: int
    fragments: list[Fragment]
    joins: list[Join]
    first_at: int
    last_at: int
    present: bool = False
    seen_at: int = 0
    mode: str = "motion"
    why: dict[str, float] = field(default_factory=dict)
    odds: float | None = None
    judged: bool = False
    doubts: list[Doubt | CrossingDoubt] = field(default_factory=list)
    identity: float = 1.0
    doubted: int = 0

    def go_on(self, at: int) -> list[Notice]:
        """Come to a frame: what is left of its identity, and what is to be told of that."""
        told: list[Notice] = []
        while self.doubted < len(self.doubts) and self.doubts[self.doubted].at <= at:
            doubt = self.doubts[self.doubted]
            self.identity = lessened(self.identity, doubt.odds)
            self.doubted += 1
            if isinstance(doubt, CrossingDoubt):
                notice = told_crossing(self.id, doubt, self.identity)
            else:
                notice = told_doubt(self.id, doubt, self.identity)
            told += [] if notice is None else [notice]
        return told

    def believed(self, target: Target) -> Target:
        """A target of this life with what is believed of it."""
        sure = target.confidence
        if self.odds is not None:
            sure = confidence(self.odds, target, self.judged)
        return replace(target, confidence=sure, identity=self.identity)

    def of(self, forward: dict[int, Target]) -> Target | None:
        """What the forward pass said of it in a frame."""
        for fragment in self.fragments:
            if fragment.id in forward:
                return forward[fragment.id]
        return None


def lives_of(
    fragments: Mapping[int, Fragment],
    joins: Sequence[Join],
    within: Within,
    beside: BesideWhom,
    p: HindsightParameters,
    scene: SceneInfo,
    times: Sequence[int],
    crossings: Sequence[Crossing] = (),
) -> tuple[dict[int, TrackLife], dict[int, str]]:
    """Every forward id's life, and of those that are not told why. A life has the id of its first
    fragment; of its doubts are those of the ``crossings`` of its forward ids.
    """
    followed = {join.later: join for join in joins}
    chains = _chains(fragments, followed)
    judged = {
        identity: _judged([fragments[k] for k in chain], p, scene, times)
        for identity, chain in chains.items()
    }
    people = {k: chain for k, chain in chains.items() if not judged[k][2]}
    told = {
        k: chain
        for k, chain in chains.items()
        if k in people
        or (
            judged[k][1].still
            and judged[k][1].seen >= p.min_support
            and beside.left(chain, people)
        )
    }
    reasons = {
        f: judged[k][2] for k, chain in chains.items() if k not in told for f in chain
    }
    for identity, (body, share) in within.doubles(told).items():
        reason = f"at one place with track {body} for {share:.2f} of its life: one body"
        reasons.update((k, reason) for k in told.pop(identity))
    lives: dict[int, TrackLife] = {}
    for identity, chain in told.items():
        parts = [fragments[k] for k in chain]
        joined = [followed[k] for k in chain if k in followed]
        life = TrackLife(identity, parts, joined, parts[0].first.at, parts[-1].last.at)
        life.why, known, _ = judged[identity]
        life.odds, life.judged = known.odds, mean_odds(parts) is not None
        life.doubts += doubts(parts, joined, scene.has_images)
        for part in parts:
            part.forget()
        lives.update((k, life) for k in chain)
    for crossing in crossings:
        for one, other in ((crossing.a, crossing.b), (crossing.b, crossing.a)):
            if one in lives:
                with_whom = lives[other].id if other in lives else None
                lives[one].doubts.append(CrossingDoubt(crossing.at, with_whom, crossing))
    for life in lives.values():
        life.doubts.sort(key=lambda doubt: doubt.at)
    return lives, reasons


def _chains(
    fragments: Mapping[int, Fragment], followed: Mapping[int, Join]
) -> dict[int, list[int]]:
    """Ids of the fragments that are one life, in order, by the first one's."""
    chains: dict[int, list[int]] = {}
    root: dict[int, int] = {}
    for f in sorted(
        fragments.values(), key=lambda fragment: (fragment.first.at, fragment.id)
    ):
        before = followed.get(f.id)
        root[f.id] = f.id if before is None else root[before.earlier]
        chains.setdefault(root[f.id], []).append(f.id)
    return chains


def _judged(
    parts: Sequence[Fragment],
    p: HindsightParameters,
    scene: SceneInfo,
    times: Sequence[int],
) -> tuple[dict[str, float], Whole, str]:
    """What speaks for a life, what is known of it, and why it is not told, "" where it is."""
    first, last = parts[0].first, parts[-1].last
    seconds = (last.time_ns - first.time_ns + scene.frame_ns) * 1e-9
    # Who is there in the first or the last frame was cut off by the recording, and lived longer
    # than is seen.
    from_start, to_end = first.at == 0, last.at == len(times) - 1
    least = p.min_life_s * (_CUT_OFF if from_start or to_end else 1.0)
    asked = scene.has_masks and not p.things
    moving = moving_odds(scene.pieces) if asked else None
    life = whole(parts, seconds, from_start, to_end, moving)
    why = {
        "life_s": seconds,
        "life_s_at_least": least,
        "support": life.seen,
        "support_at_least": p.min_support,
    }
    return why, life, why_not(parts, life, least, p)
