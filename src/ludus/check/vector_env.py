"""The ``VectorEnv`` over all worlds: shapes, types, autoreset, copies, seeds, options."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from ludus.check.causes import name_causes
from ludus.check.context import CheckContext
from ludus.check.finding import Finding, fail, info, ok
from ludus.check.seeds import RNG_HINT, SHARED_HINT
from ludus.errors import UsageError
from ludus.libraries import LudusVectorEnv
from ludus.play.players import random_player
from ludus.spec import ContinuousAction, DiscreteAction, PolicySpec
from ludus.spec.batch import ActionBatch, Batch

__all__ = ["check_vector_env"]

MAX_STEPS = 100
DEFECT_HINT = "this is a defect of Ludus; please report it with the scene"
SEED_TITLE = "VectorEnv: one seed for all equals seed + i"
MASK_TITLE = "VectorEnv: reset_mask resets only the worlds it selects"


def check_vector_env(context: CheckContext) -> list[Finding]:
    """Use the environment as a training library does."""
    if len(context.spec.policies) > 1:
        return [info("VectorEnv", "does not apply: there are several policies")]
    with context.main_pool() as pool:
        env = LudusVectorEnv(pool)
        env.closed = True  # older versions of Gymnasium would end the shared engine with it
        player = _Player(env, context)
        checks: dict[str, Callable[[_Player], str]] = {
            "VectorEnv: shapes and types": _shapes,
            "VectorEnv: final_obs exactly where an episode ended": _finals,
            "VectorEnv: returned arrays are not reused": _copies,
            SEED_TITLE: _seeds,
            MASK_TITLE: _reset_mask,
            "VectorEnv: unknown options and wrong seeds are refused": _refusals,
        }
        problems = {title: check(player) for title, check in checks.items()}
    # What only the game's own episodes decide is no proof of a defect of Ludus.
    hints = {
        SEED_TITLE: name_causes(context.scripts, RNG_HINT),
        MASK_TITLE: name_causes(context.scripts, SHARED_HINT),
    }
    findings = [
        fail(title, text, hints.get(title, DEFECT_HINT)) if text else ok(title)
        for title, text in problems.items()
    ]
    return [context.excuse(f) if f.title == SEED_TITLE else f for f in findings]


class _Player:
    """A ``VectorEnv`` and legal random actions for it."""

    def __init__(self, env: LudusVectorEnv, context: CheckContext) -> None:
        self.env = env
        self.seed = context.config.seed
        self.num_steps = min(MAX_STEPS, context.config.num_steps)
        self._act = random_player(env.pool, self.seed)
        self._mask: NDArray[np.bool_] | None = None

    def reset(self, **arguments: Any) -> Any:
        """Reset, by default with the seed of the check, and return the observation."""
        given: dict[str, Any] = {"seed": self.seed, **arguments}
        observation, infos = self.env.reset(**given)
        self._mask = infos.get("action_mask")
        return observation

    def step(self) -> tuple[Any, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Take random actions."""
        batch = Batch.allocate(self.env.policy, self.env.num_envs)
        batch.action_mask = self._mask
        actions = self._act({self.env.policy.name: batch})
        result = self.env.step(_to_space(self.env.policy, actions[self.env.policy.name]))
        self._mask = result[4].get("action_mask")
        return result


def _to_space(policy: PolicySpec, actions: ActionBatch) -> Any:
    """Return actions in the form of the batched action space; see ``ludus.spec.spaces``."""
    if not policy.continuous_size:
        return actions.discrete[:, 0] if policy.num_discrete == 1 else actions.discrete
    if not policy.num_discrete:
        return actions.continuous
    sizes = [part.size for part in policy.action if isinstance(part, ContinuousAction)]
    numbers = iter(np.split(actions.continuous, np.cumsum(sizes)[:-1], axis=1))
    choices = iter(actions.discrete.T)
    return {
        part.name: next(choices if isinstance(part, DiscreteAction) else numbers)
        for part in policy.action
    }


