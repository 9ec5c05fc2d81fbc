"""PettingZoo's own tests over our games, and what they do not ask."""

# PettingZoo's types are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownParameterType=false

from __future__ import annotations

import pickle
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pettingzoo")

from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test
from pettingzoo.test.state_test import state_test
from pettingzoo.utils.conversions import parallel_to_aec

from ludus.errors import ActionError, SequenceError, UsageError
from ludus.pettingzoo import parallel_env
from tests.godot_project import write_project

pytestmark = [
    pytest.mark.libraries,
    pytest.mark.engine,
    # Advice, which the makers of these games did not follow on purpose.
    pytest.mark.filterwarnings("ignore:Observation space for each agent probably should be"),
    pytest.mark.filterwarnings("ignore:Agents have different observation space sizes"),
    pytest.mark.filterwarnings("ignore:Agents have different action space sizes"),
    pytest.mark.filterwarnings("ignore:Observations are different shapes"),
    pytest.mark.filterwarnings("ignore:Observation is not a NumPy array"),  # but has masks
]

GAMES = ["tag", "key_door", "zombies", pytest.param("bevy:shooter", marks=pytest.mark.bevy)]


# Of the shooter, which chooses and moves at the same time.
@pytest.mark.filterwarnings("ignore:Action space for each agent probably:UserWarning")
@pytest.mark.parametrize("game", GAMES)
def test_pettingzoos_own_tests_pass(game: str) -> None:
    env = parallel_env(game)
    try:
        parallel_api_test(env, num_cycles=300)
        state_test(parallel_to_aec(env), env, num_cycles=20)
        api_test(parallel_to_aec(env), num_cycles=100)
    finally:
        env.close()
    parallel_seed_test(partial(parallel_env, game), num_cycles=20)


def test_an_agent_stays_away_until_the_next_reset() -> None:
    env = parallel_env("ball_chase", max_episode_steps=3)
    try:
        env.reset(seed=1)
        assert len(env.agents) == 16
        for step in range(1, 4):
            actions = {agent: env.action_space(agent).sample() for agent in env.agents}
            *_, truncated, _ = env.step(actions)
            assert all(truncated.values()) == (step == 3)
        assert env.agents == []
        with pytest.raises(SequenceError, match="step without agents"):
            env.step({})
        env.reset()
        assert len(env.agents) == 16
    finally:
        env.close()


TWO_ORACLES = """\
[gd_scene format=3]
[ext_resource type="Script" path="res://oracle.gd" id="1"]
[ext_resource type="Script" path="res://addons/ludus/agent/ludus_agent.gd" id="2"]
[ext_resource type="Script" path="res://addons/ludus/agent/ludus_action_component.gd" id="3"]
[ext_resource type="Script" path="res://addons/ludus/world/ludus_world.gd" id="4"]
[sub_resource type="Resource" id="number"]
script = ExtResource("3")
n = 5
[node name="Game" type="Node2D"]
[node name="LudusWorld" type="Node" parent="."]
script = ExtResource("4")
episode_mode = 0
[node name="Early" type="Node2D" parent="."]
script = ExtResource("1")
length_key = "early_length"
[node name="LudusAgent" type="Node" parent="Early"]
script = ExtResource("2")
action = Array[ExtResource("3")]([SubResource("number")])
action_timing = 1
[node name="Late" type="Node2D" parent="."]
script = ExtResource("1")
[node name="LudusAgent" type="Node" parent="Late"]
script = ExtResource("2")
action = Array[ExtResource("3")]([SubResource("number")])
action_timing = 1
"""


@pytest.mark.parametrize(("early_length", "steps_at_end"), [(3, [1, 0]), (2, [0, 0]), (4, [0, 0])])
def test_a_reset_begins_all_episodes_of_agents_that_end_one_by_one(
    early_length: int, steps_at_end: list[int], oracle: Path, tmp_path: Path
) -> None:
    files = {"game.tscn": TWO_ORACLES, "oracle.gd": oracle.with_suffix(".gd").read_text("utf-8")}
    env = parallel_env(write_project(tmp_path / "game", files, main="game"))
    try:
        env.reset(seed=1, options={"early_length": early_length, "length": 4})
        while env.agents:
            env.step(dict.fromkeys(env.agents, 0))
        last = env.state().reshape(2, -1)
        assert last[:, 1].tolist() == steps_at_end  # of agents that play on after their first end
        first = np.stack(list(env.reset()[0].values()))
        assert first[:, 1].tolist() == [0, 0]
        # Where all have just begun, the reset hands that out instead of another beginning.
        assert np.array_equal(first, last) == (steps_at_end == [0, 0])
    finally:
        env.close()


def test_wrong_actions_name_the_agent() -> None:
    env = parallel_env("tag")
    try:
        env.reset(seed=0)
        with pytest.raises(ActionError, match="agent 'runner_0' has no action"):
            env.step({"chaser_0": 0})
        with pytest.raises(ActionError, match=r"agent 'chaser_0': .*out of range 0 to 8"):
            env.step({"chaser_0": 9, "runner_0": np.zeros(2)})
        with pytest.raises(UsageError, match="starts one world"):
            parallel_env("tag", num_worlds=2)
    finally:
        env.close()


def test_a_pickle_makes_an_equal_environment(oracle: Path) -> None:
    env = parallel_env(oracle)
    other: Any = pickle.loads(pickle.dumps(env))
    try:
        np.testing.assert_equal(env.reset(seed=3)[0], other.reset(seed=3)[0])
    finally:
        env.close()
        other.close()
