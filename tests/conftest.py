"""What every run of the tests says at its end, and what is different while a test runs.

A test without the mark ``engine`` finds no engine. A test with the mark ``screen`` is left out
where nothing can be drawn; the last lines of the run name what was left out and what brings it.
With ``CI=true`` a run that left anything out has failed, but for tests with a mark in `EXCUSED`.

Imports of Godot projects are kept (see `kept_imports`).

A busy machine, or a shell that starts the tests in the background, changes nothing. Nor does
chance: every test starts from the same random numbers.
"""

from __future__ import annotations

import os
import random
import secrets
import signal
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Generator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from ludus.engine import (
    EngineKind,
    ExportTemplate,
    InstalledEngine,
    find_engine,
    importing,
    install_template,
    template_installers,
    with_display,
)
from ludus.errors import SetupError
from tests.kept_imports import KeptImports

CLEANRL = Path(__file__).parents[1] / ".venv/libraries/cleanrl"
EXCUSED = {
    "cleanrl": "CleanRL's scripts are missing, which `make test-libraries` downloads from GitHub",
    "cuda": "this machine has no GPU that PyTorch can use",
}
"""Why tests with these marks are left out: no command can be sure to bring what they need."""

_left_out: defaultdict[str, Counter[str]] = defaultdict(Counter)
_patches = pytest.StashKey[pytest.MonkeyPatch]()

# How long an example takes says more about the machine than about what is tested. The examples are
# the same in every run; `--hypothesis-profile=default` looks for new ones, `fast` tries a fifth.
settings.register_profile(
    "ludus", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("fast", settings.get_profile("ludus"), max_examples=20)
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
    return install_template(godot4, installers=template_installers(godot4)[::-1])


def pytest_configure() -> None:
    """Let Ctrl-C reach games: a shell has what it starts in the background ignore it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Leave out what cannot be drawn, and hide the engines from whoever should not start any."""
    if item.get_closest_marker("screen") and (reason := _why_nothing_is_drawn()):
        pytest.skip(reason)
    for mark, is_there in (("cleanrl", _has_cleanrl), ("cuda", _has_gpu)):
        if item.get_closest_marker(mark) and not is_there():
            pytest.skip(EXCUSED[mark])
    _seed_generators()
    patch = item.stash[_patches] = pytest.MonkeyPatch()
    patch.setenv("XDG_STATE_HOME", _own_state().name)
    patch.setenv("XDG_CONFIG_HOME", _own_state().name)
    # Drawing takes half the time of a short run.
    if (loop := sys.modules.get("ludus.training.loop")) and not item.get_closest_marker("curve"):
        patch.setattr(loop, "draw_learning_curve", _draw_nothing)
    if not item.nodeid.startswith("tests/engine/"):  # there, the import itself is tested
        patch.setattr("ludus.engine.importing._run_import", _kept_imports(item.config).run)
    if not (item.get_closest_marker("engine") or item.get_closest_marker("screen")):
        patch.setenv("XDG_CACHE_HOME", _empty_cache().name)
        for variable in ("LUDUS_GODOT", "LUDUS_GODOT3"):
            patch.delenv(variable, raising=False)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None]:
    """Take back what the test saw differently, also where its end fails."""
    try:
        yield
    finally:
        if _patches in item.stash:
            item.stash[_patches].undo()


@cache
def _kept_imports(config: pytest.Config) -> KeptImports:
    folder = config.rootpath / ".pytest_cache" / "godot_imports"
    folder.mkdir(parents=True, exist_ok=True)
    return KeptImports(folder, getattr(importing, "_run_import"))  # noqa: B009 - it is private


@cache
def _own_state() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="ludus-state-")


@cache
def _empty_cache() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="ludus-no-engine-")


@cache
def _why_nothing_is_drawn() -> str:
    """Return why no window can be opened, and what helps; empty if one can."""
    try:
        with_display(("true",))
    except SetupError as error:
        return f"{error.message}; {error.hint}"
    return ""


def _draw_nothing(*_: object) -> bool:
    return False


def _has_cleanrl() -> bool:
    return (CLEANRL / "ppo_continuous_action.py").is_file()  # the last one that comes


@cache
def _has_gpu() -> bool:
    import torch

    return torch.cuda.is_available()


def _seed_generators() -> None:
    """Seed all generators, before the fixtures of the test's module draw anything."""
    _seeds.seed(1)
    random.seed(1)
    np.random.seed(1)
    if (torch := sys.modules.get("torch")) is not None:
        torch.manual_seed(1)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Count the tests that were left out, by reason and file."""
    if report.skipped and isinstance(report.longrepr, tuple):
        reason = report.longrepr[2].removeprefix("Skipped: ")
        _left_out[reason][report.location[0]] += 1


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a run that was all right but for what it left out, where nothing may be."""
    is_strict = os.environ.get("CI") == "true" and session.exitstatus == pytest.ExitCode.OK
    if is_strict and _left_out.keys() - set(EXCUSED.values()):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_unconfigure(config: pytest.Config) -> None:
    """Say at the very end what was left out, and why."""
    reporter: Any = config.pluginmanager.get_plugin("terminalreporter")
    for reason, files in _left_out.items() if reporter else ():
        is_strict = os.environ.get("CI") == "true" and reason not in EXCUSED.values()
        verdict = "FAILED: left out" if is_strict else "left out"
        where = ", ".join(f"{file} ({count})" for file, count in sorted(files.items()))
        reporter.write_line(f"{verdict}: {files.total()} tests, in {where}: {reason}")
