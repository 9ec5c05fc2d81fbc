"""A game for godot_gym_api as ``gymnasium.Env``, out of spaces and three functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import spaces

from ludus.dialects.godot_gym_api.data import Data
from ludus.dialects.godot_gym_api.environment import GodotEnvironment
from ludus.dialects.godot_gym_api.messages import State
from ludus.dialects.gymgodot.spaces import to_action_list, to_observation
from ludus.errors import GameError, SequenceError, UsageError

__all__ = ["Functions", "GodotGymApiEnv", "observation_by_names"]


@dataclass(frozen=True, kw_only=True)
class Functions:
    """What a state ``{"agent": data, "world": data}`` means.

    Attributes:
        get_observation: Returns an element of the observation space.
        get_reward: Returns the reward of the step that led to the state.
        is_terminated: Returns whether the episode has ended in it.
    """

    get_observation: Callable[[State], Any]
    get_reward: Callable[[State], float]
    is_terminated: Callable[[State], bool]


class GodotGymApiEnv(GodotEnvironment):
    """One game, one agent.

    The game's seed is its own affair: the wire has none. ``reset(options=…)`` configures the game
    before it begins the episode.

    Args:
        action_space: What the game takes.
        observation_space: What the functions make of its data.
        functions: Observation, reward, end.
        requested_observation: Whose data the game shall send; None: agent's and world's.
        settings: Arguments of :class:`GodotEnvironment`.
    """

    def __init__(
        self,
        action_space: gymnasium.Space[Any],
        observation_space: gymnasium.Space[Any],
        functions: Functions,
        requested_observation: Mapping[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        if requested_observation is not None:
            self._requested_observation = requested_observation
        super().__init__(**settings)
        self.action_space = action_space
        self.observation_space = observation_space
        self._functions = functions
        self._needs_reset = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Seeds ``np_random`` only; the game is not told.
            options: ``agent``, ``world`` and ``environment``: what to configure before.

        Raises:
            UsageError: There is another option.
            EngineError: The game failed.
        """
        super().reset(seed=seed)
        self._needs_reset = True
        if options:
            _check_options(options, (self.AGENT_KEY, self.WORLD_KEY, self.ENVIRONMENT_KEY))
            self._godot_configure(options)
        observation = self._observation(self._godot_reset())
        self._needs_reset = False
        return observation, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act once.

        Returns:
            Observation, reward, terminated, False (the wire knows no truncation), info.

        Raises:
            SequenceError: The episode has ended, or never begun: call ``reset``.
            ActionError: The action does not fit ``action_space``.
            GameError: Observation or reward are not finite, or of another shape.
            EngineError: The game failed.
        """
        if self._needs_reset:
            raise SequenceError("step outside an episode", hint="call reset() first")
        state = self._godot_step(_plain_action(self.action_space, action))
        observation = self._observation(state)
        reward = self._reward(state)
        self._needs_reset = bool(self._functions.is_terminated(state))
        return observation, reward, self._needs_reset, False, {}

    def configure(self, configuration: Mapping[str, Any]) -> None:
        """Configure the game: ``{"agent": {…}, "world": {…}, "environment": {…}}``.

        Raises:
            ConfigError: There is another part.
            EngineError: The game failed.
        """
        self._godot_configure(configuration)

    def _observation(self, state: State) -> Any:
        try:
            value = self._functions.get_observation(state)
            return _element(self.observation_space, value, "the observation")
        except GameError:
            self.close()
            raise

    def _reward(self, state: State) -> float:
        reward = float(self._functions.get_reward(state))
        if not math.isfinite(reward):
            self.close()
            raise GameError(
                f"the reward is {reward}", hint="look at get_reward and at what the game sent"
            )
        return reward


def observation_by_names(space: spaces.Dict) -> Callable[[State], Any]:
    """Return the function that takes each entry of a space from the data that has its name.

    The agent's data comes before the world's.
    """

    def get_observation(state: State) -> dict[str, Any]:
        return {name: _field(state, name) for name in space.spaces}

    return get_observation


def _field(state: State, name: str) -> Any:
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
        value = _unpacked(space, value)
    return to_observation(space, value, name)


def _entry(value: Any, key: str, name: str) -> Any:
    try:
        return value[key]
    except (KeyError, TypeError, IndexError) as error:
        raise GameError(f"{name} has no entry {key!r}") from error


def _unpacked(space: spaces.Space[Any], value: bytes) -> Any:
    """Return bytes as numbers, in the shape of the space where they are as many."""
    numbers = np.frombuffer(value, np.uint8)
    shape = space.shape or ()
    return numbers.reshape(shape) if math.prod(shape) == numbers.size else numbers


def _plain_action(space: spaces.Space[Any], action: Any) -> Any:
    numbers = to_action_list(space, action)
    return numbers[0] if isinstance(space, spaces.Discrete) else numbers


def _check_options(options: Mapping[str, Any], known: tuple[str, ...]) -> None:
    unknown = [key for key in options if key not in known]
    if unknown:
        raise UsageError(
            f"unknown reset option {', '.join(map(repr, unknown))}",
            hint=f"there are {', '.join(known)}; they configure the game",
        )
