"""The EVENTS tracker on made-up frames: lives, merged blobs, colours, groups, regions,
checkpoints.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from recorders.messages import Box, Detections, Notice, Regions, Targets
from recorders.parameters import Config, configure
from recorders.scene import Frame, SceneInfo
from recorders.segmentation.blobs import components
from replay import hindsight
from replay.trackers import events
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.places import MaskCut, search
from replay.trackers.tracker import Tracker

WIDTH, HEIGHT, FRAME_NS = 320, 240, 100_000_000
BODY = (20.0, 40.0)
RED, BLUE, GREY = (40, 40, 200), (200, 60, 40), (120, 120, 120)
Actor = tuple[float, float, tuple[int, int, int]]
Play = Callable[[int], list[Actor]]


def _config(*words: str) -> Config:
    return configure(events.SECTIONS, None, words)


def _box_frame(
    index: int,
    boxes: Sequence[Box],
    scores: Sequence[float] = (),
    regions: Regions | None = None,
) -> Frame:
    n = len(boxes)
    given = list(scores) or [0.9] * n
    return Frame(
        index,
        index * FRAME_NS,
        Detections(index, WIDTH, HEIGHT, list(boxes), given, ["o"] * n),
        regions,
    )


def _body(x: float, y: float) -> Box:
    return (x, y, *BODY)


def _pixel_frame(index: int, actors: Sequence[Actor]) -> Frame:
    """Rectangles, later ones in front; the mask's blobs are the detections."""
    image = np.full((HEIGHT, WIDTH, 3), GREY, np.uint8)
    image += (np.arange(WIDTH) % 7).astype(np.uint8)[None, :, None]
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    for x, y, colour in actors:
        x1, y1 = max(0, round(x)), max(0, round(y))
        x2, y2 = max(0, round(x + BODY[0])), max(0, round(y + BODY[1]))
        image[y1:y2, x1:x2] = colour
        mask[y1:y2, x1:x2] = 255
    clean, _, blobs = components(mask, 20)
    n = len(blobs)
    detections = Detections(
        index, WIDTH, HEIGHT, [b.box for b in blobs], [0.8] * n, ["o"] * n,
        [b.ellipse for b in blobs], [b.id for b in blobs], blobs,
    )  # fmt: skip
    return Frame(index, index * FRAME_NS, detections, None, lambda: image, lambda: clean)


def _boxes_only(*words: str) -> Tracker:
    return events.make(SceneInfo(WIDTH, HEIGHT, FRAME_NS, False, False), _config(*words))


def _pixels(*words: str) -> Tracker:
    return events.make(SceneInfo(WIDTH, HEIGHT, FRAME_NS, True, True), _config(*words))


def _play(tracker: Tracker, play: Play, frames: int) -> list[Targets]:
    return [tracker.step(_pixel_frame(k, play(k))) for k in range(frames)]


def _told(out: Sequence[Targets], kind: str) -> list[tuple[int, Notice]]:
    return [(t.frame, n) for t in out for n in t.notices if n.kind == kind]


def _passing(k: int) -> list[Actor]:
    """Red stands, blue walks past in front of it."""
    return [(150.0, 102.0, RED), (40.0 + 4.0 * k, 106.0, BLUE)]


def test_a_target_is_confirmed_after_enough_sightings_and_keeps_them_all() -> None:
    tracker = _boxes_only()
    out = [tracker.step(_box_frame(k, [_body(100 + 3.0 * k, 80)])) for k in range(10)]
    assert [len(t.targets) for t in out] == [0, 0, 1, 1, 1, 1, 1, 1, 1, 1]
    [(frame, notice)] = _told(out, "track_confirmed")
    assert frame == 2
    assert notice.evidence["first_frame"] == 0
    assert [s.frame for s in notice.sightings] == [0, 1]
    target = out[9].targets[0]
    assert target.box == pytest.approx(_body(127, 80), abs=2.0)
    assert target.velocity == pytest.approx((30.0, 0.0), abs=4.0)
    assert (target.mode, target.observed, target.present) == ("motion", True, True)


