"""From network outputs to actions: categorical and Gaussian parts side by side.

An action has any number of discrete components and one block of continuous elements. The network
puts out the logits of all discrete components, then the means of the continuous elements, in a
space where every element's bounds are -1 and 1, then, if they depend on the state, the logarithms
of their deviations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from ludus.networks.tensors import as_tensor
from ludus.spec import PolicySpec

__all__ = [
    "LOG_STD_RANGE",
    "ActionHead",
    "GaussianShape",
    "categorical_entropy",
    "gaussian_entropy",
    "gaussian_log_prob",
    "masked_log_softmax",
    "tanh_log_det",
]

LOG_STD_RANGE = (-20.0, 2.0)
"""Log deviations that a network puts out are cut to this (Haarnoja et al. 2018)."""


FORBIDDEN = -1e8
"""Logit of an action that the mask forbids; finite, so that ``p * log p`` is 0 and not NaN."""


def masked_log_softmax(logits: Tensor, mask: Tensor | None) -> Tensor:
    """Return log-probabilities ``[..., n]``; forbidden actions (mask False) get about ``-1e8``."""
    if mask is not None:
        logits = logits.masked_fill(~mask, FORBIDDEN)
    return logits.log_softmax(-1)


def categorical_entropy(log_prob: Tensor) -> Tensor:
    """Return ``-sum p log p`` over the last axis."""
    return -(log_prob.exp() * log_prob).sum(-1)


def gaussian_log_prob(action: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
    """Return the log-density of ``action`` under independent Gaussians, summed over elements."""
    squares = ((action - mean) * torch.exp(-log_std)).square().sum(-1)
    return -0.5 * squares - log_std.sum(-1) - 0.5 * math.log(2 * math.pi) * action.shape[-1]


def gaussian_entropy(log_std: Tensor) -> Tensor:
    """Return the entropy of independent Gaussians, summed over elements."""
    return (log_std + 0.5 * math.log(2 * math.pi * math.e)).sum(-1)


def tanh_log_det(action: Tensor) -> Tensor:
    """Return ``sum log(1 - tanh(u)^2)``, what squashing takes from the log-density of ``u``.

    In the form that loses no precision for large ``u`` (Haarnoja et al. 2018, appendix C).
    """
    return (2.0 * (math.log(2.0) - action - functional.softplus(-2.0 * action))).sum(-1)


@dataclass(frozen=True)
class GaussianShape:
    """What kind of Gaussian continuous elements have.

    Attributes:
        initial_log_std: Logarithm of the deviation at the start.
        is_state_dependent: Whether the network puts out the deviation.
        is_squashed: Whether tanh keeps actions inside their bounds, or they are cut off there.
    """

    initial_log_std: float = -0.5
    is_state_dependent: bool = False
    is_squashed: bool = False


class ActionHead(nn.Module):
    """The action distribution of one policy; ``d`` discrete components, ``c`` continuous elements.

    Attributes:
        nvec: Alternatives of each discrete component.
        num_logits: Their sum.
        size: ``c``.
        num_outputs: What the network must put out: ``num_logits + c``, and ``c`` more where
            deviations depend on the state.
        num_noise: Elements that :meth:`sample` needs: ``num_logits + c``.
        log_std: ``float32[c]``, a parameter: the same in every state; None where it is not.
        shape: Kind of Gaussian.
    """

    low: Tensor
    high: Tensor

    def __init__(self, spec: PolicySpec, shape: GaussianShape) -> None:
        super().__init__()
        self.shape = shape
        self.nvec = list(spec.nvec)
        self.num_logits = sum(self.nvec)
        self.size = spec.continuous_size
        self.num_noise = self.num_logits + self.size
        self.num_outputs = self.num_noise + self.size * shape.is_state_dependent
        initial = torch.full((self.size,), shape.initial_log_std)
        self.log_std = None if shape.is_state_dependent else nn.Parameter(initial)
        low, high = spec.continuous_bounds()
        self.register_buffer("low", as_tensor(low), persistent=False)
        self.register_buffer("high", as_tensor(high), persistent=False)

    @torch.no_grad()
    def initialise(self, last: nn.Linear) -> None:
        """Let the network's last layer begin with the initial deviation."""
        if self.shape.is_state_dependent:
            last.bias[self.num_noise :] = self.shape.initial_log_std

    @torch.no_grad()
    def fill_noise(self, noise: Tensor, generator: torch.Generator) -> None:
        """Fill ``float32[..., num_noise]`` with what :meth:`sample` needs.

        Gumbel noise for logits (``argmax(logits + noise)`` is a sample of the softmax), standard
        normal noise for means.
        """
        noise[..., : self.num_logits].exponential_(generator=generator).log_().neg_()
        noise[..., self.num_logits :].normal_(generator=generator)

    def gaussian(self, outputs: Tensor) -> tuple[Tensor, Tensor]:
        """Return mean ``float32[n, c]`` and log deviation ``float32[c]`` or ``float32[n, c]``."""
        mean = outputs[:, self.num_logits : self.num_noise]
        if self.log_std is not None:
            return mean, self.log_std
        return mean, outputs[:, self.num_noise :].clamp(*LOG_STD_RANGE)

    def sample(
        self, outputs: Tensor, noise: Tensor | None = None, mask: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Return an action per row; without noise the most probable one.

        Args:
            outputs: ``float32[n, num_outputs]``.
            noise: ``float32[n, num_noise]`` from :meth:`fill_noise`.
            mask: ``bool[n, num_logits]``, True = allowed.

        Returns:
            ``int64[n, d]``, and ``float32[n, c]`` that :meth:`to_bounds` takes.
        """
        logits, mean = outputs[:, : self.num_logits], outputs[:, self.num_logits : self.num_noise]
        if noise is not None:
            logits = logits + noise[:, : self.num_logits]
            if self.size:
                mean, log_std = self.gaussian(outputs)
                mean = torch.addcmul(mean, noise[:, self.num_logits :], log_std.exp())
        if mask is not None:
            logits = logits.masked_fill(~mask, FORBIDDEN)
        if len(self.nvec) == 1:
            return logits.argmax(-1, keepdim=True), mean
        chosen = torch.zeros(len(outputs), len(self.nvec), dtype=torch.int64, device=outputs.device)
        start = 0
        for component, n in enumerate(self.nvec):
            chosen[:, component] = logits[:, start : start + n].argmax(-1)
            start += n
        return chosen, mean

    def evaluate(
        self,
        outputs: Tensor,
        discrete: Tensor,
        continuous: Tensor,
        mask: Tensor | None,
        *,
        is_deviation_held: bool = False,
    ) -> tuple[Tensor, Tensor]:
        """Return log-probability and entropy of actions as :meth:`sample` returns them.

        The entropy of a squashed Gaussian has no closed form; here it is that of the Gaussian,
        less what squashing takes at the given action.

        Args:
            outputs: ``float32[n, num_outputs]``.
            discrete: ``int64[n, d]``.
            continuous: ``float32[n, c]``, as sampled.
            mask: ``bool[n, num_logits]`` or None.
            is_deviation_held: Whether deviations get no gradient.

        Returns:
            ``float32[n]`` twice.
        """
        log_prob = entropy = torch.zeros(len(outputs), device=outputs.device)
        start = 0
        for component, n in enumerate(self.nvec):
            part = slice(start, start + n)
            logs = masked_log_softmax(outputs[:, part], None if mask is None else mask[:, part])
            chosen = logs.gather(1, discrete[:, component : component + 1]).squeeze(1)
            log_prob, entropy = log_prob + chosen, entropy + categorical_entropy(logs)
            start += n
        if self.size:
            mean, log_std = self.gaussian(outputs)
            log_std = log_std.detach() if is_deviation_held else log_std
            log_prob = log_prob + gaussian_log_prob(continuous, mean, log_std)
            entropy = entropy + gaussian_entropy(log_std)
            if self.shape.is_squashed:
                log_det = tanh_log_det(continuous)
                log_prob, entropy = log_prob - log_det, entropy + log_det
        return log_prob, entropy

    def to_bounds(self, continuous: Tensor) -> Tensor:
        """Return ``float32[n, c]`` squashed or clipped to ±1 and stretched to the spec's bounds."""
        is_squashed = self.shape.is_squashed
        unit = continuous.tanh() if is_squashed else continuous.clamp(-1.0, 1.0)
        return torch.lerp(self.low, self.high, unit.add_(1.0).mul_(0.5))

    def from_bounds(self, actions: Tensor) -> Tensor:
        """Return ``float32[n, c]`` of which :meth:`to_bounds` makes ``actions``, near enough.

        Of a squashed action at a bound, which would be infinite, what comes within 0.1 % of it.
        """
        unit = ((actions - self.low) / (self.high - self.low)).mul_(2.0).sub_(1.0)
        return unit.clamp_(-0.999, 0.999).atanh_() if self.shape.is_squashed else unit
