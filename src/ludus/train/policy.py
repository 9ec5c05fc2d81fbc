"""A policy: everything that turns observations into actions, and nothing that trains it."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ludus.batch import ActionBatch, Batch
from ludus.spec import PolicySpec
from ludus.train.config import PPOConfig
from ludus.train.distributions import ActionHead
from ludus.train.networks import ActorCritic, Inputs, ObservationEncoder
from ludus.train.tensors import as_tensor, as_tensors

__all__ = ["Policy"]


class Policy(nn.Module):
    """Network, observation statistics and action distribution of one policy.

    Attributes:
        spec: What it observes and does.
        encoder: From entries to inputs; holds the observation statistics.
        network: Actor and critic.
        head: The action distribution.
    """

    def __init__(self, spec: PolicySpec, config: PPOConfig) -> None:
        super().__init__()
        self.spec = spec
        self.encoder = ObservationEncoder(spec.observation, config.normalise_observation)
        self.head = ActionHead(spec, config.initial_log_std)
        self.network = ActorCritic(self.encoder, self.head.num_outputs, config)

    def outputs(self, inputs: Inputs) -> Tensor:
        """Return the actor's outputs, ``float32[n, head.num_outputs]``."""
        return self.network.actor(self.network.features(inputs))

    def value(self, inputs: Inputs) -> Tensor:
        """Return the critic's values, ``float32[n]``, in the units of scaled rewards."""
        return self.network.critic(self.network.features(inputs))

    @torch.inference_mode()
    def act(self, batch: Batch, generator: torch.Generator | None = None) -> ActionBatch:
        """Return the action of every slot.

        Args:
            batch: What the slots observe.
            generator: Draws samples; None takes the most probable actions.
        """
        device = self.head.log_std.device
        inputs = self.encoder(as_tensors(batch.observation, device))
        mask = None if batch.action_mask is None else as_tensor(batch.action_mask, device)
        noise = None
        if generator is not None:
            noise = torch.empty(len(inputs), self.head.num_outputs, device=device)
            self.head.fill_noise(noise, generator)
        discrete, continuous = self.head.sample(self.outputs(inputs), noise, mask)
        return ActionBatch(discrete.cpu().numpy(), self.head.to_bounds(continuous).cpu().numpy())