def test_pixels_that_two_claim_are_whose_colours_they_have() -> None:
    """Two in the space of one, each seen by half: what is disputed is no longer so where their
    colours differ much.
    """
    pixels = np.zeros((80, 80), np.uint8)
    pixels[20:60, 30:50] = 1
    left = (
        np.where(np.arange(80) < 40, 1.0, -1.0).astype(np.float32)[None].repeat(80, axis=0)
    )
    boxes = np.array([[30.0, 20.0, *BODY]] * 2)
    p = EventsParameters()

    def least_own(likeness: list[NDArray[np.float32] | None]) -> float:
        found = search(
            MaskCut(pixels, 0, 0), boxes, np.ones(2), [np.zeros((0, 2))] * 2, likeness, p
        )
        return float(found[1].min())

    unknown = least_own([None, None])
    assert least_own([left, -left]) > unknown + p.min_own
    alike = np.float32(0.2) * left
    assert least_own([alike, -alike]) <= unknown


def test_who_leaves_the_picture_is_said_to_have_left() -> None:
    tracker = _boxes_only()
    out = [
        tracker.step(_box_frame(k, [_body(250 + 8.0 * k, 80)] if k < 8 else []))
        for k in range(20)
    ]
    [(_, notice)] = _told(out, "track_removed")
    assert notice.left_scene is True
    lost = _boxes_only()
    out = [lost.step(_box_frame(k, [_body(100, 80)] if k < 8 else [])) for k in range(60)]
    [(_, notice)] = _told(out, "track_removed")
    assert notice.left_scene is False


def test_a_flash_is_no_target() -> None:
    tracker = _boxes_only()
    out = [
        tracker.step(_box_frame(k, [_body(100, 80)] if k < 2 else [])) for k in range(20)
    ]
    assert not any(t.targets or t.notices for t in out)


def test_unseen_its_confidence_falls_until_it_is_lost_and_removed() -> None:
    tracker = _boxes_only("events.keep_s=2")
    out = [
        tracker.step(_box_frame(k, [_body(100 + k, 80)] if k < 20 else []))
        for k in range(60)
    ]
    falling = [t.targets[0].confidence for t in out[19:40]]
    assert all(b < a for a, b in pairwise(falling))
    assert {t.targets[0].mode for t in out[20:40]} == {"predicted"}
    assert [t.targets[0].present for t in out[19:26]] == [True] * 4 + [False] * 3
    assert [f for f, _ in _told(out, "mode_changed")] == [20]
    assert [f for f, _ in _told(out, "track_lost")] == [23]
    assert [f for f, _ in _told(out, "track_removed")] == [40]
    assert not out[40].targets


def test_it_comes_back_under_its_id() -> None:
    tracker = _boxes_only()
    out = [
        tracker.step(_box_frame(k, [_body(100 + 2 * k, 80)] if not 20 <= k < 30 else []))
        for k in range(50)
    ]
    assert {t.id for o in out for t in o.targets} == {1}
    assert len(_told(out, "track_recovered")) == 1
    assert out[-1].targets[0].present


def test_low_scores_keep_a_target_but_start_none() -> None:
    tracker = _boxes_only()
    out = [
        tracker.step(
            _box_frame(k, [_body(100, 80), _body(200, 80)], [0.9 if k < 10 else 0.3, 0.3])
        )
        for k in range(30)
    ]
    assert [[t.id for t in o.targets] for o in out[10:]] == [[1]] * 20
    assert all(o.targets[0].observed for o in out[10:])


def test_a_merged_detection_is_one_blob_of_two_targets() -> None:
    tracker = _boxes_only()
    out = []
    for k in range(40):
        a, b = 60.0 + 3 * k, 240.0 - 3 * k
        boxes = [_body(a, 80), _body(b, 82)]
        if abs(a - b) < 14:
            boxes = [(min(a, b), 80.0, BODY[0] + abs(a - b), 42.0)]
        out.append(tracker.step(_box_frame(k, boxes)))
    shared = [
        o
        for o in out
        if len(o.targets) == 2 and o.targets[0].blob == o.targets[1].blob >= 0
    ]
    assert shared
    assert all(
        [g.members for g in o.group_tracks or [] if g.observed] == [[1, 2]] for o in shared
    )
    assert [t.id for t in out[-1].targets] == [1, 2]
    assert out[-1].targets[0].box[0] > out[-1].targets[1].box[0]


