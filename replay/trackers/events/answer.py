"""From tracks to the messages of one frame."""

from __future__ import annotations

from recorders.messages import NO_BLOB, Box, GroupTrack, Notice, Target, Targets
from replay.trackers.events.tracks import EventsTracks
from replay.trackers.life import TENTATIVE
from replay.trackers.tracker import Frame


def shared_regions(tracks: EventsTracks, frame: Frame) -> list[tuple[list[int], Box]]:
    """Regions of pixels that hold two or more present targets: ids ascending, and box, by region."""
    members: dict[int, list[int]] = {}
    for track in tracks.items:
        if track.id != TENTATIVE and not track.lost and track.blob != NO_BLOB:
            members.setdefault(track.blob, []).append(track.id)
    blobs = frame.detections.components
    out: list[tuple[list[int], Box]] = []
    for blob in sorted(members):
        if len(members[blob]) >= 2:
            boxes = [c.box for c in blobs if c.id == blob]
            # Without components a blob is the detection of that place, or a name alone.
            boxes += frame.detections.boxes[blob - 1 : blob]
            boxes += [
                item.measured
                for item in tracks.items
                if item.blob == blob and item.measured
            ]
            if boxes:
                out.append((sorted(members[blob]), boxes[0]))
    return out


def answer(
    tracks: EventsTracks, frame: Frame, groups: list[GroupTrack], notices: list[Notice]
) -> Targets:
    """All confirmed targets, by id."""
    targets: list[Target] = []
    for track, (box, ellipse, velocity) in zip(tracks.items, tracks.shapes(), strict=True):
        if track.id == TENTATIVE:
            continue
        targets.append(
            Target(
                track.id,
                box,
                velocity,
                track.mode,
                min(1.0, max(0.0, track.confidence)),
                present=not track.lost,
                observed=track.observed,
                blob=track.blob,
                newborn=track.newborn,
                born_of_split=track.split,
                ellipse=ellipse,
                score=track.quality,
                measured=track.measured,
                signature=(
                    track.colours.signature()
                    if track.signed and track.colours is not None
                    else []
                ),
            )
        )
    return Targets(
        frame.index, sorted(targets, key=lambda target: target.id), groups, notices
    )
