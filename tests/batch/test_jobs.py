"""What a batch has to do, from words."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from recorders.errors import UsageError
from replay.batch.jobs import Job, configuration_digest, filled, source_digest
from replay.batch.sources import sources_of
from replay.cli import parser
from replay.cli.batch import jobs_of
from tests.batch.conftest import WORDS, walk


def names(words: list[str]) -> list[str]:
    return [Path(source).name for source, _ in sources_of(words).found]


def test_a_folder_is_searched_for_what_it_holds(tmp_path: Path) -> None:
    for name in ("b.mp4", "a.mcap", "note.md", ".hidden.mp4", "cam/c.AVI"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "1.jpg").write_bytes(b"x")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("")
    assert names([str(tmp_path)]) == ["a.mcap", "b.mp4", "bag", "c.AVI", "pictures"]


def test_a_pattern_and_a_word_twice_give_each_source_once(tmp_path: Path) -> None:
    for name in ("1.mp4", "2.mp4"):
        (tmp_path / name).write_bytes(b"x")
    assert names([str(tmp_path / "*.mp4"), str(tmp_path / "1.mp4")]) == ["1.mp4", "2.mp4"]


def test_a_list_has_options_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "1.mp4").write_bytes(b"x")
    (tmp_path / "list.txt").write_text("# cameras\n1.mp4 --camera 'gate 4'\n\n")
    assert sources_of([f"@{tmp_path / 'list.txt'}"]).found == [
        (str(tmp_path / "1.mp4"), ["--camera", "gate 4"])
    ]


@pytest.mark.parametrize(
    ("text", "said"),
    [("no.mp4\n", "list.txt:1"), ("\n'open\n", "list.txt:2"), (None, "cannot be read")],
)
def test_a_list_that_is_wrong_is_named_with_its_line(
    tmp_path: Path, text: str | None, said: str
) -> None:
    if text is not None:
        (tmp_path / "list.txt").write_text(text)
    with pytest.raises(UsageError, match=said):
        sources_of([f"@{tmp_path / 'list.txt'}"])


def test_a_word_that_names_nothing_is_wrong() -> None:
    with pytest.raises(UsageError, match="no such file"):
        sources_of(["/nowhere/*.mp4"])


def test_a_remote_place_is_searched_as_a_folder_is(tmp_path: Path) -> None:
    pytest.importorskip("fsspec")
    for name in (
        "a.mp4", "a.jpg", "cam1/b.mp4", "cam1/pictures/1.jpg", "cam1/pictures/more/2.jpg",
        "bag/metadata.yaml", "bag/b.db3", "cam2/.hidden.mp4", "note.md",
    ):  # fmt: skip
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"x")
    place = f"file://{tmp_path}"

    def found(pattern: str) -> list[str]:
        return [
            source.removeprefix(f"{place}/")
            for source, _ in sources_of([f"{place}/{pattern}"]).found
        ]

    everything = ["a.mp4", "bag/", "cam1/b.mp4", "cam1/pictures/"]
    assert found("") == everything
    assert found("**/*.mp4") == ["a.mp4", "cam1/b.mp4"]
    assert found("*.mp4") == ["a.mp4"]
    assert found("cam*") == ["cam1/b.mp4", "cam1/pictures/"]
    assert found("none.mp4") == ["none.mp4"]
    with pytest.raises(UsageError, match="holds no video"):
        found("cam2/")
    here = [
        Path(source).relative_to(tmp_path).as_posix()
        for source, _ in sources_of([str(tmp_path)]).found
    ]
    assert here == [name.rstrip("/") for name in everything]


def test_a_worker_has_everything_loaded(tmp_path: Path) -> None:
    """What is not loaded before the fork is loaded anew for each recording."""
    words = [str(walk(tmp_path / "w.txt", frames=3)), "-o", str(tmp_path / "case"), *WORDS]
    (tmp_path / "job").write_bytes(msgspec.json.encode(jobs(words)[0]))
    script = (
        "import sys, msgspec, pathlib\n"
        "from replay.batch import nursery, steps, jobs\n"
        "nursery.load()\n"
        "from replay.cli import main\n"
        "before = set(sys.modules)\n"
        f"job = msgspec.json.decode(pathlib.Path({str(tmp_path / 'job')!r}).read_bytes(), type=jobs.Job)\n"
        "assert steps.do(job, main).status.state == 'done'\n"
        "print(*sorted(set(sys.modules) - before))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert done.stdout.split() == []


def test_marks_stand_for_the_source() -> None:
    words = ["--camera", "{folder}", "--detections", "{dir}/{stem}.txt", "{name}"]
    assert filled(words, "s3://unit/cam4/12.mp4") == [
        "--camera", "cam4", "--detections", "s3://unit/cam4/12.txt", "12.mp4",
    ]  # fmt: skip
    assert filled(["{stem} of {folder}"], "s3://unit/cam4/pictures/") == [
        "pictures of cam4"
    ]


def test_the_digest_of_a_folder_is_that_of_its_files(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"1")
    before = source_digest(tmp_path)
    (tmp_path / "b").write_bytes(b"2")
    after = source_digest(tmp_path)
    (tmp_path / "b").rename(tmp_path / "c")
    assert len({before, after, source_digest(tmp_path)}) == 3


def test_words_and_version_make_the_configuration() -> None:
    made = {
        configuration_digest(words, version)
        for words in ({"record": ["--fps", "7"]}, {"record": ["--fps", "8"]})
        for version in ("1", "2")
    }
    assert len(made) == 4


def jobs(words: list[str]) -> list[Job]:
    return jobs_of(parser("batch").parse_args(["batch", *words]))[0]


def test_options_of_record_and_replay_are_passed_on(tmp_path: Path) -> None:
    walk(tmp_path / "cam7" / "w.txt")
    (job,) = jobs(
        [
            *(str(tmp_path / "cam7" / "w.txt"), "-o", str(tmp_path / "case"), *WORDS),
            *("--camera", "{folder}", "--tracker", "shells"),
            *(
                "--set",
                "shells.hindsight=false",
                "--set",
                "segmentation.threshold_levels=9",
            ),
        ]
    )
    assert job.record == [
        "--fps", "25", "--camera", "cam7", "--size", "640x480", "--set", "segmentation.threshold_levels=9",
    ]  # fmt: skip
    assert job.replay == ["--tracker", "shells", "--set", "shells.hindsight=false"]


def test_a_file_in_the_words_counts_by_its_bytes(tmp_path: Path) -> None:
    walk(tmp_path / "w.txt")
    words = [str(tmp_path / "w.txt"), "-o", str(tmp_path / "case")]
    made = []
    for name, text in (("a", "{}"), ("b", "{}"), ("c", '{"zones": {}}')):
        (tmp_path / f"{name}.json").write_text(text)
        made.append(jobs([*words, "--regions", str(tmp_path / f"{name}.json")])[0])
    assert made[0].configuration == made[1].configuration != made[2].configuration


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--tracker", "evnts"], "unknown tracker"),
        (["--set", "events.nothing=1"], "nothing"),
        (["--limit", "max_chunks=1"], "no such limit"),
        (["--memory", "-1"], "--memory"),
    ],
)
def test_wrong_words_are_found_before_any_work(
    tmp_path: Path, words: list[str], said: str
) -> None:
    walk(tmp_path / "w.txt")
    with pytest.raises(UsageError, match=said):
        jobs([str(tmp_path / "w.txt"), "-o", str(tmp_path / "case"), *words])
