"""A skipped engine test fails the run: a machine without an engine must not look healthy."""

from __future__ import annotations

from typing import Any

import pytest

_skipped: list[str] = []


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note every engine test that was skipped."""
    if report.skipped and "engine" in report.keywords:
        _skipped.append(report.nodeid)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a run that was all right but for skipped engine tests."""
    if _skipped and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Say which ones."""
    for test in _skipped:
        terminalreporter.write_line(f"FAILED: engine test skipped: {test}")
