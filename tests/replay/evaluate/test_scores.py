"""HOTA, CLEAR and Identity: against TrackEval's figures, by hand, and by what must hold for any
result.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from replay.evaluate import MotTable, evaluate, read_truth
from tests.examples import examples

Rows = list[tuple[int, int, float, float, float, float, float]]


def degraded(truth: MotTable, kind: int) -> MotTable:
    """A tracker made out of the truth by arithmetic alone.

    0: perfect; 1: misses, shaky boxes, new identities now and then; 2: swaps, merged identities
    and false alarms on top; 3: whole spans without answers on top.
    """
    rows: dict[tuple[int, int], Any] = {}
    for f0, i, (x, y, w, h) in zip(
        truth.frames.tolist(), truth.ids.tolist(), truth.boxes.tolist(), strict=True
    ):
        f = f0 + 1
        if kind >= 1 and (f * 7 + i * 13) % 20 == 3:
            continue
        j = i
        if kind >= 1 and (f // 60 + i) % 3 == 0:
            j = i + 100
        if kind >= 2 and f % 97 > 60 and i % 2:
            j = i + 1
        if kind >= 2 and i % 5 == 0:
            j += 1000
        s = ((f * 31 + i * 17) % 11 - 5) / 40 if kind >= 1 else 0.0
        new = [((f, j), (x + s * w, y - s * h / 2, w * (1 + s / 2), h * (1 - s / 3)))]
        if kind >= 2 and (f + i) % 9 == 0:
            new.append(((f, 5000 + i), (x + w, y, w, h)))
        if kind >= 3 and f % 50 > 40:
            new.pop()
        for key, box in new:
            rows.setdefault(key, box)
    return MotTable.from_rows(
        [(f - 1, i, *(round(v, 4) for v in box), 1.0) for (f, i), box in rows.items()]
    )


def crossing() -> MotTable:
    """Six people on straight paths that cross, 120 frames; 4 leaves and comes back."""
    rows: Rows = []
    for f in range(120):
        for i in range(1, 7):
            if i == 4 and 40 <= f < 60:
                continue
            x = 300 + (f - 60) * (3 if i % 2 else -3) + 11 * i
            rows.append(
                (f, i, float(x), 100.0 + 9 * i + (f * i) % 7, 30.0 + i, 80.0 + 2 * i, 1.0)
            )
    return MotTable.from_rows(rows)


# What TrackEval 1.3.0 gives for these (truth, result) pairs.
REFERENCES: dict[tuple[str, int], dict[str, float]] = {
    ("crossing", 1): {
        "HOTA": 58.06016044525633,
        "DetA": 71.52578568308905,
        "AssA": 47.1402879627086,
        "LocA": 82.73313470419103,
        "DetRe": 75.87218045112782,
        "DetPr": 79.86545310645033,
        "AssRe": 49.34691603664408,
        "AssPr": 79.93015207338993,
        "MOTA": 93.85714285714286,
        "MOTP": 78.43886059252654,
        "precision": 100.0,
        "recall": 95.0,
        "TP": 665,
        "FP": 0,
        "FN": 35,
        "switches": 8,
        "fragments": 36,
        "mostly_tracked": 6,
        "partly_tracked": 0,
        "mostly_lost": 0,
        "IDF1": 64.02930402930403,
        "IDP": 65.71428571428571,
        "IDR": 62.42857142857143,
        "IDTP": 437,
        "IDFP": 228,
        "IDFN": 263,
    },
    ("crossing", 2): {
        "HOTA": 45.30294567075339,
        "DetA": 62.63466703508814,
        "AssA": 32.7880639079815,
        "LocA": 82.5306322153566,
        "DetRe": 72.57894736842104,
        "DetPr": 71.96212911883106,
        "AssRe": 36.67859505451425,
        "AssPr": 68.89343196725622,
        "MOTA": 78.0,
        "MOTP": 78.48237609537416,
        "precision": 89.66005665722379,
        "recall": 90.42857142857143,
        "TP": 633,
        "FP": 73,
        "FN": 67,
        "switches": 14,
        "fragments": 36,
        "mostly_tracked": 5,
        "partly_tracked": 1,
        "mostly_lost": 0,
        "IDF1": 53.200568990042676,
        "IDP": 52.97450424929179,
        "IDR": 53.42857142857142,
        "IDTP": 374,
        "IDFP": 332,
        "IDFN": 326,
    },
    ("crossing", 3): {
        "HOTA": 40.30301291458335,
        "DetA": 55.55741283050013,
        "AssA": 29.250694155505492,
        "LocA": 82.54257288336542,
        "DetRe": 63.353383458646604,
        "DetPr": 71.99248120300751,
        "AssRe": 32.40673614290473,
        "AssPr": 69.22325298744546,
        "MOTA": 68.0,
        "MOTP": 78.50505594339413,
        "precision": 89.77272727272727,
        "recall": 79.0,
        "TP": 553,
        "FP": 63,
        "FN": 147,
        "switches": 14,
        "fragments": 45,
        "mostly_tracked": 5,
        "partly_tracked": 1,
        "mostly_lost": 0,
        "IDF1": 50.15197568389058,
        "IDP": 53.57142857142857,
        "IDR": 47.14285714285714,
        "IDTP": 330,
        "IDFP": 286,
        "IDFN": 370,
    },
    ("pets09-s2l1", 1): {
        "HOTA": 54.398680531708735,
        "DetA": 71.51279968333746,
        "AssA": 41.400505470353934,
        "LocA": 82.72983036436337,
        "DetRe": 75.84074126334603,
        "DetPr": 79.89248244168907,
        "AssRe": 43.1127242549948,
        "AssPr": 79.90007340432473,
        "MOTA": 93.78909740840035,
        "MOTP": 78.45827813212284,
        "precision": 100.0,
        "recall": 94.92850759606792,
        "TP": 4249,
        "FP": 0,
        "FN": 227,
        "switches": 51,
        "fragments": 227,
        "mostly_tracked": 19,
        "partly_tracked": 0,
        "mostly_lost": 0,
        "IDF1": 65.21489971346705,
        "IDP": 66.95693104259826,
        "IDR": 63.56121537086684,
        "IDTP": 2845,
        "IDFP": 1404,
        "IDFN": 1631,
    },
    ("pets09-s2l1", 2): {
        "HOTA": 40.253709769359666,
        "DetA": 61.25392800617849,
        "AssA": 26.476655099744416,
        "LocA": 82.66623057731306,
        "DetRe": 71.14199708386246,
        "DetPr": 71.6059318523428,
        "AssRe": 29.85170229687194,
        "AssPr": 68.63916409509085,
        "MOTA": 76.18409294012511,
        "MOTP": 78.40513286589432,
        "precision": 89.63346076006296,
        "recall": 89.0527256478999,
        "TP": 3986,
        "FP": 461,
        "FN": 490,
        "switches": 115,
        "fragments": 243,
        "mostly_tracked": 15,
        "partly_tracked": 4,
        "mostly_lost": 0,
        "IDF1": 43.21416563935896,
        "IDP": 43.35507083427029,
        "IDR": 43.07417336907953,
        "IDTP": 1928,
        "IDFP": 2519,
        "IDFN": 2548,
    },
    ("pets09-s2l1", 3): {
        "HOTA": 34.48407520214075,
        "DetA": 52.53544291732886,
        "AssA": 22.65155658601307,
        "LocA": 82.6490959781071,
        "DetRe": 59.62795729269554,
        "DetPr": 71.76518871796323,
        "AssRe": 25.35487231363327,
        "AssPr": 68.29897722982005,
        "MOTA": 63.806970509383376,
        "MOTP": 78.36215245562018,
        "precision": 89.88975531056735,
        "recall": 74.68722073279714,
        "TP": 3343,
        "FP": 376,
        "FN": 1133,
        "switches": 111,
        "fragments": 323,
        "mostly_tracked": 7,
        "partly_tracked": 12,
        "mostly_lost": 0,
        "IDF1": 39.267846247712015,
        "IDP": 43.26431836515192,
        "IDR": 35.94727435210009,
        "IDTP": 1609,
        "IDFP": 2110,
        "IDFN": 2867,
    },
    ("tud-campus", 3): {
        "HOTA": 54.85734759393861,
        "DetA": 58.47259530613363,
        "AssA": 51.46752965036657,
        "LocA": 82.73477885694078,
        "DetRe": 66.82304647412404,
        "DetPr": 72.47575131181428,
        "AssRe": 54.95376847863987,
        "AssPr": 75.68520019099503,
        "MOTA": 72.70194986072424,
        "MOTP": 78.48367875344053,
        "precision": 90.6344410876133,
        "recall": 83.56545961002786,
        "TP": 300,
        "FP": 31,
        "FN": 59,
        "switches": 8,
        "fragments": 22,
        "mostly_tracked": 7,
        "partly_tracked": 1,
        "mostly_lost": 0,
        "IDF1": 76.23188405797102,
        "IDP": 79.45619335347432,
        "IDR": 73.25905292479109,
        "IDTP": 263,
        "IDFP": 68,
        "IDFN": 96,
    },
}


def truth_named(name: str, data: Path | None = None) -> MotTable:
    return (
        crossing() if name == "crossing" else read_truth(Path(str(data)) / name / "gt.txt")
    )


def check_reference(name: str, kind: int, data: Path | None = None) -> None:
    truth = truth_named(name, data)
    plain = evaluate(truth, degraded(truth, kind)).as_plain()
    for key, value in REFERENCES[name, kind].items():
        assert plain[key] == pytest.approx(value, rel=1e-10, abs=1e-9), key


@pytest.mark.parametrize("kind", [1, 2, 3])
def test_figures_are_those_of_trackeval(kind: int) -> None:
    check_reference("crossing", kind)


@pytest.mark.real
@pytest.mark.parametrize(
    ("name", "kind"),
    [("pets09-s2l1", 1), ("pets09-s2l1", 2), ("pets09-s2l1", 3), ("tud-campus", 3)],
)
def test_figures_on_real_truth_are_those_of_trackeval(
    name: str, kind: int, real_data: Path
) -> None:
    check_reference(name, kind, real_data)


def line(identity: int, frames: range, y: float = 0.0, h: float = 10.0) -> Rows:
    """One box of 10 x ``h`` that stands still."""
    return [(f, identity, 0.0, y, 10.0, h, 1.0) for f in frames]


def table(*rows: Rows) -> MotTable:
    return MotTable.from_rows([r for part in rows for r in part])


def test_the_truth_itself_is_perfect() -> None:
    truth = table(line(1, range(10)), line(2, range(3, 8), y=50.0))
    s = evaluate(truth, truth)
    assert (s.hota.hota, s.hota.det_a, s.hota.ass_a, s.hota.loc_a) == (
        100.0,
        100.0,
        100.0,
        100.0,
    )
    assert (s.clear.mota, s.clear.motp, s.identity.idf1) == (100.0, 100.0, 100.0)
    assert (
        s.clear.switches,
        s.clear.fragments,
        s.clear.mostly_tracked,
        s.clear.mostly_lost,
    ) == (0, 0, 2, 0)
    assert s.trajectories.mostly_tracked_single_id == 2
    assert s.trajectories.matched.share == 100.0
    assert s.trajectories.matched.pixels == (0.0, 0.0, 0.0, 0.0)


def test_an_empty_result_misses_everything() -> None:
    truth = table(line(1, range(10)))
    s = evaluate(truth, table())
    assert (s.hota.hota, s.clear.mota, s.identity.idf1) == (0.0, 0.0, 0.0)
    assert (s.clear.false_negatives, s.identity.idfn, s.clear.mostly_lost) == (10, 10, 1)
    assert (s.trajectories.missed, s.trajectories.mostly_lost) == (1, 0)


def test_a_result_without_truth_is_false() -> None:
    s = evaluate(table(), table(line(1, range(10))))
    assert (s.clear.false_positives, s.identity.idfp, s.clear.mota) == (10, 10, 0.0)


def test_nothing_at_all() -> None:
    s = evaluate(table(), table())
    assert (s.hota.hota, s.clear.mota, s.identity.idf1, s.true_ids) == (0.0, 0.0, 0.0, 0)


def test_swapped_identities_by_hand() -> None:
    """Two people, ten frames, identities swapped half way."""
    truth = table(line(1, range(10)), line(2, range(10), y=100.0))
    result = table(
        line(7, range(5)), line(7, range(5, 10), y=100.0), line(8, range(5), y=100.0), line(8, range(5, 10))
    )  # fmt: skip
    s = evaluate(truth, result)
    assert s.clear.switches == 2
    assert s.clear.mota == pytest.approx(100 * (20 - 2) / 20)
    assert s.identity.idf1 == pytest.approx(50.0)
    # Each match belongs to a pair that agrees in 5 frames, out of 10 + 10 - 5 of either.
    assert s.hota.ass_a == pytest.approx(100 * 5 / 15)
    assert s.hota.hota == pytest.approx(100 * np.sqrt(1 / 3))
    t = s.trajectories
    assert (
        t.swaps_per_trajectory,
        t.ids_per_trajectory,
        t.over_segmented,
        t.under_segmented,
    ) == (1.0, 2.0, 2, 0)


def test_overlap_decides_from_which_alpha_on_a_box_is_found() -> None:
    """Boxes of 10 x 10 and 10 x 6 overlap by 0.6: found at 0.05 to 0.6, at 12 of 19 alphas."""
    truth, result = table(line(1, range(4))), table(line(1, range(4), h=6.0))
    s = evaluate(truth, result)
    assert s.clear.motp == pytest.approx(60.0)
    assert s.hota.hota == pytest.approx(100 * 12 / 19)
    assert [a for a, v in zip(s.hota.alphas, s.hota.hota_alpha, strict=True) if v > 0][
        -1
    ] == 0.6
    assert evaluate(truth, result, iou=0.61).clear.true_positives == 0
    assert evaluate(truth, result, iou=0.6).clear.true_positives == 4


def test_a_match_is_kept_although_another_overlaps_more() -> None:
    """CLEAR keeps who was matched in the frame before, as long as the overlap does."""
    truth = table(line(1, range(3)))
    result = table(
        line(5, range(1)), line(5, range(1, 3), h=7.0), line(6, range(1, 3), h=9.0)
    )
    s = evaluate(truth, result)
    assert (s.clear.switches, s.clear.false_positives, s.clear.true_positives) == (0, 2, 3)


def test_a_gap_is_a_fragment_and_no_switch() -> None:
    truth = table(line(1, range(10)), line(2, range(10), y=100.0))
    result = table(line(4, range(3)), line(4, range(6, 10)), line(5, range(10), y=100.0))
    s = evaluate(truth, result)
    assert (s.clear.fragments, s.clear.switches, s.clear.false_negatives) == (1, 0, 3)
    assert (s.clear.mostly_tracked, s.clear.partly_tracked) == (1, 1)


boxes = st.tuples(
    st.integers(0, 12),
    st.integers(0, 4),
    st.integers(0, 30),
    st.integers(0, 30),
    st.integers(1, 30),
    st.integers(1, 30),
)
tracks_of = st.lists(boxes, max_size=25, unique_by=lambda r: r[:2])


def made(rows: list[tuple[int, ...]]) -> MotTable:
    return MotTable.from_rows(
        [(f, i, float(x), float(y), float(w), float(h), 1.0) for f, i, x, y, w, h in rows]
    )


@settings(max_examples=examples(60), deadline=None)
@given(tracks_of, tracks_of, st.permutations(range(5)))
def test_names_of_identities_mean_nothing(
    a: list[Any], b: list[Any], names: list[int]
) -> None:
    truth, result = made(a), made(b)
    renamed = MotTable(
        result.frames,
        np.array(names, np.int64)[result.ids] + 17,
        result.boxes,
        result.confidences,
    )
    one, other = evaluate(truth, result), evaluate(truth, renamed)
    assert one.clear == other.clear
    assert one.identity.idtp == other.identity.idtp
    # Sums run in another order.
    assert one.hota.ass_a_alpha == pytest.approx(other.hota.ass_a_alpha)
    assert one.hota.det_a_alpha == other.hota.det_a_alpha


@settings(max_examples=examples(60), deadline=None)
@given(tracks_of, tracks_of)
def test_bounds_and_counts_hold(a: list[Any], b: list[Any]) -> None:
    truth, result = made(a), made(b)
    s = evaluate(truth, result)
    c, i = s.clear, s.identity
    assert c.true_positives + c.false_negatives == i.idtp + i.idfn == len(truth)
    assert c.true_positives + c.false_positives == i.idtp + i.idfp == len(result)
    assert c.mostly_tracked + c.partly_tracked + c.mostly_lost == s.true_ids
    assert i.idtp <= c.true_positives
    assert all(
        0.0 <= v <= 100.0 + 1e-9
        for v in (s.hota.hota, s.hota.det_a, s.hota.ass_a, s.hota.loc_a, i.idf1, c.motp)
    )
    # A stricter alpha never finds more.
    assert all(
        x >= y - 1e-9
        for x, y in zip(s.hota.det_a_alpha, s.hota.det_a_alpha[1:], strict=False)
    )


@settings(max_examples=examples(30), deadline=None)
@given(tracks_of)
def test_moving_and_scaling_both_changes_nothing(a: list[Any]) -> None:
    truth = made(a)
    result = degraded(truth, 2)
    one, other = (
        evaluate(truth, result),
        evaluate(truth.scaled(2.0, 4.0), result.scaled(2.0, 4.0)),
    )
    assert one.clear == other.clear
    assert one.hota == other.hota
