"""Any Gymnasium environment as a :class:`~ludus.pool.interface.Pool`.

An "engine" is a share of the environments in this process. Trainers can be tried without a game,
and anything that Gymnasium knows can be trained. The policy is called ``agent``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import gymnasium
import numpy as np
from numpy.typing import NDArray

from ludus.errors import SequenceError, TargetError
from ludus.folder_imports import look_in_current_folder
from ludus.spec import AgentSpec, PolicySpec, Spec
from ludus.spec.batch import ActionBatch, Batch, Batches, StepTimes
from ludus.spec.batch_rows import action_reader, clear_outcome, write_finals, write_state
from ludus.spec.gymnasium_spec import read_action, read_observation

__all__ = ["GymnasiumPool"]

POLICY = "agent"

GymEnv = gymnasium.Env[Any, Any]
Parameters = Mapping[str, Any] | Sequence[Mapping[str, Any] | None] | None


class GymnasiumPool:
    """``num_engines`` times ``num_worlds`` environments with same-step autoreset.

    Observations may be boxes or dictionaries of boxes, actions discrete, multi-discrete,
    multi-binary or bounded boxes. An ``action_mask`` in the info of a reset counts as the policy's
    mask. ``reset(parameters=)`` reaches the environments as ``options``. ``open_env`` makes one
    environment; None: Gymnasium makes ``env_id``.
    """

    def __init__(
        self,
        env_id: str,
        *,
        num_worlds: int = 1,
        num_engines: int = 1,
        max_episode_steps: int | None = None,
        open_env: Callable[[], GymEnv] | None = None,
    ) -> None:
        self._num_worlds, self._num_engines = num_worlds, num_engines
        open_env = open_env or (lambda: _make(env_id, max_episode_steps))
        self._envs = [open_env() for _ in range(num_worlds * num_engines)]
        self._spec = self._read_spec(env_id)
        policy = self._spec.policies[0]
        self._to_action = action_reader(self._envs[0].action_space)
        self._batches = [Batch.allocate(policy, num_worlds) for _ in range(num_engines)]
        self._pending: list[ActionBatch | None] = [None] * num_engines
        self._is_reset = False
        self._num_steps = 0

    @property
    def spec(self) -> Spec:
        """Spec of one engine."""
        return self._spec

    @property
    def num_engines(self) -> int:
        """Number of shares the environments are split into."""
        return self._num_engines

    @property
    def policies(self) -> Mapping[str, PolicySpec]:
        """The one policy, ``agent``."""
        return {POLICY: self._spec.policies[0]}

    @property
    def num_restarts(self) -> int:
        """Always 0; an environment that fails ends the run."""
        return 0

    def num_agents(self, policy: str) -> int:
        """Return the number of environments."""
        return len(self._envs)

    def rows(self, policy: str, engine: int) -> slice:
        """Return the rows of ``engine`` in arrays over all engines."""
        return slice(engine * self._num_worlds, (engine + 1) * self._num_worlds)

    def reset(self, seed: int | None = None, parameters: Parameters = None) -> Batches:
        """Begin a new episode in every environment; see :meth:`Pool.reset`."""
        for index, env in enumerate(self._envs):
            options = parameters
            if parameters is not None and not isinstance(parameters, Mapping):
                options = parameters[index]
            observation, info = env.reset(
                seed=None if seed is None else seed + index,
                options=dict(cast(Mapping[str, Any], options)) if options else None,
            )
            engine, row = divmod(index, self._num_worlds)
            write_state(self._batches[engine], row, observation, info)
        for batch in self._batches:
            clear_outcome(batch)
            batch.active[:] = True
        self._pending = [None] * self._num_engines
        self._is_reset = True
        return self._joined()

    def send(self, engine: int, actions: Mapping[str, ActionBatch]) -> None:
        """Keep the actions until :meth:`receive`."""
        if not self._is_reset:
            raise SequenceError("send was called before reset", "call reset first")
        if self._pending[engine] is not None:
            raise SequenceError(f"engine {engine} was sent actions twice", "call receive between")
        self._pending[engine] = actions[POLICY]

    def receive(self, engine: int) -> Batches:
        """Step the environments of one engine; views that its next ``receive`` overwrites."""
        actions, self._pending[engine] = self._pending[engine], None
        if actions is None:
            raise SequenceError(f"nothing was sent to engine {engine}", "call send first")
        batch = self._batches[engine]
        clear_outcome(batch)
        finals: list[tuple[int, Any]] = []
        for row in range(self._num_worlds):
            env = self._envs[engine * self._num_worlds + row]
            observation, reward, terminated, truncated, info = env.step(
                self._to_action(actions, row)
            )
            batch.reward[row] = float(reward)
            if terminated or truncated:
                batch.terminated[row], batch.truncated[row] = terminated, truncated
                finals.append((row, observation))
                observation, info = env.reset()
            write_state(batch, row, observation, info)
        if finals:
            write_finals(batch, finals)
        self._num_steps += 1
        return {POLICY: batch}

    def step(self, actions: Mapping[str, ActionBatch]) -> Batches:
        """Step all environments; copies."""
        for engine in range(self._num_engines):
            self.send(engine, {POLICY: actions[POLICY].rows(self.rows(POLICY, engine))})
        for engine in range(self._num_engines):
            self.receive(engine)
        return self._joined()

    def times(self, engine: int) -> StepTimes:
        """Return zeros: there is no engine."""
        return StepTimes(self._num_steps, 0, 0, 0)

    def take_requests(self) -> list[dict[str, Any]]:
        """Return nothing: environments ask nothing of their trainer."""
        return []

    def show_status(self, status: Mapping[str, Any]) -> None:
        """Show nothing: environments do not watch their training."""

    def close(self) -> None:
        """Close all environments."""
        for env in self._envs:
            env.close()

    def _read_spec(self, env_id: str) -> Spec:
        env = self._envs[0]
        _, info = env.reset(seed=0)
        limit = env.spec.max_episode_steps if env.spec else None
        policy = PolicySpec(
            name=POLICY,
            observation=read_observation(env.observation_space),
            action=read_action(env.action_space),
            agents=tuple(AgentSpec(world, "env") for world in range(self._num_worlds)),
            has_action_mask="action_mask" in info,
            max_episode_steps=limit,
        )
        return Spec(self._num_worlds, "isolated", 1, 1.0, (policy,), env_id)

    def _joined(self) -> Batches:
        parts = self._batches
        index = [part.final_index + k * self._num_worlds for k, part in enumerate(parts)]
        masks = [part.action_mask for part in parts if part.action_mask is not None]
        joined = Batch(
            observation=_join_entries([part.observation for part in parts]),
            reward=np.concatenate([part.reward for part in parts]),
            terminated=np.concatenate([part.terminated for part in parts]),
            truncated=np.concatenate([part.truncated for part in parts]),
            active=np.concatenate([part.active for part in parts]),
            action_mask=np.concatenate(masks) if masks else None,
            final_index=np.concatenate(index),
            final_observation=_join_entries([part.final_observation for part in parts]),
        )
        return {POLICY: joined}


def _make(env_id: str, max_episode_steps: int | None) -> GymEnv:
    look_in_current_folder(env_id.rpartition(":")[0])
    try:
        return gymnasium.make(env_id, max_episode_steps=max_episode_steps, disable_env_checker=True)
    except (gymnasium.error.Error, ImportError) as error:
        raise TargetError(
            f"Gymnasium cannot make {env_id!r}: {error}",
            "gymnasium.pprint_registry() lists what it knows; MODULE:ENV_ID imports a module first",
        ) from None


def _join_entries(parts: list[dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
