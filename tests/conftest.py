"""A skipped engine test fails the run: a machine without an engine must not look healthy.

A busy machine, or a shell that starts the tests in the background, changes nothing. Nor does
chance: every test starts from the same random numbers.
"""

from __future__ import annotations

import random
import secrets
import signal
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from ludus.engine import EngineKind, InstalledEngine, find_engine
from ludus.engine.debian_template import DebianTemplateRoute
from ludus.engine.install_template import install_template
from ludus.engine.official_template import OfficialTemplateRoute
from ludus.engine.template import ExportTemplate

_skipped: list[str] = []

# How long an example takes says more about the machine than about what is tested. The examples are
# the same in every run; `--hypothesis-profile=default` looks for new ones.
settings.register_profile(
    "ludus", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("ludus")

# Seeds that nobody chose come from here in Ludus, too.
_seeds = random.Random()
secrets.randbits = _seeds.getrandbits


@pytest.fixture(scope="session")
def godot4() -> InstalledEngine:
    """The real engine; a machine without one fails these tests."""
    return find_engine(EngineKind.GODOT4)


@pytest.fixture(scope="session")
def template(godot4: InstalledEngine) -> ExportTemplate:
    """The real export template; a machine that cannot get one fails these tests."""
    # Debian's first: the official archive has the templates of all platforms, ten times the size.
    return install_template(godot4, routes=(DebianTemplateRoute(), OfficialTemplateRoute()))


def pytest_configure() -> None:
    """Let Ctrl-C reach games: a shell has what it starts in the background ignore it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Seed all generators, before the fixtures of the test's module draw anything."""
    _seeds.seed(1)
    random.seed(1)
    np.random.seed(1)
    if (torch := sys.modules.get("torch")) is not None:
        torch.manual_seed(1)


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
