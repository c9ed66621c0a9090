"""A tracker of somebody else's, in a package of its own: recorded, replayed, verified, named and
held against a golden file like scenetrace's own.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import scenetrace
from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from recorders.parameters import Config
from replay.configuration import replay_config, sections
from replay.trackers.choice import choose
from replay.trackers.events.parameters import EventsParameters

ROOT = Path(__file__).resolve().parents[2]
DOC = ROOT / "docs" / "golden.md"
# As the installed command runs: without the working folder on the path (-P).
COMMAND = "import sys, scenetrace; sys.exit(scenetrace.main())"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as `pip install` leaves it: the documentation's tracker, with an entry point."""
    folder = tmp_path_factory.mktemp("installed") / "site"
    about = folder / "nearest_tracker-0.3.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: nearest-tracker\nVersion: 0.3\n"
    )
    (about / "entry_points.txt").write_text(
        "[scenetrace.trackers]\nnearest = nearest:Nearest\n"
    )
    code = next(
        block
        for block in re.findall(r"```python\n(.*?)```", DOC.read_text(), re.S)
        if block.startswith("# nearest.py")
    )
    (folder / "nearest.py").write_text(code)
    return folder


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = generate("pass_by", size=(160, 120), frames=40)
    place = tmp_path_factory.mktemp("scene") / "scene.mcap"
    return write_scene_log(found, place, pictures="none", masks=False)


def run(
    *words: Any, site: Path | None = None, folder: Path | None = None, module: str = ""
) -> tuple[int, str]:
    path = [str(p) for p in (site, ROOT) if p is not None]
    done = subprocess.run(
        [
            sys.executable,
            *(("-m", module) if module else ("-P", "-c", COMMAND)),
            *map(str, words),
        ],
        cwd=folder or ROOT,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path)},
    )
    return done.returncode, done.stdout + done.stderr


