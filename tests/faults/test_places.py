"""Where outputs go: file systems without upper and lower case, paths that are too long, folders that
may not be written, files that are replaced while they are read.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from reasoning.questions import Case
from tests.faults.io_faults import COMMANDS, compiler, forked
from tests.faults.small import WORDS, annotated, run
from tests.faults.test_together import MAIN, started

HERE = Path(__file__).resolve().parent
_CAPABILITIES_VERSION, _CAP_DAC_OVERRIDE = 0x20080522, 1 << 1


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scene and its annotated log, and one to work in beside them."""
    folder = tmp_path_factory.mktemp("places")
    annotated(folder)
    return folder


@pytest.fixture
def place(made: Path) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(dir=made) as name:
        yield Path(name)


def caseless(tmp_path: Path) -> dict[str, str]:
    """What to add to the environment so that names below a folder know no upper and lower case."""
    library, built = tmp_path / "fold.so", compiler()
    assert built is not None
    source = HERE / "fold.c"
    words = [built, "-O2", "-shared", "-fPIC", "-o", str(library), str(source), "-ldl"]
    subprocess.run(words, check=True)
    return {"LD_PRELOAD": str(library), "SCENETRACE_FOLD": str(tmp_path / "files")}


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_names_that_differ_by_case_alone_where_that_is_none(tmp_path: Path) -> None:
    folder = tmp_path / "files"
    folder.mkdir()
    annotated(folder)
    environment = {**os.environ, **caseless(tmp_path)}

    def told(*words: str) -> tuple[int, str]:
        done = subprocess.run(
            [sys.executable, "-c", MAIN, *words],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        return done.returncode, done.stderr

    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    for words, code, said in (
        (["record", "DET.txt", *WORDS, "-o", "Scene.MCAP"], 1, "exists already"),
        (["record", "det.txt", *WORDS, "-o", "DET.TXT", "--force"], 2, "name another file"),
        (["replay", "scene.mcap", "-o", "SCENE.mcap", "--force"], 2, "name another file"),
        (["recover", "made.mcap", "-o", "Made.mcap", "--force"], 2, "name another file"),
        (["export", "Made.mcap", "--to", "mot", "-o", "MADE.mcap", "--force"], 2, "name"),
    ):
        assert (told(*words)[0], said in told(*words)[1]) == (code, True), words
        assert {p.name: p.read_bytes() for p in folder.iterdir()} == before
    assert told("evidence", "MADE.mcap", "--events", "1", "-o", "Evidence")[0] == 0
    assert told("evidence", "made.mcap", "--events", "1", "-o", "EVIDENCE")[0] == 1
    assert told("verify", "--manifest", "evidence/manifest.json")[0] == 0
    assert told("seal", "EVIDENCE", "-o", "Sealed.json")[0] == 0
    assert told("verify", "--manifest", "SEALED.JSON")[0] == 0


def test_two_outputs_that_differ_by_case_alone_are_refused(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(made)
    words = ["replay", "scene.mcap", "--against", "made.mcap", "--force"]
    code, said = run(*words, "-o", "new.html", "--html", "NEW.html")
    assert code == 2
    assert "name another file" in said
    assert not (made / "new.html").exists()


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("long", ["a" * 4000, "/".join(["y" * 99] * 40), "b" * 252])
def test_a_path_that_is_too_long_is_one_line(
    place: Path, command: str, long: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place)
    words = [
        f"{long}{word.removeprefix('OUT')}" if word.startswith("OUT") else word
        for word in COMMANDS[command]
    ]
    code, said = run(*words)
    if code == 0 and command in ("export csv", "evidence"):
        return  # it makes the folders above its own, and their names are short enough
    assert code in (1, 2)
    lines = [line for line in said.splitlines() if "error" in line]
    assert len(lines) == 1
    assert "Traceback" not in said
    assert [p for p in place.rglob("*") if p.is_file()] == []


def _as_others() -> None:
    """Give up the right to write whatever a folder's mode says; what may be read stays so, as
    commands load modules on the way.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(_CAPABILITIES_VERSION, 0)
    sets = (ctypes.c_uint32 * 6)()
    assert libc.capget(header, sets) == 0
    sets[0] &= ~_CAP_DAC_OVERRIDE
    assert libc.capset(header, sets) == 0


@pytest.mark.parametrize("command", COMMANDS)
def test_a_folder_that_this_user_may_not_write(made: Path, command: str) -> None:
    """Where the tests are run by the superuser, who may write everywhere, without that right."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file in ("det.txt", "scene.mcap", "made.mcap"):
            (folder / file).write_bytes((made / file).read_bytes())
        closed = folder / "closed"
        closed.mkdir(mode=0o555)
        folder.chmod(0o755)

        def work(_: Path) -> tuple[int, str]:
            if os.geteuid() == 0:
                _as_others()
            return run(*COMMANDS[command])

        answer, raised = forked(closed, work)
        assert answer is not None, raised
        code, said = answer
        assert code == 1, said
        assert "Permission denied" in said or "cannot be" in said
        assert "Traceback" not in said
        assert list(closed.iterdir()) == []


def test_an_index_of_logs_that_are_replaced_meanwhile(made: Path, tmp_path: Path) -> None:
    """Each index is of a whole log, the old one or the new one, or says that it cannot be."""
    logs = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    scene = str(made / "scene.mcap")
    for log in logs:
        log.write_bytes((made / "made.mcap").read_bytes())
    writers = [started("replay", scene, "-o", str(log), "--force") for log in logs]
    codes = []
    for number in range(3):
        index = tmp_path / f"{number}.duckdb"
        code, said = run("index", *map(str, logs), "-o", str(index))
        assert "Traceback" not in said
        codes.append(code)
        if code in (0, 3):
            with Case([index]) as case:
                counts = case.rows("SELECT count(*) FROM tracks GROUP BY recording")
            assert set(counts) == {(24,)}
    assert [writer.wait() for writer in writers] == [0, 0]
    assert codes[-1] in (0, 3)
    for writer in writers:
        writer.communicate()
