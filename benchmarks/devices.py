"""Where a policy trains faster, on the processor or on the GPU: the trainer alone, without a game.

Each learner plays one rollout after the other on observations drawn at random, so what is timed is
choosing actions, recording and updating. With several devices they take turns.

    python benchmarks/devices.py --rounds 5
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass

import torch
import tyro

from ludus.algorithms.device_trial import for_a_trial, seconds_per_update
from ludus.algorithms.learner import LearnerSettings
from ludus.algorithms.ppo import PPO
from ludus.algorithms.sac import SAC
from ludus.networks.policy import Policy
from ludus.settings.policy_config import PolicyConfig, PPOConfig, SACConfig
from ludus.spec import AgentSpec, ContinuousAction, ObservationEntry, PolicySpec


@dataclass(frozen=True)
class Options:
    """Time the trainer on each device.

    Attributes:
        rounds: Rounds in turns; medians count.
        devices: Devices that take turns, and how many threads the processor has, as "cpu:4".
    """

    rounds: int = 5
    devices: tuple[str, ...] = ("cpu:1", "cuda")


@dataclass(frozen=True)
class Task:
    """A policy and its settings, and how many agents play it.

    Attributes:
        shape: Of its one observation; images are bytes.
        num_agents: Agents of all engines.
        config: Settings.
    """

    shape: tuple[int, ...]
    num_agents: int
    config: PolicyConfig

    def spec(self) -> PolicySpec:
        """Return the policy as a game would describe it."""
        dtype = "uint8" if len(self.shape) == 3 else "float32"
        return PolicySpec(
            "hero",
            (ObservationEntry("seen", dtype, self.shape),),
            (ContinuousAction("push", 2, -1.0, 1.0),),
            (AgentSpec(0, "hero"),),
        )


TASKS = {
    "PPO, 4 numbers, units 64 64": Task((4,), 128, PPOConfig()),
    "PPO, 64 numbers, units 256 256": Task((64,), 128, PPOConfig(hidden_sizes=(256, 256))),
    "PPO, 64 numbers, units 64 64, memory 64": Task((64,), 128, PPOConfig(memory_size=64)),
    "PPO, picture of 84 x 84 x 3": Task((84, 84, 3), 32, PPOConfig()),
    "SAC, 64 numbers, units 256 256": Task((64,), 64, SACConfig()),
}


def agent_steps_per_s(task: Task, device: str) -> float:
    """Return how many steps of agents are chosen and learned from in a second."""
    kind, _, threads = device.partition(":")
    torch.set_num_threads(int(threads or 1) if kind == "cpu" else 1)
    config = for_a_trial(task.config, task.num_agents)
    policy = Policy(task.spec(), config).to(kind)
    about = LearnerSettings([slice(0, task.num_agents)], 0, is_mixed=kind == "cuda")
    learner = (
        PPO(policy, config, about) if isinstance(config, PPOConfig) else SAC(policy, config, about)
    )
    num_steps = learner.num_steps_left * task.num_agents
    return num_steps / seconds_per_update(learner, task.spec(), about.engine_rows)


def main(options: Options) -> None:
    """Print the table."""
    print("| policy |", " | ".join(options.devices), "|")
    for name, task in TASKS.items():
        speeds: dict[str, list[float]] = {device: [] for device in options.devices}
        for _ in range(options.rounds):
            for device in options.devices:
                speeds[device].append(agent_steps_per_s(task, device))
        medians = [f"{statistics.median(each):,.0f}" for each in speeds.values()]
        print(f"| {name} |", " | ".join(medians), "|", flush=True)


if __name__ == "__main__":
    main(tyro.cli(Options))
