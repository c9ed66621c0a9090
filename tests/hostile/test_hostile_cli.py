"""Bad input through the command line: one line on stderr that says what, where and what to do;
nothing left behind.
"""

from __future__ import annotations

import errno
import os
import random
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import chdir, redirect_stdout
from functools import cache
from io import StringIO
from pathlib import Path

import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from recorders import channels
from recorders.log import LogWriter
from recorders.messages import NO_BLOB, Detections
from recorders.pictures import encode_jpeg, encode_png
from recorders.scene import SceneLog
from replay.cli import main
from tests.lying_files import mcap_bomb, png

MAGIC = b"\x89MCAP0\r\n"
PROGRAM = "import sys; from replay.cli import main; sys.exit(main(sys.argv[1:]))"
POSIX = pytest.mark.skipif(
    sys.platform == "win32", reason="signals and resource limits of POSIX"
)


# -- building
# ----------------------------------------------------------------------------------------------------------


def records(data: bytes, opcode: int) -> list[tuple[int, int]]:
    """Where the content of a log's records of a kind begins and ends (a walk over the file's own
    lengths).
    """
    place, found = len(MAGIC), []
    while place < len(data) - len(MAGIC):
        kind, size = struct.unpack_from("<BQ", data, place)
        if kind == opcode:
            found.append((place + 9, place + 9 + size))
        place += 9 + size
    assert found, f"no record {opcode:#x}"
    return found


