"""Processor time of each test, its fixtures and the processes it started included: clocks say little
on a machine that others use as well. A plug-in of pytest, which `python tests --times` loads.
"""

from __future__ import annotations

import resource
import time
from collections import defaultdict
from collections.abc import Generator
from typing import Any

import pytest

SHOWN = 20


def spent_s() -> float:
    """Processor seconds of this process and of its children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


class ProcessorTime:
    """Adds the seconds to every report; prints the sums of folders and files, and the dearest tests."""

    def __init__(self) -> None:
        self.start = spent_s()
        self.phase_start = self.start
        self.by_test: defaultdict[str, float] = defaultdict(float)
        self.by_file: defaultdict[str, float] = defaultdict(float)
        self.by_folder: defaultdict[str, float] = defaultdict(float)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_makereport(self, item: pytest.Item) -> Generator[None, Any, Any]:
        report = yield
        now = spent_s()
        report.processor_s = now - self.phase_start
        self.phase_start = now
        return report

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_logstart(self) -> None:
        self.phase_start = spent_s()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        seconds = getattr(report, "processor_s", 0.0)
        self.by_test[f"{report.nodeid} ({report.when})"] += seconds
        file = report.nodeid.split("::")[0]
        self.by_file[file] += seconds
        self.by_folder["/".join(file.split("/")[:-1][:2]) or "."] += seconds

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        out = terminalreporter
        out.section("processor time")
        for title, table in (
            ("folder", self.by_folder),
            ("file", self.by_file),
            ("test", self.by_test),
        ):
            dearest = sorted(table.items(), key=lambda row: -row[1])
            for name, seconds in dearest[: SHOWN if title == "test" else None]:
                if seconds >= 0.05:
                    out.write_line(f"{seconds:8.2f} s  {title}  {name}")
        tests = sum(self.by_file.values())
        out.write_line(f"{tests:8.2f} s  all tests")
        out.write_line(f"{spent_s() - self.start:8.2f} s  this process and its children")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(ProcessorTime(), "processor-time-of-tests")
