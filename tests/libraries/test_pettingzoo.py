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
