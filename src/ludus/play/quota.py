"""Which episodes of a policy count, chosen before they begin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ludus.spec.batch import Batch

__all__ = ["Quota"]


class Quota:
    """The first episodes of each slot, a number fixed beforehand.

    Taking whichever episodes end first would favour short ones. That is done only where no slot is
    active yet: which ones a game will fill, nobody knows.

    Args:
        first: What a reset brought.
        num_episodes: Episodes to take, spread evenly over the slots that are active, or the first
            ones of any slots if none is; None: one of each active slot.
    """

    def __init__(self, first: Batch, num_episodes: int | None = None) -> None:
        slots = first.active.nonzero()[0]
        num_wanted = len(slots) if num_episodes is None else num_episodes
        self._left = np.zeros(first.num_agents, np.int64)
        self._left_of_any = 0 if len(slots) else num_wanted
        if len(slots):
            each, more = divmod(num_wanted, len(slots))
            self._left[slots] = each
            self._left[slots[:more]] += 1

    @property
    def is_met(self) -> bool:
        """Whether all episodes have been taken."""
        return not (self._left_of_any or self._left.any())

    def wants(self, slot: int) -> bool:
        """Return whether the episode that ``slot`` is in may still be taken."""
        return bool(self._left_of_any or self._left[slot])

    def take(self, slots: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Take those that count of the episodes that ended in one step.

        Args:
            slots: ``int64[m]``, where they ended; each slot once.

        Returns:
            ``bool[m]``, which ones were taken.
        """
        taken = self._left[slots] > 0
        self._left[slots[taken]] -= 1
        if self._left_of_any:
            taken[: self._left_of_any] = True
            self._left_of_any -= int(taken.sum())
        return taken