def flipped(data: bytes, opcode: int) -> bytes:
    """One bit flipped in the middle of each record of a kind."""
    damaged = bytearray(data)
    for begin, end in records(data, opcode):
        damaged[(begin + end) // 2] ^= 4
    return bytes(damaged)


def one_box(k: int, *box: float, size: tuple[int, int] = (160, 120)) -> Detections:
    return Detections(k, *size, [box], [1.0], [""], [None], [NO_BLOB])  # type: ignore[list-item]


def scene_log(
    path: Path,
    payload: Callable[[int], bytes] | None = None,
    picture: bytes | None = None,
    frames: int = 5,
) -> Path:
    """A scene log by hand: a box per frame, or what ``payload`` makes of the frame's number;
    perhaps a picture.
    """
    with LogWriter(path) as log:
        image = (
            log.channel("/camera/image", channels.schema("image"), "protobuf")
            if picture is not None
            else None
        )
        detections = log.channel(
            "/camera/detections", channels.schema("detections"), "json"
        )
        for k in range(frames):
            now = k * 100_000_000
            if image is not None and picture is not None:
                log.write(
                    image, channels.compressed_image(picture, "png", now, "camera"), now
                )
            data = (
                channels.encode("detections", one_box(k, 10, 10, 20, 50))
                if payload is None
                else payload(k)
            )
            log.write(detections, data, now)
    return path


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene log, an annotated log with checkpoints, pictures, detections, truth."""
    folder = tmp_path_factory.mktemp("good")
    scene = generate("three_way_group", seed=1, size=(160, 120), frames=25)
    write_scene_log(scene, folder / "scene.mcap", style="merged")
    words = [
        "replay",
        str(folder / "scene.mcap"),
        "-o",
        str(folder / "annotated.mcap"),
        "--checkpoint",
        "0.3",
    ]
    assert main(words) == 0
    assert (
        main(
            [
                "export",
                str(folder / "annotated.mcap"),
                "--to",
                "mot",
                "-o",
                str(folder / "gt.txt"),
            ]
        )
        == 0
    )
    (folder / "img1").mkdir()
    for k in range(3):
        (folder / "img1" / f"{k + 1}.jpg").write_bytes(encode_jpeg(scene.image(k)))
    (folder / "det.txt").write_text("1,-1,5,5,20,50,1\n")
    return folder


@pytest.fixture
def folder(good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the good files, which is the working directory."""
    copy = tmp_path / "work"
    shutil.copytree(good, copy)
    monkeypatch.chdir(copy)
    return copy


def listing(folder: Path) -> dict[str, bytes | None]:
    """Everything below a folder with its content."""
    return {
        str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None
        for p in sorted(folder.rglob("*"))
    }


Fails = Callable[..., str]


@pytest.fixture
def fails(folder: Path, capsys: pytest.CaptureFixture[str]) -> Fails:
    """Run a command that fails: one line on stderr, nothing on stdout, no file changed; returns
    the line.
    """

    def run(*words: object, code: int = 1, message: str = "") -> str:
        before = listing(folder)
        capsys.readouterr()
        assert main([str(w) for w in words]) == code
        said = capsys.readouterr()
        assert said.out == ""
        lines = [
            line
            for line in said.err.splitlines()
            if not line.startswith("scenetrace: no frame rate is known")
        ]
        (line,) = lines
        assert line.startswith("scenetrace: error: ")
        assert message in line
        assert listing(folder) == before
        return line

    return run


# -- damaged and foreign logs
# ------------------------------------------------------------------------------------------

# How each command reads a log; what it would write has no name that is there.
READERS: dict[str, list[str]] = {
    "replay": ["replay", "LOG", "-o", "out.mcap"],
    "verify": ["verify", "LOG"],
    "verify --quick": ["verify", "LOG", "--quick"],
    "diff": ["diff", "LOG", "annotated.mcap"],
    "query": ["query", "LOG", "SELECT * FROM events"],
    "explain": ["explain", "LOG", "1", "-o", "out"],
    "report": ["report", "LOG", "-o", "out.html"],
    "evidence": ["evidence", "LOG", "--events", "1", "-o", "out"],
    "index": ["index", "LOG", "-o", "out.duckdb"],
    "index to Parquet": ["index", "LOG", "-o", "out"],
    "export mot": ["export", "LOG", "--to", "mot", "-o", "out.txt"],
    "export parquet": ["export", "LOG", "--to", "parquet", "-o", "out"],
    "export video": ["export", "LOG", "--to", "video", "-o", "out.mp4"],
    "export graphml": ["export", "LOG", "--to", "graphml", "-o", "out.graphml"],
    "eval": ["eval", "LOG", "--truth", "gt.txt"],
    "info": ["info", "LOG"],
}
BAD_FILES: dict[str, Callable[[Path], object]] = {
    "no such file": lambda path: None,
    "empty file": lambda path: path.write_bytes(b""),
    "a text file": lambda path: path.write_text("frame,id,x,y\n1,1,10,10\n" * 50),
    "a folder": lambda path: path.mkdir(),
    "a truncated log": lambda path: path.write_bytes(
        Path("annotated.mcap").read_bytes()[:-300]
    ),
    "a log cut in its first chunk": lambda path: path.write_bytes(
        Path("annotated.mcap").read_bytes()[:900]
    ),
    "a chunk that unpacks to more than it declares": lambda path: path.write_bytes(
        mcap_bomb(64 << 20, declared=100)
    ),
}


@pytest.mark.parametrize("command", READERS)
@pytest.mark.parametrize("kind", BAD_FILES)
def test_what_is_no_whole_log_is_refused_by_every_command(
    folder: Path, fails: Fails, kind: str, command: str
) -> None:
    BAD_FILES[kind](Path("bad.mcap"))
    looks_below = kind == "a folder" and command.startswith(
        "index"
    )  # it takes folders of logs
    line = fails(
        *["bad.mcap" if w == "LOG" else w for w in READERS[command]],
        code=2 if looks_below else 1,
    )
    assert "bad.mcap" in line


@pytest.fixture(scope="module")
def undamaged(
    good: Path, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], tuple[int, str]]:
    """What each command that reads answers of the good log: its exit code, and stdout."""

    @cache
    def answer(command: str) -> tuple[int, str]:
        copy = tmp_path_factory.mktemp("undamaged") / "work"
        shutil.copytree(good, copy)
        words = ["annotated.mcap" if w == "LOG" else w for w in READERS[command]]
        with chdir(copy), redirect_stdout(StringIO()) as said:
            return main(words), said.getvalue()

    return answer


CHUNK, ATTACHMENT, METADATA, CHUNK_INDEX, STATISTICS = 0x06, 0x09, 0x0C, 0x08, 0x0B


