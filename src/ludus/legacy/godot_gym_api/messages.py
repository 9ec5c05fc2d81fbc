"""What is said: Python asks, the game answers. No input or output happens here.

A request is a JSON object with any of these keys:

===============  =================================================================
``config``       ``{"agent": {…}, "world": {…}, "environment": {"repeat_action": 4,
                 "time_speed": 1.0}}``
``reset``        1
``action``       any JSON value, which the game's agent understands
``observation``  ``{"agent": …, "world": …}``: whose data is wanted, and which
===============  =================================================================

An answer is the project's own protobuf ``Message``, with ``agent_data`` and ``world_data``, or the
same as JSON, or nothing.

Some games answer a request without ``observation``, others do not; so every request has it here,
and gets exactly one answer.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from ludus.errors import ActionError, ConfigError, ProtocolError
from ludus.legacy.godot_gym_api.data import Data, to_fields
from ludus.wire.godot_json import parse_godot_json

__all__ = [
    "ACTION_KEY",
    "AGENT_KEY",
    "CONFIG_KEY",
    "ENVIRONMENT_KEY",
    "OBSERVATION_KEY",
    "RESET_KEY",
    "WORLD_KEY",
    "State",
    "check_message_module",
    "decode_answer",
    "encode_request",
]

CONFIG_KEY = "config"
RESET_KEY = "reset"
ACTION_KEY = "action"
OBSERVATION_KEY = "observation"
WORLD_KEY = "world"
AGENT_KEY = "agent"
ENVIRONMENT_KEY = "environment"

State = dict[str, Any]
"""``{"agent": data, "world": data}``; a protobuf message or :class:`Data` each."""

_FIELDS = {AGENT_KEY: "agent_data", WORLD_KEY: "world_data"}
_HINT = "is what answers there a game for godot_gym_api? Ludus's own add-on is driven by ludus.make"
_NUM_SHOWN = 60
_ENCODER = json.JSONEncoder(allow_nan=False)


def encode_request(request: Mapping[str, Any]) -> bytes:
    """Return the bytes of a request; it gets an empty ``observation`` if it has none.

    Raises:
        ActionError: It is not JSON: NaN, or an object that JSON does not know.
    """
    whole: dict[str, Any] = {OBSERVATION_KEY: {}, **request}
    try:
        return _ENCODER.encode(whole).encode()
    except (ValueError, TypeError, RecursionError) as error:
        raise ActionError(
            f"the request is not JSON: {error}",
            hint="use lists and Python's own numbers: array.tolist(), integer.item()",
        ) from error


def check_message_module(module: Any) -> None:
    """Check what the user gave as the compiled messages.

    Raises:
        ConfigError: It has no ``Message`` with ``agent_data`` and ``world_data``.
    """
    if module is None:
        return
    fields = getattr(getattr(module, "Message", None), "DESCRIPTOR", None)
    names: set[str] = set(getattr(fields, "fields_by_name", ()))
    if not names >= set(_FIELDS.values()):
        raise ConfigError(
            f"{module!r} has no protobuf Message with agent_data and world_data",
            hint="give the module that `protoc --python_out=. message.proto` writes: message_pb2",
        )


def decode_answer(payload: bytes, message_module: Any = None) -> State:
    """Read an answer; what was not asked for is empty.

    Args:
        payload: Its bytes. JSON is known by its first byte, which no ``Message`` has.
        message_module: The compiled messages of the project; None if answers are JSON.

    Raises:
        ProtocolError: It is something else.
    """
    if payload[:1] == b"{" or (message_module is None and not payload):
        return _read_json(payload or b"{}")
    if message_module is None:
        raise ProtocolError(
            f"the answer is not JSON: {_shown(payload)}",
            hint="if the project has protobuf messages, give the compiled module as "
            "protobuf_message_module",
        )
    return _read_protobuf(payload, message_module)


def _read_json(payload: bytes) -> State:
    try:
        answer: Any = to_fields(parse_godot_json(payload))
    except (ValueError, RecursionError) as error:
        raise ProtocolError(
            f"the game sent something that is not JSON ({error}): {_shown(payload)}", _HINT
        ) from error
    if not isinstance(answer, Data):  # `{"$bytes": …}` stands for bytes
        raise ProtocolError(f"the answer is no JSON object: {_shown(payload)}", _HINT)
    return {key: _part(answer, name, payload) for key, name in _FIELDS.items()}


def _part(answer: Data, name: str, payload: bytes) -> Data:
    part = answer.get(name, Data({}))
    if not isinstance(part, Data):
        raise ProtocolError(f"{name} must be a JSON object, this came: {_shown(payload)}", _HINT)
    return part


def _read_protobuf(payload: bytes, message_module: Any) -> State:
    message = message_module.Message()
    try:
        message.ParseFromString(payload)
    except Exception as error:  # a DecodeError; to import it costs 0.5 µs in every step
        raise ProtocolError(
            f"the answer is not such a protobuf message ({error}): {_shown(payload)}",
            hint="were the game's and Python's messages compiled from the same message.proto?",
        ) from error
    return {AGENT_KEY: message.agent_data, WORLD_KEY: message.world_data}


def _shown(payload: bytes) -> str:
    text = repr(payload[:_NUM_SHOWN])
    return text if len(payload) <= _NUM_SHOWN else f"{text}… ({len(payload)} bytes)"
