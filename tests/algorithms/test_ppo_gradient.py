from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch

from ludus.algorithms.imitation import Imitation
from ludus.algorithms.learner import LearnerSettings
from ludus.algorithms.ppo import PPO
from ludus.algorithms.ppo_gradient import MAX_ROWS, PPOGradient
from ludus.algorithms.transitions import Transitions
from ludus.networks.networks import Inputs
from ludus.networks.policy import Policy
from ludus.settings.train_config import PPOConfig
from ludus.spec import AgentSpec, ContinuousAction, DiscreteAction, ObservationEntry, PolicySpec

AGENTS = (AgentSpec(0, "x"),)
ENTRIES = (ObservationEntry("o", "float32", (3,)),)
DISCRETE = (DiscreteAction("a", 3), DiscreteAction("b", 2))
CONTINUOUS = (ContinuousAction("c", 2, -1.0, 1.0),)
ROWS = MAX_ROWS + 77
"""More than are computed at a time."""
CONFIG = PPOConfig(hidden_sizes=(8, 6), max_grad_norm=1e9)


def learner(actions: Any, config: PPOConfig, entries: Any = ENTRIES) -> PPO:
    """Return a learner that is no longer where it began: ratios differ from 1."""
    spec = PolicySpec("hero", entries, actions, AGENTS)
    ppo = PPO(Policy(spec, config), config, LearnerSettings([slice(0, 1)], seed=1))
    generator = torch.Generator().manual_seed(0)
    for parameter in [*ppo.policy.parameters(), *ppo._critic.parameters()]:  # pyright: ignore[reportPrivateUsage]
        parameter.data.normal_(0.0, 0.5, generator=generator)
    return ppo


@torch.no_grad()
def transitions(ppo: PPO, is_masked: bool) -> Transitions:
    """Return some whose ratios are clipped about as often as not."""
    head, generator = ppo.policy.head, torch.Generator().manual_seed(2)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    mask = None
    if is_masked:
        mask = torch.rand(ROWS, head.num_logits, generator=generator) < 0.7
        mask[:, 0] = mask[:, 3] = True
    discrete, _ = head.sample(normal(ROWS, head.num_outputs), None, mask)
    vector, continuous = normal(ROWS, 3), normal(ROWS, head.size)
    log_prob, _ = head.evaluate(ppo.policy.actor(vector), discrete, continuous, mask)
    return Transitions(
        Inputs(vector), discrete, continuous, mask, log_prob + 0.3 * normal(ROWS),
        normal(ROWS), normal(ROWS), normal(ROWS),
    )  # fmt: skip


def step(ppo: PPO, batch: Transitions) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the gradient of one step that moves nothing, and its metrics."""
    ppo._learning_rate, ppo._has_seen_reward = 0.0, True  # pyright: ignore[reportPrivateUsage]
    losses = ppo._gradient_step(batch)  # pyright: ignore[reportPrivateUsage]
    parameters = [*ppo.policy.parameters(), *ppo._critic.parameters()]  # pyright: ignore[reportPrivateUsage]
    gradients = torch.nn.utils.parameters_to_vector(
        p.grad for p in parameters if p.grad is not None
    )
    return gradients, losses


@pytest.mark.parametrize(
    ("actions", "is_masked", "changes"),
    [
        (DISCRETE, False, {}),
        (DISCRETE, True, {"value_clip_range": 0.5, "activation": "relu"}),
        (CONTINUOUS, False, {"normalise_advantage": False, "hidden_sizes": ()}),
        (CONTINUOUS, False, {"squash": True, "critic_hidden_sizes": (5,)}),
        ((*DISCRETE, *CONTINUOUS), True, {"entropy_coefficient": 0.5}),
    ],
)
def test_gradient_and_losses_are_those_of_autograd(
    actions: Any, is_masked: bool, changes: dict[str, Any]
) -> None:
    ppo = learner(actions, replace(CONFIG, **changes))
    batch = transitions(ppo, is_masked)
    assert ppo._gradient is not None  # pyright: ignore[reportPrivateUsage]
    gradient, losses = step(ppo, batch)
    ppo._gradient = None  # pyright: ignore[reportPrivateUsage]
    expected, expected_losses = step(ppo, batch)
    assert 0.1 < float(losses[4]) < 0.9  # the share of clipped ratios
    torch.testing.assert_close(gradient, expected, rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(losses, expected_losses, rtol=1e-4, atol=1e-6)


IMAGE = (ObservationEntry("o", "uint8", (8, 8, 3)),)


@pytest.mark.parametrize(
    ("entries", "changes", "settings"),
    [
        (ENTRIES, {"activation": "elu"}, {}),
        (ENTRIES, {"memory_size": 4}, {}),
        (ENTRIES, {"state_dependent_std": True}, {}),
        (IMAGE, {}, {}),
        (ENTRIES, {}, {"is_mixed": True}),
        (ENTRIES, {}, {"imitation": Imitation.__new__(Imitation)}),
    ],
)
def test_leaves_other_losses_to_autograd(
    entries: Any, changes: dict[str, Any], settings: dict[str, Any]
) -> None:
    ppo = learner(CONTINUOUS, replace(CONFIG, **changes), entries)
    critic = ppo._critic  # pyright: ignore[reportPrivateUsage]
    told = LearnerSettings([slice(0, 1)], seed=1, **settings)
    assert not PPOGradient.can_do(ppo.policy, critic, told)
