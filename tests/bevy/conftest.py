"""The real executable of the Bevy example, built by Cargo when the first test asks for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ludus.session import EngineSession, LaunchOptions, open_session
from ludus.wire.handshake import EngineConfig
from tests.legacy.gymgodot.conftest import command_of, started_processes
from tests.targets import find_executable, find_game

TARGET = "bevy:cartpole"

Open = Callable[..., EngineSession]


@pytest.fixture(scope="session")
def executable() -> Path:
    """The example, built; a machine without Cargo fails these tests."""
    return find_executable(TARGET)


@pytest.fixture
def open_game(executable: Path) -> Iterator[Open]:
    """Opens sessions with the example; no process may be left behind."""
    sessions: list[EngineSession] = []

    def open_one(step_timeout_s: float = 60.0, **config: object) -> EngineSession:
        options = LaunchOptions(start_timeout_s=60.0, step_timeout_s=step_timeout_s)
        settings = EngineConfig(**config)  # pyright: ignore[reportArgumentType]
        session = open_session(find_game(executable), settings, options)
        sessions.append(session)
        return session

    yield open_one
    for session in sessions:
        session.close()
    assert processes(executable) == []


def processes(executable: Path) -> list[int]:
    """Return the ids of started processes that run an executable."""
    started = started_processes()
    return [process.pid for process in started if command_of(process)[:1] == [str(executable)]]
