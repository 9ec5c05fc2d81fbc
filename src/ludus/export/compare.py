"""How far the answers of two runtimes are apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.export.inputs import ParityInputs
from ludus.export.runtimes import Answers
from ludus.model.inference import FORBIDDEN
from ludus.model.policy_model import PolicyModel

__all__ = ["TOLERANCE", "Comparison", "compare"]

TOLERANCE = 1e-4
"""Largest difference allowed; of numbers above 1, relative to their size."""


@dataclass(frozen=True)
class Comparison:
    """Largest differences of one runtime from PyTorch; of numbers above 1 relative to their size.

    Attributes:
        runtime: Name and version.
        outputs: Of raw outputs and log deviations.
        continuous: Of continuous actions, most probable ones; 0 without such.
        discrete: Of the logits, where another choice was made; 0 if all are the same.
        num_other_choices: Choices that differ.
        worst: Where the largest of all is, and what was expected and came.
    """

    runtime: str
    outputs: float
    continuous: float
    discrete: float
    num_other_choices: int
    worst: str

    @property
    def largest(self) -> float:
        """The largest of all differences."""
        return max(self.outputs, self.continuous, self.discrete)

    @property
    def is_equal(self) -> bool:
        """Whether all differences are within the tolerance."""
        return self.largest <= TOLERANCE


def compare(
    runtime: str, expected: Answers, came: Answers, model: PolicyModel, inputs: ParityInputs
) -> Comparison:
    """Compare the answers of a runtime with those of PyTorch.

    Args:
        runtime: Its name.
        expected: Answers of PyTorch.
        came: Answers of the runtime.
        model: What was asked.
        inputs: What it was asked.
    """
    gap, num_other = _choice_gap(expected, came, model, inputs)
    parts = {
        "outputs": _difference(expected.outputs, came.outputs),
        "log_std": _difference(expected.log_std, came.log_std),
        "continuous": _difference(expected.continuous, came.continuous),
        "discrete": gap,
    }
    largest = {name: float(part.max(initial=0.0)) for name, part in parts.items()}
    worst = max(largest, key=lambda name: largest[name])
    return Comparison(
        runtime=runtime,
        outputs=max(largest["outputs"], largest["log_std"]),
        continuous=largest["continuous"],
        discrete=largest["discrete"],
        num_other_choices=num_other,
        worst=_place(worst, parts[worst], getattr(expected, worst), getattr(came, worst)),
    )


def _difference(expected: NDArray[Any], came: NDArray[Any]) -> NDArray[np.float64]:
    """Return ``|a - b| / max(1, |a|)``; infinite where one of them is not finite."""
    if expected.shape != came.shape:
        return np.full((1,) * expected.ndim, np.inf)
    wide = expected.astype(np.float64)
    difference = np.abs(wide - came) / np.maximum(1.0, np.abs(wide))
    return np.where(np.isfinite(difference), difference, np.inf)


def _choice_gap(
    expected: Answers, came: Answers, model: PolicyModel, inputs: ParityInputs
) -> tuple[NDArray[np.float64], int]:
    """Return how much less likely the other choices are, ``float64[steps, n, d]``; how many."""
    if expected.discrete.shape != came.discrete.shape:
        return np.full((1, 1, 1), np.inf), came.discrete.size
    logits = expected.outputs.astype(np.float64)
    if inputs.action_mask is not None:
        mask = inputs.action_mask
        logits[..., : mask.shape[-1]] = np.where(mask, logits[..., : mask.shape[-1]], FORBIDDEN)
    gaps = np.zeros(expected.discrete.shape)
    start = 0
    for i, n in enumerate(model.spec.nvec):
        part = logits[..., start : start + n]
        gaps[..., i] = _gap(part, expected.discrete[..., i], came.discrete[..., i])
        start += n
    return gaps, int((expected.discrete != came.discrete).sum())


def _gap(
    logits: NDArray[np.float64], expected: NDArray[np.int64], came: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return how far the logit of the given choice is below the best; infinite if it is none.

    Args:
        logits: ``float64[steps, n, choices]``.
        expected: ``int64[steps, n]``, the best.
        came: ``int64[steps, n]``.
    """
    num_choices = logits.shape[-1]
    is_choice = (came >= 0) & (came < num_choices)
    best = np.take_along_axis(logits, expected[..., None], -1)[..., 0]
    picked = np.clip(came, 0, num_choices - 1)
    own = np.take_along_axis(logits, picked[..., None], -1)[..., 0]
    return np.where(is_choice, (best - own) / np.maximum(1.0, np.abs(best)), np.inf)


def _place(
    name: str, difference: NDArray[np.float64], expected: NDArray[Any], came: NDArray[Any]
) -> str:
    """Say where the largest difference is, and what was expected and came."""
    if expected.shape != came.shape:
        return f"{name} has shape {list(came.shape)}, expected {list(expected.shape)}"
    if not difference.size:
        return ""
    index = np.unravel_index(int(np.argmax(difference)), difference.shape)
    step, agent, element = (int(axis) for axis in index)
    return (
        f"{name}[{element}] of agent {agent} in step {step} is {came[index]}, "
        f"expected {expected[index]}"
    )