@pytest.mark.parametrize("opcode", [CHUNK, ATTACHMENT, METADATA, CHUNK_INDEX, STATISTICS])
@pytest.mark.parametrize("command", READERS)
def test_one_flipped_bit_is_an_error_or_changes_nothing(
    folder: Path,
    undamaged: Callable[[str], tuple[int, str]],
    capsys: pytest.CaptureFixture[str],
    opcode: int,
    command: str,
) -> None:
    path = Path("annotated.mcap")
    words = ["annotated.mcap" if w == "LOG" else w for w in READERS[command]]
    expected_code, expected = undamaged(command)
    path.write_bytes(flipped(path.read_bytes(), opcode))
    before = listing(folder)
    capsys.readouterr()
    if main(words) == expected_code:
        said = capsys.readouterr()
        assert said.out == expected
        now = listing(folder)
        assert {k: v for k, v in now.items() if not k.startswith("out")} == before
        assert opcode != CHUNK or command in ("info", "diff")
    else:
        said = capsys.readouterr()
        (line,) = said.err.splitlines()
        assert line.startswith("scenetrace: error: annotated.mcap at byte ")
        # Where the bit lies decides whether compressed data unpacks at all.
        assert any(words in line for words in ("CRC", "differs", "cannot unpack it")), (
            "what is wrong"
        )
        assert listing(folder) == before
    capsys.readouterr()
    assert main(["doctor", "annotated.mcap"]) == 1
    said = capsys.readouterr()
    assert "error" in said.out
    assert "scenetrace recover annotated.mcap -o OUT" in said.err


def test_doctor_and_recover_of_what_is_no_log(
    folder: Path, fails: Fails, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "no such file" in fails("doctor", "none.mcap")
    assert "no such file" in fails("recover", "none.mcap", "-o", "out.mcap")
    Path("text.mcap").write_text("hello " * 99)
    fails("recover", "text.mcap", "-o", "out.mcap", message="text.mcap")
    assert main(["doctor", "text.mcap"]) == 1
    assert "not an MCAP file" in capsys.readouterr().out
    fails("recover", ".", "-o", "out.mcap", message="folder")
    fails("doctor", ".", message="folder")


def test_recover_keeps_what_is_whole_of_a_truncated_log(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("cut.mcap").write_bytes(Path("scene.mcap").read_bytes()[:-4000])
    assert main(["recover", "cut.mcap", "-o", "saved.mcap"]) == 3
    assert "lost: at byte " in capsys.readouterr().err
    assert main(["doctor", "saved.mcap"]) == 0
    assert main(["replay", "saved.mcap", "-o", "again.mcap"]) == 0


@pytest.mark.parametrize("command", [c for c in READERS if c not in ("info", "replay")])
def test_a_scene_log_has_nothing_to_ask_yet(
    folder: Path, fails: Fails, command: str
) -> None:
    line = fails(*["scene.mcap" if w == "LOG" else w for w in READERS[command]])
    assert "scene.mcap" in line
    assert "`scenetrace replay" in line


def test_a_log_without_detections_says_what_it_holds_and_how_to_record(
    folder: Path, fails: Fails
) -> None:
    with LogWriter(folder / "pictures.mcap") as log:
        image = log.channel("/camera/image", channels.schema("image"), "protobuf")
        log.write(image, channels.compressed_image(png(3, 3), "png", 0, "camera"), 0)
    line = fails(
        "replay", "pictures.mcap", "-o", "out.mcap", message="no detections to replay"
    )
    assert "it holds /camera/image" in line
    assert "`scenetrace record SOURCE -o scene.mcap`" in line
    with LogWriter(folder / "none.mcap") as log:
        log.channel("/camera/detections", channels.schema("detections"), "json")
    fails(
        "replay", "none.mcap", "-o", "out.mcap", message="the detections channel is empty"
    )


# -- lies inside a sound log
# -------------------------------------------------------------------------------------------


def altered(k: int, old: bytes, new: bytes) -> bytes:
    data = channels.encode("detections", one_box(k, 10.5, 10.5, 20.5, 50.5))
    assert old in data
    return data.replace(old, new)


PAYLOADS: dict[str, tuple[Callable[[int], bytes], str]] = {
    "NaN": (lambda k: altered(k, b"20.5", b"NaN"), "JSON is malformed"),
    "infinity": (lambda k: altered(k, b"20.5", b"1e999"), "out of range"),
    "negative width": (
        lambda k: channels.encode("detections", one_box(k, 10, 10, -5, 5)),
        "w, h over 0",
    ),
    "no height": (
        lambda k: channels.encode("detections", one_box(k, 10, 10, 5, 0)),
        "w, h over 0",
    ),
    "huge": (
        lambda k: channels.encode("detections", one_box(k, 0, 0, 1e300, 1e300)),
        "wanted finite",
    ),
    "beyond": (
        lambda k: channels.encode("detections", one_box(k, 160, 0, 5, 5)),
        "beyond the picture of 160x120",
    ),
    "left of": (
        lambda k: channels.encode("detections", one_box(k, -9, 0, 9, 5)),
        "beyond the picture of 160x120",
    ),
    "no picture": (
        lambda k: channels.encode("detections", one_box(k, 0, 0, 5, 5, size=(0, 9))),
        "a picture of 0x9",
    ),
    "unequal lists": (
        lambda k: altered(k, b'"scores":[1.0]', b'"scores":[1.0,1.0]'),
        "2 scores for 1 boxes",
    ),
    "text for a number": (
        lambda k: altered(k, b"20.5", b'"20"'),
        "Expected `float`, got `str`",
    ),
    "deep": (lambda k: b'{"else":' + b"[" * 100_000, "not a detections message"),
    "not JSON": (lambda k: b"\x00\xff", "not a detections message"),
    "empty": (lambda k: b"", "not a detections message"),
}


@pytest.mark.parametrize("name", PAYLOADS)
def test_detections_that_cannot_be_are_refused_on_replay(
    folder: Path, fails: Fails, name: str
) -> None:
    payload, message = PAYLOADS[name]
    good = channels.encode("detections", one_box(0, 10, 10, 20, 50))
    scene_log(folder / "first.mcap", payload)
    scene_log(folder / "later.mcap", lambda k: payload(k) if k == 4 else good, frames=6)
    for path in ("first.mcap", "later.mcap"):
        line = fails("replay", path, "-o", "out.mcap", message=message)
        assert f"{path} (detections): " in line


def test_a_picture_over_a_limit_is_refused_before_it_is_decoded(
    folder: Path, fails: Fails
) -> None:
    scene_log(folder / "bad.mcap", picture=png(30_000, 30_000))
    message = "a picture claims 30000 x 30000 pixels, over the limit of 16384 a side"
    line = fails("replay", "bad.mcap", "-o", "out.mcap", message=message)
    assert "bad.mcap" in line


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        (png(0, 120), "claims 0 x 120 pixels"),
        (png(160, 120), "a damaged png picture"),
        (b"hello", "neither a JPEG nor a PNG picture"),
        (b"", "a picture of 0 bytes"),
    ],
)
def test_a_picture_that_cannot_be_decoded_is_left_out_and_named(
    folder: Path, capsys: pytest.CaptureFixture[str], picture: bytes, message: str
) -> None:
    scene_log(folder / "bad.mcap", picture=picture)
    assert main(["replay", str(folder / "bad.mcap"), "-o", str(folder / "out.mcap")]) == 3
    told = [
        line
        for line in capsys.readouterr().err.splitlines()
        if line.startswith("scenetrace: left out: ")
    ]
    assert told
    assert message in told[0]
    assert "/camera/image" in told[0]
    assert (folder / "out.mcap").exists()


