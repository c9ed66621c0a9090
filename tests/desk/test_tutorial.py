"""The tutorial's commands, run in order in an empty folder; what it says they say, they say."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from fixtures.logs import export_video, write_regions
from fixtures.scenes import generate
from replay.cli import main

PAGE = Path(__file__).parents[2] / "docs" / "tutorial.md"
_BLOCK = re.compile(r"```(sh|toml)\n(.*?)```", re.DOTALL)


def steps() -> Iterator[tuple[str, str, list[str]]]:
    """Kind, command or text, and what its output must hold."""
    for kind, text in _BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        if kind == "toml":
            yield kind, text, []
            continue
        said: list[str] = []
        command = ""
        for line in text.splitlines():
            if line.startswith("# says: "):
                said.append(line.removeprefix("# says: "))
                continue
            if command:
                yield kind, command, said
            command, said = line, []
        yield kind, command, said


def test_there_are_ten_investigations() -> None:
    assert len(re.findall(r"(?m)^## \d+\. ", PAGE.read_text(encoding="utf-8"))) == 10


@pytest.mark.slow
@pytest.mark.long
def test_every_command_does_what_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("demo-out").mkdir()
    scene = generate("demo")
    export_video(scene, "demo-out/scene.mp4")
    write_regions(scene, "demo-out/regions.json")
    ran, wrong = 0, []
    for kind, text, said in steps():
        if kind == "toml":
            Path("case.toml").write_text(text, encoding="utf-8")
            continue
        words = shlex.split(text)
        assert words.pop(0) == "scenetrace"
        if words[0] == "demo":  # what it needs of it stands there already
            continue
        code = main(words)
        output = "".join(capsys.readouterr())
        wrong += [f"{text}: {code}\n{output}"] if code else []
        wrong += [f"{text}: no {w!r} in\n{output}" for w in said if w not in output]
        ran += 1
    assert not wrong, "\n".join(wrong)
    assert ran >= 28
    assert Path("evidence/evidence.pdf").is_file()
