"""Games of both bridges as pools and environments, in real Godot 3."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import ludus
from ludus.errors import UsageError
from ludus.pool import EnginePool
from ludus.runs.metrics import read_metrics
from ludus.settings.train_config import PPOConfig, TrainConfig
from ludus.training.loop import train
from tests.legacy.conftest import KINDS, Walk, move, walk_of
from tests.legacy.gymgodot.conftest import left_processes, running_games

pytestmark = [pytest.mark.engine, pytest.mark.usefixtures("nothing_left")]


def places(observations: Any) -> list[float]:
    return [row[0] for row in observations.tolist()]


def pool_places(pool: EnginePool, *values: float) -> list[float]:
    return places(pool.step(move(*values))["agent"].observation["observation"])


def test_pool_steps_two_games(walk: Walk) -> None:
    with walk.pool(num_engines=2, max_episode_steps=4) as pool:
        assert (pool.num_engines, pool.num_agents("agent")) == (2, 2)
        pool.reset(seed=3)
        assert pool_places(pool, 0.25, 0.5) == [0.5, 1.0]
        assert pool_places(pool, 0.25, 0.5) == [1.0, 2.0]
        assert pool_places(pool, 0.25, 0.5) == [1.5, 3.0]
        batch = pool.step(move(0.25, 0.5))["agent"]
        assert batch.terminated.tolist() == [False, True]
        assert batch.truncated.tolist() == [True, False]
        assert places(batch.final_observation["observation"]) == [2.0, 4.0]
        assert pool_places(pool, 0.25, 0.5) == [0.5, 1.0]
        assert pool.times(1).engine_us > 0


def test_dead_game_is_restarted(walk: Walk, tmp_path: Path) -> None:
    with walk.pool(num_engines=2, max_restarts=1, log_dir=tmp_path) as pool:
        pool.reset()
        pool_places(pool, 0.25, 0.25)
        running_games()[0].kill()
        batch = pool.step(move(0.25, 0.25))["agent"]
        assert sorted(batch.truncated.tolist()) == [False, True]
        assert sorted(places(batch.observation["observation"])) == [0.0, 1.0]
        assert places(batch.final_observation["observation"]) == [0.5]
        assert sorted(pool_places(pool, 0.25, 0.25)) == [0.5, 1.5]
        assert pool.num_restarts == 1
        assert len(running_games()) == 2
    assert "Godot Engine v3" in (tmp_path / "engine-0.log").read_text()


def test_make_is_one_environment(walk: Walk) -> None:
    env = ludus.make(walk.target, **walk.settings)
    observation, info = env.reset(seed=1)
    assert (places(observation[None]), info) == ([0.0], {})
    for count in range(1, 7):
        observation, reward, terminated, truncated, _ = env.step(np.array([0.25], np.float32))
        assert places(observation[None]) == [0.5 * count]
        assert (reward, terminated, truncated) == (0.25 * count, False, False)
    assert env.step(np.array([0.25], np.float32))[2:4] == (True, False)
    assert places(env.reset()[0][None]) == [0.0]
    env.close()
    assert left_processes() == []


@pytest.mark.filterwarnings("ignore:.*A Box observation space")
def test_gymnasium_checker_passes(walk: Walk) -> None:
    with ludus.make(walk.target, max_episode_steps=50, **walk.settings) as env:
        check_env(env, skip_render_check=True)


def test_make_vec_is_several_environments(walk: Walk) -> None:
    envs = ludus.make_vec(walk.target, num_engines=2, max_episode_steps=3, **walk.settings)
    assert envs.num_envs == 2
    envs.reset(seed=1)
    for _ in range(2):
        envs.step(np.array([[0.25], [0.5]], np.float32))
    observations, rewards, _, truncated, infos = envs.step(np.array([[0.25], [0.5]], "f4"))
    assert (places(observations), rewards.tolist()) == ([0.0, 0.0], [0.75, 1.5])
    assert truncated.all()
    assert places(np.stack(infos["final_obs"])) == [1.5, 3.0]
    envs.close()


def test_parameters_reach_the_game(projects: dict[str, Path]) -> None:
    walk = walk_of("json", projects)
    env = ludus.make(walk.target, **walk.settings)
    observation, _ = env.reset(options={"parameters": {"world": {"start": 0.5}}})
    assert observation.tolist() == [0.5]
    with pytest.raises(UsageError, match="unknown reset option 'wind'"):
        env.reset(options={"parameters": {"wind": {}}})
    assert env.reset()[0].tolist() == [0.5]
    env.close()


@pytest.mark.parametrize("kind", KINDS)
def test_ppo_trains_on_two_games(projects: dict[str, Path], kind: str, tmp_path: Path) -> None:
    """A few updates of PPO, with the trainer itself, on two games at once."""
    config = TrainConfig(
        target=kind,
        ppo=PPOConfig(hidden_sizes=(16,), rollout_steps=32, minibatch_size=64, epochs=2),
        total_steps=256,
        evaluation_episodes=2,
        runs=tmp_path,
        seed=1,
    )
    with walk_of(kind, projects).pool(num_engines=2, max_episode_steps=20) as pool:
        result = train(config, pool=pool)
    assert (result.stop_reason, result.agent_steps, result.updates) == ("total_steps", 256, 4)
    assert len(read_metrics(result.path / "metrics.jsonl")) == 4
