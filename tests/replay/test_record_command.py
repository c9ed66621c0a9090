"""`scenetrace record`: exit codes, what it says and where, interruption."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from recorders.pictures import encode_jpeg
from recorders.scene import SceneLog
from replay.cli import main


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "img1"
    path.mkdir()
    ground = np.random.default_rng(0).integers(100, 140, (48, 64, 3), np.uint8)
    for k in range(10):
        image = ground.copy()
        image[10:40, 4 * k : 4 * k + 14] = 250
        (path / f"{k + 1:06}.jpg").write_bytes(encode_jpeg(image))
    return path


def run(*words: object) -> int:
    return main(["record", *map(str, words)])


def test_a_folder_is_recorded_and_summed_up_on_stderr(
    tmp_path: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "a.mcap"
    assert (
        run(
            folder,
            "--fps",
            5,
            "-o",
            out,
            "--start",
            "2026-01-31T12:00:00.5Z",
            "--camera",
            "gate",
        )
        == 0
    )
    said = capsys.readouterr()
    assert said.out == ""
    assert f"{out}: 10 frames of 64x48 over 1.8 s" in said.err
    with SceneLog(out) as log:
        assert log.camera == "gate"
        assert next(iter(log.frame_times())) == 1_769_860_800_500_000_000


def test_what_was_assumed_and_left_out_is_said_and_the_code_is_3(
    tmp_path: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    det = tmp_path / "det.txt"
    det.write_text("12,-1,1,2,3,4,1\n2,-1,1,2,3,4,1\n")
    assert run(folder, "--detections", det, "-o", tmp_path / "a.mcap") == 3
    lines = capsys.readouterr().err.splitlines()
    assert lines[:3] == [
        (
            "scenetrace: no frame rate is known: assuming 25 frames per second; say it with"
            " --fps"
        ),
        "scenetrace: det.txt: the frames are not in order; they were sorted",
        (
            "scenetrace: left out: det.txt: 1 detections from frame 12 on come after the"
            " last picture (10 pictures) and were left out"
        ),
    ]
    assert len(lines) == 4


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["none.avi"], 1, "none.avi: no such file or folder"),
        (
            ["img1", "--fps", "0"],
            2,
            "--fps 0: must be a number of frames per second over 0",
        ),
        (["img1", "--size", "640"], 2, "--size: '640': must be WIDTHxHEIGHT, like 768x576"),
        (["img1", "--start", "noon"], 2, "time 'noon'"),
        (
            ["img1", "--start", "1960-01-01T00:00:00Z"],
            2,
            "times before 1970 cannot be recorded",
        ),
        (
            ["img1", "--set", "segmentation.nonsense=1"],
            2,
            "unknown parameter segmentation.nonsense",
        ),
        (["img1", "--set", "segmentation.min_area=7"], 2, "must be in [0, 1]"),
        (["img1", "--detect", "magic"], 2, "--detect magic: must be one of"),
        (["img1", "--codec", "gif"], 2, "--codec gif: must be one of"),
        (["img1", "--camera", "a/b"], 2, "camera name 'a/b'"),
        (["img1", "--regions", "none.json"], 1, "none.json: no such file"),
        (["img1", "--detections", "none.txt"], 1, "none.txt: no such file"),
        (["img1", "-o", "there.mcap"], 1, "there.mcap exists already, not overwriting it"),
        (["img1", "-o", "nowhere/a.mcap"], 1, "nowhere/a.mcap"),
    ],
)
def test_what_is_wrong_is_one_line_and_leaves_nothing(
    tmp_path: Path,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    code: int,
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.mcap").write_text("precious")
    before = sorted(p.name for p in tmp_path.iterdir())
    rate = [] if "--fps" in words else ["--fps", "5"]
    assert run(*words, *rate, *([] if "-o" in words else ["-o", "a.mcap"])) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("scenetrace: error: ")
    assert message in line
    assert sorted(p.name for p in tmp_path.iterdir()) == before
    assert (tmp_path / "there.mcap").read_text() == "precious"


_PATIENCE_S = 600
"""Only what hangs is to fail: a loaded machine may give the process a tenth of a core."""


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_recording_is_recovered(tmp_path: Path, number: int) -> None:
    det = tmp_path / "det.txt"
    det.write_text("".join(f"{f},-1,{f % 50},2,30,40,1\n" for f in range(1, 200_001)))
    out, part = tmp_path / "a.mcap", tmp_path / "a.mcap.part"
    command = [
        sys.executable,
        "-c",
        "import sys; from replay.cli import main; sys.exit(main(sys.argv[1:]))",
    ]
    process = subprocess.Popen(
        [*command, "record", str(det), "--fps", "25", "--size", "99x99", "-o", str(out)],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    deadline = time.monotonic() + _PATIENCE_S
    while not (part.exists() and part.stat().st_size > 20_000) and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(number)
    _, said = process.communicate(timeout=_PATIENCE_S)
    assert process.returncode != 0
    assert not out.exists()
    if number == signal.SIGINT:
        assert process.returncode == 1
        assert "scenetrace: error: interrupted after " in said
        assert f"keep them with: scenetrace recover {part} -o " in said
        assert "Traceback" not in said
    assert main(["recover", str(part), "-o", str(out)]) == 3
    with SceneLog(out) as log:
        times = list(log.frame_times())
    assert len(times) > 25
    assert times == [k * 40_000_000 for k in range(len(times))]


def test_the_examples_of_the_help_work(
    tmp_path: Path,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "det.txt").write_text("1,-1,1,2,3,4,1\n")
    box = '<box h="4" w="4" xc="9" yc="9"/>'
    frame = (
        f'<frame number="0"><objectlist><object id="0">{box}</object></objectlist></frame>'
    )
    (tmp_path / "Walk1.xml").write_text(f"<dataset>{frame}</dataset>")
    with pytest.raises(SystemExit):
        main(["record", "--help"])
    text = capsys.readouterr().out
    examples = [
        line.split()[1:]
        for line in text.split("example:")[1].splitlines()
        if "scenetrace record" in line
    ]
    assert len(examples) >= 4
    for words in examples:
        if (tmp_path / words[1]).exists():
            assert main([*words, "--force"]) == 0, words
            assert Path(words[words.index("-o") + 1]).exists()
