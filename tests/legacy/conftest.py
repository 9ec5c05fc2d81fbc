"""The games of both bridges: a point on a line, in real Godot 3, by the same numbers.

An action moves it twice; its reward is half its place; beyond 3 the episode ends. The environment
variable WALK_FAULT names what goes wrong in the third or fourth step.
"""

from __future__ import annotations

import shutil
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from ludus.legacy.godot_gym_api.messages import State
from ludus.legacy.registry import GameAddress, find_bridge, open_bridge_session
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.session import Session
from ludus.spec.batch import ActionBatch, Batch
from ludus.wire.reset import ResetRequest
from tests.legacy.godot_gym_api.compiled import WALK
from tests.legacy.godot_gym_api.conftest import make_project
from tests.legacy.gymgodot import conftest as gymgodot
from tests.legacy.gymgodot.conftest import left_processes, left_threads


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark all tests of this folder, before `-m` chooses."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker("legacy")


@dataclass(frozen=True)
class Walk:
    """How to open the game of one bridge.

    Attributes:
        target: As ``ludus.make`` takes it.
        settings: As well.
    """

    target: str
    settings: dict[str, Any] = field(default_factory=dict[str, Any])

    def pool(self, **config: Any) -> EnginePool:
        return open_pool(self.target, PoolConfig(bridge=self.settings, **config))

    def session(self, max_episode_steps: int | None = None, **settings: Any) -> Session:
        bridge = find_bridge(self.target)
        assert bridge is not None
        place = GameAddress(address=bridge.place_of(self.target))
        settings = {**self.settings, **settings}
        return open_bridge_session(bridge, place, settings, max_episode_steps)


def get_place(state: State) -> list[float]:
    return [state["agent"].place]


def get_reward(state: State) -> float:
    return state["agent"].place / 2.0


def is_far(state: State) -> bool:
    return state["agent"].place > 3.0


GODOT_GYM_API: dict[str, Any] = {
    "action_space": spaces.Box(-1.0, 1.0, ()),
    "observation_space": spaces.Box(-np.inf, np.inf, (1,)),
    "get_observation": get_place,
    "get_reward": get_reward,
    "is_terminated": is_far,
    "engine_address": ("127.0.0.1", 0),
    "configuration": {"environment": {"repeat_action": 2}},
}
GYMGODOT: dict[str, Any] = {
    "action_space": spaces.Box(-1.0, 1.0, (1,)),
    "observation_space": spaces.Box(-np.inf, np.inf, (3,)),
}


@pytest.fixture(scope="session")
def projects(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A folder for each way to speak."""
    folder = tmp_path_factory.mktemp("walks")
    shutil.copytree(Path(gymgodot.__file__).with_name("project"), folder / "gymgodot")
    json, protobuf = make_project(folder / "json"), make_project(folder / "protobuf")
    shutil.copy(protobuf / "protobuf/protobuf_message.gd", protobuf)
    return {"gymgodot": folder / "gymgodot" / "walk.tscn", "json": json, "protobuf": protobuf}


KINDS = ("gymgodot", "json")
"""Bridges. Answers in protobuf differ in decoding only, which tests of godot_gym_api hold."""


@pytest.fixture(params=KINDS)
def walk(request: pytest.FixtureRequest, projects: dict[str, Path]) -> Walk:
    """Our game, for each bridge."""
    return walk_of(request.param, projects)


def walk_of(kind: str, projects: dict[str, Path]) -> Walk:
    path = projects[kind]
    if kind == "gymgodot":
        return Walk(f"gymgodot:{path}", GYMGODOT)
    module = WALK if kind == "protobuf" else None
    settings = {**GODOT_GYM_API, "protobuf_message_module": module}
    return Walk(f"godot_gym_api:{path}", settings)


@pytest.fixture
def session(walk: Walk, nothing_left: None) -> Iterator[Session]:
    """A session with one game."""
    opened = walk.session()
    yield opened
    opened.close()


@pytest.fixture
def nothing_left() -> Iterator[None]:
    """No process and no thread may be left behind."""
    before = set(threading.enumerate())
    yield
    assert left_processes() == []
    assert left_threads(before) == set()


def move(*values: float) -> dict[str, ActionBatch]:
    """Return one action per game."""
    continuous = np.array(values, np.float32)[:, None]
    return {"agent": ActionBatch(np.zeros((len(values), 0), np.int64), continuous)}


def step(session: Session, value: float) -> Batch:
    session.send(move(value))
    return session.receive()["agent"]


def begin(session: Session, seed: int | None = None, parameters: Any = None) -> Batch:
    return session.reset(ResetRequest.all_worlds(1, seed, parameters))["agent"]


def place_of(batch: Batch) -> float:
    (place, *_) = batch.observation["observation"][0].tolist()
    return place


def final_place_of(batch: Batch) -> float:
    (final,) = batch.final_observation["observation"]
    return final.tolist()[0]
