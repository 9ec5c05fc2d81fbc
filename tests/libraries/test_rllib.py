"""RLlib: episodes of our runner hold what the game did, and PPO learns from them."""

# Ray's types are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownParameterType=false

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("ray")

import ray
import torch
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.env.multi_agent_env_runner import MultiAgentEnvRunner

from ludus.errors import UsageError
from ludus.rllib import LudusEnvRunner, LudusMultiAgentEnv, policy_of

pytestmark = [
    pytest.mark.libraries,
    pytest.mark.engine,
    pytest.mark.timeout(400, func_only=True),
    pytest.mark.filterwarnings("ignore"),  # Ray's own are many
]


@pytest.fixture(scope="module", autouse=True)
def _ray() -> Iterator[None]:
    torch.set_num_threads(1)  # several wait for each other where cores are busy
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_raylet_start_wait_time_s", "200")  # 30 s are too few on a busy machine
        ray.init(address="local", num_cpus=2, include_dashboard=False, log_to_driver=False)
        yield
        ray.shutdown()


def configure(target: Any, worlds: int, policies: set[str], **settings: Any) -> Any:
    config: Any = PPOConfig()  # it declares other types than it takes
    return (
        config.environment(LudusMultiAgentEnv, env_config={"target": str(target), **settings})
        .env_runners(
            env_runner_cls=LudusEnvRunner, num_env_runners=0, num_envs_per_env_runner=worlds
        )
        .multi_agent(policies=policies, policy_mapping_fn=policy_of)
        .debugging(seed=1)
    )


def test_episodes_hold_what_the_game_did(oracle: Path) -> None:
    config = configure(oracle, 3, {"oracle"})
    runner = LudusEnvRunner(config=config, worker_index=0)
    try:
        first = runner.sample(num_timesteps=3 * 7)
        rest = runner.sample(num_timesteps=3 * 4)
    finally:
        runner.stop()
    assert sum(map(len, first)) == 21
    assert sum(map(len, rest)) == 12
    whole = [episode for episode in first if episode.is_done]
    assert [len(episode) for episode in whole] == [5, 5, 5]  # the oracle ends after 5 steps
    for episode in [*first, *rest]:
        seen = episode.get_observations()
        start = episode.t_started
        assert seen[:, 1].tolist() == list(range(start, start + len(episode) + 1))
        np.testing.assert_array_equal(seen[1:, 2], episode.get_actions())
        np.testing.assert_allclose(episode.get_rewards(), 0.1 * seen[1:, 1], rtol=1e-6)
        assert episode.agent_id == "oracle_0"
        assert episode.module_id == "oracle"
    # Pieces of one episode have one id.
    begun = {episode.id_: len(episode) for episode in first if not episode.is_done}
    assert {episode.id_ for episode in rest if episode.t_started} == set(begun)


def test_several_policies_are_several_modules() -> None:
    runner = LudusEnvRunner(config=configure("tag", 4, {"chaser", "runner"}), worker_index=0)
    try:
        episodes = runner.sample(num_episodes=4)
    finally:
        runner.stop()
    assert {episode.module_id for episode in episodes} == {"chaser", "runner"}
    assert all(episode.is_done for episode in episodes)


def test_what_the_runner_cannot_do_is_refused(tasks: Path) -> None:
    with pytest.raises(UsageError, match="observes several arrays"):
        LudusEnvRunner(
            config=configure(tasks / "identity_mixed.tscn", 1, {"mixed"}), worker_index=0
        )
    with pytest.raises(UsageError, match=r"(?s)has action masks.*ActionMaskingTorchRLModule"):
        LudusEnvRunner(config=configure("key_door", 1, {"hero"}), worker_index=0)


def test_rllibs_own_runner_takes_the_environment() -> None:
    config = configure("tag", 1, {"chaser", "runner"})
    runner = MultiAgentEnvRunner(config=config, worker_index=0)
    try:
        episodes = runner.sample(num_timesteps=20)
    finally:
        runner.stop()
    assert sum(len(episode) for episode in episodes) == 20


def test_ppo_learns_cartpole() -> None:
    config = configure("cartpole", 32, {"cart"}).training(
        train_batch_size_per_learner=2048, minibatch_size=256, num_epochs=6, lr=2e-3, gamma=0.99
    )
    algorithm = config.build_algo()
    try:
        returns = [
            algorithm.train()["env_runners"].get("episode_return_mean", 0.0) for _ in range(6)
        ]
    finally:
        algorithm.stop()
    assert max(returns) > 3 * returns[0], returns


def test_ppo_learns_to_chase_in_tag() -> None:
    """The runner keeps its first network: two that learn chase each other's returns, too."""
    num_worlds = 32
    config = configure("tag", num_worlds, {"chaser", "runner"})
    config = config.multi_agent(policies_to_train=["chaser"]).training(
        train_batch_size_per_learner=4096, minibatch_size=512, num_epochs=6, lr=2e-3, gamma=0.98
    )
    algorithm = config.build_algo()

    def chaser_return() -> float:
        """Play as long as one round may last; whoever catches early plays on in the next one."""
        episodes = algorithm.env_runner.sample(num_timesteps=num_worlds * 200, force_reset=True)
        own = [episode.get_return() for episode in episodes if episode.module_id == "chaser"]
        return sum(own) / num_worlds

    try:
        returns = [chaser_return()]
        while len(returns) <= 10 and returns[-1] < returns[0] + 0.5:  # RLlib repeats no run
            for _ in range(4):
                algorithm.train()
            returns.append(chaser_return())
    finally:
        algorithm.stop()
    assert returns[0] < -0.7  # hardly a catch
    assert returns[-1] >= returns[0] + 0.5, returns
