"""Running statistics that shift and scale observations and rewards."""

from __future__ import annotations

import torch
from torch import Tensor, nn

__all__ = ["RewardScaler", "RunningNormaliser"]

LIMIT = 10.0
"""Normalised values are cut off here, in deviations."""

MIN_VARIANCE = 1e-8


class RunningNormaliser(nn.Module):
    """Shift and scale vectors by the mean and deviation of all seen so far.

    Statistics change in :meth:`update` only, so that a rollout is collected and learnt from with
    the same ones, and are part of the state dictionary.

    Attributes:
        mean: ``float64[size]``.
        variance: ``float64[size]``.
        count: ``float64[]``, vectors seen.
    """

    mean: Tensor
    variance: Tensor
    count: Tensor
    _shift: Tensor
    _scale: Tensor

    def __init__(self, size: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(size, dtype=torch.float64))
        self.register_buffer("variance", torch.ones(size, dtype=torch.float64))
        self.register_buffer("count", torch.zeros((), dtype=torch.float64))
        self.register_buffer("_shift", torch.zeros(size))
        self.register_buffer("_scale", torch.ones(size))

    def forward(self, vector: Tensor) -> Tensor:
        """Return ``(vector - mean) / deviation``, cut off at ±10; ``float32[..., size]``."""
        return vector.sub(self._shift).mul_(self._scale).clamp_(-LIMIT, LIMIT)

    @torch.no_grad()
    def update(self, vectors: Tensor) -> None:
        """Take ``float32[n, size]`` into the statistics (Chan et al. 1979, parallel variance)."""
        num_new = len(vectors)
        if vectors.numel() == 0:
            return
        vectors = vectors.double()
        variance, mean = torch.var_mean(vectors, dim=0, correction=0)
        total = self.count + num_new
        delta = mean - self.mean
        weight = num_new / total
        spread = delta.square() * weight * (1 - weight)
        self.variance.copy_(self.variance * (1 - weight) + variance * weight + spread)
        self.mean.add_(delta * weight)
        self.count.copy_(total)
        self._shift.copy_(self.mean)
        self._scale.copy_(self.variance.clamp(min=MIN_VARIANCE).rsqrt())


class RewardScaler(nn.Module):
    """Divide rewards by the running deviation of the discounted return (OpenAI Baselines).

    The mean stays, as shifting rewards would change what an episode's length is worth.

    Attributes:
        running_return: ``float32[agents]``, discounted sum of rewards so far in each episode.
    """

    running_return: Tensor

    def __init__(self, num_agents: int, discount: float) -> None:
        super().__init__()
        self.discount = discount
        self.statistics = RunningNormaliser(1)
        self.register_buffer("running_return", torch.zeros(num_agents))

    @torch.no_grad()
    def scale(self, reward: Tensor, is_valid: Tensor, is_done: Tensor) -> Tensor:
        """Return scaled rewards, after taking them into the statistics.

        Args:
            reward: ``float32[steps, agents]``.
            is_valid: ``bool[steps, agents]``, transitions that count.
            is_done: ``bool[steps, agents]``, where an episode ended.
        """
        returns = torch.empty_like(reward)
        for step in range(len(reward)):
            self.running_return.mul_(self.discount).add_(reward[step])
            returns[step] = self.running_return
            self.running_return.masked_fill_(is_done[step], 0.0)
        self.statistics.update(returns[is_valid].unsqueeze(1))
        deviation = self.statistics.variance.clamp(min=MIN_VARIANCE).sqrt()
        return (reward / deviation.to(reward.dtype)).clamp_(-LIMIT, LIMIT)

    def forget(self) -> None:
        """Forget the returns of all running episodes."""
        self.running_return.zero_()
