"""One agent in one world as a ``gymnasium.Env``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import gymnasium
import numpy as np

from ludus.errors import SequenceError, UsageError
from ludus.libraries.spaces import action_space, observation_of, observation_space, to_action_batch
from ludus.libraries.vector import choose_policy
from ludus.pool import EnginePool
from ludus.spec.batch import Batch

__all__ = ["LudusEnv"]


class LudusEnv(gymnasium.Env[Any, Any]):
    """One world with one agent.

    ``step`` returns the last observation of an episode when it ends; call ``reset`` then. A reset
    without a seed after an end costs nothing: the game has begun its next episode already.

    Args:
        pool: One running engine with one world; closed with the environment.
        policy: Name of the agent's policy, None if there is only one.
        render_mode: ``"human"`` if the game has a window.

    Raises:
        UsageError: The world has more than one agent.
    """

    def __init__(
        self, pool: EnginePool, policy: str | None = None, render_mode: str | None = None
    ) -> None:
        self.pool = pool
        self.policy = choose_policy(pool, policy)
        if pool.num_agents(self.policy.name) != 1:
            raise UsageError(
                f"the world has {pool.num_agents(self.policy.name)} agents, not one",
                hint="use ludus.make_vec, in which every agent is an environment",
            )
        self.observation_space = observation_space(self.policy)
        self.action_space = action_space(self.policy)
        self.render_mode = render_mode
        self.metadata = {
            "render_modes": ["human"],
            "render_fps": pool.spec.tick_rate / pool.spec.ticks_per_step,
        }
        self._fresh: Batch | None = None
        self._needs_reset = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Seed of the world's random stream; equal seeds and actions give equal bits. None
                goes on with the stream.
            options: ``{"parameters": {…}}``: what the game reads from ``LudusWorld.parameters``.

        Raises:
            UsageError: An unknown option.
            EngineError: The engine failed.
        """
        super().reset(seed=seed)
        options = options or {}
        if set(options) - {"parameters"}:
            raise UsageError(
                f"unknown reset option {', '.join(sorted(set(options) - {'parameters'}))}",
                hint="put what the game should know into options={'parameters': {…}}",
            )
        parameters = options.get("parameters")
        batch = self._fresh
        if batch is None or seed is not None or parameters is not None:
            batch = self.pool.reset(seed, parameters)[self.policy.name]
        self._fresh = None
        self._needs_reset = False
        return self._row(batch.observation, 0), self._info(batch)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act once.

        Returns:
            Observation, reward, terminated, truncated, info (with ``"action_mask"`` where the game
            has masks).

        Raises:
            SequenceError: The episode has ended, or never begun: call ``reset``.
            ActionError: The action does not fit ``action_space``.
            EngineError: The engine failed.
        """
        if self._needs_reset:
            raise SequenceError("step outside an episode", hint="call reset() first")
        own = to_action_batch(self.policy, _batched(action), 1)
        batch = self.pool.step({self.policy.name: own})[self.policy.name]
        terminated, truncated = bool(batch.terminated[0]), bool(batch.truncated[0])
        observation = batch.observation
        if terminated or truncated:
            observation = batch.final_observation
            self._fresh = batch
            self._needs_reset = True
        info = self._info(batch)
        return self._row(observation, 0), float(batch.reward[0]), terminated, truncated, info

    def render(self) -> None:
        """Do nothing: with ``render_mode="human"`` the game draws itself."""

    def close(self) -> None:
        """End the engine; may be called twice."""
        self.pool.close()

    def _row(self, entries: dict[str, Any], row: int) -> Any:
        return observation_of(self.policy, {name: values[row] for name, values in entries.items()})

    def _info(self, batch: Batch) -> dict[str, Any]:
        # A copy: when an episode ends, the same batch also answers the next reset.
        return {} if batch.action_mask is None else {"action_mask": batch.action_mask[0].copy()}


def _batched(action: Any) -> Any:
    if isinstance(action, Mapping):
        parts = cast(Mapping[str, Any], action)
        return {name: np.asarray(value)[None] for name, value in parts.items()}
    return np.asarray(action)[None]