def test_a_picture_of_another_size_than_the_detections_say(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import numpy as np

    scene_log(folder / "bad.mcap", picture=encode_png(np.zeros((50, 60, 3), np.uint8)))
    assert main(["replay", "bad.mcap", "-o", "out.mcap"]) == 3
    said = capsys.readouterr().err
    assert "left out: a picture of 60x50, the detections say 160x120" in said
    assert "/camera/image" in said


# -- sources
# -----------------------------------------------------------------------------------------------------------


def test_record_of_a_picture_that_claims_30000_x_30000(folder: Path, fails: Fails) -> None:
    Path("img1/4.png").write_bytes(png(30_000, 30_000))
    line = fails("record", "img1", "--fps", "5", "-o", "out.mcap")
    assert "4.png" in line
    assert "claims 30000 x 30000 pixels, over the limit of 16384 a side" in line


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1,-1,5,5,nan,50,1", "a row with a number that is not finite, at det.txt:1"),
        (
            "1,-1,5,5,-20,50,1",
            "a box without width or height, at det.txt:1",
        ),
        (
            "1,-1,5,5,20,0,1",
            "a box without width or height, at det.txt:1",
        ),
        ("1,-1,500,5,20,50,1", "det.txt:1: detections beyond the picture: "),
        ("one,-1,5,5,20,50,1", "(frame 'one' is not a number), at det.txt:1"),
        ("1,-1,5", "det.txt:1: "),
        ("", "det.txt: "),
    ],
)
def test_detections_that_cannot_be_are_refused_with_their_line(
    folder: Path, fails: Fails, row: str, message: str
) -> None:
    Path("det.txt").write_text(f"{row}\n")
    for words in (["img1", "--detections", "det.txt"], ["det.txt", "--size", "160x120"]):
        fails("record", *words, "--fps", "5", "-o", "out.mcap", message=message)


