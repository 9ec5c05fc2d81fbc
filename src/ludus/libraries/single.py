"""One agent in one world as a ``gymnasium.Env``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from ludus.errors import LudusError, SequenceError, UsageError
from ludus.libraries.others import OtherPolicies, Player
from ludus.libraries.recipe import Recipe, reduce_env
from ludus.libraries.rendering import Renderer
from ludus.libraries.seeds import check_seed
from ludus.libraries.vector import choose_policy
from ludus.pool import EnginePool
from ludus.spec.batch import Batch, Batches
from ludus.spec.spaces import action_space, observation_of, observation_space, to_action_batch

__all__ = ["LudusEnv"]


class LudusEnv(gymnasium.Env[Any, Any]):
    """One world with one agent.

    ``step`` returns the last observation of an episode when it ends; call ``reset`` then. A reset
    without a seed after an end costs nothing: the game has begun its next episode already.

    Args:
        pool: One running engine with one world; closed with the environment.
        policy: Name of the agent's policy, None if there is only one.
        render_mode: ``"human"`` if the game has a window, ``"rgb_array"`` for :meth:`render`.
        others: What agents of other policies do, as for :class:`ludus.LudusVectorEnv`.
        obstacle: Why :meth:`render` cannot draw.

    Raises:
        UsageError: The policy has more than one agent in the world, or does not exist.
    """

    def __init__(
        self,
        pool: EnginePool,
        policy: str | None = None,
        render_mode: str | None = None,
        *,
        others: Mapping[str, Player] | None = None,
        obstacle: LudusError | None = None,
    ) -> None:
        self.pool = pool
        self.policy = choose_policy(pool, policy)
        if pool.num_agents(self.policy.name) != 1:
            raise UsageError(
                f"the world has {pool.num_agents(self.policy.name)} agents, not one",
                hint="gymnasium.make_vec or ludus.make_vec: every agent is an environment; "
                "ludus.pettingzoo.parallel_env: one environment of several agents",
            )
        self.observation_space = observation_space(self.policy)
        self.action_space = action_space(self.policy)
        self.render_mode = render_mode
        self._renderer = Renderer(pool, render_mode, obstacle)
        self._others = OtherPolicies(pool, self.policy.name, others or {})
        self.metadata = self._renderer.metadata()
        self.recipe: Recipe | None = None
        self._fresh: Batches | None = None
        self._needs_reset = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Of the world's random stream, from 0 to 2**63 - 1; equal seeds and actions give
                equal bits. None goes on with the stream.
            options: ``{"parameters": {…}}``: what the game reads from ``LudusWorld.parameters``.

        Raises:
            UsageError: An unknown option, or a seed out of range.
            EngineError: The engine failed.
        """
        seed = check_seed(seed)
        super().reset(seed=seed)
        options = options or {}
        if set(options) - {"parameters"}:
            raise UsageError(
                f"unknown reset option {', '.join(sorted(set(options) - {'parameters'}))}",
                hint="put what the game should know into options={'parameters': {…}}",
            )
        parameters = options.get("parameters")
        batches, is_reset = self._fresh, np.zeros(1, np.bool_)
        if batches is None or seed is not None or parameters is not None:
            batches, is_reset = self.pool.reset(seed, parameters), np.ones(1, np.bool_)
        self._others.begin(batches, [seed], is_reset)
        self._fresh = None
        self._needs_reset = False
        batch = batches[self.policy.name]
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
        own = to_action_batch(self.policy, action, None)
        batches = self.pool.step({**self._others.act(), self.policy.name: own})
        self._others.observe(batches, has_begun=np.zeros(1, np.bool_))
        batch = batches[self.policy.name]
        terminated, truncated = bool(batch.terminated[0]), bool(batch.truncated[0])
        observation = batch.observation
        if terminated or truncated:
            observation = batch.final_observation
            # Where agents end one after another, the world may go on without this one.
            self._fresh = batches if batch.active[0] else None
            self._needs_reset = True
        info = self._info(batch)
        return self._row(observation, 0), float(batch.reward[0]), terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the world.

        Returns:
            With ``render_mode="rgb_array"`` a picture ``uint8[height, width, 3]``; otherwise None:
            a window draws by itself.

        Raises:
            SetupError: Nothing here can draw; the text says what is missing.
            TargetError: The game gives no pictures.
        """
        return self._renderer.picture(0) if self.render_mode == "rgb_array" else None

    def __reduce__(self) -> tuple[Any, ...]:
        return reduce_env(self, self.recipe)

    def close(self) -> None:
        """End the engine; may be called twice."""
        self.pool.close()

    def _row(self, entries: dict[str, Any], row: int) -> Any:
        return observation_of(self.policy, {name: values[row] for name, values in entries.items()})

    def _info(self, batch: Batch) -> dict[str, Any]:
        # A copy: when an episode ends, the same batch also answers the next reset.
        return {} if batch.action_mask is None else {"action_mask": batch.action_mask[0].copy()}
