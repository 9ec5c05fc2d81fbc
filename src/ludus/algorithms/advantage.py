"""Generalised advantage estimation (Schulman et al. 2016, arXiv:1506.02438)."""

from __future__ import annotations

import torch
from torch import Tensor

__all__ = ["generalised_advantage"]


def generalised_advantage(
    reward: Tensor,
    value: Tensor,
    next_value: Tensor,
    is_done: Tensor,
    discounts: tuple[float, float],
) -> Tensor:
    """Return the advantage of each transition, equations 11 to 16.

    ``delta_t = r_t + gamma * V(s_{t+1}) - V(s_t)`` and
    ``A_t = delta_t + gamma * lambda * (1 - done_t) * A_{t+1}``.

    Args:
        reward: ``float32[steps, agents]``.
        value: ``float32[steps, agents]``, V of the state acted on.
        next_value: ``float32[steps, agents]``, V of the state the action led to: 0 where the
            episode terminated, that of the final observation where it was truncated.
        is_done: ``bool[steps, agents]``, where no later transition continues this one.
        discounts: Gamma and lambda.

    Returns:
        ``float32[steps, agents]``.
    """
    discount, gae_lambda = discounts
    delta = torch.add(reward, next_value, alpha=discount).sub_(value)
    decay = (~is_done).to(delta.dtype).mul_(discount * gae_lambda)
    for step in range(len(delta) - 2, -1, -1):
        delta[step].addcmul_(decay[step], delta[step + 1])
    return delta
