"""All agents of one policy as a ``gymnasium.vector.VectorEnv``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ludus.errors import UsageError
from ludus.libraries.spaces import action_space, observation_of, observation_space, to_action_batch
from ludus.pool import EnginePool
from ludus.spec import PolicySpec
from ludus.spec.batch import Batch
from ludus.wire.reset import ResetAction, ResetRequest

__all__ = ["LudusVectorEnv"]

_OPTIONS = {"parameters", "reset_mask"}


class LudusVectorEnv(VectorEnv[Any, Any, Any]):
    """Engines × worlds × agents of one policy as parallel environments.

    Environments are numbered engine by engine, world by world, agent by agent. A new
    episode begins in the same step in which the old one ends (``AutoresetMode.SAME_STEP``): the
    step returns the reward and ``terminated``/``truncated`` of the old episode with the first
    observation of the new one; the last observation of the old one is in ``infos["final_obs"]``
    (an object array, with ``infos["_final_obs"]`` saying where). Where agents come and go,
    ``infos["active"]`` says which environments act; the others observe zeros. With action masks,
    ``infos["action_mask"]`` is ``bool[num_envs, sum(nvec)]``.

    Args:
        pool: Running engines; closed with the environment.
        policy: Whose agents; None if there is only one policy.
        render_mode: ``"human"`` if the game has a window.

    Raises:
        UsageError: There are several policies and none was chosen, or no such policy.
    """

    def __init__(
        self, pool: EnginePool, policy: str | None = None, render_mode: str | None = None
    ) -> None:
        self.pool = pool
        self.policy = choose_policy(pool, policy)
        self.num_envs = pool.num_agents(self.policy.name)
        observations, actions = observation_space(self.policy), action_space(self.policy)
        self.single_observation_space = observations
        self.single_action_space = actions
        self.observation_space = batch_space(observations, self.num_envs)
        self.action_space = batch_space(actions, self.num_envs)
        self.render_mode = render_mode
        self.metadata = {
            "autoreset_mode": AutoresetMode.SAME_STEP,
            "render_modes": ["human"],
            "render_fps": pool.spec.tick_rate / pool.spec.ticks_per_step,
        }

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes.

        Args:
            seed: World *i* gets ``seed + i``; or one seed per environment (the first agent of a
                world decides for it); None goes on with the worlds' random streams.
            options: ``"parameters"``: what the game reads from ``LudusWorld.parameters``, for every
                world or a list with one mapping or None per world; ``"reset_mask"``:
                ``bool[num_envs]``; only the worlds of these environments are reset.

        Returns:
            Observations of all environments, and infos.

        Raises:
            UsageError: An unknown option, or a list of the wrong length.
        """
        options = options or {}
        unknown = set(options) - _OPTIONS
        if unknown:
            raise UsageError(
                f"unknown reset option {', '.join(sorted(unknown))}",
                hint="put what the game should know into options={'parameters': {…}}",
            )
        if isinstance(seed, Sequence) or "reset_mask" in options:
            batches = self._reset_some(seed, options)
        else:
            whole = None if seed is None else int(seed)
            batches = self.pool.reset(whole, options.get("parameters"))
        return self._observe(batches[self.policy.name])

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Act in all environments at once.

        Args:
            actions: A sample of ``action_space``; those of inactive environments are ignored.

        Returns:
            Observations, rewards ``float32[num_envs]``, terminated and truncated
            ``bool[num_envs]``, infos.

        Raises:
            ActionError: The actions do not fit ``action_space``.
            SequenceError: ``reset`` was never called.
            EngineError: An engine failed.
        """
        own = to_action_batch(self.policy, actions, self.num_envs)
        batch = self.pool.step({self.policy.name: own})[self.policy.name]
        observation, infos = self._observe(batch)
        if len(batch.final_index):
            self._add_final(batch, infos)
        return observation, batch.reward, batch.terminated, batch.truncated, infos

    def close_extras(self, **kwargs: Any) -> None:
        """End the engines."""
        self.pool.close()

    def _reset_some(self, seed: Any, options: dict[str, Any]) -> dict[str, Batch]:
        per_world = self.policy.agents_per_world
        num_worlds = self.pool.spec.num_worlds * self.pool.num_engines
        seeds = _world_seeds(seed, num_worlds, per_world)
        mask = np.asarray(options.get("reset_mask", np.ones(self.num_envs, np.bool_)))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise UsageError(f"reset_mask must be bool[{self.num_envs}], got {mask.shape}")
        chosen = mask.reshape(num_worlds, per_world).any(axis=1)
        actions = np.where(
            [value is None for value in seeds], ResetAction.NEXT_EPISODE, ResetAction.SEED
        )
        request = ResetRequest(
            np.array([(value or 0) % (1 << 64) for value in seeds], np.uint64),
            np.where(chosen, actions, ResetAction.LEAVE).astype(np.uint8),
            options.get("parameters"),
        )
        return self.pool.reset_worlds(request)

    def _observe(self, batch: Batch) -> tuple[Any, dict[str, Any]]:
        infos: dict[str, Any] = {}
        if not batch.active.all():
            infos["active"] = batch.active
        if batch.action_mask is not None:
            infos["action_mask"] = batch.action_mask
        return observation_of(self.policy, batch.observation), infos

    def _add_final(self, batch: Batch, infos: dict[str, Any]) -> None:
        final = np.full(self.num_envs, None, dtype=object)
        for row, slot in enumerate(batch.final_index):
            entries = {name: values[row] for name, values in batch.final_observation.items()}
            final[slot] = observation_of(self.policy, entries)
        infos["final_obs"] = final
        infos["_final_obs"] = batch.terminated | batch.truncated


def choose_policy(pool: EnginePool, name: str | None) -> PolicySpec:
    """Return the policy called ``name``, or the only one.

    Raises:
        UsageError: There is no such policy, or there are several and none was named.
    """
    if len(pool.policies) == 1 and (name is None or name in pool.policies):
        return next(iter(pool.policies.values()))
    names = ", ".join(pool.policies)
    if name is None or name in pool.policies:
        raise UsageError(
            f"the game has several policies ({names}); this environment can act for one only",
            hint="act for all of them with ludus.open_pool, or train with `ludus train`",
        )
    raise UsageError(f"there is no policy {name!r}; the game has {names}")


def _world_seeds(
    seed: int | Sequence[int | None] | None, num_worlds: int, per_world: int
) -> list[int | None]:
    """Return a seed per world; the first agent of a world decides for it."""
    if seed is None:
        return [None] * num_worlds
    if not isinstance(seed, Sequence):
        return [int(seed) + i for i in range(num_worlds)]
    seeds = [None if value is None else int(value) for value in seed]
    if len(seeds) != num_worlds * per_world:
        raise UsageError(f"{len(seeds)} seeds for {num_worlds * per_world} environments")
    return seeds[::per_world]