def test_unsorted_frames_are_sorted_duplicates_left_out_and_both_are_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("det.txt").write_text(
        "3,-1,5,5,20,50,1\n1,-1,5,5,20,50,1\n1,-1,5,5,20,50,1\n2,-1,6,5,20,50,1\n"
    )
    assert (
        main(["record", "det.txt", "--size", "160x120", "--fps", "5", "-o", "out.mcap"])
        == 3
    )
    said = capsys.readouterr().err
    assert "det.txt: the frames are not in order; they were sorted" in said
    with SceneLog(folder / "out.mcap") as log:
        boxes = [len(f.detections.boxes) for f in log.frames()]
    assert boxes == [1, 1, 1]
    assert "left out: a row that repeats another row of its frame, at det.txt:3" in said


# -- outputs
# -----------------------------------------------------------------------------------------------------------

WRITERS: dict[str, list[str]] = {
    "record": ["record", "img1", "--fps", "5", "-o", "OUT.mcap"],
    "replay": ["replay", "scene.mcap", "-o", "OUT.mcap"],
    "recover": ["recover", "annotated.mcap", "-o", "OUT.mcap"],
    "export mot": ["export", "annotated.mcap", "--to", "mot", "-o", "OUT.txt"],
    "export parquet": ["export", "annotated.mcap", "--to", "parquet", "-o", "OUT.parquet"],
    "export folder": ["export", "annotated.mcap", "--to", "parquet", "-o", "OUT"],
    "export graphml": ["export", "annotated.mcap", "--to", "graphml", "-o", "OUT.graphml"],
    "export json": ["export", "annotated.mcap", "--to", "json", "-o", "OUT.json"],
    "export video": ["export", "annotated.mcap", "--to", "video", "-o", "OUT.mp4"],
    "query csv": [
        "query",
        "annotated.mcap",
        "SELECT * FROM tracks",
        "--format",
        "csv",
        "-o",
        "OUT.csv",
    ],
    "query parquet": [
        "query",
        "annotated.mcap",
        "SELECT * FROM tracks",
        "--format",
        "parquet",
        "-o",
        "OUT.parquet",
    ],
    "explain": ["explain", "annotated.mcap", "1", "-o", "OUT"],
    "evidence": ["evidence", "annotated.mcap", "--events", "1", "-o", "OUT"],
    "report": ["report", "annotated.mcap", "-o", "OUT.html"],
    "index": ["index", "annotated.mcap", "-o", "OUT.duckdb"],
    "index folder": ["index", "annotated.mcap", "-o", "OUT"],
}


@pytest.mark.parametrize("command", [c for c in WRITERS if not c.startswith("index")])
def test_an_existing_output_is_never_overwritten(
    folder: Path, fails: Fails, command: str
) -> None:
    out = Path(WRITERS[command][-1].replace("OUT", "there"))
    if out.suffix:
        out.write_text("precious")
    else:
        out.mkdir()
        (out / "mine.txt").write_text("precious")
    words = [w.replace("OUT", "there") for w in WRITERS[command]]
    fails(
        *words,
        message=f"{out} exists already, not overwriting it; give another name or --force",
    )
    if command in (
        "explain",
        "evidence",
    ):  # its files would stand among somebody else's: refused, with --force too
        fails(*words, "--force", code=2, message="holds 'mine.txt' and no")
        assert [p.name for p in out.iterdir()] == ["mine.txt"]
        (out / "mine.txt").unlink()
        assert main(words) == 0
        (out / "mine.txt").write_text("precious")
        fails(*words, message=f"{out} exists already")
    assert main([*words, "--force"]) == 0
    if out.suffix:
        assert out.read_bytes() != b"precious"
    else:
        assert (out / "mine.txt").read_text() == "precious"


@pytest.mark.parametrize("command", [c for c in WRITERS if c.startswith("index")])
def test_an_index_is_added_to_and_never_replaces_what_is_none(
    folder: Path, fails: Fails, command: str
) -> None:
    Path("there.duckdb").write_text("precious")
    Path("there").mkdir()
    Path("there/mine.txt").write_text("precious")
    words = [w.replace("OUT", "there") for w in WRITERS[command]]
    fails(
        *words,
        code=1 if command == "index" else 2,
        message=WRITERS[command][-1].replace("OUT", "there"),
    )


