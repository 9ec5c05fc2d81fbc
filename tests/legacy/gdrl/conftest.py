"""Our stand-in for a game of Godot RL Agents, in real Godot 4."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ludus.legacy.registry import GameAddress, find_bridge, open_bridge_session
from ludus.session import Session
from ludus.spec.batch import ActionBatch, Batch, Batches
from ludus.wire.reset import ResetRequest
from tests.legacy.conftest import nothing_left

__all__ = ["nothing_left"]

TICKS = 4
"""Of a step."""


@pytest.fixture(scope="session")
def walkers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project, since the engine writes into it."""
    folder = tmp_path_factory.mktemp("gdrl") / "walkers"
    shutil.copytree(Path(__file__).with_name("project"), folder)
    return folder


def open_session(
    place: str | Path, max_episode_steps: int | None = None, number: int = 0, **settings: Any
) -> Session:
    bridge = find_bridge("gdrl:")
    assert bridge is not None
    given = {"action_repeat": TICKS, **settings}
    address = GameAddress(address=str(place), number=number)
    return open_bridge_session(bridge, address, given, max_episode_steps)


@pytest.fixture
def opened(walkers: Path, nothing_left: None) -> Iterator[Callable[..., Session]]:
    """Opens sessions of the stand-in."""
    sessions: list[Session] = []

    def open_one(**settings: Any) -> Session:
        sessions.append(open_session(walkers, **settings))
        return sessions[-1]

    yield open_one
    for session in sessions:
        session.close()


def begin(session: Session) -> Batches:
    return session.reset(ResetRequest.all_worlds(1, 7))


def step(session: Session, *speeds: float) -> Batch:
    """Move the two walkers by so much; the watcher stands still. Return the walkers' batch."""
    hops = [[int(speed >= 2.0)] for speed in speeds]
    moves = [[speed - hop[0], 0.0] for speed, hop in zip(speeds, hops, strict=True)]
    session.send(
        {
            "walker": ActionBatch(np.array(hops), np.array(moves, np.float32)),
            "watcher": ActionBatch(np.zeros((1, 1), np.int64), np.zeros((1, 0), np.float32)),
        }
    )
    return session.receive()["walker"]


def places(batch: Batch) -> list[float]:
    return batch.observation["obs"][:, 0].tolist()


def ages(batch: Batch) -> list[float]:
    return batch.observation["obs"][:, 1].tolist()
