"""scenetrace: record camera scenes, replay them deterministically, ask who interacted with whom.

This module is the public library: what stands in `__all__` stays as it is described in
docs/library.md. The rooms beside it (`recorders`, `reasoning`, `replay`, `fixtures`) are private
by convention. Nothing is imported before it is asked for.

>>> # import scenetrace
>>> # scenetrace.replay("scene.mcap", "annotated.mcap", "events")
>>> # with scenetrace.open("annotated.mcap") as log:
>>> #     print(log[280].present, log.ask("met", 3))
"""

from __future__ import annotations

import os.path
import sys
from importlib import import_module

TYPE_CHECKING = False  # importing `typing` and `pathlib` would take longer than all of this
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path
    from typing import Any

    from reasoning.questions.ready_questions import Question
    from recorders.detectors.detector import Detector, Sighting
    from recorders.errors import (
        ConfigError,
        OutputExistsError,
        RecordingError,
        SceneTraceError,
        SourceError,
        UsageError,
    )
    from recorders.messages import (
        Box,
        Detections,
        Event,
        Graph,
        Group,
        Notice,
        Regions,
        Relation,
        Target,
        Targets,
        Track,
    )
    from recorders.parameters import Parameters, param
    from recorders.scene import Frame, SceneInfo, SceneLog
    from recorders.sources import Source, SourceFrame
    from replay.compare import CompareOptions, Comparison
    from replay.compare import compare as diff
    from replay.engine import Engine
    from replay.library import (
        OpenLog,
        Rows,
        SceneFrame,
        ask,
        evaluate,
        query,
        record,
        replay,
        to_detections,
    )
    from replay.library import OpenLog as open  # noqa: A004, N813
    from replay.library import graph_of as to_networkx
    from replay.trackers.tracker import Tracker
    from replay.verification import Verification, verify

    __version__: str

__all__ = [
    "Box",
    "CompareOptions",
    "Comparison",
    "ConfigError",
    "Detections",
    "Detector",
    "Engine",
    "Event",
    "Frame",
    "Graph",
    "Group",
    "Notice",
    "OpenLog",
    "OutputExistsError",
    "Parameters",
    "Question",
    "RecordingError",
    "Regions",
    "Relation",
    "Rows",
    "SceneFrame",
    "SceneInfo",
    "SceneLog",
    "SceneTraceError",
    "Sighting",
    "Source",
    "SourceError",
    "SourceFrame",
    "Target",
    "Targets",
    "Track",
    "Tracker",
    "UsageError",
    "Verification",
    "__version__",
    "ask",
    "diff",
    "evaluate",
    "open",
    "param",
    "query",
    "record",
    "replay",
    "to_detections",
    "to_networkx",
    "verify",
]

