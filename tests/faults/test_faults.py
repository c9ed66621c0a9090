"""Each kind of fault, some tries of it; `python tests/faults --long` does all."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from tests.faults.damage import cuts, flips
from tests.faults.fuzz import fuzz
from tests.faults.hostile import hostile
from tests.faults.io_faults import compiler, io_faults
from tests.faults.kills import kills
from tests.faults.tally import Tally


def check(found: Iterable[Tally]) -> None:
    tallies = list(found)
    assert tallies
    assert all(tally.tries for tally in tallies)
    assert [note for tally in tallies for note in tally.notes if not tally.clean] == []


def test_flipped_bytes_are_errors_or_change_nothing() -> None:
    check(flips(long=False))


def test_cut_logs_are_errors() -> None:
    check(cuts(long=False))


def test_what_others_wrote_is_read_or_refused() -> None:
    check(fuzz(long=False))


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_calls_that_fail_leave_nothing_half() -> None:
    check(io_faults(long=False))


@pytest.mark.slow
@pytest.mark.long
def test_killed_commands_leave_nothing_half() -> None:
    check(kills(long=False, tries=2))


@pytest.mark.slow
def test_hostile_files_stay_within_memory_and_time() -> None:
    check(hostile(long=False))
