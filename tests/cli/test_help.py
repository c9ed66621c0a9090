"""The help, the README and the commands say the same, and every example in them works."""

from __future__ import annotations

import argparse
import re
import shlex
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from fixtures.scenes import generate
from replay.cli import COMMANDS, main, parser

ROOT = Path(__file__).resolve().parents[2]
NAMES = [name for name, _, _ in COMMANDS]
REFERENCE = "relation:1-2@40"  # stands in the help for a row that a log really has
# Exit codes of examples that are about a loss or a difference.
ANSWERS = {"recover": (3,), "diff": (0, 4), "replay --against": (0, 4)}
OUTPUTS = ("-o", "--new-key", "--plot")


def command_parser(name: str) -> argparse.ArgumentParser:
    """The command's own parser."""
    (action,) = (
        a for a in parser(name)._actions if isinstance(a, argparse._SubParsersAction)
    )
    found = action.choices[name]
    assert isinstance(found, argparse.ArgumentParser)
    return found


def examples_in(text: str) -> list[list[str]]:
    """The words of each `scenetrace ...` line of a text, comments left out."""
    lines = (line.strip() for line in text.splitlines())
    found = (
        shlex.split(line, comments=True)[1:]
        for line in lines
        if line.startswith("scenetrace ")
    )
    return [words for words in found if "COMMAND" not in words]


def readme() -> str:
    return (ROOT / "README.md").read_text(encoding="utf-8")


def readme_shell() -> str:
    """What the README's shell blocks say, the set-up left out."""
    return "\n".join(re.findall(r"```sh\n(.*?)```", readme(), re.DOTALL))


def split_redirect(words: list[str]) -> tuple[list[str], Path | None]:
    """The words before `> FILE`, and the file."""
    if ">" not in words:
        return words, None
    place = words.index(">")
    return words[:place], Path(words[place + 1])


