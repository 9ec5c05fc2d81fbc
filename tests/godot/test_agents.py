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
from ludus.spec.batch import ActionBatch
from tests.godot.conftest import Game, reset, step
from tests.godot3.conftest import make_project as make_godot3_project

pytestmark = pytest.mark.engine

# Extends the agent itself, declares its spaces in code, and counts calls, ticks and resets.
COUNTER = """\
extends LudusAgent
var applied := 0
var ticks := 0
var resets := 0
var last := {}
func _init() -> void:
	action = [LudusActionComponent.discrete("move", 3), LudusActionComponent.continuous("aim", 2)]
	observation = [LudusObservationEntry.create("counts", [3])]
func _physics_process(_delta: float) -> void:
	ticks += 1
func apply_action(given: Dictionary) -> void:
	assert(given.move is int and given.aim is PackedFloat32Array)
	applied += 1
	last = given
func ludus_last() -> Dictionary:
	return {"move": last.move, "aim": Array(last.aim), "type": type_string(typeof(last.aim))}
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

MASKED = """\
extends "res://counter.gd"
func get_action_mask() -> PackedByteArray:
	return [1, 0, resets % 2]
"""

HEAD = """\
[gd_scene load_steps=2 format=3]
[ext_resource type="Script" path="res://{script}.gd" id="1"]
[node name="Game" type="Node"]
"""
AGENT = """\
[node name="{name}" type="Node" parent="."]
script = ExtResource("1")
policy_name = "{policy}"
ticks_per_step = 3
action_timing = {timing}
max_episode_steps = 4
enabled = {enabled}
"""
EVERY_TICK, ONCE = 0, 1
NUMBERS = {"godot4": "PackedFloat32Array", "godot3": "PoolRealArray"}


def agent(name: str, policy: str = "agent", timing: int = EVERY_TICK) -> str:
    enabled = str(name != "Idle").lower()
    return AGENT.format(name=name, policy=policy, timing=timing, enabled=enabled)


SCENES = {
    "every": HEAD.format(script="counter") + agent("Agent") + agent("Idle"),
    "once": HEAD.format(script="counter") + agent("Agent", timing=ONCE) + agent("Idle"),
    "masked": HEAD.format(script="masked") + agent("Agent") + "has_action_mask = true\n",
    "masked_unasked": HEAD.format(script="masked") + agent("Agent"),
    "several": HEAD.format(script="counter")
    + agent("A", "hero")
    + agent("B", "target")
    + agent("C", "hero"),
}


def sample(envs: ludus.LudusVectorEnv) -> Any:
    return cast(Any, envs).action_space.sample()


@pytest.fixture(scope="module")
def project(engine: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("agents")
    if engine == "godot3":
        return make_godot3_project(folder)
    (folder / "project.godot").write_text('config_version=5\n[application]\nconfig/name="Agents"\n')
    (folder / "counter.gd").write_text(COUNTER)
    (folder / "masked.gd").write_text(MASKED)
    for name, text in SCENES.items():
        (folder / f"{name}.tscn").write_text(text)
    install_addon(folder)
    return folder


@pytest.mark.parametrize(("scene", "applied_per_step"), [("every", 3), ("once", 1)])
def test_actions_and_ticks_of_a_step(project: Path, scene: str, applied_per_step: int) -> None:
    envs = ludus.make_vec(project / f"{scene}.tscn", num_worlds=2)
    assert envs.policy.agents_per_world == 1, "the agent that is not enabled takes part"
    assert envs.policy.action == (DiscreteAction("move", 3), ContinuousAction("aim", 2))
    observation, _ = envs.reset(seed=0)
    assert np.array_equal(observation["counts"], [[0, 0, 1]] * 2)
    for number in (1, 2, 3):
        observation, _, terminated, truncated, _ = envs.step(sample(envs))
        assert np.array_equal(
            observation["counts"], [[applied_per_step * number, 3 * number, 1]] * 2
        )
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


def test_every_agent_gets_its_own_action(game: Game, engine: str) -> None:
    session = game.open("every", num_worlds=3)
    reset(session)
    discrete = np.array([[2], [0], [1]])
    continuous = np.array([[0.5, -1.0], [0.25, 0.0], [-0.125, 1.0]], np.float32)
    session.send({"agent": ActionBatch(discrete, continuous)})
    session.receive()
    for world in range(3):
        assert session.call({"world": world, "agent": "Agent"}, "ludus_last") == {
            "move": discrete[world, 0],
            "aim": continuous[world].tolist(),
            "type": NUMBERS[engine],
        }


@pytest.mark.parametrize("scene", ["masked", "masked_unasked"])
def test_masks(game: Game, scene: str) -> None:
    session = game.open(scene, num_worlds=2)
    assert session.policies["agent"].has_action_mask
    mask = reset(session)["agent"].action_mask
    assert mask is not None and mask.tolist() == [[1, 0, 1]] * 2
    mask = step(session, 4)["agent"].action_mask  # the next episode has begun
    assert mask is not None and mask.tolist() == [[1, 0, 0]] * 2


def test_several_policies(game: Game) -> None:
    session = game.open("several", num_worlds=2)
    assert {name: spec.num_agents for name, spec in session.policies.items()} == {
        "hero": 4,
        "target": 2,
    }
    paths = [(agent.world, agent.path) for agent in session.policies["hero"].agents]
    assert paths == [(0, "A"), (0, "C"), (1, "A"), (1, "C")]
    reset(session)
    batches = step(session, 2)
    assert batches["hero"].observation["counts"].tolist() == [[6, 6, 1]] * 4
    assert batches["target"].observation["counts"].tolist() == [[6, 6, 1]] * 2
