"""The terms of SAC's losses (Haarnoja et al. 2018, arXiv:1812.05905).

Numbers of equations are those of that paper unless it says otherwise.
"""

from __future__ import annotations

import math

from torch import Tensor

from ludus.networks.distributions import tanh_log_det

__all__ = [
    "critic_loss",
    "discrete_soft_value",
    "soft_value",
    "squashed_log_prob",
    "temperature_loss",
]


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
