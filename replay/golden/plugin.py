"""The pytest plugin: fixture `golden_scene`, option `--scenetrace-update NAME`. See
docs/golden.md.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from replay.golden.file_names import Owners

_USED = pytest.StashKey[list[str]]()
_OWNERS = pytest.StashKey[Owners]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare the option."""
    group = parser.getgroup("scenetrace", "golden files of scenetrace")
    group.addoption(
        "--scenetrace-update",
        action="append",
        default=[],
        metavar="NAME",
        help=(
            "write the golden file NAME.mcap anew (the run fails); may be repeated, there"
            " is no way to name them all"
        ),
    )


def pytest_configure(config: pytest.Config) -> None:
    """Prepare to count which names are used."""
    config.stash[_USED] = []
    config.stash[_OWNERS] = Owners()


def pytest_collection_finish(session: pytest.Session) -> None:
    """Note which tests would name a golden file: two of one name in a folder are told when they
    run.
    """
    users = (
        item
        for item in session.items
        if "golden_scene" in getattr(item, "fixturenames", ())
    )
    session.config.stash[_OWNERS].collected(
        (item.path.parent, item.name, item.nodeid) for item in users
    )


@pytest.fixture
def golden_scene(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., object]:
    """Replay a scene log through a tracker and hold it against the golden file beside the test.

    ``golden_scene(log, tracker="events", config=None, tolerance=0.0)``; see
    `replay.golden.scene.GoldenScene`.
    """
    from replay.golden.scene import GoldenError, GoldenScene

    used, owners = request.config.stash[_USED], request.config.stash[_OWNERS]
    folder = Path(request.node.path).parent
    scratch = tmp_path / "scenetrace-golden"
    scratch.mkdir()
    golden = GoldenScene(
        folder=folder,
        name=request.node.name,
        scratch=scratch,
        update=frozenset(request.config.getoption("--scenetrace-update")),
        used=used.append,
        claim=lambda name, given: owners.claim(folder, name, request.node.nodeid, given),
    )

    def run(*args: object, **more: object) -> object:
        __tracebackhide__ = True
        try:
            return golden(*args, **more)  # type: ignore[arg-type]
        except GoldenError as e:
            words = str(e)
        # Outside the handler: the text is the whole story, a chain of exceptions would bury it.
        return pytest.fail(words, pytrace=False)

    return run


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """A name that no test used is an error: nothing was updated."""
    missing = _missing(session.config)
    if missing and exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
        session.exitstatus = pytest.ExitCode.USAGE_ERROR


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Say which names were not used."""
    for name in _missing(config):
        terminalreporter.write_line(
            f"--scenetrace-update {name}: no test that ran has a golden file of that name"
        )


def _missing(config: pytest.Config) -> list[str]:
    # With pytest-xdist the tests run in workers, and this process sees none of the names.
    if getattr(config.option, "numprocesses", None):
        return []
    return [
        name
        for name in config.getoption("--scenetrace-update")
        if name not in config.stash[_USED]
    ]