@pytest.mark.parametrize("command", [c for c in WRITERS if "." in WRITERS[c][-1]])
def test_an_output_in_a_missing_folder_is_said(
    folder: Path, fails: Fails, command: str
) -> None:
    fails(
        *[w.replace("OUT", "no/such/out") for w in WRITERS[command]], message="no/such/out"
    )


@pytest.mark.parametrize(
    "command", [c for c in WRITERS if "." in WRITERS[c][-1] and c != "export parquet"]
)
def test_an_output_that_is_a_folder_is_said(
    folder: Path, fails: Fails, command: str
) -> None:
    out = WRITERS[command][-1]
    Path(out).mkdir()
    force = [] if command == "index" else ["--force"]
    fails(*WRITERS[command], *force, message=out)


def locked_folder() -> str | None:
    """A folder in which nobody may make files: root may in any of its own, but not where the
    kernel shows itself.
    """
    if hasattr(os, "geteuid") and os.geteuid() != 0:
        Path("locked").mkdir(mode=0o500)
        return "locked"
    try:
        os.close(os.open("/sys/kernel/scenetrace", os.O_WRONLY | os.O_CREAT))
    except PermissionError:
        return "/sys/kernel"
    except OSError:
        pass
    return None


@pytest.mark.parametrize("command", WRITERS)
def test_an_output_in_a_folder_that_may_not_be_written(
    folder: Path, fails: Fails, command: str
) -> None:
    locked = locked_folder()
    if locked is None:
        pytest.skip("this user may write anywhere")
    fails(*[w.replace("OUT", f"{locked}/out") for w in WRITERS[command]], message=locked)


