"""What is said: Python asks, the game answers. No input or output happens here.

============================================  ===================================================
request                                       answer
============================================  ===================================================
``{"type": "handshake", …}``                  none
``{"type": "env_info"}``                      :class:`EnvInfo`
``{"type": "reset"}``                         ``{"type": "reset", "obs": […], …}``
``{"type": "action", "action": [{…}]}``       ``{"type": "step", "obs", "reward", "done", …}``
``{"type": "call", "method": "name"}``        ``{"type": "call", "returns": […]}``
``{"type": "close"}``                         none: the game quits
============================================  ===================================================

Lists have one element per agent.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from reprlib import repr as short
from typing import Any, cast

import numpy as np
import orjson

from ludus.errors import GameError, ProtocolError
from ludus.wire.godot_json import parse_godot_json
from ludus.wire.json_object import JsonObject

__all__ = [
    "CLOSE_REQUEST",
    "ENV_INFO_REQUEST",
    "HANDSHAKE",
    "RESET_REQUEST",
    "EnvInfo",
    "StepAnswer",
    "action_request",
    "call_request",
    "is_env_info",
    "read_call",
    "read_env_info",
    "read_reset",
    "read_step",
]

HANDSHAKE = b'{"type": "handshake", "major_version": "0", "minor_version": "7"}'
ENV_INFO_REQUEST = b'{"type": "env_info"}'
RESET_REQUEST = b'{"type": "reset"}'
CLOSE_REQUEST = b'{"type": "close"}'

_OLD_POLICY = "shared_policy"
"""Policy of every agent, if a plug-in is too old to name policies."""
_MAX_AGENTS = 1 << 16
_MAX_NAME = 64
_HINT = (
    "is what connected a game of Godot RL Agents? Plug-ins from 0.3 on are understood; games with "
    "Ludus's own add-on take no prefix"
)


@dataclass(frozen=True)
class EnvInfo:
    """What a game says of itself, one element per agent.

    Attributes:
        observations: By entry: ``size``, ``space`` and bounds, as the game sent them.
        actions: By component: ``size`` and ``action_type``, as the game sent them.
        policies: Names.
    """

    observations: Sequence[JsonObject]
    actions: Sequence[JsonObject]
    policies: Sequence[str]


@dataclass(frozen=True)
class StepAnswer:
    """What a step led to, one element per agent.

    Attributes:
        observations: By entry, as the game sent them.
        rewards: Finite.
        is_done: Whether an episode has ended; the game begins the next one by itself.
    """

    observations: Sequence[Mapping[str, Any]]
    rewards: Sequence[float]
    is_done: Sequence[bool]


def action_request(actions: Sequence[Mapping[str, Any]]) -> bytes:
    """Return the request for one step.

    Args:
        actions: Per agent and component an integer, or finite numbers as a list or an array.
    """
    return orjson.dumps({"type": "action", "action": actions}, default=np.ndarray.tolist)


def call_request(method: str) -> bytes:
    """Return the request to call a method of every controller."""
    return orjson.dumps({"type": "call", "method": method})


def is_env_info(message: bytes) -> bool:
    """Tell whether a message is an answer to ``env_info``, well-formed or not.

    Raises:
        ProtocolError: It is not even an object in JSON.
    """
    return _read(message).optional("type") == "env_info"


def read_env_info(message: bytes) -> EnvInfo:
    """Read what a game says of itself; older plug-ins say it once for all agents.

    Raises:
        ProtocolError: It is something else.
        GameError: It has no agents.
    """
    answer = _read_answer(message, "env_info")
    num = answer.integer("n_agents", 0, _MAX_AGENTS)
    if num == 0:
        raise GameError(
            "the game has no agents to train",
            hint="set control_mode of the Sync node, or of the AIControllers, to Training",
        )
    policies = [_OLD_POLICY] * num
    if answer.optional("agent_policy_names") is not None:
        policies = _names(answer, "agent_policy_names", num)
    observations = _spaces(answer, "observation_space", num)
    return EnvInfo(observations, _spaces(answer, "action_space", num), policies)


def read_reset(message: bytes, num_agents: int) -> Sequence[Mapping[str, Any]]:
    """Read the answer to a reset: observations. Errors as :func:`read_step`."""
    return _observations(_read_answer(message, "reset"), "obs", num_agents)


def read_step(message: bytes, num_agents: int) -> StepAnswer:
    """Read the answer to a step.

    Raises:
        ProtocolError: It is something else.
        GameError: A reward is not finite.
    """
    answer = _read_answer(message, "step")
    rewards = _list_of(answer, "reward", num_agents)
    if set(map(type, rewards)) != {float} or not all(map(math.isfinite, rewards)):
        rewards = [_reward(answer, index, value) for index, value in enumerate(rewards)]
    is_done = _list_of(answer, "done", num_agents)
    for index, value in enumerate(is_done):
        if not isinstance(value, bool):
            raise answer.unexpected(f"done[{index}]", "true or false", value)
    return StepAnswer(
        _observations(answer, "obs", num_agents),
        rewards,
        is_done,
    )


def read_call(message: bytes) -> list[Any]:
    """Read what a method returned, per controller in the game. Errors as :func:`read_step`."""
    return _read_answer(message, "call").items("returns")


def _reward(answer: JsonObject, index: int, value: Any) -> float:
    if isinstance(value, bool | int | float):
        try:
            reward = float(value)
        except OverflowError:
            reward = math.inf
    elif value is None:  # what Godot's JSON makes of NaN
        reward = math.nan
    else:
        raise answer.unexpected(f"reward[{index}]", "a number", value)
    if not math.isfinite(reward):
        raise GameError(
            f"the reward of agent {index} is {reward}", "look at get_reward() of the game"
        )
    return reward


def _names(answer: JsonObject, key: str, num_agents: int) -> list[str]:
    names = _list_of(answer, key, num_agents)
    for index, name in enumerate(names):
        if not isinstance(name, str):
            raise answer.unexpected(f"{key}[{index}]", "a text", name)
        answer.check_name(f"{key}[{index}]", name, _MAX_NAME)
    return names


def _spaces(answer: JsonObject, key: str, num_agents: int) -> list[JsonObject]:
    value = answer.get(key)
    if isinstance(value, dict):
        return [JsonObject(value, f"answer.{key}", _HINT)] * num_agents
    parts = _list_of(answer, key, num_agents)
    return [JsonObject(part, f"answer.{key}[{i}]", _HINT) for i, part in enumerate(parts)]


def _observations(answer: JsonObject, key: str, num_agents: int) -> list[Mapping[str, Any]]:
    parts = _list_of(answer, key, num_agents)
    for index, part in enumerate(parts):
        if not isinstance(part, dict):
            raise answer.unexpected(f"{key}[{index}]", "an object", part)
    return cast("list[Mapping[str, Any]]", parts)


def _list_of(answer: JsonObject, key: str, num_agents: int) -> list[Any]:
    items = answer.items(key)
    if len(items) != num_agents:
        text = f"expected one element for each of {num_agents} agents, got {len(items)}"
        raise answer.error(key, text)
    return items


def _read_answer(message: bytes, kind: str) -> JsonObject:
    answer = _read(message)
    if answer.text("type") != kind:
        raise answer.unexpected("type", repr(kind), answer.text("type"))
    return answer


def _read(message: bytes) -> JsonObject:
    try:
        return JsonObject(parse_godot_json(message), "answer", _HINT)
    except ValueError as error:
        text = f"the game sent something that is not JSON ({error}): {short(message)}"
        raise ProtocolError(text, _HINT) from error
