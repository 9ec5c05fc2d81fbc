"""Policies play in real games without a trainer."""

from __future__ import annotations

import json
import shutil
import subprocess
import threading
from collections.abc import Generator
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest

import ludus
from ludus.engine import EngineKind, InstalledEngine, ensure_imported, find_engine, read_project
from ludus.engine.bundled import runnable_bundled_root
from ludus.engine.export_game import export_game
from ludus.model import ModelRunner, PolicyModel, write_model
from ludus.model.policy_model import Distribution, Linear
from ludus.spec import DiscreteAction, ObservationEntry
from tests.godot_project import write_project

pytestmark = pytest.mark.engine

TIMEOUT_S = 60.0
CARTPOLE = "res://examples/cartpole/cartpole.tscn"

# A pole of one number that falls over unless it is pushed back; ends after 20 steps at most.
POLE = """\
extends Node
var lean := 0.0
var steps := 0
func _ready() -> void:
	Ludus.player.episode_ended.connect(tell)
func apply_action(action: int) -> void:
	lean = lean * 1.5 + (0.4 if action == 1 else -0.4)
	steps += 1
func get_observation() -> Array:
	return [lean]
func get_reward() -> float:
	return 2.0
func is_done() -> bool:
	return absf(lean) > 2.0
func reset() -> void:
	lean = 0.3
	steps = 0
func tell(policy: String, agent: LudusAgent, total: float, length: int) -> void:
	print("told %s %s %.0f %d" % [policy, agent.name, total, length])
	get_tree().quit()
"""

SCENE = """\
[gd_scene format=3]

[ext_resource type="Script" path="res://pole.gd" id="1"]
[ext_resource type="Script" path="res://addons/ludus/agent/ludus_agent.gd" id="2"]
[ext_resource type="Script" path="res://addons/ludus/agent/ludus_action_component.gd" id="3"]
[ext_resource type="Script" path="res://addons/ludus/policy/ludus_policy.gd" id="4"]
[ext_resource type="JSON" path="res://pole.ludus.json" id="5"]

[sub_resource type="Resource" id="action"]
script = ExtResource("3")
name = "push"

[sub_resource type="Resource" id="policy"]
script = ExtResource("4")
model = ExtResource("5")

[node name="Pole" type="Node"]
script = ExtResource("1")

[node name="Agent" type="Node" parent="."]
script = ExtResource("2")
policy_name = "pole"
action = Array[ExtResource("3")]([SubResource("action")])
ticks_per_step = 1
max_episode_steps = 20
policy = SubResource("policy")
"""


def linear_policy(name: str, weights: list[float]) -> PolicyModel:
    """Push towards 1 if the weighted sum of the observation is positive, otherwise towards 0."""
    row = np.array(weights, np.float32)
    layer = Linear(np.stack([-row, row]), np.zeros(2, np.float32), "none")
    return PolicyModel(
        policy=name,
        fingerprint="",
        observation=(ObservationEntry("observation", "float32", (len(weights),)),),
        action=(DiscreteAction("push", 2),),
        has_action_mask=False,
        normalisation=None,
        images=(),
        memory=None,
        layers=(layer,),
        distribution=Distribution(np.zeros(0, np.float32)),
    )


BALANCING = linear_policy("cart", [0.3, 0.3, 1.0, 1.0])
FALLING = linear_policy("cart", [0.0, 0.0, -1.0, -1.0])


class Game:
    """A running game whose output is read as it comes, until it ends or is stopped."""

    def __init__(self, command: list[str]) -> None:
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self._timer = threading.Timer(TIMEOUT_S, self._process.kill)
        self._timer.start()
        self.lines: list[str] = []

    @property
    def _output(self) -> IO[bytes]:
        assert self._process.stdout is not None
        return self._process.stdout

    def read_episodes(self, count: int) -> list[dict[str, Any]]:
        """Return the first reports."""
        found: list[dict[str, Any]] = []
        while len(found) < count:
            line = self._output.readline().decode()
            assert line, "\n".join(self.lines)
            self.lines.append(line)
            if line.startswith("ludus-episode "):
                found.append(json.loads(line.removeprefix("ludus-episode ")))
        return found

    def wait(self) -> int:
        """Read to the end and return the exit code."""
        self.lines += self._output.read().decode(errors="replace").splitlines()
        return self._process.wait()

    def stop(self) -> None:
        self._timer.cancel()
        self._process.kill()
        self._process.wait()
        self._output.close()