@pytest.mark.parametrize("name", NAMES)
def test_help_has_a_description_an_example_and_a_word_on_every_option(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main([name, "--help"])
    assert stop.value.code == 0
    said = capsys.readouterr()
    assert said.err == ""
    found = command_parser(name)
    assert found.description
    assert len(found.description) > 30
    assert any(words[0] == name for words in examples_in(found.epilog or "")), (
        "no example of the command itself"
    )
    assert found.epilog is not None
    assert found.epilog.strip() in said.out, "the example's lines were wrapped"
    assert [a.dest for a in found._actions if not a.help] == []
    too_long = [line for line in found.epilog.splitlines() if len(line) > 120]
    assert not too_long


@pytest.mark.parametrize("name", NAMES)
def test_every_example_of_the_help_parses(name: str) -> None:
    for words in examples_in(command_parser(name).epilog or ""):
        args = parser(words[0]).parse_args(split_redirect(words)[0])
        assert args.command == words[0]
        assert callable(args.run)


def run_example(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Run an example in the working directory, in which its output is not yet there."""
    words, redirected = split_redirect(words)
    outputs = [Path(words[words.index(flag) + 1]) for flag in OUTPUTS if flag in words]
    for out in outputs:
        Path(f"{out}.pub").unlink(missing_ok=True)
        if out.is_dir():
            shutil.rmtree(out)
        else:
            out.unlink(missing_ok=True)
        if f"{out}.part" not in words:
            Path(f"{out}.part").unlink(missing_ok=True)
    capsys.readouterr()
    code = main(words)
    said = capsys.readouterr()
    kind = f"{words[0]} --against" if "--against" in words else words[0]
    assert code in ANSWERS.get(kind, (0,)), f"{shlex.join(words)}: {said.err}"
    assert [out for out in outputs if not out.exists()] == []
    if redirected is not None:
        redirected.write_text(said.out)


def reference_of(log: str, capsys: pytest.CaptureFixture[str]) -> str:
    """A relation of the log, as `explain` names it."""
    sql = (
        "SELECT format('relation:{}-{}@{}', a, b, start_frame) FROM relations ORDER BY"
        " start_frame LIMIT 1"
    )
    capsys.readouterr()
    assert main(["query", log, sql, "--format", "csv"]) == 0
    return capsys.readouterr().out.splitlines()[1]


# A view serves until it is interrupted; tests/replay/report/test_view.py asks it.
@pytest.mark.parametrize("name", [n for n in NAMES if n not in ("demo", "view")])
def test_every_example_of_the_help_runs(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reference = reference_of("annotated.mcap", capsys)
    for words in examples_in(command_parser(name).epilog or ""):
        if {"--key", "--new-key", "--public-key"} & set(words):
            pytest.importorskip("cryptography")
        if any("://" in word for word in words):
            continue  # a camera (tests/live has one) or an object store
        run_example([reference if w == REFERENCE else w for w in words], capsys)


def test_every_example_of_the_overview_runs(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = examples_in(parser("").epilog or "")
    assert len(found) >= 3
    for words in found:
        run_example(words, capsys)


def test_every_example_of_the_readme_runs(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = examples_in(readme_shell())
    assert len(found) >= 7
    for words in found:
        if not any("://" in word for word in words):
            run_example(words, capsys)


def test_the_readme_lists_the_commands_that_there_are() -> None:
    cells = re.findall(r"^\| (`.*?`) \|", readme(), re.MULTILINE)
    codes = [code for cell in cells for code in re.findall(r"`([^`]+)`", cell)]
    assert [
        c for c in dict.fromkeys(code.split()[0] for code in codes) if c not in NAMES
    ] == []
    assert [n for n in NAMES if n not in {code.split()[0] for code in codes}] == []


def test_the_overview_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    said = capsys.readouterr().out
    for name, _, line in COMMANDS:
        assert re.search(
            rf"^ +{name}\s+{re.escape(line.split()[0])}", said, re.MULTILINE
        ), name
    for code in (
        "0 done",
        "1 failed",
        "2 wrong usage",
        "3 done, but something was lost",
        "4 differs",
    ):
        assert code in said


@pytest.mark.parametrize(("name", "line"), [(name, line) for name, _, line in COMMANDS])
def test_the_overview_and_the_command_summarise_alike(name: str, line: str) -> None:
    (action,) = (
        a for a in parser(name)._actions if isinstance(a, argparse._SubParsersAction)
    )
    shown = {a.dest: a.help for a in action._choices_actions}
    assert shown[name] == line


@pytest.mark.parametrize(
    "size",
    [
        pytest.param({"size": (160, 120), "frames": 200}, id="small"),
        pytest.param({}, id="whole", marks=[pytest.mark.slow, pytest.mark.long]),
    ],
)
def test_the_demo_runs_every_command_that_it_prints(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    size: dict[str, Any],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("fixtures.scenes.generate", partial(generate, **size))
    (words,) = examples_in(command_parser("demo").epilog or "")
    assert main(words) == 0
    said = capsys.readouterr()
    printed = [line for line in said.out.splitlines() if line.startswith("$ scenetrace ")]
    assert [shlex.split(line)[2] for line in printed] == [
        "record", "replay", "verify", "query", "query", "eval", "export", "report",
    ]  # fmt: skip
    assert "identical: " in said.out
    files = {p.name for p in (tmp_path / "demo-out").iterdir()}
    assert {"scene.mcap", "annotated.mcap", "annotated.mp4", "report.html"} <= files
    assert main(words) == 1
    assert "exists already" in capsys.readouterr().err


_HELP_OF_ALL = """
import sys
from contextlib import redirect_stdout
from io import StringIO
from replay.cli import main

heavy = {"av", "cv2", "duckdb", "google.protobuf", "networkx", "numpy", "scipy"}
for name in sys.argv[1:]:
    try:
        with redirect_stdout(StringIO()) as said:
            main([*filter(None, [name]), "--help"])
    except SystemExit as end:
        print(name, end.code, len(said.getvalue()) > 200, sorted(heavy & sys.modules.keys()))
"""


def test_help_loads_no_heavy_library() -> None:
    names = ["", *NAMES]
    command = [sys.executable, "-c", _HELP_OF_ALL, *names]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [f"{name} 0 True []" for name in names]
