"""Policies play in real games of both Godots without a trainer."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import threading
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest

import ludus
from ludus.engine import (
    EngineKind,
    GodotFlags,
    ensure_imported,
    executable_command,
    find_engine,
    godot_command,
    read_project,
)
from ludus.engine.bundled import runnable_bundled_root
from ludus.model import ModelRunner, PolicyModel, write_model
from ludus.model.policy_model import Distribution, Linear
from ludus.spec import DiscreteAction, ObservationEntry
from tests.godot_project import export_project, write_project

pytestmark = [pytest.mark.engine, pytest.mark.games, pytest.mark.timeout(300)]

TIMEOUT_S = 60.0
CARTPOLE = "res://examples/cartpole/cartpole.tscn"

# A pole of one number that falls over unless it is pushed back; ends after 20 steps at most.
POLE = """\
extends Node
var lean := 0.0
var num_ticks := 0
func _ready() -> void:
	var bridge = get_node_or_null("/root/Ludus")
	var player = bridge.player if bridge != null else $Player
	var _error = player.connect("episode_ended", {callable})
func _physics_process(_delta: float) -> void:
	num_ticks += 1
	if num_ticks == 100:
		get_tree().quit()
func apply_action(action: int) -> void:
	lean = lean * 1.5 + (0.4 if action == 1 else -0.4)
func get_observation() -> Array:
	return [lean]
func get_reward() -> float:
	return 2.0
func is_done() -> bool:
	return abs(lean) > 2.0
func reset() -> void:
	lean = 0.3
func tell(policy: String, agent: LudusAgent, total: float, length: int) -> void:
	print("told %s %s %.0f %d" % [policy, agent.name, total, length])
	get_tree().quit()
"""
CALLABLES = {"godot4": "tell", "godot3": 'self, "tell"'}

SCENES = {
    "godot4": """\
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
""",
    "godot3": """\
[gd_scene format=2]
[ext_resource path="res://pole.gd" type="Script" id=1]
[ext_resource path="res://addons/ludus/ludus_agent.gd" type="Script" id=2]
[ext_resource path="res://addons/ludus/ludus_action_component.gd" type="Script" id=3]
[ext_resource path="res://addons/ludus/ludus_policy.gd" type="Script" id=4]
[sub_resource type="Resource" id=1]
script = ExtResource( 3 )
name = "push"
[sub_resource type="Resource" id=2]
script = ExtResource( 4 )
model = "res://pole.ludus.json"
[node name="Pole" type="Node"]
script = ExtResource( 1 )
[node name="Agent" type="Node" parent="."]
script = ExtResource( 2 )
policy_name = "pole"
action = [ SubResource( 1 ) ]
ticks_per_step = 1
max_episode_steps = 20
policy = SubResource( 2 )
""",
}
# What takes the place of the autoload in a game without it: a script, and a node with it.
PLAYERS = {
    "godot4": (
        '[ext_resource type="Script" path="res://addons/ludus/policy/ludus_policy_player.gd"'
        ' id="6"]\n',
        '[node name="Player" type="Node" parent="."]\nscript = ExtResource("6")\n',
    ),
    "godot3": (
        '[ext_resource path="res://addons/ludus/ludus_policy_player.gd" type="Script" id=6]\n',
        '[node name="Player" type="Node" parent="."]\nscript = ExtResource( 6 )\n',
    ),
}


def linear_policy(name: str, weights: list[float], frames: int = 1) -> PolicyModel:
    """Push towards 1 if the weighted sum of the observation is positive, otherwise towards 0."""
    row = np.array(weights, np.float32)
    layer = Linear(np.stack([-row, row]), np.zeros(2, np.float32), "none")
    return PolicyModel(
        policy=name,
        fingerprint="",
        observation=(ObservationEntry("observation", "float32", (len(weights) // frames,)),),
        action=(DiscreteAction("push", 2),),
        has_action_mask=False,
        normalisation=None,
        images=(),
        memory=None,
        layers=(layer,),
        distribution=Distribution(np.zeros(0, np.float32)),
        frames=frames,
    )


BALANCING = linear_policy("cart", [0.3, 0.3, 1.0, 1.0])
FALLING = linear_policy("cart", [0.0, 0.0, -1.0, -1.0])


class Game:
    """A running game whose output is read as it comes, until it ends or is stopped."""

    def __init__(self, command: Sequence[str]) -> None:
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
    """Starts games of one engine and stops them at the end of the test."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self._engine = find_engine(EngineKind(kind))
        self._games: list[Game] = []

    @property
    def examples(self) -> Path:
        """The project with the examples."""
        return runnable_bundled_root(self._engine.kind)

    def start(self, root: Path, scene: str, *user_args: str) -> Game:
        ensure_imported(self._engine, read_project(root))
        flags = GodotFlags(user_args=user_args)
        return self.run(godot_command(self._engine, root, scene, flags))

    def run(self, command: Sequence[str]) -> Game:
        self._games.append(Game(command))
        return self._games[-1]

    def stop(self) -> None:
        for game in self._games:
            game.stop()


@pytest.fixture(params=["godot4", "godot3"])
def games(request: pytest.FixtureRequest) -> Generator[Games]:
    made = Games(request.param)
    yield made
    made.stop()


@pytest.fixture
def project(games: Games, tmp_path: Path) -> Path:
    script = POLE.replace("{callable}", CALLABLES[games.kind])
    files = {"pole.gd": script, "pole.tscn": SCENES[games.kind]}
    return write_project(tmp_path / "project", files, main="pole", kind=games.kind)


