"""Training on real Godot: settings of the scene, several policies, exact resume, lost engines."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest
import torch

from ludus.addon import install_addon
from ludus.errors import ConfigError
from ludus.runs.checkpoint import Checkpoint, read_checkpoint
from ludus.runs.metrics import read_metrics
from ludus.runs.run_folder import RunFolder
from ludus.settings.train_config import LeagueConfig, PPOConfig, SACConfig, TrainConfig
from ludus.training.loop import train
from ludus.training.progress import Progress, SilentReporter

pytestmark = pytest.mark.engine

# Guess what the other does: a zero-sum game of ten steps. Both see how often the other said 1.
PENNIES = """\
extends LudusAgent
@export var sign := 1.0
@export var other: LudusAgent
@export var freezes_at := -1
var choice := 0
var steps := 0
var total := 0
func _init() -> void:
	observation = [LudusObservationEntry.create("seen", [2])]
	ticks_per_step = 1
func apply_action(given: Variant) -> void:
	choice = int(given) if given is int else int(given[0] > 0.0)
func get_observation() -> Dictionary:
	return {"seen": [other.total / 10.0, steps / 10.0]}
func get_reward() -> float:
	steps += 1
	total += choice
	if freezes_at >= 0 and LudusWorld.of(self).index == 0:
		freezes_at -= 1
		if freezes_at == 0:
			Ludus.set_policy_mode(policy_name, LudusBridge.PolicyMode.FROZEN)
	return sign if choice == other.choice else -sign
func is_done() -> bool:
	return steps >= 10
func reset() -> void:
	steps = 0
	total = 0
