"""What a parity test feeds to every runtime: random, extreme and recorded observations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.model.policy_model import PolicyModel, is_image
from ludus.spec import ObservationEntry

__all__ = ["ParityInputs", "draw_inputs"]

NUM_RANDOM, NUM_RANDOM_IMAGES = 128, 16
"""Random agents; fewer where images make them expensive."""
MEMORY_STEPS = 12
"""Steps that a memory goes through."""
TYPICAL = 3.0
"""Deviations that random observations keep within."""
EXTREME = 12.0
"""Deviations of the extreme ones, beyond where normalised values are cut off."""
BEYOND = 1e6
"""Bounds further out than this say nothing about typical values."""


@dataclass(frozen=True)
class ParityInputs:
    """Observations of ``n`` agents in consecutive steps of one episode.

    Attributes:
        observation: Per entry ``dtype[steps, n, *shape]``.
        action_mask: ``bool[steps, n, mask_size]``; None without masks.
        num_recorded: Agents, the last ones, whose observations are from the training.
    """

    observation: dict[str, NDArray[Any]]
    action_mask: NDArray[np.bool_] | None
    num_recorded: int

    @property
    def num_steps(self) -> int:
        """Steps of the episode."""
        return next(iter(self.observation.values())).shape[0]

    @property
    def num_agents(self) -> int:
        """Agents side by side."""
        return next(iter(self.observation.values())).shape[1]

    def at(self, step: int) -> tuple[dict[str, NDArray[Any]], NDArray[np.bool_] | None]:
        """Return the observations ``dtype[n, *shape]`` and masks of one step."""
        mask = None if self.action_mask is None else self.action_mask[step]
        return {name: values[step] for name, values in self.observation.items()}, mask


def draw_inputs(
    model: PolicyModel, recorded: Mapping[str, NDArray[Any]], seed: int = 0
) -> ParityInputs:
    """Return random observations within the entries' bounds, and recorded ones from training.

    The first two agents see the lowest and the highest values. Of the other random ones every
    second one keeps within three deviations of the mean, as the normalisation knows them.

    Args:
        model: What is tested.
        recorded: Per entry of ``model.inputs`` ``dtype[m, *shape]``, or empty.
        seed: Of the random ones.
    """
    random = np.random.default_rng(seed)
    num_steps = 1 if model.memory is None else MEMORY_STEPS
    num_random = NUM_RANDOM_IMAGES if model.images else NUM_RANDOM
    num_recorded = min(num_random, len(next(iter(recorded.values()), ())))
    order = np.stack([random.permutation(num_recorded) for _ in range(num_steps)])
    observation: dict[str, NDArray[Any]] = {}
    start = 0
    for entry in model.inputs:
        mean, deviation = np.zeros(entry.size), np.ones(entry.size)
        if model.normalisation is not None and not is_image(entry):
            part = slice(start, start + entry.size)
            mean = model.normalisation.shift[part].astype(np.float64)
            deviation = 1.0 / np.maximum(model.normalisation.scale[part].astype(np.float64), 1e-6)
            start += entry.size
        drawn = _draw(random, entry, (num_steps, num_random), mean, deviation)
        if num_recorded:
            drawn = np.concatenate([drawn, recorded[entry.name][order]], 1)
        observation[entry.name] = drawn
    shape = (num_steps, num_random + num_recorded)
    return ParityInputs(observation, _draw_masks(random, model, shape), num_recorded)


def _draw(
    random: np.random.Generator,
    entry: ObservationEntry,
    shape: tuple[int, int],
    mean: NDArray[Any],
    deviation: NDArray[Any],
) -> NDArray[Any]:
    """Return ``dtype[*shape, *entry.shape]``; mean and deviation are ``float64[entry.size]``."""
    low, high = (bound.astype(np.float64).reshape(-1) for bound in entry.bounds())
    low, has_low = np.where(low < -BEYOND, mean - EXTREME * deviation, low), low >= -BEYOND
    high, has_high = np.where(high > BEYOND, mean + EXTREME * deviation, high), high <= BEYOND
    near_low, near_high = mean - TYPICAL * deviation, mean + TYPICAL * deviation
    full_shape = (*shape, entry.size)
    values = random.uniform(
        np.where(has_low, low, near_low), np.where(has_high, high, near_high), full_shape
    )
    typical = random.uniform(near_low, near_high, full_shape)
    if not is_image(entry):
        values[:, 1::2] = np.clip(typical, low, high)[:, 1::2]
    values[:, 0], values[:, 1] = low, high
    if entry.dtype != "float32":
        values = np.rint(values)
    return values.reshape(*shape, *entry.shape).astype(entry.numpy_dtype)


def _draw_masks(
    random: np.random.Generator, model: PolicyModel, shape: tuple[int, int]
) -> NDArray[np.bool_] | None:
    """Return random masks that leave one choice at least; the first agent's allow everything."""
    if not model.has_action_mask:
        return None
    parts: list[NDArray[np.bool_]] = []
    for n in model.spec.nvec:
        allowed = random.random((*shape, n)) < 0.5
        np.put_along_axis(allowed, random.integers(n, size=(*shape, 1)), True, -1)
        parts.append(allowed)
    mask = np.concatenate(parts, -1)
    mask[:, 0] = True
    return mask
