"""How fast RLlib trains with as many workers."""

# The types of these libraries are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
from __future__ import annotations

import statistics
import time
from dataclasses import dataclass
from typing import Any

from cluster_timing import WARM_S, agent_steps_per_s, print_table


@dataclass(frozen=True)
class RLlib:
    """Train on ball_chase with RLlib's MultiAgentEnvRunner and with a cluster, in turns.

    Ours runs twice, as it is and with overlap, where it learns while workers play.

    Attributes:
        rounds: Turns of all three; the median of their ratios counts.
        seconds: Of each run.
        workers: Processes that play, of both.
        worlds: Of each worker of ours, in one engine.
        envs: Of each runner of RLlib, each an engine.
    """

    rounds: int = 3
    seconds: float = 10.0
    workers: tuple[int, ...] = (1, 2)
    worlds: int = 8
    envs: int = 1


def measure_rllib(options: RLlib) -> None:
    """Print agent-steps/s of training on ball_chase, RLlib's and ours with as many workers."""
    rows: list[list[object]] = []
    for num in options.workers:

        def run(num: int = num, **ppo: Any) -> float:
            return agent_steps_per_s(
                options.seconds, "ball_chase", num_worlds=options.worlds, num_engines=1,
                cluster=f"local:{num}", ppo=ppo,
            )  # fmt: skip

        rounds = [
            (run(), run(overlap=True), _rllib_steps_per_s(options, num))
            for _ in range(options.rounds)
        ]
        speeds = [f"{statistics.median(each):,.0f}" for each in zip(*rounds, strict=True)]
        ratios: list[str] = []
        for way in (0, 1):
            of_rounds = sorted(each[way] / each[2] for each in rounds)
            ratios.append(
                f"{statistics.median(of_rounds):.1f} ({of_rounds[0]:.1f} to {of_rounds[-1]:.1f})"
            )
        rows.append([num, *speeds, *ratios])
        print(*rows[-1], flush=True)
    header = ["workers", "Ludus", "with overlap", "RLlib", "ratio", "with overlap"]
    print_table(header, rows)


def _rllib_steps_per_s(options: RLlib, workers: int) -> float:
    """Train with RLlib's own runners, network sizes and batches as ours have by default."""
    import ray
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    from ludus.rllib import LudusMultiAgentEnv, policy_of

    ray.init(address="local", num_cpus=workers + 1, include_dashboard=False, log_to_driver=False)
    config: Any = PPOConfig()
    config = (
        config.environment(LudusMultiAgentEnv, env_config={"target": "ball_chase"})
        .env_runners(num_env_runners=workers, num_envs_per_env_runner=options.envs)
        .multi_agent(policies={"chaser"}, policy_mapping_fn=policy_of)
        .rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[64, 64]))
        .training(
            # Steps of the environment; its 16 agents make as many transitions as ours, 4,096 for
            # each worker. RLlib compares the minibatch, of transitions, with them.
            train_batch_size_per_learner=256 * options.envs * workers, minibatch_size=1024,
            num_epochs=4,
        )
        .experimental(_validate_config=False)
    )  # fmt: skip
    algorithm = config.build_algo()
    try:
        start, steps = time.perf_counter(), 0
        algorithm.train()
        while time.perf_counter() - start < WARM_S:
            algorithm.train()
        start = time.perf_counter()
        while time.perf_counter() - start < options.seconds:
            result = algorithm.train()
            steps += sum(result["env_runners"]["num_agent_steps_sampled"].values())
        return steps / (time.perf_counter() - start)
    finally:
        algorithm.stop()
        ray.shutdown()
