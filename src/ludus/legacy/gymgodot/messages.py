"""What is said: Python asks, the game answers. No input or output happens here.

=====================================  ==================================================
request                                answer
=====================================  ==================================================
``{"cmd": "reset"}``                   ``{"init_observation": […]}``
``{"cmd": "step", "action": […]}``     ``{"observation": […], "reward": 1.0, "done": false}``
``{"cmd": "render"}``                  ``{"render_error": "0"}``: Godot's error code as text
``{"cmd": "close"}``                   none: the game disconnects and quits
=====================================  ==================================================
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from reprlib import repr as short
from typing import Any

from ludus.errors import GameError, ProtocolError
from ludus.wire.godot_json import parse_godot_json
from ludus.wire.json_object import JsonObject

__all__ = [
    "CLOSE_REQUEST",
    "RENDER_REQUEST",
    "RESET_REQUEST",
    "StepAnswer",
    "read_render",
    "read_reset",
    "read_step",
    "step_request",
]

RESET_REQUEST = b'{"cmd": "reset"}'
RENDER_REQUEST = b'{"cmd": "render"}'
CLOSE_REQUEST = b'{"cmd": "close"}'

_HINT = "is what connected a GymGodot project? Ludus's own add-on is driven by ludus.make"


@dataclass(frozen=True)
class StepAnswer:
    """What a step led to.

    Attributes:
        observation: Lists of numbers, as the game sent them.
        reward: Finite.
        is_done: Whether the episode has ended.
    """

    observation: Any
    reward: float
    is_done: bool


def step_request(action: Any) -> bytes:
    """Return the request for one step; ``action`` is a list of numbers."""
    return json.dumps({"cmd": "step", "action": action}, allow_nan=False).encode()


def read_step(message: bytes) -> StepAnswer:
    """Read the answer to a step.

    Raises:
        ProtocolError: It is something else.
        GameError: The reward is not finite.
    """
    answer = _read(message)
    reward = answer.get("reward")
    if isinstance(reward, bool) or not isinstance(reward, int | float):
        raise answer.unexpected("reward", "a number", reward)
    return StepAnswer(answer.get("observation"), _finite(reward), answer.flag("done"))


def read_reset(message: bytes) -> Any:
    """Read the answer to a reset: the first observation. Errors as :func:`read_step`."""
    return _read(message).get("init_observation")


def read_render(message: bytes) -> int:
    """Read the answer to a render: Godot's error code, 0 if all is well.

    Raises:
        ProtocolError: It is something else.
    """
    answer = _read(message)
    code = answer.text("render_error")
    # More digits than an error code can have would make `int` slow, or refuse.
    if len(code) > 6 or not (code.isascii() and code.isdigit()):
        raise answer.unexpected("render_error", "a code such as '0'", code)
    return int(code)


def _read(message: bytes) -> JsonObject:
    try:
        return JsonObject(parse_godot_json(message), "answer", _HINT)
    except ValueError as error:
        text = f"the game sent something that is not JSON ({error}): {short(message)}"
        raise ProtocolError(text, _HINT) from error


def _finite(reward: float) -> float:
    try:
        value = float(reward)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise GameError(f"the reward is {value}", "look at get_reward() of the game")
    return value
