"""Curiosity by random network distillation (Burda et al. 2018, arXiv:1810.12894).

A network that stays as it was made maps observations to features, and a second one learns to
predict them. Where the prediction is far off, little like it was seen before: its error is a
reward of its own, the bonus, for the action that led there. Bonuses have a critic of their own and
go on past the end of an episode, as what lies behind it may be new as well.
"""

from __future__ import annotations

import itertools
from typing import Any, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from ludus.algorithms.adam import Adam
from ludus.algorithms.losses import generalised_advantage
from ludus.algorithms.transitions import equal_parts
from ludus.networks.networks import Inputs, perceptron
from ludus.networks.normalise import RewardScaler
from ludus.networks.policy import Policy
from ludus.networks.tensors import join_names, load_tensors, take_rows, with_prefix
from ludus.settings.policy_config import PPOConfig

__all__ = ["Curiosity"]

ADAM_EPSILON = 1e-5
HIDDEN_SIZE = 128
FEATURE_SIZE = 64


class Curiosity:
    """The bonus of one policy, and what it is worth to have acted for it.

    Args:
        policy: What observes; the networks here have torsos like its own.
        config: Its settings.
        num_agents: Slots of a rollout.
    """

    def __init__(self, policy: Policy, config: PPOConfig, num_agents: int) -> None:
        self._target = _Network(policy, 1, FEATURE_SIZE, 1.0).requires_grad_(False)
        self._predictor = _Network(policy, 2, FEATURE_SIZE, 1.0)
        self._critic = _Network(policy, 2, 1, 0.0)
        self._scaler = RewardScaler(num_agents, config.curiosity_discount)
        self._modules = nn.ModuleDict({
            "target": self._target, "predictor": self._predictor,
            "critic": self._critic, "scaler": self._scaler,
        }).to(policy.device)  # fmt: skip
        trained = itertools.chain(self._predictor.parameters(), self._critic.parameters())
        self._optimiser = Adam(trained, ADAM_EPSILON)
        self._inputs: Inputs | None = None
        self._return = torch.zeros(0)

    @torch.no_grad()
    def advantage(self, inputs: Inputs, is_active: Tensor, config: PPOConfig) -> Tensor:
        """Return ``float32[steps, agents]``, the advantages by bonuses of one rollout.

        They are in units of the standard deviation of the bonuses' return.

        Args:
            inputs: What was observed: ``steps + 1`` rows of each agent, step after step.
            is_active: ``bool[steps + 1, agents]``, who observed it.
            config: Settings, some of which may change while a run goes on.
        """
        value = self._critic(inputs).view(is_active.shape)
        bonus = self._errors(inputs).view(is_active.shape)[1:]
        # Only where an agent is gone, nothing follows.
        is_cut = ~is_active[1:]
        bonus = self._scaler.scale(bonus.masked_fill(is_cut, 0.0), is_active[:-1], is_cut)
        next_value = value[1:].masked_fill(is_cut, 0.0)
        discounts = config.curiosity_discount, config.gae_lambda
        advantage = generalised_advantage(bonus, value[:-1], next_value, is_cut, discounts)
        rows = is_active[:-1].flatten().nonzero()[:, 0]
        self._inputs = inputs.rows(rows)
        self._return = (advantage + value[:-1]).flatten().index_select(0, rows)
        return advantage

    def learn(self, config: PPOConfig, learning_rate: float, generator: torch.Generator) -> float:
        """Learn from the rollout of the last :meth:`advantage`; return the mean error before.

        Args:
            config: As for :meth:`advantage`.
            learning_rate: Of Adam.
            generator: Shuffles what was observed.
        """
        inputs, self._inputs = self._inputs, None
        if inputs is None or not len(inputs):
            return 0.0
        with torch.no_grad():
            novelty = float(self._errors(inputs).mean())
        num_parts = -(-len(inputs) // config.minibatch_size)
        for _ in range(config.epochs):
            order = torch.randperm(len(inputs), generator=generator, device=generator.device)
            for part in equal_parts(len(inputs), num_parts):
                self._gradient_step(inputs, order[part], learning_rate)
        return novelty

    def _gradient_step(self, every: Inputs, rows: Tensor, learning_rate: float) -> None:
        inputs = every.rows(rows)
        self._optimiser.zero_gradients()
        value = self._critic(inputs).squeeze(-1)
        loss = self._errors(inputs).mean()
        loss = loss + 0.5 * functional.mse_loss(value, take_rows(self._return, rows))
        cast(Any, loss).backward()
        self._optimiser.step(learning_rate)

    def _errors(self, inputs: Inputs) -> Tensor:
        """Return ``float32[n]``, how far the prediction is off."""
        return (self._predictor(inputs) - self._target(inputs)).square().mean(-1)

    def forget(self) -> None:
        """Forget the bonuses of all running episodes."""
        self._scaler.forget()

    # --- saving ---------------------------------------------------------------------------------

    def state(self) -> dict[str, Tensor]:
        """Return networks, statistics and optimiser, not copied."""
        parts = {"networks": self._modules.state_dict(), "optimiser": self._optimiser.state()}
        return join_names(parts, ".")

    def load_state(self, state: dict[str, Tensor]) -> None:
        """Go on from :meth:`state`, of curiosity with equal settings."""
        load_tensors(self._modules, state, "networks.")
        self._optimiser.load_state(with_prefix(state, "optimiser."))


class _Network(nn.Module):
    """A torso like that of the policy, and layers on it."""

    def __init__(self, policy: Policy, num_hidden: int, num_outputs: int, gain: float) -> None:
        super().__init__()
        self.torso = policy.make_torso()
        sizes = (self.torso.size, *[HIDDEN_SIZE] * num_hidden, num_outputs)
        self.layers = perceptron(sizes, "relu", gain)

    def forward(self, inputs: Inputs) -> Tensor:
        """Return ``float32[n, num_outputs]``."""
        return self.layers(self.torso(inputs))