_ROOMS = ("recorders", "reasoning", "replay", "fixtures")
_HOME = os.path.dirname(os.path.realpath(__file__))
_PLACES = {
    "reasoning.questions.ready_questions": "Question",
    "recorders.detectors.detector": "Detector Sighting",
    "recorders.errors": "ConfigError OutputExistsError RecordingError SceneTraceError"
    " SourceError UsageError",
    "recorders.messages": "Box Detections Event Graph Group Notice Regions Relation Target"
    " Targets Track",
    "recorders.parameters": "Parameters param",
    "recorders.scene": "Frame SceneInfo SceneLog",
    "recorders.sources": "Source SourceFrame",
    "replay.compare": "CompareOptions Comparison diff=compare",
    "replay.engine": "Engine",
    "replay.library": "OpenLog Rows SceneFrame ask evaluate open=OpenLog query record replay"
    " to_detections to_networkx=graph_of",
    "replay.trackers.tracker": "Tracker",
    "replay.verification": "Verification verify",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for (PEP 562)."""
    if name == "__version__":
        from importlib.metadata import version

        found: Any = version("scenetrace")
    elif name == "pytest_plugin":
        found = _pytest_plugin()
    else:
        for module, words in _PLACES.items():
            for word in words.split():
                public, _, private = word.partition("=")
                if public == name:
                    found = getattr(_room(module), private or public)
                    globals()[name] = found
                    return found
        raise AttributeError(f"module 'scenetrace' has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def main(argv: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code.

    The process is ours alone, so what hides a room on Python's path (a project's own folder
    ``fixtures/``) does not matter here: the room is taken from beside this module.
    """
    for room in _hidden(_ROOMS):
        if room in sys.modules:
            break  # somebody's own program calls us: it needs its own, and is told below
        _load_from_here(room)
    run: Callable[[Sequence[str] | None], int] = _room("replay.cli").main
    return run(argv)


def _load_from_here(room: str) -> None:
    from importlib.util import module_from_spec, spec_from_file_location

    folder = os.path.join(_HOME, room)
    spec = spec_from_file_location(
        room, os.path.join(folder, "__init__.py"), submodule_search_locations=[folder]
    )
    assert spec is not None
    assert spec.loader is not None
    sys.modules[room] = module_from_spec(spec)
    spec.loader.exec_module(sys.modules[room])


def _room(module: str) -> Any:
    """Import a module of ours.

    Raises:
        ImportError: folders or modules of the user's own hide ours; names them.
    """
    hidden = _hidden(_ROOMS[:3])
    if hidden:
        raise ImportError("; ".join(hidden.values()))
    return import_module(module)


def _hidden(rooms: Sequence[str]) -> dict[str, str]:
    """Rooms that something else hides on Python's path, with a line on what and what to do.

    Imports nothing.
    """
    from importlib.util import find_spec

    lines = {}
    for room in rooms:
        loaded = sys.modules.get(room)
        try:
            spec = find_spec(room) if loaded is None else loaded.__spec__
        except (ImportError, ValueError):
            spec = None
        ways = (
            [] if spec is None else [spec.origin, *(spec.submodule_search_locations or ())]
        )
        places = [os.path.realpath(way) for way in ways if way]
        own = os.path.join(_HOME, room)
        if not any(place == own or os.path.dirname(place) == own for place in places):
            place = places[0] if places else "something else"
            place = place.removesuffix("__init__.py").rstrip(os.sep)
            lines[room] = (
                f"scenetrace: {place} hides the package {room!r} of scenetrace: rename it, or"
                " take it off Python's path"
            )
    return lines


def _pytest_plugin() -> object:
    """The pytest plug-in: fixture `golden_scene`, option `--scenetrace-update NAME`, see
    docs/golden.md.

    It imports nothing of the rooms before a test asks for the fixture: pytest loads it in every
    project of an environment, and some have folders of the rooms' names.
    """
    import pytest

    update = "--scenetrace-update"
    used_names: pytest.StashKey[list[str]] = pytest.StashKey()
    users: pytest.StashKey[list[tuple[Path, str, str]]] = pytest.StashKey()
    owners: pytest.StashKey[Any] = pytest.StashKey()

    def missing(config: pytest.Config) -> list[str]:
        # With pytest-xdist the tests run in workers, and this process sees none of the names.
        if getattr(config.option, "numprocesses", None):
            return []
        return [n for n in config.getoption(update) if n not in config.stash[used_names]]

    class Plugin:
        def pytest_addoption(self, parser: pytest.Parser) -> None:
            parser.getgroup("scenetrace", "golden files of scenetrace").addoption(
                update,
                action="append",
                default=[],
                metavar="NAME",
                help="write the golden file NAME.mcap anew (the run fails); may be repeated,"
                " there is no way to name them all",
            )

        def pytest_configure(self, config: pytest.Config) -> None:
            config.stash[used_names], config.stash[users] = [], []

        def pytest_collection_finish(self, session: pytest.Session) -> None:
            session.config.stash[users] = [
                (item.path.parent, item.name, item.nodeid)
                for item in session.items
                if "golden_scene" in getattr(item, "fixturenames", ())
            ]

        @pytest.fixture
        def golden_scene(
            self, request: pytest.FixtureRequest, tmp_path: Path
        ) -> Callable[..., object]:
            """Replay a scene log through a tracker and hold it against the golden file beside
            the test.

            ``golden_scene(log, tracker="events", config=None, tolerance=0.0)``; see
            docs/golden.md.
            """
            try:
                golden_module = _room("replay.golden.scene")
            except ImportError as e:
                pytest.fail(str(e), pytrace=False)
            stash, node = request.config.stash, request.node
            if owners not in stash:
                stash[owners] = _room("replay.golden.file_names").Owners()
                stash[owners].collected(stash[users])
            folder = node.path.parent
            scratch = tmp_path / "scenetrace-golden"
            scratch.mkdir()
            golden = golden_module.GoldenScene(
                folder=folder,
                name=node.name,
                scratch=scratch,
                update=frozenset(request.config.getoption(update)),
                used=stash[used_names].append,
                claim=lambda name, given: stash[owners].claim(
                    folder, name, node.nodeid, given
                ),
            )

            def run(*args: object, **more: object) -> object:
                __tracebackhide__ = True
                try:
                    return golden(*args, **more)
                except golden_module.GoldenError as e:
                    words = str(e)
                # Outside the handler: the text is the whole story, a chain would bury it.
                return pytest.fail(words, pytrace=False)

            return run

        def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
            # A name that no test used is an error: nothing was updated.
            good = (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED)
            if exitstatus in good and missing(session.config):
                session.exitstatus = pytest.ExitCode.USAGE_ERROR

        def pytest_terminal_summary(
            self, terminalreporter: pytest.TerminalReporter, config: pytest.Config
        ) -> None:
            for name in missing(config):
                terminalreporter.write_line(
                    f"{update} {name}: no test that ran has a golden file of that name"
                )

    return Plugin()
