"""Environments of Gymnasium as a session: stepped one by one in this process.

Trainers can be tried without a game, and anything that Gymnasium knows can be trained. The policy
is called ``agent``.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from ludus.errors import GameError, SequenceError, TargetError
from ludus.folder_imports import look_in_current_folder
from ludus.spec import AgentSpec, PolicySpec, Spec
from ludus.spec.batch import ActionBatch, Batch, Batches, StepTimes
from ludus.spec.batch_rows import (
    actions_reader,
    clear_outcome,
    stacked,
    write_finals,
    write_state,
)
from ludus.spec.finite import check_finite
from ludus.spec.gymnasium_spec import read_action, read_observation
from ludus.wire.requests import MetricSummary
from ludus.wire.reset import ResetAction, ResetRequest

__all__ = ["GymEnv", "GymnasiumSession", "make_environment"]

POLICY = "agent"

GymEnv = gymnasium.Env[Any, Any]


def make_environment(
    env_id: str, max_episode_steps: int | None = None, render_mode: str | None = None
) -> GymEnv:
    """Make one environment.

    Args:
        env_id: ``ID``, or ``MODULE:ID``, which imports a module first.
        max_episode_steps: Steps until truncation; None: what the environment says.
        render_mode: How it renders; None: not at all.

    Raises:
        TargetError: There is no such environment, or it has no such render mode.
    """
    look_in_current_folder(env_id.rpartition(":")[0])
    settings = {} if render_mode is None else {"render_mode": render_mode}
    try:
        return gymnasium.make(
            env_id, max_episode_steps=max_episode_steps, disable_env_checker=True, **settings
        )
    except (gymnasium.error.Error, ImportError) as error:
        raise TargetError(
            f"Gymnasium cannot make {env_id!r}: {error}",
            "gymnasium.pprint_registry() lists what it knows; MODULE:ENV_ID imports a module "
            "that is installed or lies in the current folder",
        ) from None


class GymnasiumSession:
    """Equal environments, one for each world, with same-step autoreset.

    Observations may be boxes or dictionaries of boxes, actions discrete, multi-discrete,
    multi-binary or bounded boxes. An ``action_mask`` in the info of a reset counts as the policy's
    mask. The parameters of a reset reach the environments as ``options``. What an environment
    raises is passed on; an environment is never made again. What it returns that does not fit its
    spaces, or is NaN or infinite, is a ``GameError``.

    Args:
        envs: One for each world; closed with the session.
        name: For the spec.

    Raises:
        TargetError: A space cannot be trained.
    """

    def __init__(self, envs: Sequence[GymEnv], name: str = "") -> None:
        self._envs = envs
        self._spec = _read_spec(envs, name)
        (policy,) = self._spec.policies
        self._policies = {POLICY: policy}
        self._to_actions = actions_reader(envs[0].action_space)
        self._batch = Batch.allocate(policy, len(envs))
        self._has_reset = False
        self._pending: ActionBatch | None = None
        self._held: NDArray[np.bool_] | None = None
        self._num_steps = 0

    @property
    def spec(self) -> Spec:
        """What the environments' spaces say."""
        return self._spec

    @property
    def pid(self) -> None:
        """None: environments run in this process."""

    @property
    def times(self) -> StepTimes:
        """Zeros: there is no engine."""
        return StepTimes(self._num_steps, 0, 0, 0)

    def reset(self, request: ResetRequest) -> Batches:
        """Begin new episodes; see :meth:`ludus.session.Session.reset`."""
        clear_outcome(self._batch)
        for row, env in enumerate(self._envs):
            action = ResetAction(int(request.actions[row]))
            if action is ResetAction.LEAVE:
                continue
            given = request.parameters
            options = given if given is None or isinstance(given, Mapping) else given[row]
            observation, info = env.reset(
                seed=int(request.seeds[row]) if action is ResetAction.SEED else None,
                options=dict(options) if options else None,
            )
            self._write(row, observation, info)
        self._batch.active[:] = True
        self._pending = None
        self._has_reset = True
        return self._checked()

    def send(self, actions: Mapping[str, ActionBatch]) -> None:
        """Keep the actions until :meth:`receive`.

        Raises:
            SequenceError: ``reset`` was never called, or the last answer was not received.
        """
        if not self._has_reset:
            raise SequenceError("step before the first reset", hint="call reset() first")
        if self._pending is not None:
            raise SequenceError("step during a step", hint="receive its answer first")
        self._pending = actions[POLICY]

    def receive(self) -> Batches:
        """Step the environments; returns views that the next answer overwrites.

        Raises:
            SequenceError: Nothing was sent.
        """
        actions, self._pending = self._pending, None
        held, self._held = self._held, None
        if actions is None:
            raise SequenceError("nothing to receive", hint="call send() first")
        batch = self._batch
        clear_outcome(batch)
        finals: dict[int, Any] = {}
        own = self._to_actions(actions.discrete, actions.continuous)
        for row, env in enumerate(self._envs):
            if held is not None and held[row]:
                continue
            observation, reward, terminated, truncated, info = env.step(own[row])
            batch.reward[row] = float(reward)
            if terminated or truncated:
                batch.terminated[row], batch.truncated[row] = terminated, truncated
                finals[row] = observation
                observation, info = env.reset()
            self._write(row, observation, info)
        if finals:
            write_finals(batch, list(finals), stacked(batch, list(finals.values())))
        self._num_steps += 1
        return self._checked()

    def _write(self, row: int, observation: Any, info: Mapping[str, Any]) -> None:
        try:
            write_state(self._batch, row, observation, info)
        except (ValueError, TypeError, KeyError) as error:
            raise GameError(
                f"{self._spec.scene}, world {row}: what the environment observes does not fit its "
                f"observation_space, or its action_mask: {error}",
                hint="compare what reset() and step() return with the spaces that it declares",
            ) from error

    def _checked(self) -> Batches:
        batches = {POLICY: self._batch}
        check_finite(self._policies, batches, self._num_steps)
        return batches

    def hold(self, worlds: NDArray[np.bool_]) -> bool:
        """Let some environments stand still in the next step; returns True."""
        self._held = worlds
        return True

    def render(self, world: int) -> Any:
        """Return what the environment of a world renders."""
        return self._envs[world].render()

    def call(self, target: Mapping[str, Any], method: str, arguments: Sequence[Any] = ()) -> Any:
        """Refuse: there is no game to call.

        Raises:
            GameError: Always.
        """
        raise GameError(f"call of {method} failed: a Gymnasium environment has no such methods")

    @property
    def has_requests(self) -> bool:
        """False: environments ask nothing of their trainer."""
        return False

    def take_requests(self) -> list[dict[str, Any]]:
        """Return nothing: environments ask nothing of their trainer."""
        return []

    def take_metrics(self) -> dict[str, MetricSummary]:
        """Return nothing: environments report no metrics."""
        return {}

    def show_status(self, status: Mapping[str, Any]) -> None:
        """Show nothing: environments do not watch their training."""

    def close(self) -> None:
        """Close all environments."""
        with contextlib.ExitStack() as stack:
            for env in self._envs:
                stack.callback(env.close)


def _read_spec(envs: Sequence[GymEnv], name: str) -> Spec:
    env = envs[0]
    _, info = env.reset(seed=0)
    policy = PolicySpec(
        name=POLICY,
        observation=read_observation(env.observation_space),
        action=read_action(env.action_space),
        agents=tuple(AgentSpec(world, "env") for world in range(len(envs))),
        has_action_mask="action_mask" in info,
        max_episode_steps=env.spec.max_episode_steps if env.spec else None,
    )
    return Spec(len(envs), "isolated", 1, 1.0, (policy,), name)
