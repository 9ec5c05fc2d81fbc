"""Play a pool step by step."""

from __future__ import annotations

from collections.abc import Callable

from ludus.play.episodes import EndedEpisodes, EpisodeCounter, EpisodeTracker
from ludus.play.players import Act
from ludus.pool.interface import Pool

__all__ = ["Play"]


class Play:
    """A pool that is played, and its episodes.

    Args:
        pool: Is reset here; in the middle of episodes afterwards.
        act: Decides what agents do.
        seed: Of the worlds.

    Attributes:
        batches: What all agents see now.
    """

    def __init__(self, pool: Pool, act: Act, seed: int) -> None:
        self.batches = pool.reset(seed)
        self._pool = pool
        self._act = act
        self._trackers = {
            name: EpisodeTracker(batch.num_agents, 0) for name, batch in self.batches.items()
        }
        for name, batch in self.batches.items():
            self._trackers[name].begin(slice(None), batch)

    def step(self) -> dict[str, EndedEpisodes]:
        """Play one step; return the episodes that it ended, by policy."""
        self.batches = self._pool.step(self._act(self.batches))
        return {
            name: self._trackers[name].record(slice(None), batch)
            for name, batch in self.batches.items()
        }

    def run(self, counter: EpisodeCounter, is_stopping: Callable[[], bool] = lambda: False) -> None:
        """Play until ``counter`` is complete, or ``is_stopping``, asked before each step."""
        while not counter.is_complete and not is_stopping():
            for name, ended in self.step().items():
                outcomes = zip(ended.returns.tolist(), ended.lengths.tolist(), strict=True)
                for episode_return, length in outcomes:
                    counter.add(name, episode_return, length)
