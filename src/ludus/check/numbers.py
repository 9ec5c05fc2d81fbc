"""Observations as tables of numbers: differences in units of what the game usually shows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ludus.check.recording import Recording
from ludus.spec import PolicySpec
from ludus.spec.batch import Batch

__all__ = ["differences", "element_names", "scales", "table"]

SMALLEST_SCALE = 1e-3


def table(policy: PolicySpec, batch: Batch) -> NDArray[np.float64]:
    """Return all entries side by side, ``float64[num_agents, elements]``."""
    parts = [
        batch.observation[entry.name].reshape(batch.num_agents, -1).astype(np.float64)
        for entry in policy.observation
    ]
    return np.concatenate(parts, axis=1)


def element_names(policy: PolicySpec) -> list[tuple[str, int]]:
    """Return entry name and flat index of every column of :func:`table`."""
    return [(entry.name, i) for entry in policy.observation for i in range(entry.size)]


def scales(recording: Recording) -> dict[str, NDArray[np.float64]]:
    """Return the largest absolute value of every element, per policy ``float64[elements]``."""
    return {
        policy.name: np.max(
            [np.abs(table(policy, f.batches[policy.name])).max(axis=0) for f in recording.frames],
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
    first, second = table(policy, one[policy.name]), table(policy, two[policy.name])
    return np.abs(first - second) / scale[policy.name]