def test_only_roi_and_border_start_targets_and_whoever_leaves_them_goes() -> None:
    square = [(80.0, 20.0), (240.0, 20.0), (240.0, 220.0), (80.0, 220.0)]
    regions = Regions(WIDTH, HEIGHT, [square], [square])
    tracker = _boxes_only()
    out = [
        tracker.step(_box_frame(k, [_body(20 + 6.0 * k, 80)], (), regions))
        for k in range(45)
    ]
    here = [o.frame for o in out if o.targets]
    assert 20 + 6.0 * here[0] + BODY[0] > 80
    first = _told(out, "track_confirmed")[0][1].evidence["first_frame"]
    assert 20 + 6.0 * first + BODY[0] / 2 == pytest.approx(80, abs=6)
    [(_, notice)] = _told(out, "track_removed")
    assert "outside" in notice.rule
    assert not out[-1].targets


def test_two_who_pass_keep_their_ids_and_are_followed_by_appearance_within_one_blob() -> (
    None
):
    out = _play(_pixels(), _passing, 60)
    assert {t.id for o in out for t in o.targets} == {1, 2}
    merged = [
        o
        for o in out[10:]
        if len(o.targets) == 2 and o.targets[0].blob == o.targets[1].blob >= 0
    ]
    assert len(merged) >= 6
    assert all({t.mode for t in o.targets} == {"appearance"} for o in merged)
    assert all(
        [g.members for g in o.group_tracks or [] if g.observed] == [[1, 2]] for o in merged
    )
    newborn = [g.newborn for o in merged for g in o.group_tracks or [] if g.observed]
    assert newborn == [True] + [False] * (len(newborn) - 1)
    red, blue = (min(out[8].targets, key=lambda t: abs(t.box[0] - x)).id for x in (150, 72))
    end = {t.id: t for t in out[-1].targets}
    assert end[red].box[0] == pytest.approx(150, abs=4)
    assert end[blue].box[0] == pytest.approx(40 + 4 * 59, abs=6)
    assert {t.mode for t in out[-1].targets} == {"motion"}