def test_replaying_into_the_scene_itself_is_refused(folder: Path, fails: Fails) -> None:
    fails(
        "replay",
        "scene.mcap",
        "-o",
        "scene.mcap",
        "--force",
        code=2,
        message="is the recording itself",
    )


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk with room for 3000 bytes of logs."""
    real, room = os.write, 3000

    def write(descriptor: int, data: memoryview) -> int:
        nonlocal room
        room -= len(data)
        if room < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(descriptor, data)

    monkeypatch.setattr("recorders.log.output.os.write", write)


@pytest.mark.usefixtures("full_disk")
@pytest.mark.parametrize("command", ["replay", "recover"])
def test_a_full_disk_is_said(folder: Path, fails: Fails, command: str) -> None:
    fails(*WRITERS[command], message="OUT.mcap: the disk is full")


@pytest.mark.usefixtures("full_disk")
def test_a_disk_that_fills_while_recording_keeps_what_was_recorded(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = listing(folder)
    capsys.readouterr()
    assert main(WRITERS["record"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("scenetrace: error: OUT.mcap: the disk is full")
    assert "keep them with: scenetrace recover OUT.mcap.part -o " in line
    Path("OUT.mcap.part").unlink()
    assert listing(folder) == before


@POSIX
@pytest.mark.parametrize("command", WRITERS)
def test_a_write_that_the_system_refuses_leaves_nothing(
    folder: Path, capfd: pytest.CaptureFixture[str], command: str
) -> None:
    """A file-size limit of the system: every library underneath meets it, not only our own
    writer.
    """
    before = listing(folder)
    # Of a recording something is kept once the record of how it is made, over 1000 bytes by now,
    # has been written.
    limit = 2000 if command == "record" else 700
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    capfd.readouterr()
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        code = main(WRITERS[command])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert code == 1
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("scenetrace: error: ")
    assert "File too large" in line
    assert "OUT" in line
    left = listing(folder)
    if command == "record":
        left.pop("OUT.mcap.part")
    assert left == before


# -- words
# -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--from", "0.8", "--to", "0.4"],
            2,
            "--from 0.8 --to 0.4: an empty",
        ),
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--from", "100"],
            2,
            "--from 100: after the last frame",
        ),
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--to", "0"],
            2,
            "--to 0: before the first frame",
        ),
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--from", "frame:25"],
            2,
            "scene.mcap has frames 0 to 24",
        ),
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--from", "2030-01-01T00:00:00Z"],
            2,
            "after the last frame",
        ),
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--from", "noon"],
            2,
            "time 'noon': must be seconds",
        ),
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--from", "-1"],
            2,
            "time '-1': must be seconds",
        ),
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--checkpoint", "0"],
            2,
            "--checkpoint 0.0: must be over 0",
        ),
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--checkpoint", "nan"],
            2,
            "--checkpoint nan: must be over 0",
        ),
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--checkpoint", "inf"],
            2,
            "--checkpoint inf: must be",
        ),
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--camera", "roof"],
            2,
            "no camera 'roof'; it has: camera",
        ),
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--tracker", "sort"],
            2,
            "unknown tracker 'sort'; there are: events",
        ),
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--set", "events.nonsense=1"],
            2,
            "unknown parameter events.nonsens",
        ),
        (
            ["replay", "scene.mcap", "-o", "o.mcap", "--set", "shell_model.k_s=-1"],
            2,
            "shell_model.k_s = -1.0: must b",
        ),
        (["replay", "scene.mcap", "-o", "o.mcap", "--config", "none.toml"], 2, "none.toml"),
        (["replay", "scene.mcap", "-o", "o.mcap", "--config", "det.txt"], 2, "det.txt"),
        (
            [
                "replay",
                "scene.mcap",
                "-o",
                "o.mcap",
                "--from",
                "0.5",
                "--checkpoints",
                "none.mcap",
            ],
            1,
            "none.mcap",
        ),
        (
            ["record", "img1", "--fps", "5", "-o", "o.mcap", "--camera", "a/b"],
            2,
            "camera name 'a/b'",
        ),
        (
            ["record", "img1", "--fps", "5", "-o", "o.mcap", "--camera", ""],
            2,
            "camera name ''",
        ),
        (
            ["record", "img1", "--fps", "5", "-o", "o.mcap", "--set", "motion.nonsense=1"],
            2,
            "motion.nonsense",
        ),
        (["record", "good", "-o", "o.mcap"], 1, "good: no such file"),
        (
            ["export", "annotated.mcap", "--to", "mot", "-o", "o", "--camera", "roof"],
            2,
            "'roof'",
        ),
        (
            ["export", "annotated.mcap", "--to", "video", "-o", "o.mp4", "--from", "100"],
            1,
            "no frame in the span",
        ),
        (["query", "annotated.mcap", "SELEC 1"], 1, "SQL: "),
        (["query", "annotated.mcap", "SELECT * FROM nonsense"], 1, "SQL: "),
        (
            ["query", "annotated.mcap", "SELECT 1", "--camera", "roof"],
            2,
            "--camera and --date choose within a case",
        ),
        (["query", "none.mcap", "--ask", "met", "1"], 1, "none.mcap"),
        (["query", "annotated.mcap", "--ask", "met"], 2, "met"),
        (["explain", "annotated.mcap", "99999"], 2, "event:99999: there is none"),
        (["explain", "annotated.mcap", "why"], 2, "why"),
        (
            ["evidence", "annotated.mcap", "--events", "99999", "-o", "o"],
            2,
            "event:99999: there is none",
        ),
        (["eval", "annotated.mcap", "--truth", "none.txt"], 1, "none.txt"),
        (["eval", "annotated.mcap", "--truth", "img1"], 1, "img1"),
        (
            ["eval", "annotated.mcap", "--truth", "gt.txt", "--frames", "9000:"],
            1,
            "no truth in the frames to score",
        ),
        (["verify", "annotated.mcap", "--scene", "none.mcap"], 1, "none.mcap"),
        (
            ["diff", "annotated.mcap", "annotated.mcap", "--tolerance", "nan"],
            2,
            "must be at least 0",
        ),
        (["index", "img1", "-o", "o.duckdb"], 2, "no .mcap below img1"),
        (["demo", "-o", "scene.mcap"], 1, "scene.mcap: is a file; name a folder"),
    ],
)
def test_what_is_wrong_with_the_words_is_one_line(
    folder: Path, fails: Fails, words: list[str], code: int, message: str
) -> None:
    fails(*words, code=code, message=message)


def test_a_wrong_name_of_a_parameter_is_answered_with_the_right_one(
    folder: Path, fails: Fails
) -> None:
    Path("c.toml").write_text("[shell_model]\nk_sigma = 0.1\n")
    line = fails("replay", "scene.mcap", "-o", "o.mcap", "--config", "c.toml", code=2)
    assert "shell_model.k_sigma" in line


def test_damage_anywhere_never_gives_a_traceback(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = Path("annotated.mcap").read_bytes()
    chance = random.Random(5)
    for _ in range(25):
        damaged = bytearray(whole)
        begin = chance.randrange(len(whole))
        damaged[begin : begin + chance.choice((1, 8, 300))] = chance.randbytes(
            chance.choice((1, 8, 300))
        )
        Path("bad.mcap").write_bytes(damaged)
        for command in ("replay", "query", "verify --quick", "export mot", "info"):
            words = [*("bad.mcap" if w == "LOG" else w for w in READERS[command])]
            capsys.readouterr()
            code = main([*words, "--force"] if "-o" in words else words)
            said = capsys.readouterr().err
            assert code in (0, 1, 4)
            assert code != 1 or (
                said.startswith("scenetrace: error: bad.mcap") and said.count("\n") == 1
            ), said


# -- interruption
# ------------------------------------------------------------------------------------------------------


def start(*words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *words], stderr=subprocess.PIPE, text=True
    )


def wait_for(path: Path, size: int, process: subprocess.Popen[str]) -> None:
    """Until a file has grown to a size, the process still running."""
    deadline = time.monotonic() + 60
    while not (path.exists() and path.stat().st_size > size):
        assert process.poll() is None, "it ended before it could be interrupted"
        assert time.monotonic() < deadline
        time.sleep(0.005)


@pytest.fixture(scope="module")
def made_long(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene log of ten minutes of detections."""
    return scene_log(
        tmp_path_factory.mktemp("long") / "long.mcap",
        lambda k: channels.encode("detections", one_box(k, k % 100, 10, 20, 50)),
        frames=6_000,
    )


