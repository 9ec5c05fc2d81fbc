"""Opens environments of small programs that speak GymGodot's wire; nothing may stay behind."""

from __future__ import annotations

import shlex
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import psutil
import pytest

import ludus
from ludus.legacy.gymgodot.env import GymGodotEnv

ROOT = Path(__file__).parents[3]
ACTIONS = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
_DEADLINE_S = 20.0
_NO_GAMES = {"", "sh", "dash", "bash", "sleep"}
OBSERVATIONS = gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float32)


class Opener:
    """Opens environments by ``gymnasium.make``, and closes them."""

    def __init__(self) -> None:
        self._opened: list[gymnasium.Env[Any, Any]] = []

    def open(self, command: str, **settings: Any) -> gymnasium.Env[Any, Any]:
        arguments: dict[str, Any] = {
            "serverPort": 0,
            "action_space": ACTIONS,
            "observation_space": OBSERVATIONS,
            "start_timeout_s": 30.0,
            "step_timeout_s": 30.0,
            "exeCmd": command,
            **settings,
        }
        env = gymnasium.make("ludus/GymGodot-v0", **arguments)
        self._opened.append(env)
        return env

    def fake(self, name: str, **settings: Any) -> gymnasium.Env[Any, Any]:
        return self.open(fake_command(name), **settings)

    def close(self) -> None:
        for env in self._opened:
            env.close()


def fake_command(name: str) -> str:
    python = shlex.quote(sys.executable)
    return f"cd {shlex.quote(str(ROOT))} && {python} -m tests.legacy.gymgodot.fake_game {name}"


def game_of(env: gymnasium.Env[Any, Any]) -> GymGodotEnv:
    unwrapped = env.unwrapped
    assert isinstance(unwrapped, GymGodotEnv)
    return unwrapped


def started_processes() -> list[psutil.Process]:
    """Return the processes that this one started, and those that they started.

    Python's own servers for multiprocessing are left out, which stay as long as it does.
    """
    return [each for each in psutil.Process().children(recursive=True) if not _stays(each)]


def _stays(process: psutil.Process) -> bool:
    try:
        command = " ".join(process.cmdline())
    except psutil.NoSuchProcess:
        return True
    return "multiprocessing.forkserver" in command or "multiprocessing.resource_tracker" in command


def left_processes() -> list[str]:
    """Return the commands of started processes that do not go."""
    await_so(lambda: not started_processes())
    return [str(child) for child in started_processes()]


def left_threads(before: set[threading.Thread]) -> set[threading.Thread]:
    """Return the threads that have come since, and do not go."""
    await_so(lambda: set(threading.enumerate()) <= before)
    return set(threading.enumerate()) - before


def await_so(is_so: Callable[[], bool]) -> None:
    """Wait until something is so; on a busy machine even an end takes its time."""
    deadline = time.monotonic() + _DEADLINE_S
    while not is_so() and time.monotonic() < deadline:
        time.sleep(0.02)


def command_of(process: psutil.Process) -> list[str]:
    """Return the command line of a process; nothing if it has ended."""
    try:
        return process.cmdline()
    except psutil.NoSuchProcess:
        return []


def running_game() -> psutil.Process:
    """Return the process of the one game that runs."""
    (game,) = running_games()
    return game


def running_games() -> list[psutil.Process]:
    """Return the processes of games, without their shells and what ends them with us."""
    return [process for process in started_processes() if _name(process) not in _NO_GAMES]


def _name(process: psutil.Process) -> str:
    try:
        return process.name()
    except psutil.NoSuchProcess:
        return ""


@pytest.fixture
def opener() -> Iterator[Opener]:
    """Opens environments; no process and no thread may be left behind."""
    assert ludus.__version__
    before = set(threading.enumerate())
    made = Opener()
    yield made
    made.close()
    assert left_processes() == []
    assert left_threads(before) == set()
