"""Batches of several engines: joined, copied, and marked where an engine was lost."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.spec import PolicySpec
from ludus.spec.batch import Batch, Batches

__all__ = ["copy_batch", "copy_state", "join_batches", "truncate", "who_acts"]


def join_batches(parts: list[Batch], policy: PolicySpec) -> Batch:
    """Return one batch over all engines, or over those of all machines; copies."""
    if len(parts) == 1:  # takes half as long, which is felt where there is one world
        return copy_batch(parts[0])
    masks = [part.action_mask for part in parts if part.action_mask is not None]
    starts = itertools.accumulate((part.num_agents for part in parts), initial=0)
    return Batch(
        observation={
            e.name: np.concatenate([part.observation[e.name] for part in parts])
            for e in policy.observation
        },
        reward=np.concatenate([part.reward for part in parts]),
        terminated=np.concatenate([part.terminated for part in parts]),
        truncated=np.concatenate([part.truncated for part in parts]),
        active=np.concatenate([part.active for part in parts]),
        action_mask=np.concatenate(masks) if masks else None,
        final_index=np.concatenate(
            [part.final_index + start for part, start in zip(parts, starts, strict=False)]
        ),
        final_observation={
            e.name: np.concatenate([part.final_observation[e.name] for part in parts])
            for e in policy.observation
        },
    )


def copy_batch(batch: Batch) -> Batch:
    """Return a batch with arrays of its own."""
    return Batch(
        observation={name: array.copy() for name, array in batch.observation.items()},
        reward=batch.reward.copy(),
        terminated=batch.terminated.copy(),
        truncated=batch.truncated.copy(),
        active=batch.active.copy(),
        action_mask=None if batch.action_mask is None else batch.action_mask.copy(),
        final_index=batch.final_index.copy(),
        final_observation={name: array.copy() for name, array in batch.final_observation.items()},
    )


def copy_state(fresh: Batch, joined: Batch, rows: NDArray[np.bool_], place: slice) -> None:
    """Copy what some slots of an engine see into the batch over all engines."""
    for entry, values in fresh.observation.items():
        joined.observation[entry][place][rows] = values[rows]
    joined.active[place][rows] = fresh.active[rows]
    if joined.action_mask is not None and fresh.action_mask is not None:
        joined.action_mask[place][rows] = fresh.action_mask[rows]


def who_acts(
    batches: Batches | None,
) -> dict[str, tuple[NDArray[np.bool_], dict[str, NDArray[Any]]]]:
    """Return copies of who acts and what they see, by policy."""
    return {
        name: (
            batch.active.copy(),
            {entry: values.copy() for entry, values in batch.observation.items()},
        )
        for name, batch in (batches or {}).items()
    }


def truncate(fresh: Batch, acted: NDArray[np.bool_], seen: Mapping[str, NDArray[Any]]) -> Batch:
    """Mark the episodes that an engine took with it as truncated."""
    index = np.flatnonzero(acted)
    return Batch(
        observation=fresh.observation,
        reward=np.zeros_like(fresh.reward),
        terminated=np.zeros_like(fresh.terminated),
        truncated=acted.copy(),
        active=fresh.active,
        action_mask=fresh.action_mask,
        final_index=index,
        final_observation={entry: values[index] for entry, values in seen.items()},
    )