def _divided_frame(index: int, bodies: Sequence[Box], blobs: Sequence[int]) -> Frame:
    """Bodies seen from above, each a detection of the given blob; one blob of several is tied."""
    image = np.full((HEIGHT, WIDTH, 3), GREY, np.uint8)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    for x, y, w, h in bodies:
        mask[int(y) : int(y + h), int(x) : int(x + w)] = 255
    image[mask > 0] = RED
    if len(set(blobs)) < len(blobs):
        x1, y1 = (int(min(b[k] for b in bodies)) for k in (0, 1))
        x2, y2 = (int(max(b[k] + b[k + 2] for b in bodies)) for k in (0, 1))
        mask[y1:y2, (x1 + x2) // 2] = 255
        mask[(y1 + y2) // 2, x1:x2] = 255
    clean, _, found = components(mask, 20)
    n = len(bodies)
    detections = Detections(
        index, WIDTH, HEIGHT, list(bodies), [0.8] * n, ["o"] * n,
        [found[blob - 1].ellipse for blob in blobs], list(blobs), found,
    )  # fmt: skip
    return Frame(index, index * FRAME_NS, detections, None, lambda: image, lambda: clean)


@pytest.mark.parametrize("touched", [False, True])
def test_bodies_that_turn_are_where_the_segmentation_divided_them(touched: bool) -> None:
    """Two lie side by side and in touch, and then stand side by side: boxes of the size that they
    had reach over both.
    """
    lying: list[Box] = [(100.0, 100.0, 80.0, 26.0), (100.0, 130.0, 80.0, 26.0)]
    standing: list[Box] = [(106.0, 90.0, 26.0, 80.0), (146.0, 90.0, 26.0, 80.0)]
    tracker = _pixels()
    for k in range(20):
        tracker.step(_divided_frame(k, lying, [1, 1] if touched and k > 15 else [1, 2]))
    out = [tracker.step(_divided_frame(k, standing, [1, 2])) for k in range(20, 24)]
    assert all([t.id for t in o.targets] == [1, 2] for o in out)
    there = [sorted(t.measured or () for t in o.targets) == standing for o in out]
    assert all(there) == touched


def test_who_is_left_takes_his_own_part_of_a_divided_blob() -> None:
    """One of two was lost; the other does not lie between what the blob was divided into."""
    tracker = _pixels()
    both: list[Box] = [(100.0, 100.0, 80.0, 26.0), (100.0, 130.0, 80.0, 26.0)]
    for k in range(10):
        tracker.step(_divided_frame(k, both[:1], [1]))
    out = [tracker.step(_divided_frame(k, both, [1, 1])) for k in range(10, 20)]
    assert all(o.targets[0].measured == both[0] for o in out)
    assert [t.measured for t in out[-1].targets] == both


def test_places_within_a_blob_are_near_the_truth() -> None:
    out = _play(_pixels(), _passing, 60)
    for o in out[10:50]:
        truth = [150.0, 40.0 + 4.0 * o.frame]
        boxes = sorted(t.box[0] for t in o.targets)
        assert len(boxes) == 2
        if abs(truth[0] - truth[1]) > 10:
            assert boxes == pytest.approx(sorted(truth), abs=8)


def test_colours_bring_a_target_back_that_waited_elsewhere() -> None:
    def play(k: int) -> list[Actor]:
        here: list[Actor] = [(220.0, 150.0, BLUE)]
        return here if 30 <= k < 50 else [*here, (100.0 if k < 30 else 135.0, 80.0, RED)]

    out = _play(_pixels(), play, 70)
    assert {t.id for o in out for t in o.targets} == {1, 2}
    [(_, notice)] = _told(out, "track_recovered")
    assert notice.evidence["appearance"] < 0.3
    assert notice.evidence["cost"] <= notice.evidence["cost_at_most"]


def test_exchanged_identities_are_put_right_by_colours() -> None:
    """They meet, stop behind one another, and turn back: by motion alone each would be taken for
    the other.
    """

    def play(k: int) -> list[Actor]:
        away = max(0.0, 90.0 - 6.0 * k) if k < 22 else 6.0 * (k - 22)
        return [(150.0 - away, 100.0, RED), (150.0 + away, 101.0, BLUE)]

    out = _play(_pixels(), play, 45)
    red = next(t.id for t in out[8].targets if t.box[0] < 150)
    assert red == next(t.id for t in out[-1].targets if t.present and t.box[0] < 150)
    [(_, notice)] = [
        (f, n) for f, n in _told(out, "track_recovered") if "exchanged" in n.evidence
    ]
    assert notice.subjects == [1, 2]
    assert (
        notice.evidence["exchanged"]
        <= notice.evidence["exchanged_at_most"]
        < notice.evidence["as_they_were"]
    )


def _given_frame(index: int, boxes: Sequence[Box]) -> Frame:
    """A mask and no picture; each detection has the blob that it lies in."""
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    for x, y, w, h in boxes:
        mask[round(y) : round(y + h), round(x) : round(x + w)] = 255
    clean, labels, blobs = components(mask, 20)
    own = [int(labels[round(y + h / 2), round(x + w / 2)]) for x, y, w, h in boxes]
    n = len(boxes)
    given = Detections(
        index, WIDTH, HEIGHT, list(boxes), [1.0] * n, ["o"] * n, [None] * n, own, blobs
    )
    return Frame(index, index * FRAME_NS, given, None, None, lambda: clean)


def _given_only(*words: str) -> Tracker:
    return events.make(SceneInfo(WIDTH, HEIGHT, FRAME_NS, False, True), _config(*words))


def test_in_one_blob_with_a_detection_for_each_nobody_is_taken_for_another() -> None:
    """Two stand side by side, a third walks past right behind them: all three are one blob for
    long.
    """
    tracker, out = _given_only(), []
    for k in range(70):
        out.append(
            tracker.step(
                _given_frame(k, [_body(140, 100), _body(158, 104), _body(20 + 4.0 * k, 96)])
            )
        )
    assert {t.id for o in out for t in o.targets} == {1, 2, 3}
    together = [o for o in out if len({t.blob for t in o.targets}) == 1 < len(o.targets)]
    assert len(together) >= 12
    places = {o.frame: {t.id: t.box[0] for t in o.targets} for o in out[6:]}
    ids = [min(places[10], key=lambda i: abs(places[10][i] - x)) for x in (140, 158, 60)]
    for frame, at in places.items():
        assert [at[i] for i in ids] == pytest.approx([140, 158, 20 + 4.0 * frame], abs=5)


def test_who_comes_off_a_target_is_born_of_a_split_and_who_walks_in_is_not() -> None:
    """From frame 20 on a second body comes out of the first one's blob; a third walks in from the
    left.
    """
    tracker, out = _pixels(), []
    for k in range(60):
        actors = [
            (200.0, 100.0, RED),
            (200.0 + 3.0 * max(0, k - 20), 98.0, RED),
            (-20.0 + 2.0 * k, 60.0, RED),
        ]
        out.append(tracker.step(_pixel_frame(k, actors)))
    born = {t.id: t.born_of_split for o in out for t in o.targets if t.newborn}
    where = {t.id: t.box[0] for t in out[-1].targets}
    assert len(born) == 3
    assert sorted(where[i] > 190 for i, split in born.items() if split) == [True]
    walked_in = min(where, key=lambda i: where[i])
    assert not born[walked_in]


def _side_by_side(tracker: Tracker) -> list[Targets]:
    """Two stand side by side; in single frames a gap opens between them."""
    out = []
    for k in range(40):
        apart = 20.0 if k < 12 else 2.0 if k % 5 == 4 else 0.0
        out.append(tracker.step(_given_frame(k, [_body(100, 80), _body(120 + apart, 82)])))
    assert [len({t.blob for t in o.targets}) for o in out[8:12]] == [2] * 4
    return out


def test_a_split_is_told_in_its_own_frame() -> None:
    out = _side_by_side(_given_only())
    regions = [len({t.blob for t in o.targets}) for o in out]
    assert [k for k in range(15, 40) if regions[k] == 2] == [19, 24, 29, 34, 39]


def test_a_blob_that_flickers_may_be_held_to_be_one_region_all_the_time() -> None:
    out = _side_by_side(_given_only("events.hold_s=0.12"))
    assert [len({t.blob for t in o.targets}) for o in out[15:]] == [1] * 25
    assert {g.id for o in out[15:] for g in o.group_tracks or []} == {1}


def test_a_new_track_over_a_collision_zone_is_a_group_tracker() -> None:
    """Boxes alone: two meet, and the detector gives one box for both; that is no third target."""
    tracker, out = _boxes_only(), []
    for k in range(70):
        x = min(100.0 + 2 * k, 148.0)
        boxes = [_body(x, 80), _body(320 - x, 80)]
        if k >= 30:
            boxes = [(148.0, 78.0, 44.0, 44.0)]
        if k >= 50:
            boxes = [_body(148.0 - 2 * (k - 50), 80), _body(172.0 + 2 * (k - 50), 80)]
        out.append(tracker.step(_box_frame(k, boxes)))
    assert {t.id for o in out for t in o.targets} == {1, 2}
    together = [[g.members for g in o.group_tracks or [] if g.observed] for o in out]
    assert together[35:50] == [[[1, 2]]] * 15
    assert all(t.present for o in out[30:50] for t in o.targets)
    assert not any(together[54:])


def test_detections_outside_of_region_and_border_are_not_followed() -> None:
    """EVENTS 3.2: a target is detected only if its centroid lies in region of interest or border."""
    square = [(60.0, 20.0), (200.0, 20.0), (200.0, 200.0), (60.0, 200.0)]
    drawn = Regions(WIDTH, HEIGHT, [square], [square], source="file")
    tracker, followed = _boxes_only(), []
    for k in range(40):
        answer = tracker.step(_box_frame(k, [_body(150.0 + 2 * k, 80)], regions=drawn))
        here = [t for t in answer.targets if t.observed]
        assert len(here) <= (160.0 + 2 * k <= 200.0)
        followed += [k] * len(here)
    assert followed[-1] == 20, "until its centre lies on the border's edge"


def test_who_comes_out_of_the_door_is_not_who_went_in() -> None:
    """Red walks to a door and is gone; in the very next frame blue comes out of it: motion sees
    one who turns.
    """

    def play(k: int) -> list[Actor]:
        return (
            [(60.0 + 3 * k, 100.0, RED)]
            if k < 30
            else [(150.0 - 3 * (k - 30), 100.0, BLUE)]
        )

    out = _play(_pixels(), play, 55)
    [(told, notice)] = [
        (f, n) for f, n in _told(out, "track_recovered") if n.since_frame is not None
    ]
    assert notice.subjects == [1, 2]
    assert notice.since_frame is not None
    assert 30 <= notice.since_frame <= 32 <= told <= 35
    assert notice.evidence["appearance"] > notice.evidence["appearance_over"]
    assert {t.id for o in out[:told] for t in o.targets} == {1}
    assert {t.id for o in out[told:] for t in o.targets if t.present} == {2}
    config = configure({**events.SECTIONS, **hindsight.SECTIONS})
    times = [o.frame * FRAME_NS for o in out]
    final = list(
        hindsight.rewrite(
            lambda: iter(out), SceneInfo(WIDTH, HEIGHT, FRAME_NS, True, True), times, config
        )
    )
    seen = {
        i: [o.frame for o in final for t in o.targets if t.id == i and t.present]
        for i in (1, 2)
    }
    assert seen[1][-1] == notice.since_frame - 1
    assert seen[2] == list(range(notice.since_frame, 55))


@pytest.mark.parametrize("at", [31, 33, 35])
def test_restored_it_goes_on_the_same_while_it_wonders_who_that_is(at: int) -> None:
    frames = [
        _pixel_frame(k, [(60.0 + 3 * min(k, 30), 100.0, RED if k < 30 else BLUE)])
        for k in range(42)
    ]
    whole, first, second = _pixels(), _pixels(), _pixels()
    expected = [_encoded(whole.step(f)) for f in frames]
    for f in frames[: at + 1]:
        first.step(f)
    second.restore(_plain(first.state()))
    assert [_encoded(second.step(f)) for f in frames[at + 1 :]] == expected[at + 1 :]


def test_signatures_come_from_lone_targets_only() -> None:
    out = _play(_pixels(), _passing, 60)
    signed = [t for o in out for t in o.targets if t.signature]
    assert signed
    assert all(t.mode == "motion" for t in signed)
    assert len({len(t.signature) for t in signed}) == 1


def test_ellipses_turn_with_their_target() -> None:
    tracker = _pixels()
    for k in range(12):
        out = tracker.step(_pixel_frame(k, [(100.0 + k, 100.0, RED)]))
    ellipse = out.targets[0].ellipse
    assert ellipse is not None
    assert abs(ellipse.theta) == pytest.approx(np.pi / 2, abs=0.1)
    assert ellipse.h > 1.5 * ellipse.w


def _encoded(out: Targets) -> bytes:
    return msgspec.json.encode(out)


def _plain(state: Any) -> Any:
    """What a checkpoint keeps: arrays by their bytes, everything else as JSON."""
    if isinstance(state, np.ndarray):
        return np.frombuffer(state.tobytes(), state.dtype).reshape(state.shape).copy()
    if isinstance(state, dict):
        assert all(isinstance(k, str) for k in state)
        return {k: _plain(v) for k, v in state.items()}
    if isinstance(state, list):
        return [_plain(v) for v in state]
    assert state is None or isinstance(state, (bool, int, float, str)), type(state)
    return state


@pytest.mark.parametrize("at", [0, 3, 9, 25, 29, 36, 44])
def test_restored_it_goes_on_the_same_with_pixels(at: int) -> None:
    frames = [
        _pixel_frame(
            k, [*_passing(k), (250.0, 30.0 + 2 * k, RED)][: 3 if k % 20 < 15 else 2]
        )
        for k in range(60)
    ]
    whole, first, second = _pixels(), _pixels(), _pixels()
    expected = [_encoded(whole.step(f)) for f in frames]
    for f in frames[: at + 1]:
        first.step(f)
    second.restore(_plain(first.state()))
    assert [_encoded(second.step(f)) for f in frames[at + 1 :]] == expected[at + 1 :]


@pytest.mark.parametrize("at", [0, 5, 14, 22, 31])
def test_restored_it_goes_on_the_same_with_boxes(at: int) -> None:
    rng = np.random.Generator(np.random.PCG64(2))
    frames = []
    for k in range(50):
        boxes = [
            (20 + 4.0 * k + rng.normal(), 60.0 + rng.normal(), 20.0, 40.0),
            (260 - 4.0 * k, 70.0, 20.0, 40.0),
        ]
        frames.append(
            _box_frame(k, boxes[: 1 + (k % 9 > 2)], [0.9, 0.5][: 1 + (k % 9 > 2)])
        )
    whole, first, second = _boxes_only(), _boxes_only(), _boxes_only()
    expected = [_encoded(whole.step(f)) for f in frames]
    for f in frames[: at + 1]:
        first.step(f)
    second.restore(_plain(first.state()))
    assert [_encoded(second.step(f)) for f in frames[at + 1 :]] == expected[at + 1 :]


def test_two_trackers_do_not_share_ids() -> None:
    for _ in range(2):
        tracker = _boxes_only()
        out = [tracker.step(_box_frame(k, [_body(100, 80)])) for k in range(8)]
        assert [t.id for t in out[-1].targets] == [1]


def test_empty_frames_and_gaps_in_time() -> None:
    tracker = _pixels()
    assert tracker.step(_pixel_frame(0, [])).targets == []
    for k in range(1, 12):
        out = tracker.step(_pixel_frame(k, [(100.0, 100.0, RED)]))
    later = _pixel_frame(12, [(100.0, 100.0, RED)])
    later.time_ns += 60_000_000_000
    assert len(out.targets) == 1
    assert len(tracker.step(later).targets) <= 1


def test_who_moves_by_more_than_his_own_width_between_pictures_is_one_track() -> None:
    tracker = _pixels("events.hindsight=false")
    out = _play(tracker, lambda k: [(5.0 + 28.0 * k, 100.0, RED)], 10)
    assert [[t.id for t in answer.targets] for answer in out[4:]] == [[1]] * 6
    target = out[9].targets[0]
    assert target.observed
    assert target.box[0] == pytest.approx(5.0 + 28.0 * 9, abs=3.0)
    assert target.velocity[0] == pytest.approx(280.0, rel=0.1)


def test_what_appears_here_and_there_begins_no_track() -> None:
    places = [(100.0, 100.0), (128.0, 100.0), (112.0, 60.0), (136.0, 90.0), (104.0, 70.0)]
    tracker = _pixels("events.hindsight=false")
    out = _play(tracker, lambda k: [(*places[k % 5], RED)], 15)
    assert not _told(out, "track_confirmed")


def test_time_lapse_is_tracked_from_picture_to_picture() -> None:
    """A picture in ten seconds: as many tracks as animals, through a picture in which one is not
    seen.
    """
    scene = SceneInfo(WIDTH, HEIGHT, 100 * FRAME_NS, True, True)
    tracker = events.make(scene, _config("events.hindsight=false"))
    ids: dict[int, int] = {}
    for k in range(40):
        turn = 0.4 * k
        actors = [
            (60.0 + 120 * i + 30 * np.cos(turn + i), 60.0 + 60 * i + 30 * np.sin(turn), RED)
            for i in range(2)
        ]
        seen = actors[:1] if k == 20 else actors
        frame = _pixel_frame(k, seen)
        frame.time_ns *= 100
        answer = tracker.step(frame)
        for t in answer.targets:
            if t.observed:
                ids[t.id] = ids.get(t.id, 0) + 1
    assert sorted(ids) == [1, 2]
    assert min(ids.values()) >= 35
