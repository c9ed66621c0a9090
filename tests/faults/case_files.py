"""The files that people reported, made by the scripts beside the project, where they are there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

_SHARED = Path(__file__).resolve().parents[3] / "shared"
CASES = Path(os.environ.get("SCENETRACE_DATA", _SHARED / "data")).parent / "cases"

_WORDS: dict[str, tuple[str, ...]] = {
    "bursts_long": ("400 1000",),
    "clock_jump": ("5000000 10", "4000000000 10"),
    "fg_sdk": ("normal", "empty", "unused"),
    "minimal_json": ("least", "extra", "frame1", "float", "nan", "dup", "size0"),
    "overlap_all": ("800",),
    "video_p_first": ("libx264 5 25", "libx265 5 25"),
    "zero_tail": ("0.7 4096", "0.2 100000"),
    "c_rotate": ("45", "hflip", "vflip"),
    "t_nightgap": ("8",),
    "t_rawrate": ("mjpeg", "hevc", "h264"),
}
"""The words of each script that takes some and does not name their kinds."""
_KINDS = re.compile(r'kind == "(\w+)"|^(\w+)\)|^ "(\w+)": \[', re.MULTILINE)
"""How the other scripts name the kinds of file that they make."""
_LEFT_OUT = ("_lib", "scene", "s_scene", "s_real", "l_long")
"""What is no script, and long sound videos."""
_ENDINGS = {
    "c_audio": ".mp4",
    "c_dav": ".dav",
    "m_mot": ".txt",
    "t_rawrate": ".mjpeg",
    "c_rotate": ".mp4",
}
_FOLDERS = ("e_eval", "f_det_gap", "f_folder", "f_timenames", "d_formats")


def case_files(folder: Path) -> Iterator[Path]:
    """Each of them, gone again once the next is asked for; none where the scripts are not there."""
    folder.mkdir(exist_ok=True)
    for script in sorted(CASES.glob("mcap/*.py")) + sorted(CASES.glob("video/*.*")):
        stem = script.stem
        if stem in _LEFT_OUT:
            continue
        found = _KINDS.findall(script.read_text())
        kinds = _WORDS.get(stem) or dict.fromkeys("".join(names) for names in found) or [""]
        for number, words in enumerate(kinds):
            ending = ".mcap" if script.parent.name == "mcap" else _ENDINGS.get(stem, ".mkv")
            name = f"{stem}-{number}" + ("" if stem in _FOLDERS else ending)
            yield from _made(script, folder / name, words.split())


def _made(script: Path, out: Path, words: list[str]) -> Iterator[Path]:
    """What a script makes; of a folder of files, each of them and the folder."""
    program = ["sh"] if script.suffix == ".sh" else [sys.executable, "-W", "ignore"]
    done = subprocess.run(
        [*program, str(script), str(out), *words],
        cwd=script.parent,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        check=False,
        capture_output=True,
        text=True,
    )
    if done.returncode:  # a library or a codec is not there
        why = done.stderr.strip().splitlines()[-1:]
        print(f"left out: {script.name} {' '.join(words)}: {why}", file=sys.stderr)
        return
    if out.is_dir():
        yield from sorted(p for p in out.iterdir() if p.is_file())[:40]
    yield out
    subprocess.run(["rm", "-rf", "--", str(out)], check=True)
