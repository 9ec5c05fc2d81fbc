"""A small Godot project whose scenes and scripts go wrong in many ways, and a real engine."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from ludus.engine.bundled import bundled_root
from ludus.session import EngineSession, LaunchOptions, open_session
from ludus.spec.batch import ActionBatch, Batches
from ludus.wire.handshake import EngineConfig
from ludus.wire.reset import ResetRequest
from tests.targets import find_game

PROJECT = """\
config_version=5

[application]

config/name="Faults"
config/features=PackedStringArray("4.4")
run/main_scene="res://right.tscn"

[debug]

file_logging/enable_file_logging=false
file_logging/enable_file_logging.pc=false
"""

# Counts its steps, and goes wrong at step 3 in the way that the parameter `fault` names.
GAME = """\
extends Node
var steps := 0
var fault := ""
func ludus_is(name: String) -> bool:
	return fault == name and steps == 3
func apply_action(_action: int) -> void:
	if ludus_is("apply_action"):
		var nobody: Node = null
		nobody.queue_free()
	while ludus_is("hang"):
		pass
func get_observation() -> Variant:
	if ludus_is("get_observation"):
		var nothing: Variant = null
		return nothing.size()
	if ludus_is("size"):
		return PackedFloat32Array([1.0])
	return {"steps": [steps], "rays": PackedFloat32Array([1, NAN if ludus_is("nan") else 2.0, 3])}
func get_reward() -> float:
	steps += 1
	return INF if ludus_is("reward") else 1.0
func is_done() -> bool:
	return false
func reset() -> void:
	steps = 0
	fault = LudusWorld.of(self).parameters.get("fault", "")
"""

SCRIPTS = {
    "game": GAME,
    "no_reset": GAME.replace("func reset(", "func begin("),
    "hangs": GAME + "func _ready() -> void:\n\twhile true:\n\t\tpass\n",
    "broken": GAME + "this is no GDScript\n",
    "quits": GAME + "func _ready() -> void:\n\tOS.kill(OS.get_process_id())\n",
}

HEAD = """\
[gd_scene format=3]
[ext_resource type="Script" path="res://{script}.gd" id="1"]
[ext_resource type="Script" path="res://addons/ludus/agent/ludus_agent.gd" id="2"]
[ext_resource type="Script" path="res://addons/ludus/agent/ludus_action_component.gd" id="3"]
[sub_resource type="Resource" id="a"]
script = ExtResource("3")
[node name="Root" type="Node"]
[node name="Cart" type="Node" parent="."]
script = ExtResource("1")
"""
AGENT = """\
[node name="{name}" type="Node" parent="Cart"]
script = ExtResource("2")
ticks_per_step = {ticks}
"""
ACTION = 'action = Array[ExtResource("3")]([SubResource("a")])\n'
RIGHT_AGENT = AGENT.format(name="LudusAgent", ticks=1) + ACTION

SCENES = {
    "right": HEAD.format(script="game") + RIGHT_AGENT,
    "no_agent": HEAD.format(script="game"),
    "no_action": HEAD.format(script="game") + AGENT.format(name="LudusAgent", ticks=1),
    "disagreeing": HEAD.format(script="game")
    + RIGHT_AGENT
    + AGENT.format(name="Other", ticks=4)
    + ACTION,
    **{
        script: HEAD.format(script=script) + RIGHT_AGENT
        for script in ("no_reset", "hangs", "broken", "quits")
    },
}


class Game:
    """Opens sessions with the scenes of the project, and ends them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._sessions: list[EngineSession] = []

    def open(
        self,
        scene: str = "right",
        start_timeout_s: float = 20.0,
        step_timeout_s: float = 20.0,
        num_worlds: int = 1,
        engine_scene: str | None = None,
    ) -> EngineSession:
        target = find_game(self.folder, scene=f"res://{scene}.tscn")
        options = LaunchOptions(start_timeout_s=start_timeout_s, step_timeout_s=step_timeout_s)
        config = EngineConfig(num_worlds=num_worlds, scene=engine_scene)
        session = open_session(target, config, options)
        self._sessions.append(session)
        return session

    def close(self) -> None:
        for session in self._sessions:
            session.close()

    def engines(self) -> list[int]:
        """Return the ids of all processes that run this project."""
        own = str(self.folder)
        return [
            process.pid
            for process in psutil.process_iter(["cmdline", "status"])
            if own in (process.info["cmdline"] or ()) and process.info["status"] != "zombie"
        ]


def reset(session: EngineSession, **parameters: Any) -> Batches:
    return session.reset(ResetRequest.all_worlds(session.spec.num_worlds, 7, parameters))


def step(session: EngineSession, count: int = 1) -> Batches:
    """Take steps with zero actions; returns what the last one brought."""
    actions = {
        name: ActionBatch.zeros(policy, policy.num_agents)
        for name, policy in session.policies.items()
    }
    for _ in range(count - 1):
        session.send(actions)
        session.receive()
    session.send(actions)
    return session.receive()


def is_gone(pid: int, within_s: float = 30.0) -> bool:
    """Wait for the end of a process, which need not be a child."""
    deadline = time.monotonic() + within_s
    while not (has_ended := _has_ended(pid)) and time.monotonic() < deadline:
        time.sleep(0.02)
    return has_ended


def _has_ended(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def make_project(folder: Path) -> Path:
    """Write the project; it is imported when the first scene is opened."""
    shutil.copytree(bundled_root() / "addons", folder / "addons")
    (folder / "project.godot").write_text(PROJECT)
    for name, text in SCRIPTS.items():
        (folder / f"{name}.gd").write_text(text)
    for name, text in SCENES.items():
        (folder / f"{name}.tscn").write_text(text)
    return Path(os.path.realpath(folder))


@pytest.fixture(scope="module", params=["godot4", "godot3"])
def engine(request: pytest.FixtureRequest) -> str:
    """Which Godot it is."""
    return request.param


@pytest.fixture(scope="module")
def project(engine: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project, for that Godot."""
    make = make_project
    if engine == "godot3":
        from tests.godot3.conftest import make_project as make
    return make(tmp_path_factory.mktemp("faults"))


@pytest.fixture
def game(project: Path) -> Iterator[Game]:
    """Opens scenes of the project; no engine may be left behind."""
    made = Game(project)
    yield made
    made.close()
    assert made.engines() == []
