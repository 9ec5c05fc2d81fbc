"""Opens environments, and lets no process stay behind."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

import ludus
from ludus.engine.bundled import runnable_bundled_root
from ludus.engine.kinds import EngineKind
from ludus.engine.script_classes import add_script_classes, find_script_classes
from ludus.legacy.godot_gym_api import GodotClient
from ludus.legacy.godot_gym_api.messages import State
from tests.legacy.gymgodot.conftest import left_processes, left_threads

ALL: dict[str, list[str]] = {"agent": [], "world": []}
CLASSES = ("Communication", "PhysicsFramesTimer", "RLAgent", "RLEnvWorld", "RLEnvironment")


def get_reward(state: State) -> float:
    return state["agent"].place / 2.0


def is_far(state: State) -> bool:
    return state["agent"].place > 3.0


WALK_SPACES: dict[str, Any] = {
    "action_space": spaces.Box(-1.0, 1.0, ()),
    "observation_space": spaces.Dict({"place": spaces.Box(-np.inf, np.inf, ())}),
    "get_reward": get_reward,
    "is_terminated": is_far,
}


class Opener:
    """Opens clients and environments, and closes them."""

    def __init__(self) -> None:
        self._opened: list[Any] = []

    def client(self, *arguments: Any, **settings: Any) -> GodotClient:
        return self._kept(GodotClient(*arguments, **_with_deadlines(settings)))

    def env(self, **settings: Any) -> gymnasium.Env[Any, Any]:
        arguments = {**WALK_SPACES, **_with_deadlines(settings)}
        return self._kept(gymnasium.make("ludus/GodotGymApi-v0", **arguments))

    def close(self) -> None:
        for opened in self._opened:
            opened.close()

    def _kept(self, opened: Any) -> Any:
        self._opened.append(opened)
        return opened


def _with_deadlines(settings: dict[str, Any]) -> dict[str, Any]:
    return {"start_timeout_s": 30.0, "step_timeout_s": 30.0, **settings}


@pytest.fixture
def opener() -> Iterator[Opener]:
    """Opens things; no process and no thread may be left behind."""
    assert ludus.__version__
    before = set(threading.enumerate())
    made = Opener()
    yield made
    made.close()
    assert left_processes() == []
    assert left_threads(before) == set()


@pytest.fixture(scope="session")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Our game with our classes; it answers in JSON."""
    return make_project(tmp_path_factory.mktemp("walk") / "project")


@pytest.fixture(scope="session")
def protobuf_project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with a protobuf message, where godot_gym_api wants it."""
    folder = make_project(tmp_path_factory.mktemp("walk") / "project")
    shutil.copy(folder / "protobuf/protobuf_message.gd", folder)
    return folder


def make_project(folder: Path) -> Path:
    """Copy our game and our classes into it."""
    shutil.copytree(Path(__file__).with_name("project"), folder)
    addon = folder / "addons/ludus_classic"
    shutil.copytree(runnable_bundled_root(EngineKind.GODOT3) / "addons/ludus_classic", addon)
    found = find_script_classes(addon, "res://addons/ludus_classic")
    file = folder / "project.godot"
    scripts = [script for script in found if script.name in CLASSES]
    assert len(scripts) == len(CLASSES)
    file.write_text(add_script_classes(file.read_text(), scripts))
    return folder
