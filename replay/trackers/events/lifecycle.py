"""The life of a target: confirmed or recovered, seen, lost, removed (EVENTS 2, 3.2); ids and
notices.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from reasoning.geometry import OUTSIDE
from reasoning.regions import SceneRegions
from recorders.messages import Mode, Notice
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.recover import Recovery, recover
from replay.trackers.events.tracks import TENTATIVE, Track, Tracks
from replay.trackers.tracker import Frame

NS = 1e9


class Lifecycle:
    """Gives ids, and decides who is confirmed, lost and removed."""

    def __init__(self, tracks: Tracks, parameters: EventsParameters) -> None:
        self._tracks = tracks
        self._p = parameters
        self._next_id = 1

    def new_id(self) -> int:
        """The next identity; none is ever given twice."""
        self._next_id += 1
        return self._next_id - 1

    def confirm(self, frame: Frame, regions: SceneRegions) -> list[Notice]:
        """Tentative tracks with enough support become targets, new ones or ones that had been
        lost (case 2).
        """
        items = self._tracks.items
        ripe = [
            k for k, t in enumerate(items) if t.id == TENTATIVE and self._ripe(t, frame)
        ]
        if not ripe:
            return []
        lost = [
            k
            for k, t in enumerate(items)
            if t.id != TENTATIVE and t.lost and not t.observed
        ]
        notices: list[Notice] = []
        found = {
            r.track: r for r in recover(self._tracks, lost, ripe, frame.time_ns, self._p)
        }
        for row in ripe:
            track = items[row]
            if row in found:
                notices += self._take_over(found[row], frame)
            elif regions.may_start_high_level(self._tracks.box(row)):
                track.id, track.newborn = self.new_id(), True
                evidence = {
                    "hits": track.hits,
                    "first_frame": track.born,
                    "sightings": track.sightings[:-1],
                }
                rule = "EVENTS 2: enough support, at least partly in the region of interest"
                notices.append(Notice("track_confirmed", [track.id], rule, evidence))
                track.sightings = []
        gone = [r.orphan for r in found.values()]
        self._tracks.keep([k for k in range(len(items)) if k not in gone])
        return notices

    def _ripe(self, track: Track, frame: Frame) -> bool:
        old = (frame.time_ns - track.born_ns) / NS >= self._p.confirm_s
        return track.observed and old and track.hits >= self._p.confirm_hits

    def _take_over(self, r: Recovery, frame: Frame) -> list[Notice]:
        """The new track lives on under the orphan's id, with the orphan's past."""
        orphan, track = self._tracks.items[r.orphan], self._tracks.items[r.track]
        track.id, track.split, track.mode = orphan.id, orphan.split, orphan.mode
        track.born, track.born_ns, track.hits = (
            orphan.born,
            orphan.born_ns,
            orphan.hits + track.hits,
        )
        if orphan.colours is not None:
            track.colours = orphan.colours
        evidence: dict[str, Any] = {
            "unseen_s": (frame.time_ns - orphan.seen_ns) / NS,
            "cost": r.cost,
            "motion": r.motion,
            "size": r.size,
            "most": self._p.recover_cost,
            "sightings": track.sightings[:-1],
        }
        if r.appearance is not None:
            evidence["appearance"] = r.appearance
        track.sightings = []
        rule = "EVENTS 2, matching case 2: an orphan and a new track look alike"
        return [Notice("track_recovered", [track.id], rule, evidence)]

    def age(self, frame: Frame, regions: SceneRegions) -> list[Notice]:
        """Modes and confidences; confidence falls while a target is unseen, then it is lost, then
        removed.
        """
        kept: list[int] = []
        notices: list[Notice] = []
        evidence: dict[str, Any]
        places = regions.area_cover(self._tracks.boxes)
        for row, track in enumerate(self._tracks.items):
            unseen = (frame.time_ns - track.seen_ns) / NS
            if track.id == TENTATIVE:
                if unseen <= self._p.tentative_s:
                    kept.append(row)
                continue
            notices += self._mode(track, unseen)
            why = self._must_go(places[row], track, unseen, regions)
            if why is None:
                kept.append(row)
            else:
                evidence = {
                    "unseen_s": unseen,
                    "confidence": track.confidence,
                    "box": list(self._tracks.box(row)),
                }
                evidence["left_scene"] = places[row] == OUTSIDE
                notices.append(Notice("track_removed", [track.id], why, evidence))
        self._tracks.keep(kept)
        return notices

    def _mode(self, track: Track, unseen: float) -> list[Notice]:
        notices: list[Notice] = []
        mode: Mode = track.now if track.observed else "predicted"
        if track.hidden or (track.observed and track.held):
            mode = "appearance"
        # Behind somebody who explains the pixels where it should be, a target can be nowhere else.
        patience = self._p.hidden_patience if track.hidden else 1.0
        track.confidence = track.quality * 0.5 ** (
            unseen / (patience * self._p.half_life_s)
        )
        if mode != track.mode:
            case = {"motion": 1, "appearance": 3, "predicted": 3}[mode]
            change = {
                "from": track.mode,
                "to": mode,
                "unseen_s": unseen,
                "confidence": track.confidence,
            }
            notices.append(
                Notice(
                    "mode_changed", [track.id], f"EVENTS 2, matching case {case}", change
                )
            )
            track.mode = mode
        lost = unseen > patience * self._p.coast_s
        if lost and not track.lost:
            evidence = {
                "unseen_s": unseen,
                "most_s": patience * self._p.coast_s,
                "confidence": track.confidence,
            }
            notices.append(
                Notice(
                    "track_lost",
                    [track.id],
                    "EVENTS 2: no observation for too long",
                    evidence,
                )
            )
        elif track.lost and not lost:
            rule = "EVENTS 2, matching case 1: an observation where it was expected"
            notices.append(
                Notice("track_recovered", [track.id], rule, {"quality": track.quality})
            )
        track.lost = lost
        return notices

    def _must_go(
        self, place: int, track: Track, unseen: float, regions: SceneRegions
    ) -> str | None:
        if unseen > self._p.keep_s:
            return "EVENTS 2: no observation for longer than targets are kept"
        return regions.reason_to_remove(
            place, track.mode, min(1.0, max(0.0, track.confidence))
        )

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {"next_id": self._next_id}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._next_id = state["next_id"]
