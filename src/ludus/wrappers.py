"""Gymnasium's vector wrappers, right for all autoreset modes where its own are not.

Up to Gymnasium 1.3, ``gymnasium.wrappers.vector.RecordEpisodeStatistics`` counts episodes with
same-step autoreset wrongly: it leaves out the first step of each but the first.
"""

from __future__ import annotations

import time
from collections import deque
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from numpy.typing import NDArray

from ludus.errors import UsageError
from ludus.libraries.vector import LudusVectorEnv

__all__ = ["RecordEpisodeStatistics"]


class RecordEpisodeStatistics(VectorWrapper):
    """Adds return, length and duration of the episodes that end to ``infos``.

    As Gymnasium's: ``infos["episode"]`` holds ``"r"``, ``"l"`` and ``"t"`` (seconds), each
    ``[num_envs]``, where ``infos["_episode"]`` is true; they are there in steps that end one.
    Steps in which an agent of a game waits inactive, as ``infos["active"]`` says, do not count.

    Args:
        env: Any vector environment whose metadata has an ``autoreset_mode``.
        buffer_length: Episodes that the queues keep.
        stats_key: Key in ``infos``.

    Attributes:
        return_queue: Returns of the last episodes.
        length_queue: Their lengths, steps.
        time_queue: Their durations, seconds.
        episode_count: Episodes that have ended.

    Raises:
        UsageError: The environment does not tell its autoreset mode.
    """

    def __init__(
        self, env: VectorEnv[Any, Any, Any], buffer_length: int = 100, stats_key: str = "episode"
    ) -> None:
        super().__init__(env)
        mode = env.metadata.get("autoreset_mode")
        if not isinstance(mode, AutoresetMode):
            raise UsageError(f"metadata['autoreset_mode'] is {mode!r}, expected an AutoresetMode")
        self._waits = mode is AutoresetMode.NEXT_STEP
        game = env.unwrapped
        self._is_game = isinstance(game, LudusVectorEnv)
        self._agents_per_world = (
            game.policy.agents_per_world if isinstance(game, LudusVectorEnv) else 1
        )
        self._stats_key = stats_key
        self.return_queue: deque[float] = deque(maxlen=buffer_length)
        self.length_queue: deque[int] = deque(maxlen=buffer_length)
        self.time_queue: deque[float] = deque(maxlen=buffer_length)
        self.episode_count = 0
        self._returns = np.zeros(self.num_envs, np.float64)
        self._lengths = np.zeros(self.num_envs, np.int64)
        self._starts = np.zeros(self.num_envs, np.float64)
        self._is_over = np.zeros(self.num_envs, np.bool_)
        self._active = np.ones(self.num_envs, np.bool_)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset, and begin to count where episodes begin."""
        chosen = np.ones(self.num_envs, np.bool_)
        if options and "reset_mask" in options:
            chosen = options["reset_mask"].copy()  # SyncVectorEnv takes it out
        observations, infos = self.env.reset(seed=seed, options=options)
        # A game resets the whole world of an agent.
        worlds = chosen.reshape(-1, self._agents_per_world).any(axis=1)
        self._begin(np.repeat(worlds, self._agents_per_world))
        self._note_active(infos)
        return observations, infos

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Step, and add the statistics of episodes that ended."""
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        acted = self._active & ~self._is_over if self._waits else self._active
        self._begin(~acted)  # where this step has only begun the next episode, or nobody acted
        self._returns += np.where(acted, rewards, 0.0)
        self._lengths += acted
        self._is_over = terminated | truncated
        if self._is_over.any():
            self._record(infos)
            if not self._waits:
                self._begin(self._is_over)
        self._note_active(infos)
        return observations, rewards, terminated, truncated, infos

    def _note_active(self, infos: dict[str, Any]) -> None:
        """Note who acts in the next step; what others call ``"active"`` may mean anything."""
        if self._is_game:
            everyone = np.ones(self.num_envs, np.bool_)
            self._active = infos.get("active", everyone).copy()

    def _begin(self, rows: NDArray[np.bool_]) -> None:
        self._returns[rows] = 0.0
        self._lengths[rows] = 0
        self._starts[rows] = time.perf_counter()
        self._is_over = self._is_over & ~rows

    def _record(self, infos: dict[str, Any]) -> None:
        over = self._is_over
        durations = np.round(time.perf_counter() - self._starts, 6)
        infos[self._stats_key] = {
            "r": np.where(over, self._returns, 0.0),
            "l": np.where(over, self._lengths, 0),
            "t": np.where(over, durations, 0.0),
        }
        infos[f"_{self._stats_key}"] = over.copy()
        self.episode_count += int(over.sum())
        self.return_queue.extend(self._returns[over].tolist())
        self.length_queue.extend(self._lengths[over].tolist())
        self.time_queue.extend(durations[over].tolist())
