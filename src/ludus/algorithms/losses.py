"""The terms of the losses of PPO and SAC, and generalised advantage estimation.

PPO: Schulman et al. 2017, arXiv:1707.06347. SAC: Haarnoja et al. 2018, arXiv:1812.05905, whose
numbers of equations stand beside its terms unless they say otherwise.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ludus.networks.distributions import tanh_log_det

__all__ = [
    "approximate_kl",
    "clipped_surrogate",
    "critic_loss",
    "discrete_soft_value",
    "generalised_advantage",
    "soft_value",
    "squashed_log_prob",
    "temperature_loss",
    "value_loss",
]

# --- PPO ----------------------------------------------------------------------------------------


def generalised_advantage(
    reward: Tensor,
    value: Tensor,
    next_value: Tensor,
    is_done: Tensor,
    discounts: tuple[float, float],
) -> Tensor:
    """Return the advantage of each transition (Schulman et al. 2016, arXiv:1506.02438).

    Equations 11 to 16: ``delta_t = r_t + gamma * V(s_{t+1}) - V(s_t)`` and
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


# --- SAC ----------------------------------------------------------------------------------------


def squashed_log_prob(raw: Tensor, noise: Tensor, log_std: Tensor) -> Tensor:
    """Return the log-density of ``tanh(raw)``, appendix C; ``raw`` is ``mean + noise * std``."""
    squares = 0.5 * noise.square() + log_std + 0.5 * math.log(2 * math.pi)
    return -squares.sum(-1) - tanh_log_det(raw)


def soft_value(q: Tensor, log_prob: Tensor, temperature: Tensor) -> Tensor:
    """Return ``Q - alpha log pi``, equation 3.

    Args:
        q: ``float32[n]``, of an action drawn from the policy; the smaller one of two critics.
        log_prob: ``float32[n]``, of that action.
        temperature: Alpha.
    """
    return q - temperature * log_prob


def discrete_soft_value(q: Tensor, log_prob: Tensor, temperature: Tensor) -> tuple[Tensor, Tensor]:
    """Return ``sum_a pi (Q - alpha log pi)``, Christodoulou's equation 10, and the entropy.

    Args:
        q: ``float32[n, a]``, of every action; the smaller one of two critics.
        log_prob: ``float32[n, a]``.
        temperature: Alpha.
    """
    probability = log_prob.exp()
    entropy = -(probability * log_prob).sum(-1)
    return (probability * q).sum(-1) + temperature * entropy, entropy


def critic_loss(first: Tensor, second: Tensor, target: Tensor) -> Tensor:
    """Return ``1/2 (Q - y)^2``, equation 5: mean over the batch, sum over both critics.

    Args:
        first: ``float32[n]``, what one critic says of the actions taken.
        second: The same of the other.
        target: ``float32[n]``, what both should say.
    """
    return 0.5 * ((first - target).square().mean() + (second - target).square().mean())


def temperature_loss(log_temperature: Tensor, excess: Tensor) -> Tensor:
    """Return ``log(alpha) (H - target)``, equation 18 with the logarithm in place of alpha.

    The paper's authors, too, learn the logarithm so; it has the same root and never gets negative.

    Args:
        log_temperature: ``float32[1]``.
        excess: ``float32[n]``, entropy of the policy above the target entropy.
    """
    return log_temperature.squeeze(0) * excess.mean()
