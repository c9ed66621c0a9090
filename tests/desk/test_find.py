"""Colours of who wears what, and finding by them, against the generator's outfits."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fixtures.scenes import GeneratedScene
from fixtures.scripts import Script, walk
from reasoning.questions import Case
from reasoning.questions.finding import Wanted, find, likeness_to
from reasoning.questions.index import build_index
from recorders.errors import UsageError
from recorders.looks import COLOURS, SHADES, body_shades, count_shades, shades_of
from replay.cli import main

Filmed = Callable[..., tuple[GeneratedScene, Path]]
WEAR = {
    "red": ("red", None), "blue": ("blue", None), "yellow": ("yellow", None), "purple": ("purple", None),
    "orange": ("orange", None), "black": ("black", None), "green": ("green", None), "white": ("white", "black"),
}  # fmt: skip
PARADE = Script(
    "Eight people, each in a lane of its own",
    6.0,
    tuple(
        walk(f"0 {0.1 + 0.1 * k:.2f} .9; 6 {0.14 + 0.1 * k:.2f} .9", outfit)
        for k, outfit in enumerate(WEAR)
    ),
    size=(640, 360),
    fps=5,
)


@pytest.mark.parametrize(
    ("bgr", "name"),
    [((20, 20, 20), "black"), ((128, 128, 128), "grey"), ((250, 250, 250), "white"), ((30, 30, 200), "red"),
     ((200, 60, 30), "blue"), ((40, 220, 230), "yellow"), ((40, 160, 40), "green"), ((30, 60, 110), "brown"),
     ((40, 130, 240), "orange"), ((150, 40, 130), "purple"), ((190, 150, 240), "pink"), ((70, 45, 35), "blue"),
     ((160, 190, 215), "beige")],
)  # fmt: skip
def test_colours_have_the_names_that_people_give_them(
    bgr: tuple[int, int, int], name: str
) -> None:
    counts = count_shades(np.array([bgr], np.uint8))
    assert SHADES[int(counts.argmax())][1] == name


def test_every_shade_can_be_asked_for() -> None:
    assert sorted({k for c in COLOURS for k in shades_of([c])}) == list(range(len(SHADES)))
    assert shades_of(["mauve"]) == []


def test_others_pixels_do_not_count() -> None:
    image = np.full((100, 60, 3), (30, 30, 200), np.uint8)
    image[:, 30:] = (200, 60, 30)
    whole = body_shades(image, None, (0, 0, 60, 100))
    alone = body_shades(image, None, (0, 0, 60, 100), [(30, 0, 30, 100)])
    assert whole is not None
    assert alone is not None
    blue = shades_of(["blue"])
    assert whole[0][blue].sum() > 0
    assert alone[0][blue].sum() == alone[1][blue].sum() == 0
    assert body_shades(image, None, (0, 0, 60, 100), [(0, 0, 60, 100)]) is None


def test_each_wears_what_the_script_says(filmed: Filmed, tmp_path: Path) -> None:
    scene, path = filmed("parade", PARADE)
    with Case([path], looks=True) as case:
        rows = case.rows("SELECT track, upper_colour, height FROM targets ORDER BY track")
        assert [r[1] for r in rows] == [upper for upper, _ in WEAR.values()]
        for track, _, height in rows:
            boxes = [a.box[3] for f in scene.truth.frames if (a := f.actor(track))]
            assert height == pytest.approx(np.median(boxes), abs=2)
        for track, (upper, _) in enumerate(WEAR.values(), 1):
            (first, *_) = find(case, Wanted(upper=(upper,))).rows
            assert first[1] == track
        like = likeness_to(case, "3", None)
        assert all(row[1] != 3 for row in find(case, like).rows)
    with Case([path]) as case:
        assert case.rows("SELECT DISTINCT upper_colour FROM targets") == [(None,)]
    index = tmp_path / "case.duckdb"
    build_index([path], index)
    with Case([path], looks=True) as one, Case([index]) as other:
        assert one.rows("SELECT * FROM looks ORDER BY ALL") == other.rows(
            "SELECT * FROM looks ORDER BY ALL"
        )


def test_the_same_person_is_found_in_another_recording(
    filmed: Filmed, tmp_path: Path
) -> None:
    _, path = filmed("parade", PARADE)
    again = Script(
        "Three of them, elsewhere", 4.0,
        (walk("0 .2 .8; 4 .3 .8", "purple"), walk("0 .5 .8; 4 .6 .8", "yellow"), walk("0 .8 .8; 4 .9 .8", "white")),
        size=(640, 360), fps=5,
    )  # fmt: skip
    _, other = filmed("again", again)
    with Case([path, other], looks=True) as case:
        for track, wanted in ((1, 4), (2, 3), (3, 8)):
            like = likeness_to(case, f"again:{track}", None)
            best = next(row for row in find(case, like).rows if row[0] == "parade")
            assert best[1] == wanted
        with pytest.raises(UsageError, match="in several recordings"):
            likeness_to(case, "1", None)


def test_the_command_shows_them(
    filmed: Filmed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, path = filmed("parade", PARADE)
    out = tmp_path / "found"
    assert (
        main(["find", str(path), "--colour", "red", "--upper", "--json", "-o", str(out)])
        == 0
    )
    rows = json.loads(capsys.readouterr().out)
    assert rows[0]["track"] == 1
    thumbnail = next(out.glob("001_*.jpg"))
    page = (out / "index.html").read_text(encoding="utf-8")
    assert thumbnail.name in page
    assert main(["find", str(path), "--like", str(thumbnail), "--json", "--most", "1"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["track"] == 1
    assert main(["find", str(path), "--colour", "mauve"]) == 2
    assert "there are: black" in capsys.readouterr().err
    assert main(["find", str(path)]) == 2
    assert main(["find", str(path), "--upper"]) == 2
    assert main(["find", str(path), "--like", "99"]) == 2


def test_a_network_ranks_who_looks_alike(
    filmed: Filmed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its features are the mean colours of a picture, so who wears the same comes first."""
    import onnx
    from onnx import TensorProto, helper

    _, path = filmed("parade", PARADE)
    value = helper.make_tensor_value_info
    graph = helper.make_graph(
        [helper.make_node("GlobalAveragePool", ["in"], ["features"])],
        "means",
        [value("in", TensorProto.FLOAT, [1, 3, 256, 128])],
        [value("features", TensorProto.FLOAT, [1, 3, 1, 1])],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)])
    made.ir_version = 8
    model = tmp_path / "means.onnx"
    onnx.save(made, str(model))
    words = ["find", str(path), "--like", "1", "--least", "0", "--json"]
    assert main([*words, "--model", str(model)]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert len(rows) == len(WEAR) - 1
    likenesses = [row["likeness"] for row in rows]
    assert likenesses == sorted(likenesses, reverse=True)
    assert all(-1 <= value <= 1 for value in likenesses)
    assert main([*words, "--model", str(tmp_path / "none.onnx")]) == 1