@pytest.mark.parametrize("policy", [BALANCING, FALLING], ids=["balancing", "falling"])
def test_a_policy_from_the_command_line(policy: PolicyModel, games: Games, tmp_path: Path) -> None:
    path = tmp_path / "cart.ludus.json"
    write_model(path, policy)
    game = games.start(games.examples, CARTPOLE, f"--ludus-policy=cart={path}", "--ludus-report")
    lengths = [episode["length"] for episode in game.read_episodes(4)]
    expected = lengths_in_training(policy, f"{games.kind}:cartpole")
    if policy is BALANCING:
        assert lengths == expected == [250] * 4
    else:
        assert max(lengths) < 60 and abs(np.mean(lengths) - np.mean(expected)) < 10


def test_draws_are_not_the_most_probable_actions(games: Games, tmp_path: Path) -> None:
    path = tmp_path / "cart.ludus.json"
    # A hundredth of the balancing weights: draws are nearly even.
    write_model(path, linear_policy("cart", [0.003, 0.003, 0.01, 0.01]))
    options = (f"--ludus-policy=cart={path}", "--ludus-sample", "--ludus-report")
    game = games.start(games.examples, CARTPOLE, *options)
    assert max(episode["length"] for episode in game.read_episodes(3)) < 200


def lengths_in_training(policy: PolicyModel, target: str) -> list[int]:
    """Return the lengths of episodes that a trainer sees when the same policy acts."""
    runner = ModelRunner(policy)
    lengths: list[int] = []
    env = ludus.make(target)
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


@pytest.mark.parametrize(
    ("weights", "length"),
    # With two frames, one who looks at the older of them pushes a step too late.
    [([-1.0], 20), ([1.0], 3), ([0.0, -1.0], 20), ([-1.0, 0.0], 10)],
)
def test_a_policy_in_the_scene(
    weights: list[float], length: int, project: Path, games: Games
) -> None:
    write_model(project / "pole.ludus.json", linear_policy("pole", weights, len(weights)))
    game = games.start(project, "res://pole.tscn")
    assert game.wait() == 0, game.lines
    assert f"told pole Agent {2 * length} {length}" in game.lines, game.lines


@pytest.mark.parametrize("is_in_scene", [True, False])
def test_an_observation_of_nan_is_reported_once(
    is_in_scene: bool, project: Path, games: Games
) -> None:
    script = project / "pole.gd"
    script.write_text(script.read_text().replace("return [lean]", "return [sqrt(-1.0)]"))
    write_model(project / "pole.ludus.json", linear_policy("pole", [-1.0]))
    policy = f"--ludus-policy=pole={project / 'pole.ludus.json'}"
    game = games.start(project, "res://pole.tscn", *([] if is_in_scene else [policy]))
    # A policy from the command line is being tried out, so that a mistake ends the game.
    assert game.wait() == (0 if is_in_scene else 1), game.lines
    warnings = [line for line in game.lines if 'observation["observation"][0] is ' in line]
    assert len(warnings) == 1 and "world 0, agent Agent" in warnings[0], game.lines
    assert any(line.startswith("told pole") for line in game.lines) == is_in_scene


def test_a_policy_without_the_autoload(project: Path, games: Games) -> None:
    write_model(project / "pole.ludus.json", linear_policy("pole", [-1.0]))
    settings, scene = project / "project.godot", project / "pole.tscn"
    settings.write_text(re.sub(r"^Ludus=.*\n", "", settings.read_text(), flags=re.MULTILINE))
    script, node = PLAYERS[games.kind]
    text = scene.read_text().replace("[sub_resource", f"{script}\n[sub_resource", 1)
    scene.write_text(text + node)
    game = games.start(project, "res://pole.tscn")
    assert game.wait() == 0, game.lines
    assert "told pole Agent 40 20" in game.lines, game.lines


@pytest.mark.usefixtures("template")
def test_a_policy_in_an_exported_game(project: Path, games: Games, tmp_path: Path) -> None:
    """In Godot 4 the file goes along because the scene needs it, in Godot 3 by a filter."""
    write_model(project / "pole.ludus.json", linear_policy("pole", [-1.0]))
    include = ("*.ludus.json",) if games.kind == "godot3" else ()
    program = export_project(games.kind, project, tmp_path / "build" / "pole.x86_64", include)
    shutil.rmtree(project)
    game = games.run(executable_command(program, GodotFlags()))
    assert game.wait() == 0, game.lines
    assert "told pole Agent 40 20" in game.lines, game.lines


def test_a_policy_that_does_not_fit_is_told(project: Path, games: Games) -> None:
    write_model(project / "pole.ludus.json", linear_policy("pole", [1.0, 1.0]))
    game = games.start(project, "res://pole.tscn")
    assert game.wait() == 0
    text = "\n".join(game.lines)
    assert text.count('observation["observation"]: expected 2 numbers, got Array of 1') == 1, text
    assert "agent Agent" in text


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("{}", "format: missing"),
        ("[", "is not JSON"),
        (None, "cannot read"),
    ],
)
def test_a_wrong_file_ends_the_game(
    content: str | None, expected: str, games: Games, tmp_path: Path
) -> None:
    path = tmp_path / "cart.ludus.json"
    if content is not None:
        path.write_text(content)
    game = games.start(games.examples, CARTPOLE, f"--ludus-policy=cart={path}")
    assert game.wait() == 1, game.lines
    assert any("policy cart" in line and expected in line for line in game.lines), game.lines


def test_a_policy_for_another_action_ends_the_game(games: Games, tmp_path: Path) -> None:
    path = tmp_path / "cart.ludus.json"
    write_model(path, BALANCING)
    path.write_text(path.read_text().replace('"push"', '"jump"'))
    game = games.start(games.examples, CARTPOLE, f"--ludus-policy=cart={path}")
    assert game.wait() == 1, game.lines
    assert any("the policy decides this component" in line for line in game.lines), game.lines


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
