"""Play a pool until the film is long enough."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from ludus.pool.interface import Pool
from ludus.record.players import Act

__all__ = ["Play"]


class Play:
    """Plays a pool.

    Args:
        pool: Is reset.
        act: Decides what agents do.
        seed: Of worlds.

    Attributes:
        num_episodes: How many have ended so far, by policy.
    """

    def __init__(self, pool: Pool, act: Act, seed: int) -> None:
        self._pool = pool
        self._act = act
        self._batches = pool.reset(seed)
        self._num_steps = 0
        self.num_episodes: Counter[str] = Counter(dict.fromkeys(pool.policies, 0))

    def run(self, num_episodes: int | None, is_full: Callable[[], bool]) -> None:
        """Play on.

        Args:
            num_episodes: End after so many episodes of every policy; None: never.
            is_full: Whether the film is long enough.
        """
        while not is_full():
            self.step()
            for name, batch in self._batches.items():
                self.num_episodes[name] += len(batch.final_index)
            if num_episodes is not None and min(self.num_episodes.values()) >= num_episodes:
                return

    def step(self) -> None:
        """Play one step, whose episodes do not count."""
        self._batches = self._pool.step(self._act(self._num_steps, self._batches))
        self._num_steps += 1
