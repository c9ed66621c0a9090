"""Regions from a JSON file."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorders.errors import SourceError
from recorders.messages import Regions
from recorders.sources import read_regions

SQUARE = [[10, 10], [50, 10], [50, 50], [10, 50]]
AROUND = [[5, 5], [60, 5], [60, 60], [5, 60]]
DOOR = [[0, 0], [9, 0], [9, 20]]


def regions(folder: Path, value: object) -> Regions:
    path = folder / "regions.json"
    path.write_text(value if isinstance(value, str) else json.dumps(value))
    return read_regions(path, 100, 80)


def test_roi_border_and_zones(tmp_path: Path) -> None:
    found = regions(
        tmp_path, {"roi": SQUARE, "border": AROUND, "zones": {"window": DOOR, "door": DOOR}}
    )
    assert (found.width, found.height, found.source) == (100, 80, "file")
    assert found.roi == [[(10, 10), (50, 10), (50, 50), (10, 50)]]
    assert found.border == [[(5, 5), (60, 5), (60, 60), (5, 60)]]
    assert [z.name for z in found.zones] == ["door", "window"], "sorted by name"


def test_several_polygons_and_no_border(tmp_path: Path) -> None:
    other = [[60, 10], [70, 10], [70, 20], [60, 10]]
    found = regions(tmp_path, {"roi": [SQUARE, other]})
    assert found.border == found.roi
    assert len(found.roi) == 2
    assert len(found.roi[1]) == 3, "a vertex that closes the polygon is dropped"


def test_a_border_may_share_edges_with_the_roi_and_be_concave(tmp_path: Path) -> None:
    assert regions(tmp_path, {"roi": SQUARE, "border": SQUARE}).border
    notched = [[5, 5], [60, 5], [60, 60], [30, 52], [5, 60]]
    assert regions(tmp_path, {"roi": SQUARE, "border": notched}).border
    with pytest.raises(SourceError, match="the border does not enclose the roi"):
        regions(
            tmp_path,
            {"roi": SQUARE, "border": [[5, 5], [60, 5], [60, 60], [30, 30], [5, 60]]},
        )


BOW_TIE = [[10, 10], [50, 50], [50, 10], [10, 50]]


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({"roi": SQUARE[:2]}, "roi has 2 vertices, at least 3 are wanted"),
        ({"roi": BOW_TIE}, "roi crosses itself"),
        ({"roi": [SQUARE, BOW_TIE]}, "roi 2 crosses itself"),
        ({"roi": [[10, 10], [20, 20], [30, 30]]}, "roi has no area"),
        ({"roi": [[10, 10], [50, 10], [20, 10], [20, 40]]}, "roi crosses itself"),
        (
            {"roi": SQUARE, "border": [[20, 20], [40, 20], [30, 40]]},
            "the border does not enclose the roi",
        ),
        (
            {"roi": [[200, 10], [250, 10], [250, 50]]},
            "roi lies wholly beyond the picture of 100x80",
        ),
        ({"roi": [["a", 10], [50, 10], [50, 50]]}, "a is not a coordinate"),
        ({"roi": [[1, 2, 3], [50, 10], [50, 50]]}, r"a vertex must be \[x, y\]"),
        ({"roi": [[True, 2], [50, 10], [50, 50]]}, "not a coordinate"),
        ({"roi": [[10**30, 2], [50, 10], [50, 50]]}, "not a coordinate"),
        ('{"roi": [[NaN, 1], [5, 5], [1, 5]]}', "nan is not a coordinate"),
        ({"roi": 5}, r"roi must be a polygon \[\[x, y\], ...\] or a list of polygons"),
        ({"roi": []}, "roi must be a polygon"),
        ({"roi": [[], []]}, "a vertex must be"),
        ({}, 'wanted an object with "roi", "border" or "zones"'),
        ([], 'wanted an object with "roi", "border" or "zones"'),
        ({"roi": SQUARE, "rio": 1}, "unknown field 'rio'"),
        ({"roi": SQUARE, "zones": [DOOR]}, "zones must be an object"),
        ({"roi": SQUARE, "zones": {" ": DOOR}}, "a zone without a name"),
        ({"roi": SQUARE, "zones": {"door": DOOR[:2]}}, "zone 'door' has 2 vertices"),
        ('{"roi": [[1,1]], "roi": [[1,1]]}', "'roi' is there twice"),
        ("{", "not JSON"),
        ("[" * 100_000, "not JSON"),
        (
            {"roi": [[math.cos(k / 100), k] for k in range(600)]},
            "600 vertices, at most 500",
        ),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, value: object, message: str) -> None:
    with pytest.raises(SourceError, match=message) as e:
        regions(tmp_path, value)
    assert "regions.json" in str(e.value)


@given(
    st.integers(3, 12),
    st.floats(5, 30),
    st.floats(0.1, 0.9),
    st.floats(0, 6),
)
def test_a_polygon_encloses_its_own_shrunk_copy_and_not_the_other_way(
    tmp_path_factory: pytest.TempPathFactory,
    n: int,
    radius: float,
    share: float,
    turn: float,
) -> None:
    def ring(r: float) -> list[list[float]]:
        angles = [turn + 2 * math.pi * k / n for k in range(n)]
        return [[40 + r * math.cos(a), 40 + r * math.sin(a)] for a in angles]

    folder = tmp_path_factory.mktemp("regions")
    assert regions(folder, {"roi": ring(radius * share), "border": ring(radius)}).border
    with pytest.raises(SourceError, match="does not enclose"):
        regions(folder, {"roi": ring(radius), "border": ring(radius * share)})


def test_border_polygons_together_may_enclose_the_region_of_interest(
    tmp_path: Path,
) -> None:
    halves = [
        [[0, 0], [60, 0], [60, 100], [0, 100]],
        [[50, 0], [100, 0], [100, 100], [50, 100]],
    ]
    roi = [[20, 20], [80, 20], [80, 80], [20, 80]]
    path = tmp_path / "regions.json"
    path.write_text(json.dumps({"roi": roi, "border": halves}))
    assert len(read_regions(path, 100, 100).border) == 2
    halves[1] = [[65, 0], [100, 0], [100, 100], [65, 100]]
    path.write_text(json.dumps({"roi": roi, "border": halves}))
    with pytest.raises(SourceError, match="does not enclose"):
        read_regions(path, 100, 100)


def test_zones_alone_keep_what_was_recorded(tmp_path: Path) -> None:
    path = tmp_path / "regions.json"
    path.write_text(json.dumps({"zones": {"door": SQUARE}}))
    whole = read_regions(path, 100, 80)
    assert whole.roi == whole.border == [[(0, 0), (100, 0), (100, 80), (0, 80)]]
    assert [zone.name for zone in whole.zones] == ["door"]
    path.write_text(json.dumps({"roi": SQUARE}))
    recorded = read_regions(path, 100, 80)
    path.write_text(json.dumps({"zones": {"door": SQUARE}}))
    assert read_regions(path, 100, 80, recorded).roi == recorded.roi
