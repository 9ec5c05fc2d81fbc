"""From network outputs to actions: categorical and Gaussian parts side by side.

An action has any number of discrete components and one block of continuous elements. The network
puts out the logits of all discrete components, then the means of the continuous elements, in a
space where every element's bounds are -1 and 1.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from ludus.spec import PolicySpec
from ludus.train.tensors import as_tensor

__all__ = [
    "ActionHead",
    "categorical_entropy",
    "gaussian_entropy",
    "gaussian_log_prob",
    "masked_log_softmax",
]

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


class ActionHead(nn.Module):
    """The action distribution of one policy; ``d`` discrete components, ``c`` continuous elements.

    Attributes:
        nvec: Alternatives of each discrete component.
        num_logits: Their sum.
        size: ``c``.
        num_outputs: What the network must put out: ``num_logits + size``.
        log_std: ``float32[c]``, a parameter: the same in every state.
    """

    low: Tensor
    high: Tensor

    def __init__(self, spec: PolicySpec, initial_log_std: float) -> None:
        super().__init__()
        self.nvec = list(spec.nvec)
        self.num_logits = sum(self.nvec)
        self.size = spec.continuous_size
        self.num_outputs = self.num_logits + self.size
        self.log_std = nn.Parameter(torch.full((self.size,), initial_log_std))
        low, high = spec.continuous_bounds()
        self.register_buffer("low", as_tensor(low), persistent=False)
        self.register_buffer("high", as_tensor(high), persistent=False)

    @torch.no_grad()
    def fill_noise(self, noise: Tensor, generator: torch.Generator) -> None:
        """Fill ``float32[..., num_outputs]`` with what :meth:`sample` needs.

        Gumbel noise for logits (``argmax(logits + noise)`` is a sample of the softmax), standard
        normal noise for means.
        """
        noise[..., : self.num_logits].exponential_(generator=generator).log_().neg_()
        noise[..., self.num_logits :].normal_(generator=generator)

    def sample(
        self, outputs: Tensor, noise: Tensor | None = None, mask: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Return an action per row; without noise the most probable one.

        Args:
            outputs: ``float32[n, num_outputs]``.
            noise: ``float32[n, num_outputs]`` from :meth:`fill_noise`.
            mask: ``bool[n, num_logits]``, True = allowed.

        Returns:
            ``int64[n, d]``, and ``float32[n, c]`` where bounds are -1 and 1, but not yet clipped.
        """
        logits, mean = outputs[:, : self.num_logits], outputs[:, self.num_logits :]
        if noise is not None:
            logits = logits + noise[:, : self.num_logits]
            if self.size:
                mean = torch.addcmul(mean, noise[:, self.num_logits :], self.log_std.exp())
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
        self, outputs: Tensor, discrete: Tensor, continuous: Tensor, mask: Tensor | None
    ) -> tuple[Tensor, Tensor]:
        """Return log-probability and entropy of actions as :meth:`sample` returns them.

        Args:
            outputs: ``float32[n, num_outputs]``.
            discrete: ``int64[n, d]``.
            continuous: ``float32[n, c]``, unclipped.
            mask: ``bool[n, num_logits]`` or None.

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
            mean = outputs[:, self.num_logits :]
            log_prob = log_prob + gaussian_log_prob(continuous, mean, self.log_std)
            entropy = entropy + gaussian_entropy(self.log_std)
        return log_prob, entropy

    def to_bounds(self, continuous: Tensor) -> Tensor:
        """Return ``float32[n, c]`` clipped to ±1 and stretched to the bounds of the spec."""
        unit = continuous.clamp(-1.0, 1.0).add_(1.0).mul_(0.5)
        return torch.lerp(self.low, self.high, unit)
