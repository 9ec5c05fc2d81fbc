"""All agents of one policy as a ``gymnasium.vector.VectorEnv``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ludus.errors import LudusError, UsageError
from ludus.libraries.autoreset import read_mode, stepper_of
from ludus.libraries.others import OtherPolicies, Player
from ludus.libraries.recipe import Recipe, reduce_env
from ludus.libraries.rendering import Renderer
from ludus.libraries.seeds import Seeds, world_seeds
from ludus.pool import EnginePool
from ludus.spec import PolicySpec
from ludus.spec.batch import Batch
from ludus.spec.spaces import action_space, observation_of, observation_space, to_action_batch
from ludus.wire.reset import ResetAction, ResetRequest

__all__ = ["LudusVectorEnv"]

_OPTIONS = {"parameters", "reset_mask"}


class LudusVectorEnv(VectorEnv[Any, Any, Any]):
    """Engines × worlds × agents of one policy as parallel environments.

    Environments are numbered engine by engine, world by world, agent by agent. A new episode
    begins when ``metadata["autoreset_mode"]`` says:

    - ``SAME_STEP``: the step that ends an episode returns its reward and
      ``terminated``/``truncated`` with the first observation of the next one; the last observation
      is in ``infos["final_obs"]`` (an object array, with ``infos["_final_obs"]`` saying where).
    - ``NEXT_STEP``: that step returns the last observation; the next one ignores the action, and
      returns the first observation with reward 0.
    - ``DISABLED``: ``reset(options={"reset_mask": …})`` begins it; to step before is an error.

    Where agents come and go, ``infos["active"]`` says which environments act; the others observe
    zeros. With action masks, ``infos["action_mask"]`` is ``bool[num_envs, sum(nvec)]``; where an
    episode has ended without the next one having begun, it allows everything.

    Args:
        pool: Running engines; closed with the environment.
        policy: Whose agents; None if there is only one policy.
        render_mode: ``"human"`` if the game has a window, ``"rgb_array"`` for :meth:`render`.
        autoreset_mode: One of Gymnasium's, or its name in lower case.
        others: What agents of other policies do, by policy: a policy file or a function from
            observations to actions; those not named act at random.
        obstacle: Why :meth:`render` cannot draw.

    Raises:
        UsageError: There are several policies and none was chosen, or no such policy; or agents of
            one world end one by one, which the mode does not allow.
    """

    def __init__(
        self,
        pool: EnginePool,
        policy: str | None = None,
        render_mode: str | None = None,
        *,
        autoreset_mode: str | AutoresetMode = AutoresetMode.SAME_STEP,
        others: Mapping[str, Player] | None = None,
        obstacle: LudusError | None = None,
    ) -> None:
        mode = read_mode(autoreset_mode)
        self.pool = pool
        self.policy = choose_policy(pool, policy)
        self.num_envs = pool.num_agents(self.policy.name)
        observations, actions = observation_space(self.policy), action_space(self.policy)
        self.single_observation_space = observations
        self.single_action_space = actions
        self.observation_space = batch_space(observations, self.num_envs)
        self.action_space = batch_space(actions, self.num_envs)
        self.render_mode = render_mode
        self._renderer = Renderer(pool, render_mode, obstacle)
        self._stepper = stepper_of(pool, mode)
        self._others = OtherPolicies(pool, self.policy.name, others or {})
        self._shows_final = mode is AutoresetMode.SAME_STEP
        self._everywhere = np.ones(self.num_envs, np.bool_)
        self.metadata = {"autoreset_mode": mode, **self._renderer.metadata()}
        self.autoreset_mode = mode  # where TorchRL looks, as SyncVectorEnv has it
        self.recipe: Recipe | None = None

    def reset(
        self,
        *,
        seed: Seeds = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes.

        Args:
            seed: From 0 to 2**63 - 1. World *i* gets ``seed + i``; or one seed or None per
                environment (the first agent of a world decides for it); None goes on with the
                worlds' random streams.
            options: ``"parameters"``: what the game reads from ``LudusWorld.parameters``, for every
                world or a list with one mapping or None per world; ``"reset_mask"``:
                ``bool[num_envs]``; only the worlds of these environments are reset.

        Returns:
            Observations of all environments, and infos.

        Raises:
            UsageError: An unknown option, a seed out of range, or a list of the wrong length.
        """
        options = options or {}
        unknown = set(options) - _OPTIONS
        if unknown:
            raise UsageError(
                f"unknown reset option {', '.join(sorted(unknown))}",
                hint="put what the game should know into options={'parameters': {…}}",
            )
        seeds = world_seeds(seed, self.pool.num_worlds, self.policy.agents_per_world)
        if isinstance(seed, Sequence | np.ndarray) or "reset_mask" in options:
            request = self._request_some(seeds, options)
        else:
            request = self.pool.request_all(seeds[0], options.get("parameters"))
        batches = self._stepper.reset(request)
        self._others.begin(batches, seeds, request.actions != ResetAction.LEAVE)
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
            SequenceError: ``reset`` was never called, or an episode has ended that
                ``DISABLED`` leaves to ``reset``.
            EngineError: An engine failed.
        """
        own = to_action_batch(self.policy, actions, self.num_envs)
        is_over = self._stepper.is_over  # in ``NEXT_STEP`` this step begins their next episodes
        batches = self._stepper.step({**self._others.act(), self.policy.name: own})
        self._others.observe(batches, has_begun=is_over)
        batch = batches[self.policy.name]
        observation, infos = self._observe(batch)
        if self._shows_final and len(batch.final_index):
            self._add_final(batch, infos)
        return observation, batch.reward, batch.terminated, batch.truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Draw all environments.

        Returns:
            With ``render_mode="rgb_array"`` a picture ``uint8[height, width, 3]`` for each
            environment, of its world; otherwise None: a window draws by itself.

        Raises:
            SetupError: Nothing here can draw; the text says what is missing.
            TargetError: The game gives no pictures.
        """
        if self.render_mode != "rgb_array":
            return None
        pictures = [self._renderer.picture(world) for world in range(self.pool.num_worlds)]
        return tuple(picture for picture in pictures for _ in range(self.policy.agents_per_world))

    def __reduce__(self) -> tuple[Any, ...]:
        return reduce_env(self, self.recipe)

    def close_extras(self, **kwargs: Any) -> None:
        """End the engines."""
        self.pool.close()

    def _request_some(self, seeds: list[int | None], options: dict[str, Any]) -> ResetRequest:
        mask = np.asarray(options.get("reset_mask", self._everywhere))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise UsageError(
                f"reset_mask must be bool[{self.num_envs}], got {mask.dtype}{list(mask.shape)}"
            )
        chosen = mask.reshape(-1, self.policy.agents_per_world).any(axis=1)
        actions = np.where(
            [value is None for value in seeds], ResetAction.NEXT_EPISODE, ResetAction.SEED
        )
        return ResetRequest(
            np.array([value or 0 for value in seeds], np.uint64),
            np.where(chosen, actions, ResetAction.LEAVE).astype(np.uint8),
            options.get("parameters"),
        )

    def _observe(self, batch: Batch) -> tuple[Any, dict[str, Any]]:
        infos: dict[str, Any] = {}
        if not batch.active.all():
            infos["active"] = batch.active
        if batch.action_mask is not None:
            infos["action_mask"] = batch.action_mask
            infos["_action_mask"] = self._everywhere.copy()
        return observation_of(self.policy, batch.observation), infos

    def _add_final(self, batch: Batch, infos: dict[str, Any]) -> None:
        final = np.full(self.num_envs, None, dtype=object)
        for row, slot in enumerate(batch.final_index):
            entries = {name: values[row] for name, values in batch.final_observation.items()}
            final[slot] = observation_of(self.policy, entries)
        infos["final_obs"], infos["_final_obs"] = final, batch.terminated | batch.truncated
        infos["final_info"], infos["_final_info"] = {}, infos["_final_obs"].copy()


def choose_policy(pool: EnginePool, name: str | None) -> PolicySpec:
    """Return the policy called ``name``, or the only one.

    Raises:
        UsageError: There is no such policy, or there are several and none was named.
    """
    names = ", ".join(pool.policies)
    if name is None and len(pool.policies) > 1:
        raise UsageError(
            f"the game has several policies ({names}), and none was chosen",
            hint=f"policy={next(iter(pool.policies))!r} acts for one (in gymnasium.make_vec and "
            "ludus.make_vec for each of its agents), the others act at random or as others={…} "
            "says; act for all of them with ludus.pettingzoo.parallel_env or ludus.open_pool",
        )
    if name is not None and name not in pool.policies:
        raise UsageError(f"there is no policy {name!r}; the game has {names}")
    return pool.policies[name or next(iter(pool.policies))]
