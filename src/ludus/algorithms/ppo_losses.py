"""The terms of PPO's objective (Schulman et al. 2017, arXiv:1707.06347)."""

from __future__ import annotations

import torch
from torch import Tensor

__all__ = ["approximate_kl", "clipped_surrogate", "value_loss"]


def clipped_surrogate(log_ratio: Tensor, advantage: Tensor, clip_range: float) -> Tensor:
    """Return ``L^CLIP``, equation 7: ``min(ratio * A, clip(ratio, 1 - eps, 1 + eps) * A)``."""
    ratio = log_ratio.exp()
    clipped = ratio.clamp(1.0 - clip_range, 1.0 + clip_range)
    return torch.minimum(ratio * advantage, clipped * advantage)


def value_loss(value: Tensor, target: Tensor, old: Tensor, clip_range: float | None) -> Tensor:
    """Return half the mean squared error, with values optionally held near the ``old`` ones."""
    loss = (value - target).square()
    if clip_range is not None:
        held = old + (value - old).clamp(-clip_range, clip_range)
        loss = torch.maximum(loss, (held - target).square())
    return 0.5 * loss.mean()


def approximate_kl(log_ratio: Tensor) -> Tensor:
    """Return the estimator k3 of Schulman, http://joschu.net/blog/kl-approx.html."""
    return (log_ratio.expm1() - log_ratio).mean()