@pytest.fixture(scope="module")
def annotated(site: Path, scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("annotated") / "annotated.mcap"
    words = (
        "replay",
        scene,
        "-o",
        out,
        "--tracker",
        "nearest",
        "--set",
        "nearest.reach=0.7",
    )
    status, said = run(*words, site=site)
    assert status == 0, said
    return out


def test_it_is_verified_without_being_named(site: Path, annotated: Path) -> None:
    status, said = run("verify", annotated, site=site)
    assert (status, "identical: 40 frames" in said) == (0, True), said
    assert "without effect" not in said


def test_the_log_says_which_tracker_with_version_and_parameters(
    site: Path, annotated: Path
) -> None:
    status, said = run("info", annotated, "--json", site=site)
    assert status == 0, said
    facts = next(
        m["values"] for m in json.loads(said)["metadata"] if m["name"] == "scenetrace"
    )
    assert facts["tracker"] == "nearest"
    assert re.fullmatch(
        r"nearest-tracker 0\.3 sha256:[0-9a-f]{64}", facts["tracker_version"]
    )
    assert json.loads(facts["configuration"])["nearest"] == {"reach": 0.7}
    status, said = run("info", annotated, site=site)
    assert "tracker: nearest" in said
    assert "nearest-tracker 0.3" in said
    status, said = run("config", "--tracker", "nearest", site=site)
    assert (status, "[nearest]" in said, "reach = 0.8" in said) == (0, True, True), said


def test_it_is_as_deterministic_as_any(site: Path, scene: Path, annotated: Path) -> None:
    status, said = run(
        "replay", scene, "--against", annotated, "--checkpoint", 0.5, site=site
    )
    assert (status, "identical: 40 frames" in said) == (0, True), said


def test_without_the_package_verify_says_what_to_install(annotated: Path) -> None:
    status, said = run("verify", annotated)
    assert status == 2
    assert "was made with the tracker 'nearest' (nearest-tracker 0.3 sha256:" in said
    assert "not installed here" in said
    assert "--tracker module:Class" in said


def test_other_code_under_the_same_name_is_told(
    site: Path, annotated: Path, tmp_path: Path
) -> None:
    changed = tmp_path / "site"
    changed.mkdir()
    for file in sorted(site.rglob("*")):
        if file.is_file() and file.suffix != ".pyc":
            copy = changed / file.relative_to(site)
            copy.parent.mkdir(exist_ok=True)
            copy.write_text(file.read_text())
    code = (changed / "nearest.py").read_text()
    (changed / "nearest.py").write_text(code + "\n# a word more\n")
    status, said = run("verify", annotated, site=changed)
    assert (status, "identical" in said) == (0, True), said
    assert "without effect: the code of the tracker nearest was nearest-tracker 0.3" in said
    (changed / "nearest.py").write_text(
        code.replace("self._next_id = 1", "self._next_id = 7")
    )
    status, said = run("verify", annotated, site=changed)
    assert status == 4, said
    assert "reason: the code of the tracker nearest was" in said


def test_a_module_of_the_working_folder_must_be_named(
    site: Path, scene: Path, tmp_path: Path
) -> None:
    out = tmp_path / "a.mcap"
    name = ("--tracker", "nearest:Nearest")
    status, said = run("replay", scene, "-o", out, *name, folder=site)
    assert status == 0, said
    status, said = run("verify", out, folder=site)
    assert (status, "name it: --tracker nearest:Nearest" in said) == (2, True), said
    status, said = run("verify", out, *name, folder=site)
    assert (status, "identical" in said) == (0, True), said
    status, said = run("verify", out, site=site)
    assert (status, "identical" in said) == (0, True), said


def test_a_log_cannot_make_verify_call_what_is_no_tracker(
    site: Path, annotated: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from recorders.annotated.provenance import provenance_of
    from recorders.log import LogReader
    from replay.verification import choice_of

    with LogReader(annotated) as log:
        facts = provenance_of(log)
    monkeypatch.syspath_prepend(site)
    for name in ("os:system", "nearest:dataclass", "nearest:param", "nothing.of.it:X"):
        object.__setattr__(facts, "tracker", name)
        with pytest.raises(scenetrace.UsageError, match="not installed here"):
            choice_of(facts)


def test_it_has_golden_files(site: Path, scene: Path, tmp_path: Path) -> None:
    test = tmp_path / "test_nearest.py"
    call = f"golden_scene({str(scene)!r}, tracker='nearest')"
    test.write_text(f"def test_it(golden_scene):\n    {call}\n")
    plain = ("-q", "-p", "no:randomly", "-p", "no:cacheprovider")
    status, said = run(*plain, site=site, folder=tmp_path, module="pytest")
    assert (status, "was written" in said) == (1, True), said
    # Other processes have been tried; what follows is about the file.
    test.write_text(
        test.read_text().replace("'nearest')", "'nearest', other_process=False)")
    )
    status, said = run(*plain, site=site, folder=tmp_path, module="pytest")
    assert (status, "1 passed" in said) == (0, True), said


class Silent:
    """A tracker that sees nothing."""

    def __init__(self, scene: object, config: Config, word: str = "") -> None:
        self.word = word

    def step(self, frame: scenetrace.Frame) -> scenetrace.Targets:
        return scenetrace.Targets(frame.index)

    def state(self) -> dict[str, str]:
        return {"word": self.word}

    def restore(self, state: Any) -> None:
        self.word = state["word"]


class Looking(Silent):
    HINDSIGHT = True


class Chosen(Silent):
    SECTIONS = {"events": EventsParameters}  # noqa: RUF012


class Failing(Silent):
    def step(self, frame: scenetrace.Frame) -> scenetrace.Targets:
        raise ValueError(f"not frame {frame.index}")


def test_hindsight_is_the_trackers_own_to_ask_for() -> None:
    def wanted(tracker: Any, *words: str) -> bool:
        choice = choose(tracker)
        return choice.wants_hindsight(replay_config(choice, assignments=words))

    assert not wanted(Silent)
    assert wanted(Looking)
    assert wanted(partial(Looking, word="b"))
    assert wanted(Chosen)
    assert not wanted(Chosen, "events.hindsight=false")
    for name in ("events", "shells", "parts"):
        assert wanted(name)
        assert not wanted(name, f"{name}.hindsight=false")


def test_a_class_is_known_by_the_address_that_leads_to_it(
    scene: Path, tmp_path: Path
) -> None:
    choice = choose(Silent)
    assert choice.foreign
    assert choice.name == f"{Silent.__module__}:Silent"
    assert choice.title == "Silent"
    assert choice.version.startswith("sha256:")
    assert not choose("events").version
    assert choose(choose("shells").factory) == choose("shells")
    scenetrace.replay(scene, tmp_path / "a.mcap", Silent)
    verdict = scenetrace.verify(tmp_path / "a.mcap", tracker=Silent)
    assert (verdict.identical, verdict.reasons) == (True, [])


def test_what_goes_wrong_in_it_is_told_with_frame_and_line(
    scene: Path, tmp_path: Path
) -> None:
    said = r"frame 0: the tracker Failing fails: ValueError: not frame 0 \(test_foreign_tracker"
    with pytest.raises(scenetrace.SceneTraceError, match=said):
        scenetrace.replay(scene, tmp_path / "a.mcap", Failing)
    assert not (tmp_path / "a.mcap").exists()


def test_sections_of_scenetraces_own_names_are_refused() -> None:
    class Clashing(Silent):
        SECTIONS = {"relations": EventsParameters, "hindsight": EventsParameters}  # noqa: RUF012

    with pytest.raises(scenetrace.UsageError, match="which is scenetrace's own"):
        sections(Clashing)

    class Wrong(Silent):
        SECTIONS = {"mine": 3}  # noqa: RUF012

    with pytest.raises(scenetrace.SceneTraceError, match="SECTIONS must be a dict"):
        choose(Wrong)