def _shapes(player: _Player) -> str:
    env = player.env
    if env.metadata.get("autoreset_mode") is not AutoresetMode.SAME_STEP:
        return "metadata['autoreset_mode'] is not SAME_STEP"
    observation = player.reset()
    for step in range(3):
        problem = _incompatibility(cast(Any, env).observation_space, observation, "observation")
        if problem:
            return f"step {step}: {problem}"
        observation, reward, terminated, truncated, _ = player.step()
        for name, array, dtype in (
            ("reward", reward, np.float32),
            ("terminated", terminated, np.bool_),
            ("truncated", truncated, np.bool_),
        ):
            if array.shape != (env.num_envs,) or array.dtype != dtype:
                return f"{name} is {array.dtype}{array.shape}, expected ({env.num_envs},)"
    return ""


def _incompatibility(space: spaces.Space[Any], value: Any, name: str) -> str:
    """Describe how shape or dtype of ``value`` differ from ``space``; bounds are not checked."""
    if isinstance(space, spaces.Dict):
        parts = cast(dict[str, spaces.Space[Any]], cast(Any, space).spaces)
        if set(value) != set(parts):
            return f"{name} has {sorted(value)}, expected {sorted(parts)}"
        problems = (_incompatibility(part, value[key], key) for key, part in parts.items())
        return next(filter(None, problems), "")
    array = np.asarray(value)
    if array.shape != space.shape or array.dtype != space.dtype:
        return f"{name} is {array.dtype}{array.shape}, expected {space.dtype}{space.shape}"
    return ""


def _finals(player: _Player) -> str:
    player.reset()
    for step in range(player.num_steps):
        _, _, terminated, truncated, infos = player.step()
        has_ended = terminated | truncated
        if not has_ended.any():
            if "final_obs" in infos:
                return f"step {step}: there is final_obs, but no episode ended"
            continue
        given = np.array([value is not None for value in infos["final_obs"]])
        if (given != has_ended).any() or (infos["_final_obs"] != has_ended).any():
            return f"step {step}: final_obs is given for {given}, but {has_ended} ended"
        first = infos["final_obs"][int(has_ended.argmax())]
        problem = _incompatibility(
            cast(Any, player.env).single_observation_space, first, "final_obs"
        )
        if problem:
            return problem
    return ""


def _copies(player: _Player) -> str:
    observation = player.reset()
    for step in range(3):
        kept = [array.copy() for array in _arrays(observation)]
        following, *_ = player.step()
        for before, array in zip(kept, _arrays(observation), strict=True):
            if before.tobytes() != array.tobytes():
                return f"step {step} overwrote the previous observation"
        for one, two in zip(_arrays(observation), _arrays(following), strict=True):
            if np.shares_memory(one, two):
                return f"steps {step} and {step + 1} share memory"
        observation = following
    return ""


def _seeds(player: _Player) -> str:
    env, per_world = player.env, player.env.policy.agents_per_world
    one = player.reset()
    two = player.reset(seed=[player.seed + i // per_world for i in range(env.num_envs)])
    same = _equal_rows(env.policy, one, two)
    return "" if same.all() else f"environments {np.flatnonzero(~same).tolist()} differ"


def _reset_mask(player: _Player) -> str:
    env = player.env
    player.reset()
    before = player.step()[0]
    mask = np.zeros(env.num_envs, np.bool_)
    mask[: env.policy.agents_per_world] = True
    after = player.reset(options={"reset_mask": mask})
    same = _equal_rows(env.policy, before, after)
    return "" if same[~mask].all() else f"environments {np.flatnonzero(~same & ~mask)} changed"


def _refusals(player: _Player) -> str:
    for name, arguments in {
        "an unknown option": {"options": {"no_such_option": 1}},
        "too many seeds": {"seed": [0] * (player.env.num_envs + 1)},
    }.items():
        try:
            player.reset(**arguments)
        except UsageError:
            continue
        return f"{name} was accepted"
    player.reset(options={"parameters": {}})
    return ""


def _arrays(observation: Any) -> list[NDArray[Any]]:
    if isinstance(observation, Mapping):
        return list(cast(Mapping[str, NDArray[Any]], observation).values())
    return [observation]


def _equal_rows(policy: PolicySpec, one: Any, two: Any) -> NDArray[np.bool_]:
    """Return ``bool[num_envs]``: whether the rows are equal to the bit."""
    num = policy.num_agents
    same = np.ones(num, np.bool_)
    for first, second in zip(_arrays(one), _arrays(two), strict=True):
        same &= (first.reshape(num, -1) == second.reshape(num, -1)).all(axis=1)
    return same
