"""What goes to stdout, what to stderr, with which exit code; terminals and pipes."""

from __future__ import annotations

import importlib.metadata
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from replay.cli import COMMANDS, main

Start = Callable[..., "subprocess.Popen[bytes]"]

# A call of every command that can answer as JSON, without --json.
JSON_CALLS: dict[str, list[str]] = {
    "replay": ["scene.mcap", "--against", "annotated.mcap"],
    "verify": ["annotated.mcap"],
    "diff": ["before.mcap", "annotated.mcap"],
    "query": ["annotated.mcap", "SELECT * FROM events"],
    "find": ["annotated.mcap", "--like", "1"],
    "correct": ["annotated.mcap", "list", "-o", "known.jsonl"],
    "batch": ["scene.mcap", "-o", "case"],
    "explain": ["annotated.mcap", "12"],
    "index": ["monday.mcap", "tuesday.mcap", "-o", "new.duckdb"],
    "eval": ["annotated.mcap", "--truth", "gt.txt"],
    "info": ["annotated.mcap"],
    "doctor": ["annotated.mcap"],
}
# The messages of these are files or folders; a person is told on stderr.
QUIET_CALLS: dict[str, list[str]] = {
    "record": ["img1", "--fps", "7", "-o", "new.mcap"],
    "replay": ["scene.mcap", "-o", "new.mcap"],
    "export": ["annotated.mcap", "--to", "video", "-o", "new.mp4", "--until", "5"],
    "evidence": ["annotated.mcap", "--events", "12", "-o", "new"],
}


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that a failure says, on stderr."""
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert line.startswith("scenetrace: error: ")
    return line


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    said = capsys.readouterr()
    assert said.out == f"scenetrace {importlib.metadata.version('scenetrace')}\n"
    assert said.err == ""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "no command given; `scenetrace --help` lists them"),
        (["replya"], "no command 'replya'; did you mean 'replay'?"),
        (["xyz"], "no command 'xyz'; there are: demo, record, replay, "),
        (["--nonsense"], "unrecognized arguments: --nonsense; see `scenetrace --help`"),
        (
            ["record"],
            "arguments are required: SOURCE, -o/--output; see `scenetrace record --help`",
        ),
        (["replay", "a.mcap", "b.mcap", "-o", "c.mcap"], "unrecognized arguments: b.mcap"),
        (
            ["replay", "a.mcap", "-o", "b.mcap", "--checkpoint", "often"],
            "--checkpoint: invalid float value: 'often'",
        ),
        (
            ["query", "a.mcap", "SELECT 1", "--format", "xls"],
            "--format: invalid choice: 'xls'",
        ),
        (["export", "a.mcap", "--to", "xls", "-o", "b"], "--to: invalid choice: 'xls'"),
        (
            ["eval", "a.mcap", "--truth", "gt.txt", "--truth-size", "big"],
            "'big': must be WIDTHxHEIGHT, like 768x576",
        ),
        (["config", "--tracker", "none"], "unknown tracker 'none'; there are: events"),
        (["config", "--set", "events.nonsense=1"], "unknown parameter events.nonsense"),
        (["config", "--set", "nonsense"], "nonsense"),
        (["query", "--ask", "nonsense"], "no ready question 'nonsense'"),
    ],
)
def test_wrong_words_are_one_line_and_exit_code_2(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert message in one_line(capsys)


@pytest.mark.parametrize("name", [name for name, _, _ in COMMANDS])
def test_a_call_of_every_command_with_json_is_here(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([name, "--help"])
    assert ("--json" in capsys.readouterr().out) == (name in JSON_CALLS)


@pytest.mark.parametrize("name", JSON_CALLS)
def test_json_is_all_that_stdout_gets(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if name == "correct":
        words = ["label", "1", "person", "--by", "Jo", "--why", "seen", "-o", "known.jsonl"]
        assert main(["correct", "annotated.mcap", *words]) == 0
        capsys.readouterr()
    code = main([name, *JSON_CALLS[name], "--json"])
    said = capsys.readouterr()
    assert code == (4 if name == "diff" else 0)
    assert json.loads(said.out) is not None
    assert "Traceback" not in said.err


@pytest.mark.parametrize("name", QUIET_CALLS)
def test_messages_go_to_stderr_without_a_progress_bar(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([name, *QUIET_CALLS[name]]) == 0
    said = capsys.readouterr()
    assert said.out == ""
    assert "\x1b" not in said.err
    assert "\r" not in said.err
    assert "frames/s" not in said.err
    out = QUIET_CALLS[name][QUIET_CALLS[name].index("-o") + 1]
    assert said.err.splitlines()[-1].startswith(f"{out}: ")


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals")
def test_a_terminal_gets_progress_with_rate_and_time_left(
    folder: Path, start: Start
) -> None:
    import pty

    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    process = start(
        "replay", "scene.mcap", "-o", "new.mcap", stderr=theirs, env=environment
    )
    os.close(theirs)
    said = b""
    while True:
        try:
            data = os.read(ours, 65536)
        except OSError:  # how Linux says that the other side has gone
            break
        if not data:
            break
        said += data
    os.close(ours)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    assert out == b""
    assert b"frames/s" in said
    assert b"tracking" in said
    assert b"150/150" in said


def test_exit_code_4_is_for_what_differs(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diff", "annotated.mcap", "annotated.mcap"]) == 0
    assert capsys.readouterr().out.startswith("identical: ")
    assert main(["diff", "before.mcap", "annotated.mcap"]) in (0, 4)
    assert main(["verify", "annotated.mcap"]) == 0
    assert (
        capsys.readouterr()
        .out.splitlines()[-1]
        .startswith("identical: 150 frames, output digest ")
    )


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of POSIX")
@pytest.mark.parametrize("form", ["table", "json", "csv"])
def test_a_reader_that_goes_away_is_no_error(folder: Path, start: Start, form: str) -> None:
    sql = "SELECT a.*, b.* FROM tracks a, tracks b LIMIT 20000"
    process = start("query", "annotated.mcap", sql, "--format", form)
    assert process.stdout is not None
    assert process.stdout.readline()
    process.stdout.close()
    assert process.stderr is not None
    said = process.stderr.read()
    process.stderr.close()
    assert process.wait(timeout=60) == 141
    assert said == b""


@pytest.mark.parametrize(
    "error",
    [MemoryError(), RuntimeError("can't start new thread")],
    ids=["bytes", "threads"],
)
def test_memory_that_does_not_suffice_is_one_line(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def greedy(_: object) -> int:
        raise error

    monkeypatch.setattr("replay.cli.info.run", greedy)
    assert main(["info", "a.mcap"]) == 1
    assert one_line(capsys).startswith("scenetrace: error: out of memory; give it more")


def test_what_is_no_want_of_memory_is_not_called_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def wrong(_: object) -> int:
        raise ValueError("wrong")

    monkeypatch.setattr("replay.cli.info.run", wrong)
    with pytest.raises(ValueError, match="wrong"):
        main(["info", "a.mcap"])
