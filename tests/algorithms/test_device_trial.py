from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import pytest
import torch

from ludus.algorithms.device_trial import faster_device, for_a_trial, seconds_per_update
from ludus.algorithms.learner import Learner, LearnerSettings
from ludus.algorithms.ppo import PPO
from ludus.algorithms.sac import SAC
from ludus.networks.policy import Policy
from ludus.settings.policy_config import PolicyConfig, PPOConfig, SACConfig
from ludus.spec import AgentSpec, DiscreteAction, ObservationEntry, PolicySpec

SPEC = PolicySpec(
    "hero",
    (ObservationEntry("o", "float32", (2,)), ObservationEntry("eye", "uint8", (12, 12, 1))),
    (DiscreteAction("a", 3),),
    (AgentSpec(0, "x"),),
)
ROWS = [slice(0, 3), slice(3, 5)]


class Slow:
    """A learner whose updates take a given time; it counts them."""

    num_steps_left = 0

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.num_updates = 0

    def begin(self, *_: object) -> None:
        self.num_steps_left = 2

    def act(self, _: int) -> None:
        time.sleep(self.seconds)

    def learn_while_stepping(self) -> None:
        pass

    def record(self, engine: int, _: object) -> None:
        self.num_steps_left -= engine

    def update(self, _: float) -> None:
        self.num_updates += 1
        self.num_steps_left = 2


def maker(**seconds: float) -> tuple[dict[str, Slow], Callable[[torch.device], Learner]]:
    """Return learners by device, and what makes them: some seconds for each choice of actions."""
    made = {device: Slow(each) for device, each in seconds.items()}
    return made, lambda device: cast(Learner, made[device.type])


@pytest.mark.parametrize("cpu, cuda", [(0.001, 0.02), (0.02, 0.001)])
def test_the_faster_device_is_taken(cpu: float, cuda: float) -> None:
    made, make = maker(cpu=cpu, cuda=cuda)
    assert faster_device(SPEC, ROWS, make).type == ("cpu" if cpu < cuda else "cuda")
    assert made["cuda"].num_updates > 1


def test_a_processor_that_is_far_slower_need_not_finish() -> None:
    made, make = maker(cpu=0.05, cuda=0.001)
    assert faster_device(SPEC, ROWS, make).type == "cuda"
    assert made["cpu"].num_updates == 0


def test_a_gpu_that_fails_is_named_and_not_taken(caplog: pytest.LogCaptureFixture) -> None:
    def make(device: torch.device) -> Learner:
        raise RuntimeError(f"{device}: out of memory\nand a page of details")

    with caplog.at_level(logging.WARNING):
        assert faster_device(SPEC, ROWS, make).type == "cpu"
    assert caplog.messages == [
        "policy hero learns on the CPU, as the GPU fails: cuda: out of memory"
    ]


@pytest.mark.parametrize(
    "config",
    [
        PPOConfig(minibatch_size=32),
        PPOConfig(memory_size=8),
        SACConfig(batch_size=16, report_steps=4),
    ],
    ids=["ppo", "memory", "sac"],
)
def test_a_trial_plays_and_learns(config: PolicyConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = for_a_trial(config, 5)
    algorithm: Any = PPO if isinstance(settings, PPOConfig) else SAC
    learner = algorithm(Policy(SPEC, settings), settings, LearnerSettings(ROWS, seed=0))
    before = [parameter.clone() for parameter in learner.policy.parameters()]
    updates: list[dict[str, float]] = []
    update = learner.update

    def counted(progress: float) -> None:
        updates.append(update(progress))

    monkeypatch.setattr(learner, "update", counted)
    assert seconds_per_update(learner, SPEC, ROWS) > 0.0
    assert len(updates) == 4
    changed = [
        not torch.equal(old, new)
        for old, new in zip(before, learner.policy.parameters(), strict=True)
    ]
    assert any(changed)


def test_a_trial_of_a_policy_with_memory_keeps_sequences_whole() -> None:
    config = PPOConfig(memory_size=8, sequence_length=16, rollout_steps=128, minibatch_size=1024)
    for num_agents, num_steps in ((100, 16), (50, 32), (1, 128)):
        assert for_a_trial(config, num_agents) == replace(config, rollout_steps=num_steps)
