"""Returns and lengths of episodes, agent by agent."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.spec.batch import Batch

__all__ = ["EpisodeTracker"]


class EpisodeTracker:
    """Follows every slot of one policy through its episodes.

    Attributes:
        returns: Of the last episodes, in the order they ended.
        lengths: Their agent steps.
        num_episodes: Episodes that ended so far.
        num_steps: Agent steps so far, those of active slots.
    """

    def __init__(self, num_agents: int, window: int) -> None:
        self.returns: deque[float] = deque(maxlen=window)
        self.lengths: deque[int] = deque(maxlen=window)
        self.num_episodes = 0
        self.num_steps = 0
        self._return = np.zeros(num_agents, np.float64)
        self._length = np.zeros(num_agents, np.int64)
        self._is_active = np.zeros(num_agents, np.bool_)

    def begin(self, rows: slice, batch: Batch) -> None:
        """Take the first batch after a reset of the slots ``rows``."""
        self._return[rows] = 0.0
        self._length[rows] = 0
        self._is_active[rows] = batch.active

    def record(self, rows: slice, batch: Batch) -> NDArray[np.int64]:
        """Take the outcome of a step of the slots ``rows``; rewards of inactive slots don't count.

        Returns:
            Slots whose episode ended, counted from the first of ``rows``; their returns and
            lengths are the last ones in :attr:`returns` and :attr:`lengths`.
        """
        was_active = self._is_active[rows]
        returns, lengths = self._return[rows], self._length[rows]
        np.add(returns, batch.reward, out=returns, where=was_active)
        lengths += was_active
        self.num_steps += int(np.count_nonzero(was_active))
        ended = ((batch.terminated | batch.truncated) & was_active).nonzero()[0]
        was_active[...] = batch.active
        if len(ended):
            self.returns.extend(returns[ended].tolist())
            self.lengths.extend(lengths[ended].tolist())
            self.num_episodes += len(ended)
            returns[ended] = 0.0
            lengths[ended] = 0
        return ended

    def summary(self) -> dict[str, float]:
        """Return mean and spread of the last episodes; empty before the first one ended."""
        if not self.returns:
            return {}
        returns = np.asarray(self.returns)
        low, high = np.percentile(returns, (10, 90))
        return {
            "mean_return": float(returns.mean()),
            "min_return": float(returns.min()),
            "max_return": float(returns.max()),
            "return_p10": float(low),
            "return_p90": float(high),
            "mean_length": float(np.mean(self.lengths)),
        }

    def state(self) -> dict[str, Any]:
        """Return what a resumed run goes on with, as JSON values."""
        return {
            "returns": list(self.returns),
            "lengths": list(self.lengths),
            "num_episodes": self.num_episodes,
            "num_steps": self.num_steps,
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Go on from :meth:`state`; episodes that had not ended are forgotten."""
        self.returns.extend(state["returns"])
        self.lengths.extend(state["lengths"])
        self.num_episodes = int(state["num_episodes"])
        self.num_steps = int(state["num_steps"])