"""

SCENE = """\
[gd_scene format=3]
[ext_resource type="Script" path="res://pennies.gd" id="1"]
[ext_resource type="Script" path="res://addons/ludus/world/ludus_world.gd" id="2"]
[ext_resource type="Script" path="res://addons/ludus/agent/ludus_action_component.gd" id="3"]
[ext_resource type="Script" path="res://addons/ludus/training/ludus_policy_settings.gd" id="4"]
[sub_resource type="Resource" id="choice"]
script = ExtResource("3")
name = "say"
n = 2
[sub_resource type="Resource" id="number"]
script = ExtResource("3")
name = "lean"
kind = 1
size = 1
[sub_resource type="Resource" id="settings"]
script = ExtResource("4")
{settings}
[node name="Game" type="Node"]
[node name="World" type="Node" parent="."]
script = ExtResource("2")
episode_mode = 1
[node name="Even" type="Node" parent="." node_paths=PackedStringArray("other")]
script = ExtResource("1")
policy_name = "even"
action = [SubResource("choice")]
other = NodePath("../Odd")
{even}
[node name="Odd" type="Node" parent="." node_paths=PackedStringArray("other")]
script = ExtResource("1")
policy_name = "odd"
sign = -1.0
action = [SubResource("number")]
settings = SubResource("settings")
other = NodePath("../Even")
"""

PROJECT = """\
config_version=5
[application]
config/name="Pennies"
config/features=PackedStringArray("4.4")
run/main_scene="res://pennies.tscn"
"""


@pytest.fixture
def pennies(tmp_path: Path) -> Any:
    """Return a maker of configs that train in a game of two policies."""

    def make(settings: str = "", even: str = "", **changes: Any) -> TrainConfig:
        project = tmp_path / "pennies"
        project.mkdir(exist_ok=True)
        (project / "project.godot").write_text(PROJECT)
        (project / "pennies.gd").write_text(PENNIES)
        (project / "pennies.tscn").write_text(SCENE.format(settings=settings, even=even))
        install_addon(project)
        ppo = PPOConfig(hidden_sizes=(8,), rollout_steps=20, epochs=2,
                        learning_rate_schedule="constant")  # fmt: skip
        defaults: dict[str, Any] = {
            "num_worlds": 4, "num_engines": 1, "seed": 3, "total_steps": 1600, "ppo": ppo,
            "runs": tmp_path / "runs", "name": "run", "evaluation_episodes": 0,
            "checkpoint_every_s": None, "checkpoint_every_updates": 5,
        }  # fmt: skip
        return TrainConfig(str(project), **{**defaults, **changes})

    return make


def newest(run: Path) -> Checkpoint:
    return read_checkpoint(RunFolder(run).checkpoints().paths()[-1], has_replay=True)


def assert_equal(first: Checkpoint, second: Checkpoint) -> None:
    """Compare everything that a later run depends on."""
    assert first.agent_steps == second.agent_steps
    assert first.run["episodes"] == second.run["episodes"]
    assert first.run["seats"] == second.run["seats"]
    assert first.run.get("league") == second.run.get("league")
    assert first.learners.keys() == second.learners.keys()
    pairs = [(first.league, second.league)]
    for name, learner in first.learners.items():
        pairs.append((learner.tensors, second.learners[name].tensors))
        pairs.append((learner.replay, second.learners[name].replay))
        assert learner.values == second.learners[name].values
    for one, two in pairs:
        assert one.keys() == two.keys()
        assert [name for name in one if not torch.equal(one[name], two[name])] == []


def metrics(run: Path, policy: str, name: str) -> list[float | None]:
    lines = read_metrics(run / "metrics.jsonl")
    return [line["policies"][policy].get(name) for line in lines]


SAC_IN_SCENE = """\
algorithm = 2
hidden_sizes = PackedInt32Array(7, 5)
batch_size = 16
learning_rate = 0.002
more = {"report_steps": 20, "learning_starts": 40}
"""


def test_the_scene_chooses_algorithm_and_network(pennies: Any) -> None:
    result = train(pennies(SAC_IN_SCENE))
    saved = RunFolder(result.path).read_config().policies
    even, odd = saved["even"], saved["odd"]
    assert isinstance(even, PPOConfig)
    assert isinstance(odd, SACConfig)
    assert (even.hidden_sizes, even.rollout_steps) == ((8,), 20)
    assert (odd.hidden_sizes, odd.batch_size, odd.report_steps) == ((7, 5), 16, 20)
    tensors = newest(result.path).learners
    assert tensors["even"].tensors["policy.actor.0.weight"].shape == (8, 2)
    assert tensors["odd"].tensors["policy.actor.0.weight"].shape == (7, 2)
    assert tensors["odd"].tensors["policy.actor.2.weight"].shape == (5, 7)
    # Both learn, each in its own way, and every step of both is counted.
    assert None not in metrics(result.path, "even", "approximate_kl")
    assert metrics(result.path, "odd", "approximate_kl")[-1] is None
    assert metrics(result.path, "odd", "gradient_steps")[-1]
    assert result.agent_steps == 1600


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ('more = {"learning_rat": 1}', r"policy odd \(scene\): unknown setting learning_rat"),
        ("hidden_sizes = PackedInt32Array(-1)", r"policy odd \(scene\): hidden_sizes must be"),
        ('algorithm = 2\nmore = {"clip_range": 0.1}', "has no setting clip_range"),
    ],
)
def test_settings_that_do_not_fit_name_policy_and_setting(
    settings: str, text: str, pennies: Any
) -> None:
    config = pennies(settings)
    with pytest.raises(ConfigError, match=text):
        train(config)
    assert not (config.runs / "run").exists()


def test_policies_take_turns(pennies: Any) -> None:
    result = train(pennies(alternate_every=2))
    even, odd = (metrics(result.path, name, "is_learning") for name in ("even", "odd"))
    assert even == [1, 1, 0, 0, 1, 1, 0, 0, 1, 1]
    assert odd == [0, 0, 1, 1, 0, 0, 1, 1, 0, 0]


def test_the_game_freezes_a_policy(pennies: Any) -> None:
    result = train(pennies(even="freezes_at = 70"))
    assert metrics(result.path, "even", "is_learning") == [1] * 4 + [0] * 6
    assert metrics(result.path, "odd", "is_learning") == [1] * 10


def test_self_play_is_rated(pennies: Any) -> None:
    league = LeagueConfig(share=0.5, snapshot_every_updates=2, pool_size=3)
    result = train(pennies(league=league))
    ratings = [metrics(result.path, name, "elo") for name in ("even", "odd")]
    assert ratings[0][0] != ratings[0][-1]
    checkpoint = newest(result.path)
    numbers = [number for number, _ in checkpoint.run["league"]["past"]["even"]]
    assert numbers[-3:] == sorted(numbers)[-3:]
    assert numbers[-1] >= 8
    # In half of the worlds one of two sides learns: three quarters of the steps are learnt from.
    share = result.agent_steps / (result.updates * 20 * 4 * 2)
    assert 0.6 < share < 0.9


@pytest.mark.parametrize("kind", ["ppo", "sac and past selves"])
def test_resuming_repeats_an_uninterrupted_run_to_the_bit(kind: str, pennies: Any) -> None:
    changes: dict[str, Any] = {"exact_resume": True, "checkpoint_every_updates": 2}
    if kind == "ppo":
        whole = pennies(**changes)
    else:
        league = LeagueConfig(share=0.5, snapshot_every_updates=2)
        whole = pennies(SAC_IN_SCENE, league=league, alternate_every=3, **changes)
    whole = replace(whole, total_steps=10**9, name="whole")
    train(whole, reporter=Stopping(8))
    half = train(replace(whole, name="half"), reporter=Stopping(4))
    train(replace(whole, name="half"), resume=half.path, reporter=Stopping(4))
    assert_equal(newest(whole.runs / "whole"), newest(half.path))


def test_cartpole_resumes_to_the_bit(tmp_path: Path) -> None:
    """Rigid bodies and two engines; physics is deterministic as well."""
    ppo = PPOConfig(hidden_sizes=(16,), rollout_steps=16, learning_rate_schedule="constant")
    config = TrainConfig(
        "cartpole", num_worlds=8, num_engines=2, seed=5, total_steps=10**9, ppo=ppo,
        runs=tmp_path, name="whole", evaluation_episodes=0, exact_resume=True,
        checkpoint_every_s=None, checkpoint_every_updates=3,
    )  # fmt: skip
    train(config, reporter=Stopping(6))
    half = train(replace(config, name="half"), reporter=Stopping(3))
    train(replace(config, name="half"), resume=half.path, reporter=Stopping(3))
    assert_equal(newest(tmp_path / "whole"), newest(half.path))


def test_a_killed_engine_is_replaced_and_the_run_goes_on(pennies: Any) -> None:
    config = pennies(num_engines=2, total_steps=6400)
    result = train(config, reporter=Killing(at_update=5))
    assert result.stop_reason == "total_steps"
    lines = read_metrics(result.path / "metrics.jsonl")
    assert [line["restarts"] for line in lines][:5] == [0] * 5
    assert lines[-1]["restarts"] == 1


class Stopping(SilentReporter):
    """Ask for an end, through the run's folder, after some updates."""

    def __init__(self, updates: int) -> None:
        self._left = updates

    def started(self, config: TrainConfig, run: Path) -> None:
        self._run = run

    def updated(self, progress: Progress) -> None:
        from ludus.runs.control import StopRequest, send_request

        self._left -= 1
        if self._left == 0:
            send_request(self._run / "control", StopRequest())


class Killing(SilentReporter):
    """Kill one engine, the hard way."""

    def __init__(self, at_update: int) -> None:
        self._left = at_update

    def updated(self, progress: Progress) -> None:
        self._left -= 1
        if self._left == 0:
            children = psutil.Process().children(recursive=True)
            alive = [child for child in children if child.status() != psutil.STATUS_ZOMBIE]
            engines = [child for child in alive if "godot" in " ".join(child.cmdline())]
            os.kill(engines[-1].pid, signal.SIGKILL)
