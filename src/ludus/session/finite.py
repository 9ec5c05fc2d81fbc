"""Refuse observations and rewards that are not finite, and say where they came from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.errors import GameError
from ludus.spec import AgentSpec, PolicySpec
from ludus.spec.batch import Batch, Batches

__all__ = ["check_finite"]


def check_finite(policies: Mapping[str, PolicySpec], batches: Batches, step: int) -> None:
    """Check all numbers of a step.

    Raises:
        GameError: A number is NaN or infinite; the text names world, agent, entry, element, step.
    """
    for name, batch in batches.items():
        _check_batch(policies[name], batch, step)


def _check_batch(policy: PolicySpec, batch: Batch, step: int) -> None:
    _check(policy, "reward", batch.reward, step)
    for entry, values in batch.observation.items():
        if values.dtype.kind == "f":
            _check(policy, f'observation["{entry}"]', values, step)
    if not len(batch.final_index):
        return
    for entry, values in batch.final_observation.items():
        if values.dtype.kind == "f":
            what = f'final observation["{entry}"]'
            _check(policy, what, values, step, batch.final_index)


def _check(
    policy: PolicySpec,
    what: str,
    values: NDArray[Any],
    step: int,
    slots: NDArray[np.int64] | None = None,
) -> None:
    # A dot product is the cheapest way to see all elements; it may overflow where all are finite.
    # Of vdot, NumPy says nothing then.
    if math.isfinite(np.vdot(values, values)) or np.isfinite(values).all():
        return
    row, *element = (int(i) for i in np.argwhere(~np.isfinite(values))[0])
    slot = row if slots is None else int(slots[row])
    place = _describe(policy.agents[slot])
    index = "".join(f"[{i}]" for i in element)
    value = values[(row, *element)]
    raise GameError(
        f"{policy.name}: {place}: {what}{index} is {value} at step {step}",
        hint="look for a division by zero or an uninitialised value in the game's script",
    )


def _describe(agent: AgentSpec) -> str:
    return f"world {agent.world}, agent {agent.path or '(joined later)'}"
