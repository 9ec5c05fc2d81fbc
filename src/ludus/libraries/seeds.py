"""Seeds as Gymnasium gives them: one, or one per environment; and what is wrong with others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ludus.errors import UsageError

__all__ = ["MAX_SEED", "Seeds", "check_seed", "world_seeds"]

MAX_SEED = 2**63 - 1

Seeds = int | Sequence[int | None] | NDArray[np.integer[Any]] | None


def check_seed(seed: Any, where: str = "seed") -> int | None:
    """Return a seed as an integer, or None.

    Raises:
        UsageError: It is anything else than an integer from 0 to 2**63 - 1 or None.
    """
    if seed is None:
        return None
    if isinstance(seed, int | np.integer) and not isinstance(seed, bool) and 0 <= seed <= MAX_SEED:
        return int(cast(int, seed))
    raise UsageError(f"{where} must be an integer from 0 to 2**63 - 1, not {seed!r}")


def world_seeds(seeds: Seeds, num_worlds: int, agents_per_world: int) -> list[int | None]:
    """Return a seed per world; of several agents in a world the first one's counts.

    Args:
        seeds: One, of which world *i* gets ``seeds + i``; or one per environment; or None.
        num_worlds: Over all engines.
        agents_per_world: Environments in each world.

    Raises:
        UsageError: A seed is wrong, or there are too many or too few.
    """
    if not isinstance(seeds, Sequence | np.ndarray) or isinstance(seeds, str | bytes):
        seed = check_seed(seeds)
        return [None if seed is None else seed + i for i in range(num_worlds)]
    num_envs = num_worlds * agents_per_world
    if len(seeds) != num_envs:
        raise UsageError(f"{len(seeds)} seeds for {num_envs} environments")
    checked = [check_seed(seed, f"seed[{row}]") for row, seed in enumerate(seeds)]
    return checked[::agents_per_world]
