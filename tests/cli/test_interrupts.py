"""Ctrl-C between frames: where it takes effect, and that it does at once the second time."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator

import pytest

from replay.cli.common import ends_at_interrupt, interrupts_at

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals")


@pytest.fixture(autouse=True)
def python_s_own_handlers() -> Iterator[None]:
    # Libraries that other tests of this process load (Ray) have handlers of their own.
    before = {
        signal.SIGINT: signal.signal(signal.SIGINT, signal.default_int_handler),
        signal.SIGTERM: signal.signal(signal.SIGTERM, signal.SIG_DFL),
    }
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_an_interrupt_waits_for_the_next_report() -> None:
    reported: list[int] = []
    with interrupts_at(reported.append) as report:
        report(1)
        signal.raise_signal(signal.SIGINT)  # and goes on
        with pytest.raises(KeyboardInterrupt):
            report(2)
    assert reported == [1]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_second_interrupt_waits_for_nothing() -> None:
    with interrupts_at(print):
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_who_handles_interrupts_otherwise_goes_on_doing_so() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with interrupts_at(print) as report:
        assert report is print
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_other_threads_than_the_main_one_get_no_signals() -> None:
    found: list[bool] = []

    def work() -> None:
        with interrupts_at(print) as report:
            found.append(report is print)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [True]


def test_a_service_that_ignores_interrupts_is_ended_by_sigterm() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stopped: list[bool] = []
    with ends_at_interrupt(lambda: stopped.append(True)):
        signal.raise_signal(signal.SIGINT)
        assert stopped == []
        signal.raise_signal(signal.SIGTERM)
    assert stopped == [True]
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
