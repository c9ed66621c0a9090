"""No command writes over what it reads, not even by --force."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

import pytest

from replay.cli import main

# A call of every command with an output, where the output is one of the inputs; what is read, and
# by which option.
CALLS: list[tuple[str, str]] = [
    ("record det.txt --size 384x288 -o det.txt", "-o det.txt"),
    ("record img1 --fps 7 --detections det.txt -o det.txt", "-o det.txt"),
    ("record img1 --fps 7 --regions regions.json -o regions.json", "-o regions.json"),
    ("replay scene.mcap -o scene.mcap", "-o scene.mcap"),
    ("replay scene.mcap -o annotated.mcap --against annotated.mcap", "-o annotated.mcap"),
    (
        "replay scene.mcap -o annotated.mcap --from 5 --checkpoints annotated.mcap",
        "-o annotated.mcap",
    ),
    (
        "replay scene.mcap --against annotated.mcap --html annotated.mcap",
        "--html annotated.mcap",
    ),
    (
        "replay scene.mcap -o new.mcap --against annotated.mcap --html new.mcap",
        "-o new.mcap",
    ),
    ("diff before.mcap after.mcap --html before.mcap", "--html before.mcap"),
    ("diff before.mcap after.mcap --html after.mcap", "--html after.mcap"),
    (
        "diff before.mcap after.mcap --scene scene.mcap --html scene.mcap",
        "--html scene.mcap",
    ),
    ("query annotated.mcap events.sql --format csv -o annotated.mcap", "-o annotated.mcap"),
    ("report annotated.mcap -o annotated.mcap", "-o annotated.mcap"),
    ("export annotated.mcap --to mot -o annotated.mcap", "-o annotated.mcap"),
    ("export annotated.mcap --to json -o annotated.mcap", "-o annotated.mcap"),
    ("export annotated.mcap --to video -o annotated.mcap", "-o annotated.mcap"),
    ("eval annotated.mcap --truth gt.txt --plot gt.txt", "--plot gt.txt"),
    ("eval annotated.mcap --truth gt.txt --plot annotated.mcap", "--plot annotated.mcap"),
    ("fit scene.mcap --truth gt.txt -o gt.txt", "-o gt.txt"),
    ("fit scene.mcap --truth gt.txt -o scene.mcap", "-o scene.mcap"),
    ("fit scene.mcap --truth gt.txt -o new.png --plot new.png", "-o new.png"),
    ("seal scene.mcap annotated.mcap -o scene.mcap", "-o scene.mcap"),
    ("seal scene.mcap -o lab.key --key lab.key", "-o lab.key"),
    ("recover scene.mcap -o scene.mcap", "-o scene.mcap"),
    ("replay scene.mcap --regions regions.json -o regions.json", "-o regions.json"),
    ("cut scene.mcap --from 1 -o scene.mcap", "-o scene.mcap"),
    ("filter scene.mcap --topics /camera/regions -o scene.mcap", "-o scene.mcap"),
    ("merge before.mcap after.mcap -o after.mcap", "-o after.mcap"),
    ("sort scene.mcap -o scene.mcap", "-o scene.mcap"),
    ("index monday.mcap -o monday.mcap", "-o monday.mcap"),
]


@pytest.mark.parametrize(("words", "named"), CALLS, ids=[words for words, _ in CALLS])
def test_an_input_is_never_overwritten(
    folder: Path, capsys: pytest.CaptureFixture[str], words: str, named: str
) -> None:
    if "lab.key" in words and importlib.util.find_spec("cryptography") is None:
        pytest.skip("no keys without cryptography")
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    force = [] if words.startswith("index") else ["--force"]
    assert main([*words.split(), *force]) == 2
    said = capsys.readouterr().err
    assert f"{named}: is " in said
    assert "name another file" in said
    assert {
        path: path.read_bytes() for path in folder.iterdir() if path.is_file()
    } == before


@pytest.mark.parametrize(
    "words",
    [
        "replay scene.mcap -o events --tracker events --force",
        "export annotated.mcap --to json -o json --force",
        "query annotated.mcap --ask entered-never-left --format csv -o csv --force",
        "index monday.mcap -o index",
        "explain annotated.mcap event:1 -o explain --force",
    ],
)
def test_a_word_that_is_no_file_is_no_input(folder: Path, words: str) -> None:
    assert main(words.split()) == 0
    assert (folder / words.split(" -o ")[1].split(maxsplit=1)[0]).exists()


def test_nor_under_another_name(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.link(folder / "before.mcap", folder / "hard.html")
    (folder / "soft.html").symlink_to("before.mcap")
    for page in (
        "hard.html",
        "soft.html",
        "recordings/../before.mcap",
        str(folder / "before.mcap"),
    ):
        assert main(["diff", "before.mcap", "after.mcap", "--html", page, "--force"]) == 2
        assert "read by the same command" in capsys.readouterr().err


def test_a_folder_of_evidence_does_not_replace_the_log_in_it(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for place in (".", "recordings"):
        log = "annotated.mcap" if place == "." else "recordings/before.mcap"
        assert main(["evidence", log, "--events", "12", "-o", place, "--force"]) == 2
        assert "no folder of ours" in capsys.readouterr().err
        assert (folder / log).exists()


def test_words_without_an_effect_are_told(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What belongs to --against or to --from says so, and checkpoints that could not be used,
    too.
    """
    assert main(["replay", "scene.mcap", "-o", "new.mcap", "--json"]) == 2
    assert "--json shows what differs: give --against LOG" in capsys.readouterr().err
    assert main(["replay", "scene.mcap", "-o", "new.mcap", "--html", "new.html"]) == 2
    assert "--html shows what differs" in capsys.readouterr().err
    from_log = [
        "replay",
        "scene.mcap",
        "-o",
        "new.mcap",
        "--force",
        "--annotations-only",
        "--checkpoints",
    ]
    for words, said in (
        (["annotated.mcap"], "without --from there is nothing to skip"),
        (
            ["monday.mcap", "--from", "30"],
            "it holds no checkpoint before --from; replayed from the start",
        ),
        (
            ["annotated.mcap", "--from", "1"],
            "it holds no checkpoint before --from; replayed from the start",
        ),
    ):
        assert main([*from_log, *words]) == 0
        assert said in capsys.readouterr().err
    assert main([*from_log, "annotated.mcap", "--from", "30", "--to", "frame:61"]) == 0
    said = capsys.readouterr().err
    assert "--checkpoints" not in said
    assert "new.mcap: 1 frame, " in said


def test_replay_against_writes_the_page(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["replay", "scene.mcap", "--against", "annotated.mcap", "--html", "new.html"]
    assert main([*words, "--set", "interactions.safety_margin=0.6"]) == 4
    assert "new.html: the first differences, side by side" in capsys.readouterr().err
    assert "data:image/jpeg;base64," in (folder / "new.html").read_text()
    assert main([*words, "--from", "5", "--to", "9"]) == 1, "an existing page"
    capsys.readouterr()
    assert main([*words, "--force", "--from", "5", "--to", "9"]) == 0
    said = capsys.readouterr()
    assert "identical: " in said.out
    assert "new.html: nothing differs" in said.err