@pytest.fixture
def long_scene(made_long: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """It, alone in the working directory."""
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copy(made_long, tmp_path))


@POSIX
@pytest.mark.parametrize("assignment", ["events.hindsight=false", "events.hindsight=true"])
def test_an_interrupted_replay_leaves_nothing(long_scene: Path, assignment: str) -> None:
    process = start("replay", "long.mcap", "-o", "out.mcap", "--set", assignment)
    wait_for(Path("out.mcap.part"), 0 if assignment.endswith("true") else 50_000, process)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 1
    (line,) = said.splitlines()
    assert line.startswith("scenetrace: error: interrupted")
    assert sorted(p.name for p in Path().iterdir()) == ["long.mcap"]


@POSIX
def test_a_killed_replay_is_no_output_and_is_done_again(
    long_scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    process = start(
        "replay", "long.mcap", "-o", "out.mcap", "--set", "events.hindsight=false"
    )
    wait_for(Path("out.mcap.part"), 50_000, process)
    process.kill()
    process.communicate(timeout=60)
    assert sorted(p.name for p in Path().iterdir()) == ["long.mcap", "out.mcap.part"]
    capsys.readouterr()
    again = [
        "replay",
        "long.mcap",
        "-o",
        "out.mcap",
        "--to",
        "2",
        "--set",
        "events.hindsight=false",
    ]
    assert main(again) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert (
        "out.mcap.part: exists already: another run is writing it, or one was interrupted"
        in line
    )
    assert main([*again, "--force"]) == 0
    assert sorted(p.name for p in Path().iterdir()) == ["long.mcap", "out.mcap"]


@POSIX
def test_a_killed_recording_is_recovered_and_replayed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("det.txt").write_text(
        "".join(f"{f},-1,{f % 50},2,30,40,1\n" for f in range(1, 20_001))
    )
    process = start(
        "record", "det.txt", "--fps", "25", "--size", "99x99", "-o", "scene.mcap"
    )
    wait_for(Path("scene.mcap.part"), 20_000, process)
    process.kill()
    process.communicate(timeout=60)
    assert sorted(p.name for p in Path().iterdir()) == ["det.txt", "scene.mcap.part"]
    capsys.readouterr()
    assert main(["replay", "scene.mcap.part", "-o", "annotated.mcap"]) == 1
    assert "scenetrace recover" in capsys.readouterr().err
    assert main(["recover", "scene.mcap.part", "-o", "scene.mcap"]) == 3
    assert "lost: at byte " in capsys.readouterr().err
    assert main(["doctor", "scene.mcap"]) == 0
    assert main(["replay", "scene.mcap", "-o", "annotated.mcap", "--to", "10"]) == 0
