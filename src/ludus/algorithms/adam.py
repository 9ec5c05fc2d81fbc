"""Adam over all parameters as one vector.

A small network has a dozen parameters, and most of the time of an optimiser step would go into
calling PyTorch for each. Here parameters and gradients are views of two vectors, so a step is a
handful of calls. ``torch.optim`` would also import PyTorch's compiler, which takes seconds at the
start of every run.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import Tensor, nn

from ludus.settings.policy_config import PolicyConfig

__all__ = ["Adam", "as_one_vector", "learning_rate_at"]

BETA_1, BETA_2 = 0.9, 0.999


class Adam:
    """Adam (Kingma and Ba 2015, arXiv:1412.6980, algorithm 1).

    The parameters must stay on the device they are on now; loading a state dictionary into their
    module is fine.

    Attributes:
        values: All parameters as one vector.
    """

    def __init__(self, parameters: Iterable[nn.Parameter], epsilon: float) -> None:
        self._epsilon = epsilon
        self._num_steps = 0
        parts = list(parameters)
        self.values = as_one_vector(parts)
        self._gradients = torch.zeros_like(self.values)
        self._mean = torch.zeros_like(self.values)
        self._square = torch.zeros_like(self.values)
        for part, gradient in zip(parts, _views(self._gradients, parts), strict=True):
            part.grad = gradient

    def zero_gradients(self) -> None:
        """Set all gradients to 0; ``backward`` adds to them."""
        self._gradients.zero_()

    @torch.no_grad()
    def clip_grad_norm(self, max_norm: float) -> Tensor:
        """Scale the gradient to ``max_norm`` if it is longer; return its length before."""
        length = self._gradients.dot(self._gradients).sqrt_()
        self._gradients.mul_((max_norm / (length + 1e-6)).clamp_(max=1.0))
        return length

    @torch.no_grad()
    def step(self, learning_rate: float) -> None:
        """Move the parameters against the gradient."""
        self._num_steps += 1
        self._mean.lerp_(self._gradients, 1 - BETA_1)
        self._square.mul_(BETA_2).addcmul_(self._gradients, self._gradients, value=1 - BETA_2)
        unbias_1 = 1 - BETA_1**self._num_steps
        unbias_2 = math.sqrt(1 - BETA_2**self._num_steps)
        deviation = self._square.sqrt().div_(unbias_2).add_(self._epsilon)
        self.values.addcdiv_(self._mean, deviation, value=-learning_rate / unbias_1)

    def state(self) -> dict[str, Tensor]:
        """Return the moments and the number of steps, not copied."""
        return {
            "mean": self._mean,
            "square": self._square,
            "num_steps": torch.tensor(self._num_steps),
        }

    def load_state(self, state: dict[str, Tensor]) -> None:
        """Go on from :meth:`state`, of an optimiser of equal parameters."""
        self._mean.copy_(state["mean"])
        self._square.copy_(state["square"])
        self._num_steps = int(state["num_steps"])


def as_one_vector(parameters: Iterable[nn.Parameter]) -> Tensor:
    """Make ``parameters`` views of one vector, and return it."""
    parts = list(parameters)
    values = torch.cat([part.detach().flatten() for part in parts])
    for part, view in zip(parts, _views(values, parts), strict=True):
        part.data = view
    return values


def learning_rate_at(progress: float, config: PolicyConfig) -> float:
    """Return the step size when a share ``progress``, 0 to 1, of the run is over."""
    is_linear = config.learning_rate_schedule == "linear"
    return config.learning_rate * (max(0.0, 1.0 - progress) if is_linear else 1.0)


def _views(vector: Tensor, parts: list[nn.Parameter]) -> list[Tensor]:
    """Cut ``vector`` into views shaped as ``parts``."""
    views: list[Tensor] = []
    start = 0
    for part in parts:
        views.append(vector[start : start + part.numel()].view_as(part))
        start += part.numel()
    return views
