"""Clips of answers, and bystanders of whom nothing is left, against the generator's label images."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from fixtures.scenes import GeneratedScene
from fixtures.scripts import Script, walk
from recorders.annotated.reader import AnnotatedLog
from recorders.pictures import Image
from recorders.scene import SceneLog
from replay.cli import main
from replay.export.shots import Camera, Shot, ShotFile
from replay.hiding import COVER, Bystanders

Filmed = Callable[..., tuple[GeneratedScene, Path]]
CROSSING = Script(
    "Two meet while three pass, one of them right in front",
    9.0,
    (
        walk("0 -.1 .78; 3 .40 .78; 6 .40 .78; 9 .0 .78", "red"),
        walk("0 1.1 .76; 3 .52 .76; 6 .52 .76; 9 1.0 .76", "blue"),
        walk("1 -.1 .92; 8 1.1 .92", "yellow"),
        walk("0 .9 .6; 9 .1 .6", "white"),
        walk("2 1.1 .82; 8 -.1 .82", "green"),
    ),
    size=(320, 240),
    fps=10,
)
START_NS = 1_700_000_000_000_000_000


def pictures(path: Path) -> Iterator[Image]:
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            yield np.asarray(frame.to_ndarray(format="bgr24"), np.uint8)


def test_of_bystanders_no_pixel_is_left(filmed: Filmed) -> None:
    scene, path = filmed("crossing", CROSSING)
    shown, others = (1, 2), (3, 4, 5)
    checked = kept = 0
    with AnnotatedLog(path) as log, SceneLog(path) as recorded:
        bystanders = Bystanders(log)
        for frame in recorded.frames():
            assert frame.image is not None
            hidden = bystanders.hidden(frame.image, frame, shown)
            labels = scene.labels(frame.index)
            theirs = np.isin(labels, others)
            assert (hidden[theirs] == COVER).all(), frame.index
            checked += int(theirs.sum())
            own = np.isin(labels, shown)
            kept += int((hidden[own] == frame.image[own]).all(axis=1).sum())
            assert not np.shares_memory(hidden, frame.image)
    assert checked > 20_000
    assert kept > 20_000, "the subjects are to be seen"


def test_a_track_that_was_missing_is_hidden_all_the_same(filmed: Filmed) -> None:
    """Between two sights of it, and a second around its life; the mask is not needed for that."""
    _, path = filmed("crossing", CROSSING)
    with AnnotatedLog(path) as log:
        bystanders = Bystanders(log)
        times, boxes = bystanders._times[3], bystanders._boxes[3]
        middle = times[30]
        bystanders._times[3] = times[:28] + times[33:]
        bystanders._boxes[3] = boxes[:28] + boxes[33:]
        (found,) = (b for b in bystanders.boxes(middle, (1, 2, 4, 5)))
        x, y, w, h = boxes[30]
        assert found[0] <= x
        assert found[1] <= y + 2
        assert found[0] + found[2] >= x + w
        assert found[1] + found[3] >= y + h - 2
        before = times[0] - 500_000_000
        assert bystanders.boxes(before, (1, 2, 4, 5)) == [boxes[0]]
        assert bystanders.boxes(before - 600_000_000, (1, 2, 4, 5)) == []


def test_many_shots_are_what_each_is_alone(filmed: Filmed, tmp_path: Path) -> None:
    scene, path = filmed("crossing", CROSSING)
    spans = [
        (0, 30),
        (10, 50),
        (20, 90),
        (60, 90),
        *((k, k + 20) for k in range(0, 60, 10)),
    ]
    ns = scene.frame_ns
    with AnnotatedLog(path) as log:

        def shots(folder: Path, chosen: list[int]) -> list[Shot]:
            folder.mkdir()
            return [
                Shot(folder / f"{k}-{m}.mp4", a * ns, b * ns, frozenset({1, 2}), m)
                for k in chosen for m in (True, False) for a, b in [spans[k]]
            ]  # fmt: skip

        together, alone = tmp_path / "together", tmp_path / "alone"
        stills = [ShotFile(together / "still", 40 * ns, frozenset({1}), True),
                  ShotFile(together / "bare", 40 * ns, frozenset({1}), False)]  # fmt: skip
        placed = Camera(log).write(shots(together, list(range(len(spans)))), stills)
        Camera(log).write(shots(alone, [2]))
    for name in ("2-True.mp4", "2-False.mp4"):
        assert (together / name).read_bytes() == (alone / name).read_bytes()
    counts = [sum(1 for _ in pictures(together / f"{k}-False.mp4")) for k in range(4)]
    assert counts == [30, 40, 70, 30]
    assert placed[together / "still"].suffix == ".jpg"
    assert placed[together / "bare"].suffix == ".png"
    plain = next(pictures(together / "3-False.mp4"))
    assert np.abs(plain.astype(int) - scene.image(60)).mean() < 6
    marked = next(pictures(together / "3-True.mp4"))
    assert marked.shape[1] == 640


def test_an_answers_clips(
    filmed: Filmed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, path = filmed("crossing", CROSSING, START_NS)
    out = tmp_path / "clips"
    words = ["query", str(path), "--ask", "together", "1", "2", "--json"]
    assert main([*words, "--clips", str(out), "--blur-others"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["start_clock"].startswith("2023-11-14T22:13:")
    (told,) = csv.DictReader((out / "clips.csv").read_text().splitlines())
    assert told["subjects"] == "1 2"
    assert told["start_clock"] == row["start_clock"]
    assert len(told["log_sha256"]) == 64
    first = max(0, round((row["start_t"] - 2) * scene.fps))
    last = min(scene.frame_count - 1, round((row["end_t"] + 2) * scene.fps))
    found = list(pictures(out / told["plain"]))
    assert len(found) == last - first + 1
    for image, index in zip(found, range(first, last + 1), strict=True):
        labels = scene.labels(index)
        theirs = np.isin(labels, (3, 4, 5))
        # An encoder mixes what borders: away from the edge all is one colour.
        assert (
            np.abs(image[theirs].astype(int) - COVER[0]).mean() < 4
            if theirs.any()
            else True
        )
    assert len(list(pictures(out / told["clip"]))) == len(found)
    assert main([*words, "--clips", str(out)]) == 1
    assert main([*words, "--clips", str(out), "--force"]) == 0
    assert main([*words, "--blur-others"]) == 2
    capsys.readouterr()
    bare = ["query", str(path), "SELECT count(*) FROM tracks"]
    assert main([*bare, "--clips", str(tmp_path / "no")]) == 2
    assert "do not say when" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def test_counts_have_a_clip_of_each_that_was_counted(
    filmed: Filmed, tmp_path: Path
) -> None:
    _, path = filmed("crossing", CROSSING)
    out = tmp_path / "counted"
    line = ["--line", "gate=160,150,160,240"]
    assert (
        main(["query", str(path), *line, "--ask", "count", "gate", "--clips", str(out)])
        == 0
    )
    rows = list(csv.DictReader((out / "clips.csv").read_text().splitlines()))
    assert {r["subjects"] for r in rows} == {"3", "5"}


@pytest.mark.parametrize("hide", [False, True])
def test_evidence_is_the_same_twice_and_verifies(
    filmed: Filmed, tmp_path: Path, hide: bool
) -> None:
    _, path = filmed("crossing", CROSSING, START_NS)
    line = ["--line", "gate=160,150,160,240", "--timezone", "Europe/Vienna"]
    folders = []
    for name in ("one", "two"):
        out = tmp_path / name
        events = ["--events", *lines_of(path, line)]
        blur = ["--blur-others"] if hide else []
        assert main(["evidence", str(path), *events, *line, *blur, "-o", str(out)]) == 0
        assert main(["verify", "--manifest", str(out / "manifest.json")]) == 0
        files = sorted(f for f in out.rglob("*") if f.is_file())
        folders.append({f.relative_to(out).as_posix(): f.read_bytes() for f in files})
    assert folders[0] == folders[1]
    names = set(folders[0])
    assert {"evidence.pdf", "index.html"} < names
    assert ("log_0001.mcap" in names) is not hide
    page = folders[0]["index.html"].decode()
    assert "2023-11-14T23:13:" in page
    assert ("is hidden in clips" in page) is hide
    facts: dict[str, Any] = json.loads(folders[0]["facts.json"])
    assert facts["others_hidden"] is hide


def lines_of(path: Path, line: list[str]) -> list[str]:
    """References of an encounter and of a crossing."""
    from reasoning.questions import Case
    from reasoning.questions.drawn import drawn

    with Case([path], drawn=drawn(lines=[line[1]])) as case:
        (a,) = case.rows("SELECT min(start_frame) FROM encounters WHERE a = 1 AND b = 2")[0]
        ((track, frame),) = case.rows(
            "SELECT track, frame FROM crossings ORDER BY frame LIMIT 1"
        )
    return [f"encounter:1-2@{a}", f"line:{track}@{frame}:gate"]