class Games:
    """Starts games and stops them at the end of the test."""

    def __init__(self, engine: InstalledEngine) -> None:
        self._engine = engine
        self._games: list[Game] = []

    def start(self, root: Path, scene: str, *user_args: str, num_frames: int = 0) -> Game:
        ensure_imported(self._engine, read_project(root))
        program = str(self._engine.executable(headless=True))
        flags = ["--headless", "--fixed-fps", "60", "--path", str(root), scene]
        flags += ["--quit-after", str(num_frames)] if num_frames else []
        return self.run([program, *flags, "--", *user_args])

    def run(self, command: list[str]) -> Game:
        self._games.append(Game(command))
        return self._games[-1]

    def stop(self) -> None:
        for game in self._games:
            game.stop()


@pytest.fixture
def games() -> Generator[Games]:
    made = Games(find_engine(EngineKind.GODOT4))
    yield made
    made.stop()


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return write_project(tmp_path, {"pole.gd": POLE, "pole.tscn": SCENE}, main="pole")


@pytest.mark.parametrize("policy", [BALANCING, FALLING], ids=["balancing", "falling"])
def test_a_policy_from_the_command_line(policy: PolicyModel, games: Games, tmp_path: Path) -> None:
    path = tmp_path / "cart.ludus.json"
    write_model(path, policy)
    game = games.start(
        runnable_bundled_root(), CARTPOLE, f"--ludus-policy=cart={path}", "--ludus-report"
    )
    lengths = [episode["length"] for episode in game.read_episodes(4)]
    expected = lengths_in_training(policy)
    if policy is BALANCING:
        assert lengths == expected == [250] * 4
    else:
        assert max(lengths) < 60 and abs(np.mean(lengths) - np.mean(expected)) < 10


def lengths_in_training(policy: PolicyModel) -> list[int]:
    """Return the lengths of episodes that a trainer sees when the same policy acts."""
    runner = ModelRunner(policy)
    lengths: list[int] = []
    env = ludus.make("cartpole")
    for seed in range(4):
        observation, _ = env.reset(seed=seed)
        is_over, length = False, 0
        while not is_over:
            actions, _ = runner.act({"observation": observation[None]})
            observation, _, terminated, truncated, _ = env.step(int(actions.discrete[0, 0]))
            is_over, length = terminated or truncated, length + 1
        lengths.append(length)
    env.close()
    return lengths


@pytest.mark.parametrize(("weight", "length"), [(-1.0, 20), (1.0, 3)])
def test_a_policy_in_the_scene(weight: float, length: int, project: Path, games: Games) -> None:
    write_model(project / "pole.ludus.json", linear_policy("pole", [weight]))
    game = games.start(project, "res://pole.tscn")
    assert game.wait() == 0, game.lines
    assert f"told pole Agent {2 * length} {length}" in game.lines, game.lines


@pytest.mark.usefixtures("template")
def test_a_policy_in_an_exported_game(project: Path, games: Games) -> None:
    """The file goes along because the scene needs it, not because a filter includes it."""
    write_model(project / "pole.ludus.json", linear_policy("pole", [-1.0]))
    program = export_game(project, project / "build" / "pole.x86_64", include=())
    shutil.rmtree(project / "addons")
    game = games.run([str(program), "--headless", "--fixed-fps", "60"])
    assert game.wait() == 0, game.lines
    assert "told pole Agent 40 20" in game.lines, game.lines


def test_a_policy_that_does_not_fit_is_told(project: Path, games: Games) -> None:
    write_model(project / "pole.ludus.json", linear_policy("pole", [1.0, 1.0]))
    game = games.start(project, "res://pole.tscn", num_frames=30)
    assert game.wait() == 0
    text = "\n".join(game.lines)
    assert text.count('observation["observation"]: expected 2 numbers, got Array of 1') == 1, text
    assert "agent Agent" in text


@pytest.mark.parametrize(
    ("content", "expected"),
    [("{}", "format: missing"), ("[", "is not JSON"), (None, "cannot read")],
)
def test_a_wrong_file_ends_the_game(
    content: str | None, expected: str, games: Games, tmp_path: Path
) -> None:
    path = tmp_path / "cart.ludus.json"
    if content is not None:
        path.write_text(content)
    game = games.start(runnable_bundled_root(), CARTPOLE, f"--ludus-policy=cart={path}")
    assert game.wait() == 1, game.lines
    assert any("policy cart" in line and expected in line for line in game.lines), game.lines


def test_a_trainer_wins(project: Path) -> None:
    write_model(project / "pole.ludus.json", linear_policy("pole", [1.0]))
    env = ludus.make(project)
    observation, _ = env.reset(seed=0)
    for _ in range(3):
        action = 0 if observation[0] > 0 else 1
        expected = np.float32(observation[0] * 1.5 + (0.4 if action else -0.4))
        observation, *_ = env.step(action)
        assert observation[0] == pytest.approx(expected, abs=1e-6)
    env.close()
