"""What a LudusAgent can be told, shown on the real engine by a game that counts."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import ludus
from ludus.addon import install_addon
from ludus.pool import PoolConfig, open_pool
from ludus.spec import ContinuousAction, DiscreteAction
from tests.godot3.conftest import make_project as make_godot3_project

pytestmark = pytest.mark.engine

# Extends the agent itself, declares its spaces in code, and counts calls, ticks and resets.
COUNTER = """\
extends LudusAgent
var applied := 0
var ticks := 0
var resets := 0
func _init() -> void:
	action = [LudusActionComponent.discrete("move", 3), LudusActionComponent.continuous("aim", 2)]
	observation = [LudusObservationEntry.create("counts", [3])]
func _physics_process(_delta: float) -> void:
	ticks += 1
func apply_action(given: Dictionary) -> void:
	assert(given.move is int and given.aim is PackedFloat32Array)
	applied += 1
func get_observation() -> Dictionary:
	return {"counts": [applied, ticks, resets]}
func get_reward() -> float:
	return 1.0
func is_done() -> bool:
	return false
func reset() -> void:
	applied = 0
	ticks = 0
	resets += 1
"""

SCENE = """\
[gd_scene load_steps=2 format=3]
[ext_resource type="Script" path="res://counter.gd" id="1"]
[node name="Game" type="Node"]
[node name="Agent" type="Node" parent="."]
script = ExtResource("1")
ticks_per_step = 3
action_timing = {timing}
max_episode_steps = 4
[node name="Idle" type="Node" parent="."]
script = ExtResource("1")
enabled = false
"""
EVERY_TICK, ONCE = 0, 1


def sample(envs: ludus.LudusVectorEnv) -> Any:
    return cast(Any, envs).action_space.sample()


@pytest.fixture(scope="module")
def project(engine: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("agents")
    if engine == "godot3":
        return make_godot3_project(folder)
    (folder / "project.godot").write_text('config_version=5\n[application]\nconfig/name="Agents"\n')
    (folder / "counter.gd").write_text(COUNTER)
    for name, timing in (("every", EVERY_TICK), ("once", ONCE)):
        (folder / f"{name}.tscn").write_text(SCENE.format(timing=timing))
    install_addon(folder)
    return folder


@pytest.mark.parametrize(("scene", "applied_per_step"), [("every", 3), ("once", 1)])
def test_actions_and_ticks_of_a_step(project: Path, scene: str, applied_per_step: int) -> None:
    envs = ludus.make_vec(project / f"{scene}.tscn", num_worlds=2)
    assert envs.policy.agents_per_world == 1, "the agent that is not enabled takes part"
    assert envs.policy.action == (DiscreteAction("move", 3), ContinuousAction("aim", 2))
    observation, _ = envs.reset(seed=0)
    assert np.array_equal(observation["counts"], [[0, 0, 1]] * 2)
    for step in (1, 2, 3):
        observation, _, terminated, truncated, _ = envs.step(sample(envs))
        assert np.array_equal(observation["counts"], [[applied_per_step * step, 3 * step, 1]] * 2)
        assert not terminated.any() and not truncated.any()
    observation, _, terminated, truncated, infos = envs.step(sample(envs))
    assert truncated.all() and not terminated.any()
    assert np.array_equal(infos["final_obs"][1]["counts"], [applied_per_step * 4, 12, 1])
    assert np.array_equal(observation["counts"], [[0, 0, 2]] * 2)
    envs.close()


def test_random_play_inside_the_engine_may_come_first(project: Path) -> None:
    """What ``ludus bench`` calls the ceiling, with several ticks a step; the game goes on after."""
    with open_pool(project / "every.tscn", PoolConfig(num_worlds=2)) as pool:
        result = pool.call({"bridge": True}, "run_ceiling", [20, 0])
        assert result[0]["num_steps"] == 20 and result[0]["elapsed_us"] > 0
        counts = pool.reset(0)["agent"].observation["counts"]
    assert np.array_equal(counts, [[0, 0, 1]] * 2)


def test_the_trainer_may_choose_ticks_and_limit(project: Path) -> None:
    envs = ludus.make_vec(project / "every.tscn", ticks_per_step=2, max_episode_steps=2)
    envs.reset(seed=0)
    observation, *_ = envs.step(sample(envs))
    assert np.array_equal(observation["counts"], [[2, 2, 1]])
    assert envs.step(sample(envs))[3].all()
    envs.close()
