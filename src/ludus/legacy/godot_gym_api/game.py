"""A game for godot_gym_api with what its user declares: spaces, observation, reward, end."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from gymnasium import spaces

from ludus.errors import ConfigError, GameError
from ludus.legacy.game import Declaration, LegacyGame, Outcome, check_reset_parameters
from ludus.legacy.godot_gym_api.client import PARTS, GodotClient
from ludus.legacy.godot_gym_api.data import Data
from ludus.legacy.godot_gym_api.messages import AGENT_KEY, ENVIRONMENT_KEY, WORLD_KEY, State
from ludus.legacy.spaces import check_space, to_action_list, to_observation

__all__ = ["GodotGymApiGame", "Task"]


@dataclass(frozen=True, kw_only=True)
class Task:
    """What a user declares of a game whose wire has neither spaces, nor rewards, nor ends.

    A state is ``{"agent": data, "world": data}``.

    Attributes:
        action_space: What the game's ``set_action`` takes: ``Discrete`` (it gets a number),
            ``Box``, ``MultiDiscrete`` or ``MultiBinary`` (lists).
        observation_space: What ``get_observation`` returns: one of these, or a ``Dict`` of them.
        get_reward: Returns the reward of the step that led to a state.
        is_terminated: Returns whether the episode has ended in a state.
        get_observation: Returns the observation for a state. None: each entry of the ``Dict``
            is the field of that name, of agent or world.
        requested_observation: What the game is asked for, ``{"agent": […], "world": […]}``.
        configuration: ``{"agent": {…}, "world": {…}, "environment": {"repeat_action": 4}}``, told
            once at the beginning.
    """

    action_space: Any
    observation_space: Any
    get_reward: Callable[[State], float]
    is_terminated: Callable[[State], bool]
    get_observation: Callable[[State], Any] | None = None
    requested_observation: Mapping[str, Any] | None = None
    configuration: Mapping[str, Any] | None = None

    def check(self) -> None:
        """Check what the user has declared.

        Raises:
            ConfigError: A function is missing, or the wire cannot carry a space.
        """
        check_space("action_space", self.action_space)
        is_named = isinstance(self.observation_space, spaces.Dict)
        if is_named:
            for name, space in self.observation_space.spaces.items():
                check_space(f"observation_space[{name!r}]", space)
        else:
            check_space("observation_space", self.observation_space)
        if self.get_observation is None and not is_named:
            raise ConfigError(
                "get_observation is missing",
                hint="give it, or an observation_space that is a Dict with the names of the data",
            )
        for name in ("get_reward", "is_terminated"):
            if not callable(getattr(self, name)):
                raise ConfigError(
                    f"{name} is missing",
                    hint="the wire has no reward and no end: write functions of the state, "
                    '{"agent": data, "world": data}',
                )

    @property
    def repeat_action(self) -> float:
        """How many physics frames a step lasts, for all we know; at least 1."""
        environment = (self.configuration or {}).get(ENVIRONMENT_KEY, {})
        frames = environment.get("repeat_action", GodotClient.DEFAULT_REPEAT_ACTION)
        return max(1.0, float(frames)) if isinstance(frames, int | float) else 1.0


class GodotGymApiGame(LegacyGame):
    """A game with one agent. Parameters of a reset configure it.

    Args:
        name: For messages.
        client: Closed with this object, and if the game sends what does not fit.
        task: What the user declares.
        frames_per_second: Frames in one second of game time.

    Raises:
        ConfigError: The configuration has an unknown part.
        EngineError: The game failed.
    """

    def __init__(
        self, name: str, client: GodotClient, task: Task, frames_per_second: int = 60
    ) -> None:
        declaration = Declaration(
            name=name,
            observation_space=task.observation_space,
            action_space=task.action_space,
            steps_per_second=frames_per_second / task.repeat_action,
        )
        super().__init__(declaration)
        self.methods = {
            "configure": client.configure,
            "set_repeat_action": client.set_repeat_action,
            "set_time_speed": client.set_time_speed,
        }
        self._client = client
        self.pid = client.pid
        self._task = task
        self._requested = task.requested_observation or {AGENT_KEY: [], WORLD_KEY: []}
        if task.configuration:
            try:
                client.configure(task.configuration)
            except BaseException:
                client.close()
                raise

    def reset(self, seed: int | None, parameters: Mapping[str, Any] | None) -> Sequence[Any]:
        """Begin an episode; see :meth:`LegacyGame.reset`."""
        check_reset_parameters(
            parameters, PARTS, f"there are {', '.join(PARTS)}; they configure the game"
        )
        if parameters:
            self._client.configure(parameters)
        return self._read(self._client.reset(self._requested), self._observation)

    def send(self, actions: Sequence[Any]) -> None:
        """Begin a step; see :meth:`LegacyGame.send`."""
        space = self.declaration.action_space
        action = to_action_list(space, actions[0])
        plain = action[0] if isinstance(space, spaces.Discrete) else action
        self._client.begin_step(plain, self._requested)

    def receive(self) -> Outcome:
        """Wait for the end of the step; see :meth:`LegacyGame.receive`."""
        return self._read(self._client.end_step(), self._outcome)

    def close(self) -> None:
        """End the conversation, and the game if we started it; may be called twice."""
        self._client.close()

    def _read(self, state: State, read: Callable[[State], Any]) -> Any:
        try:
            return read(state)
        except GameError:
            self.close()
            raise

    def _outcome(self, state: State) -> Outcome:
        observations = self._observation(state)
        reward = float(self._task.get_reward(state))
        if not math.isfinite(reward):
            raise GameError(
                f"the reward is {reward}", hint="look at get_reward and at what the game sent"
            )
        is_terminated = bool(self._task.is_terminated(state))
        return Outcome(observations, (reward,), (is_terminated,), (False,))

    def _observation(self, state: State) -> Sequence[Any]:
        space = self.declaration.observation_space
        if self._task.get_observation is None:
            value: Any = {name: _field(state, name) for name in cast("spaces.Dict", space).spaces}
        else:
            value = self._task.get_observation(state)
        return (_element(space, value, "the observation"),)


def _field(state: State, name: str) -> Any:
    """Return the data of a name; the agent's comes before the world's."""
    for part in state.values():
        if isinstance(part, Data):  # where a field may be called `items`
            if name in part:
                return part[name]
        elif hasattr(part, name):
            return getattr(part, name)
    raise GameError(
        f"neither agent nor world sent a field called {name!r}",
        hint="name the entries of observation_space as the game's data, or give get_observation",
    )


def _element(space: spaces.Space[Any], value: Any, name: str) -> Any:
    if isinstance(space, spaces.Dict):
        entries = cast("dict[str, spaces.Space[Any]]", cast(Any, space).spaces)
        return {
            key: _element(entry, _entry(value, key, name), f"{name}[{key!r}]")
            for key, entry in entries.items()
        }
    if isinstance(value, bytes):
        numbers = np.frombuffer(value, np.uint8)
        shape = space.shape or ()
        value = numbers.reshape(shape) if math.prod(shape) == numbers.size else numbers
    return to_observation(space, value, name)


def _entry(value: Any, key: str, name: str) -> Any:
    try:
        return value[key]
    except (KeyError, TypeError, IndexError) as error:
        raise GameError(f"{name} has no entry {key!r}") from error
