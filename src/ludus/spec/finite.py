"""Refuse observations and rewards that are NaN or infinite, and say where they came from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.errors import GameError
from ludus.spec import PolicySpec
from ludus.spec.batch import Batch, Batches

__all__ = ["all_finite_fast", "check_finite"]


def all_finite_fast(arrays: Iterable[NDArray[Any]]) -> bool:
    """Return True only if all numbers are finite; False may also mean that some are very large.

    A dot product is the cheapest way to look at all elements. It may overflow although all of them
    are finite; NumPy does not warn of that for ``vdot``.
    """
    for values in arrays:  # noqa: SIM110 - runs in every step, and a generator is slower
        if not math.isfinite(np.vdot(values, values)):
            return False
    return True


def check_finite(policies: Mapping[str, PolicySpec], batches: Batches, step: int) -> None:
    """Check all numbers of a step.

    Raises:
        GameError: A number is NaN or infinite; the text names world, agent, entry, element, step.
    """
    for name, batch in batches.items():
        for what, values, slots in _float_arrays(batch):
            if all_finite_fast((values,)) or np.isfinite(values).all():
                continue
            row, *element = (int(i) for i in np.argwhere(~np.isfinite(values))[0])
            agent = policies[name].agents[row if slots is None else int(slots[row])]
            index = "".join(f"[{i}]" for i in element)
            raise GameError(
                f"{name}: {agent}: {what}{index} is {values[(row, *element)]} at step {step}",
                hint="look for a division by zero or an uninitialised value in the game's script",
            )


def _float_arrays(batch: Batch) -> Iterator[tuple[str, NDArray[Any], NDArray[np.int64] | None]]:
    """Yield name and values of every float array, and the slots of its rows if not all."""
    yield "reward", batch.reward, None
    for entry, values in batch.observation.items():
        if values.dtype.kind == "f":
            yield f'observation["{entry}"]', values, None
    if len(batch.final_index):
        for entry, values in batch.final_observation.items():
            if values.dtype.kind == "f":
                yield f'final observation["{entry}"]', values, batch.final_index
