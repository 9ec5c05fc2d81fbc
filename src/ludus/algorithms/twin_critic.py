"""The two critics of SAC: the smaller of two estimates keeps values from growing too high."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ludus.networks.dense import Network, accelerate
from ludus.networks.networks import FeatureTorso, Inputs, perceptron
from ludus.networks.own_network import OwnTorso

__all__ = ["TwinCritic"]


class TwinCritic(nn.Module):
    """Two networks over the same observations; images go through convolutions of their own.

    Args:
        torso: From observations to features; the critics' own.
        sizes: Units of each hidden layer.
        num_inputs: Elements of the action that the networks look at, beside the observation.
        num_outputs: Values that each puts out.
        activation: Non-linearity between layers.
    """

    def __init__(
        self,
        torso: FeatureTorso | OwnTorso,
        sizes: tuple[int, ...],
        num_inputs: int,
        num_outputs: int,
        activation: str,
    ) -> None:
        super().__init__()
        self.torso = torso
        sizes = (self.torso.size + num_inputs, *sizes, num_outputs)
        self.first = perceptron(sizes, activation, 1.0)
        self.second = perceptron(sizes, activation, 1.0)
        self._networks: tuple[Network, Network] = (self.first, self.second)

    def accelerate(self) -> None:
        """Compute faster where that is possible; call it once parameters are where they stay."""
        self._networks = accelerate(self.first), accelerate(self.second)

    def forward(self, inputs: Inputs, action: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Return the values of both, ``float32[n, num_outputs]`` each.

        Args:
            inputs: ``n`` observations.
            action: ``float32[n, num_inputs]``, None if the networks look at none.
        """
        features = self.torso(inputs)
        if action is not None:
            features = torch.cat([features, action], 1)
        first, second = self._networks
        return first(features).float(), second(features).float()
