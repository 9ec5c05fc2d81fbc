"""Differences between observations, in units of each element's usual size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ludus.check.recording import Recording
from ludus.spec import PolicySpec, Spec
from ludus.spec.batch import Batch

__all__ = ["Largest", "differences", "largest_difference", "scales"]

SMALLEST_SCALE = 1e-3


def _table(policy: PolicySpec, batch: Batch) -> NDArray[np.float64]:
    """Return all entries side by side, ``float64[num_agents, elements]``."""
    parts = [
        batch.observation[entry.name].reshape(batch.num_agents, -1).astype(np.float64)
        for entry in policy.observation
    ]
    return np.concatenate(parts, axis=1)


def scales(recording: Recording) -> dict[str, NDArray[np.float64]]:
    """Return the largest absolute value of every element, per policy ``float64[elements]``."""
    return {
        policy.name: np.max(
            [np.abs(_table(policy, f.batches[policy.name])).max(axis=0) for f in recording.frames],
            axis=0,
            initial=SMALLEST_SCALE,
        )
        for policy in recording.spec.policies
    }


def differences(
    policy: PolicySpec,
    one: Mapping[str, Batch],
    two: Mapping[str, Batch],
    scale: Mapping[str, NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Return ``float64[num_agents, elements]``: absolute differences in units of ``scale``."""
    first, second = _table(policy, one[policy.name]), _table(policy, two[policy.name])
    return np.abs(first - second) / scale[policy.name]


@dataclass(frozen=True)
class Largest:
    """Where two observations of a world differ most.

    Attributes:
        size: The difference, in units of the element's usual size.
        name: The element, for example ``hero.observation["rays"][3]``.
        values: The element in the one and in the other observation.
    """

    size: float
    name: str
    values: tuple[float, float]


def largest_difference(
    spec: Spec,
    one: Mapping[str, Batch],
    two: Mapping[str, Batch],
    scale: Mapping[str, NDArray[np.float64]],
    world: int,
) -> Largest | None:
    """Return the largest difference in one world; None if its observations are equal."""
    found: Largest | None = None
    for policy in spec.policies:
        rows = policy.world_slots(world)
        sizes = differences(policy, one, two, scale)[rows]
        slot, column = (int(i) for i in np.unravel_index(sizes.argmax(), sizes.shape))
        size = float(sizes[slot, column])
        if size <= (found.size if found else 0.0):
            continue
        names = [f'"{entry.name}"][{i}]' for entry in policy.observation for i in range(entry.size)]
        first, second = (_table(policy, batches[policy.name])[rows] for batches in (one, two))
        values = (float(first[slot, column]), float(second[slot, column]))
        found = Largest(size, f"{policy.name}.observation[{names[column]}", values)
    return found
