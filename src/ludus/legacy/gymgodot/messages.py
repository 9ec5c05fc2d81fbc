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
from typing import Any, cast

from ludus.errors import GameError, ProtocolError
from ludus.wire.godot_json import parse_godot_json

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
_NUM_SHOWN = 80


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
    answer = _object(message)
    reward = _field(answer, "reward", message)
    if isinstance(reward, bool) or not isinstance(reward, int | float):
        raise ProtocolError(f"the reward must be a number, this came: {_shown(reward)}", _HINT)
    is_done = _field(answer, "done", message)
    if not isinstance(is_done, bool):
        raise ProtocolError(f"done must be true or false, this came: {_shown(is_done)}", _HINT)
    return StepAnswer(_field(answer, "observation", message), _finite(reward), is_done)


def read_reset(message: bytes) -> Any:
    """Read the answer to a reset: the first observation. Errors as :func:`read_step`."""
    return _field(_object(message), "init_observation", message)


def read_render(message: bytes) -> int:
    """Read the answer to a render: Godot's error code, 0 if all is well.

    Raises:
        ProtocolError: It is something else.
    """
    code = _field(_object(message), "render_error", message)
    # More digits than an error code can have would make `int` slow, or refuse.
    if not isinstance(code, str) or len(code) > 6 or not (code.isascii() and code.isdigit()):
        raise ProtocolError(f"render_error must be a code such as '0', not {_shown(code)}", _HINT)
    return int(code)


def _object(message: bytes) -> dict[str, Any]:
    try:
        answer: Any = parse_godot_json(message)
    except ValueError as error:
        raise ProtocolError(
            f"the game sent something that is not JSON ({error}): {_shown(message)}", _HINT
        ) from error
    if not isinstance(answer, dict):
        raise ProtocolError(f"the game must send a JSON object, not {_shown(answer)}", _HINT)
    return cast(dict[str, Any], answer)


def _field(answer: dict[str, Any], name: str, message: bytes) -> Any:
    if name not in answer:
        raise ProtocolError(
            f"expected an answer with {name!r}, this came: {_shown(message)}", _HINT
        )
    return answer[name]


def _finite(reward: float) -> float:
    try:
        value = float(reward)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise GameError(f"the reward is {value}", "look at get_reward() of the game")
    return value


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _NUM_SHOWN else f"{text[:_NUM_SHOWN]}…"
