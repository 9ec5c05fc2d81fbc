"""A game for godot_gym_api together with what its user has declared: spaces, reward, end."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from gymnasium import spaces

from ludus.errors import GameError, UsageError
from ludus.legacy.game import Declaration, Outcome
from ludus.legacy.godot_gym_api.client import GodotClient
from ludus.legacy.godot_gym_api.data import Data
from ludus.legacy.godot_gym_api.messages import AGENT_KEY, ENVIRONMENT_KEY, WORLD_KEY, State
from ludus.legacy.gymgodot.spaces import to_action_list, to_observation

__all__ = ["DeclaredGame", "Functions", "observation_by_names"]

_PARTS = (AGENT_KEY, WORLD_KEY, ENVIRONMENT_KEY)


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


class DeclaredGame:
    """A :class:`~ludus.legacy.game.LegacyGame` with one agent.

    The game's seed is its own affair: the wire has none. Parameters of a reset configure the game.

    Args:
        client: Closed with this object, and if the game sends what does not fit.
        declaration: What the user says of the game.
        functions: Observation, reward, end.
        requested_observation: Whose data the game shall send.
    """

    def __init__(
        self,
        client: GodotClient,
        declaration: Declaration,
        functions: Functions,
        requested_observation: Mapping[str, Any],
    ) -> None:
        self._client = client
        self._declaration = declaration
        self._functions = functions
        self._requested_observation = requested_observation

    @property
    def declaration(self) -> Declaration:
        """What the user says of it."""
        return self._declaration

    @property
    def methods(self) -> Mapping[str, Callable[..., Any]]:
        """``configure``, ``set_repeat_action`` and ``set_time_speed`` of :class:`GodotClient`."""
        client = self._client
        return {
            "configure": client.configure,
            "set_repeat_action": client.set_repeat_action,
            "set_time_speed": client.set_time_speed,
        }

    def reset(self, seed: int | None, parameters: Mapping[str, Any] | None) -> Sequence[Any]:
        """Begin an episode.

        Args:
            seed: Without effect.
            parameters: ``agent``, ``world`` and ``environment``: what to configure before.

        Raises:
            UsageError: There is another parameter.
            GameError: The observation does not fit the space.
            EngineError: The game failed.
        """
        if parameters:
            _check_parameters(parameters)
            self._client.configure(parameters)
        return (self._observation(self._client.reset(self._requested_observation)),)

    def send(self, actions: Sequence[Any]) -> None:
        """Begin a step; errors as :meth:`LegacyGame.send`."""
        action = _plain_action(self._declaration.action_space, actions[0])
        self._client.begin_step(action, self._requested_observation)

    def receive(self) -> Outcome:
        """Wait for the end of the step.

        Raises:
            GameError: Observation or reward are not finite, or of another shape.
            EngineError: The game failed.
        """
        state = self._client.end_step()
        observation, reward = self._observation(state), self._reward(state)
        is_terminated = bool(self._functions.is_terminated(state))
        return Outcome((observation,), (reward,), (is_terminated,), (False,))

    def close(self) -> None:
        """End the conversation, and the game if we started it; may be called twice."""
        self._client.close()

    def _observation(self, state: State) -> Any:
        try:
            value = self._functions.get_observation(state)
            return _element(self._declaration.observation_space, value, "the observation")
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


def _check_parameters(parameters: Mapping[str, Any]) -> None:
    unknown = [key for key in parameters if key not in _PARTS]
    if unknown:
        raise UsageError(
            f"unknown reset option {', '.join(map(repr, unknown))}",
            hint=f"there are {', '.join(_PARTS)}; they configure the game",
        )
