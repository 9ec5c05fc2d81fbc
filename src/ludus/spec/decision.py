"""How probable an action was: from a network's outputs to what people read of a decision."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.spec.engine_spec import PolicySpec

__all__ = ["ActionShape", "Decision", "describe_outputs"]

FORBIDDEN = np.float32(-1e8)

Decision = dict[str, Any]
"""The lists ``probabilities``, ``means`` and ``deviations``, and ``value`` (PROTOCOL.md §8)."""


@dataclass(frozen=True)
class ActionShape:
    """How outputs become continuous elements, as :class:`~ludus.model.policy_model.Distribution`.

    Attributes:
        log_std: ``float32[continuous_size]``, or None where the network puts them out.
        log_std_range: Lowest and highest log deviation that a network puts out.
        is_squashed: Whether ``tanh`` keeps elements within their bounds.
    """

    log_std: NDArray[np.float32] | None
    log_std_range: tuple[float, float]
    is_squashed: bool


def describe_outputs(
    outputs: NDArray[np.float32],
    spec: PolicySpec,
    shape: ActionShape,
    mask: NDArray[np.bool_] | None = None,
    value: float | None = None,
) -> Decision:
    """Return how probable each action is.

    A deviation is half of the way between what lies one deviation below the mean and one above,
    within the bounds.

    Args:
        outputs: ``float32[num_outputs]`` of one agent.
        spec: Of its policy.
        shape: How outputs become actions.
        mask: ``bool[sum(nvec)]``, True = allowed.
        value: The return that a critic expects.
    """
    num_logits, size = sum(spec.nvec), spec.continuous_size
    logits = outputs[:num_logits]
    if mask is not None:
        logits = np.where(mask, logits, FORBIDDEN)
    ends = np.cumsum(spec.nvec, dtype=np.int64)[:-1]
    parts = np.split(logits, ends) if num_logits else []
    mean = outputs[num_logits : num_logits + size]
    log_std = shape.log_std
    if log_std is None:
        log_std = np.clip(outputs[num_logits + size :], *shape.log_std_range)
    low, high = spec.continuous_bounds()

    def stretch(unit: NDArray[np.float32]) -> NDArray[np.float32]:
        unit = np.tanh(unit) if shape.is_squashed else np.clip(unit, -1, 1)
        stretched = low + (high - low) * (unit * 0.5 + 0.5)
        return stretched.astype(np.float32)

    deviation = np.exp(log_std)
    return {
        "probabilities": [number for part in parts for number in _softmax(part).tolist()],
        "means": stretch(mean).tolist(),
        "deviations": ((stretch(mean + deviation) - stretch(mean - deviation)) / 2).tolist(),
        "value": value,
    }


def _softmax(logits: NDArray[np.float32]) -> NDArray[np.float32]:
    weights = np.exp(logits - logits.max())
    return weights / weights.sum()
