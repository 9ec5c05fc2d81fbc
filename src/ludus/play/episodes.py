"""Returns and lengths of episodes: the one place that counts them."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Collection
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ludus.spec.batch import Batch

__all__ = ["EndedEpisodes", "EpisodeCounter", "EpisodeTracker", "OnEpisode"]

OnEpisode = Callable[[str, int, float, int], None]
"""Gets policy, number, return and length of an episode that ended; numbers begin at 1."""


class EndedEpisodes(NamedTuple):
    """Episodes of one policy that ended in one step.

    Attributes:
        slots: ``int64[m]``, where; ascending.
        returns: ``float64[m]``, undiscounted.
        lengths: ``int64[m]``, agent steps.
    """

    slots: NDArray[np.int64]
    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]


class EpisodeTracker:
    """Follows every slot of one policy through its episodes.

    Args:
        num_agents: Slots of the policy.
        window: Episodes to keep in :attr:`returns` and :attr:`lengths`; None: all.

    Attributes:
        returns: Of the last episodes, in the order they ended.
        lengths: Their agent steps.
        num_episodes: Episodes that ended so far.
        num_steps: Agent steps so far, those of active slots.
    """

    def __init__(self, num_agents: int, window: int | None) -> None:
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

    def record(self, rows: slice, batch: Batch) -> EndedEpisodes:
        """Take the outcome of a step of the slots ``rows``; rewards of inactive slots don't count.

        Returns:
            Episodes that ended; their slots are counted from the first of ``rows``.
        """
        was_active = self._is_active[rows]
        returns, lengths = self._return[rows], self._length[rows]
        np.add(returns, batch.reward, out=returns, where=was_active)
        lengths += was_active
        self.num_steps += int(np.count_nonzero(was_active))
        ended = ((batch.terminated | batch.truncated) & was_active).nonzero()[0]
        was_active[...] = batch.active
        if not len(ended):
            return _NONE_ENDED
        episodes = EndedEpisodes(ended, returns[ended], lengths[ended])
        self.add(episodes)
        returns[ended] = 0.0
        lengths[ended] = 0
        return episodes

    def add(self, ended: EndedEpisodes) -> None:
        """Take episodes that ended."""
        self.returns.extend(ended.returns.tolist())
        self.lengths.extend(ended.lengths.tolist())
        self.num_episodes += len(ended.slots)

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


class EpisodeCounter:
    """Counts episodes until every policy has had enough of them.

    Args:
        policies: Names of the policies that must have them; others are counted, too.
        num_wanted: Episodes of each policy; None: never enough.
        on_episode: Gets the episodes up to ``num_wanted`` of each policy.

    Attributes:
        num_episodes: How many have ended, by policy.
    """

    def __init__(
        self,
        policies: Collection[str],
        num_wanted: int | None,
        on_episode: OnEpisode | None = None,
    ) -> None:
        self.num_episodes: Counter[str] = Counter(dict.fromkeys(policies, 0))
        self._policies = policies
        self._num_wanted = num_wanted
        self._on_episode = on_episode

    @property
    def is_complete(self) -> bool:
        """Whether every policy has had its episodes."""
        return self._num_wanted is not None and all(
            self.num_episodes[name] >= self._num_wanted for name in self._policies
        )

    def add(self, policy: str, episode_return: float, length: int) -> None:
        """Count an episode that ended."""
        self.num_episodes[policy] += 1
        number = self.num_episodes[policy]
        if self._on_episode and (self._num_wanted is None or number <= self._num_wanted):
            self._on_episode(policy, number, episode_return, length)


_NONE_ENDED = EndedEpisodes(np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64))
