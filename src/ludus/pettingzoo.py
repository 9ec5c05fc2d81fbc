"""Games as ``ParallelEnv`` of PettingZoo: one world, all of its agents.

>>> import ludus.pettingzoo
>>> env = ludus.pettingzoo.parallel_env("tag")                          # doctest: +SKIP
>>> observations, infos = env.reset(seed=0)                             # doctest: +SKIP
>>> actions = {agent: env.action_space(agent).sample() for agent in env.agents}  # doctest: +SKIP
>>> observations, rewards, terminated, truncated, infos = env.step(actions)      # doctest: +SKIP

``pettingzoo.utils.conversions.parallel_to_aec`` makes an ``AECEnv`` of it. Many worlds at once are
:func:`ludus.open_pool`'s.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.errors import ActionError, SequenceError
from ludus.extras import missing_extra
from ludus.libraries.making import open_game, refuse_several_worlds
from ludus.libraries.recipe import Recipe, reduce_env
from ludus.libraries.rendering import Renderer
from ludus.libraries.seeds import check_seed
from ludus.pool import EnginePool
from ludus.spec import PolicySpec
from ludus.spec.batch import ActionBatch, Batch, Batches
from ludus.spec.spaces import action_space, observation_of, observation_space, to_action_batch

try:
    from pettingzoo import ParallelEnv
except ImportError as error:
    raise missing_extra("pettingzoo", "pettingzoo") from error

__all__ = ["LudusParallelEnv", "parallel_env"]


def parallel_env(
    target: str | Path, *, render_mode: str | None = None, **settings: Any
) -> LudusParallelEnv:
    """Start a game as a ``ParallelEnv``.

    Args:
        target: A bundled example (``"tag"``), a project folder, a ``.tscn``, an exported game, or
            any other word that docs/targets.md lists.
        render_mode: As for :func:`ludus.make`.
        settings: As for :func:`ludus.make`.

    Raises:
        UsageError: Settings are unknown, or ask for several worlds.
        TargetError: The target cannot be run.
        EngineNotFound: There is no engine to run it with.
        EngineError: The engine did not start.
    """
    refuse_several_worlds("ludus.pettingzoo.parallel_env", settings)
    recipe = Recipe.of("parallel_env", target, {"render_mode": render_mode, **settings}, __name__)
    pool, obstacle = open_game("make", target, settings, render_mode)
    env = LudusParallelEnv(pool, render_mode, Renderer(pool, render_mode, obstacle))
    env.recipe = recipe
    return env


class LudusParallelEnv(ParallelEnv[str, Any, Any]):
    """One world with all of its agents, which are called ``POLICY_NUMBER``.

    Agents whose episode has ended leave :attr:`agents`, and stay away until :meth:`reset`, even
    where the game has begun another episode for them. Agents that join appear. Where a policy has
    action masks, its agents observe ``{"observation": …, "action_mask": int8[n]}``, as PettingZoo
    has it; of several choices ``"action_mask"`` is a tuple with one mask for each.

    Args:
        pool: One engine with one world; closed with the environment.
        render_mode: One of ``"human"``, ``"rgb_array"``, or None.
        renderer: Draws for :meth:`render`.

    Attributes:
        agents: Those that act in the next step.
        possible_agents: All slots of all policies, free ones included.
        state_space: Of :meth:`state`.
    """

    def __init__(
        self, pool: EnginePool, render_mode: str | None = None, renderer: Renderer | None = None
    ) -> None:
        self.pool = pool
        self.render_mode = render_mode
        self._renderer = renderer or Renderer(pool, render_mode)
        self.metadata = {
            "name": Path(pool.spec.scene).stem or "ludus",
            "is_parallelizable": True,
            **self._renderer.metadata(),
        }
        self._slots = {
            f"{name}_{slot}": (policy, slot)
            for name, policy in pool.policies.items()
            for slot in range(policy.agents_per_world)
        }
        self.possible_agents = list(self._slots)
        self.agents: list[str] = []
        self.observation_spaces = {
            agent: _masked_space(policy) for agent, (policy, _) in self._slots.items()
        }
        self.action_spaces = {
            agent: action_space(policy) for agent, (policy, _) in self._slots.items()
        }
        self.state_space = _state_space(pool)
        self.recipe: Recipe | None = None
        self._batches: Batches = {}
        self._dead: set[str] = set()
        self._has_begun = False

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of one agent's observations, the same object each time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of one agent's actions, the same object each time."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin an episode of the world.

        Args:
            seed: Of the world's random stream, from 0 to 2**63 - 1; None goes on with it.
            options: What the game reads from ``LudusWorld.parameters``.

        Returns:
            Observations and infos by agent.

        Raises:
            UsageError: The seed is out of range, or options are not JSON.
            EngineError: The engine failed.
        """
        seed = check_seed(seed)
        given = options or {}
        parameters = given.get("parameters", given) or None
        if not (self._has_begun and seed is None and parameters is None):
            self._batches = self.pool.reset(seed, parameters)
        self._has_begun = False
        self._dead = set()
        self.agents = self._active()
        observations = {agent: self._observation(agent) for agent in self.agents}
        return observations, {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, Any]) -> tuple[dict[str, Any], ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Act once.

        Args:
            actions: One for each of :attr:`agents`.

        Returns:
            Observations, rewards, terminated, truncated and infos of the agents that acted, and of
            those that joined.

        Raises:
            SequenceError: There are no agents: call ``reset``.
            ActionError: An agent has no action, or one that does not fit its space.
            EngineError: The engine failed.
        """
        if not self.agents:
            raise SequenceError("step without agents", hint="call reset() first")
        self._batches = self.pool.step(self._join(actions))
        acted = self.agents
        outcomes = {agent: self._outcome(agent) for agent in acted}
        self._dead |= {agent for agent, (_, *ends) in outcomes.items() if any(ends)}
        active = self._active()
        self.agents = [agent for agent in active if agent not in self._dead]
        # The world is over, and has begun anew: the next reset needs no message.
        self._has_begun = not self.agents and self._begin_together(active)
        joined = [agent for agent in self.agents if agent not in outcomes]
        outcomes |= {agent: (0.0, False, False) for agent in joined}
        observations = {
            agent: self._observation(agent, is_final=agent in self._dead) for agent in outcomes
        }
        rewards, terminated, truncated = (
            {agent: outcome[part] for agent, outcome in outcomes.items()} for part in range(3)
        )
        return observations, rewards, terminated, truncated, {agent: {} for agent in outcomes}

    def state(self) -> NDArray[np.float32]:
        """Return what all slots observe, flat, in the order of ``possible_agents``; free ones 0."""
        parts = [
            np.concatenate([values[slot].ravel() for values in batch.observation.values()])
            for batch, slot in map(self._place, self.possible_agents)
        ]
        return np.concatenate(parts).astype(np.float32)

    def render(self) -> Any:
        """Return a picture of the world with ``render_mode="rgb_array"``.

        Raises:
            SetupError: Nothing here can draw; the text says what is missing.
        """
        return self._renderer.picture(0) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """End the engine; may be called twice."""
        self.pool.close()

    def __reduce__(self) -> tuple[Any, ...]:
        return reduce_env(self, self.recipe)

    def __str__(self) -> str:
        return str(self.metadata["name"])

    def _active(self) -> list[str]:
        return [
            agent
            for agent in self.possible_agents
            for batch, slot in (self._place(agent),)
            if batch.active[slot]
        ]

    def _begin_together(self, active: list[str]) -> bool:
        """Return whether all agents of the world have begun an episode in the last step."""
        if not active or len(self._dead) != len(active):
            return False
        if all(policy.episode == "world" for policy in self.pool.policies.values()):
            return True
        # Where each agent has episodes of its own, one that ended earlier plays its next by now.
        return all(any(self._outcome(agent)[1:]) for agent in active)

    def _place(self, agent: str) -> tuple[Batch, int]:
        policy, slot = self._slots[agent]
        return self._batches[policy.name], slot

    def _outcome(self, agent: str) -> tuple[float, bool, bool]:
        batch, slot = self._place(agent)
        return float(batch.reward[slot]), bool(batch.terminated[slot]), bool(batch.truncated[slot])

    def _observation(self, agent: str, *, is_final: bool = False) -> Any:
        policy, slot = self._slots[agent]
        batch = self._batches[policy.name]
        if is_final:
            row = int(np.searchsorted(batch.final_index, slot))
            entries = {name: values[row] for name, values in batch.final_observation.items()}
        else:
            entries = {name: values[slot] for name, values in batch.observation.items()}
        own = observation_of(policy, entries)
        if batch.action_mask is None:
            return own
        mask = np.ones(policy.mask_size, np.int8)
        if not is_final:
            mask = batch.action_mask[slot].astype(np.int8)
        parts = np.split(mask, np.cumsum(policy.nvec)[:-1])
        return {"observation": own, "action_mask": parts[0] if len(parts) == 1 else tuple(parts)}

    def _join(self, actions: Mapping[str, Any]) -> dict[str, ActionBatch]:
        joined = {
            name: ActionBatch.zeros(policy, policy.num_agents)
            for name, policy in self.pool.policies.items()
        }
        for agent in self.agents:
            if agent not in actions:
                raise ActionError(
                    f"agent {agent!r} has no action", hint="give one for each of env.agents"
                )
            policy, slot = self._slots[agent]
            try:
                own = to_action_batch(policy, actions[agent], None)
            except ActionError as error:
                raise ActionError(f"agent {agent!r}: {error.message}", error.hint) from error
            joined[policy.name].discrete[slot] = own.discrete[0]
            joined[policy.name].continuous[slot] = own.continuous[0]
        return joined


def _masked_space(policy: PolicySpec) -> spaces.Space[Any]:
    own = observation_space(policy)
    if not policy.has_action_mask:
        return own
    masks = [spaces.Box(0, 1, (n,), np.int8) for n in policy.nvec]
    mask = masks[0] if len(masks) == 1 else spaces.Tuple(masks)
    return spaces.Dict({"observation": own, "action_mask": mask})


def _state_space(pool: EnginePool) -> spaces.Box:
    bounds = [
        np.concatenate([entry.bounds()[side].ravel() for entry in policy.observation])
        for side in (0, 1)
        for policy in pool.policies.values()
        for _ in range(policy.agents_per_world)
    ]
    half = len(bounds) // 2
    # Free slots are zeros, whatever the bounds.
    low = np.minimum(np.concatenate(bounds[:half]), 0).astype(np.float32)
    high = np.maximum(np.concatenate(bounds[half:]), 0).astype(np.float32)
    return spaces.Box(low, high, dtype=np.float32)
