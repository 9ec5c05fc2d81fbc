"""``GodotClient``: what one can ask of a game."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ludus.errors import ConfigError
from ludus.legacy.godot_gym_api.connecting import ConnectionSettings, open_conversation
from ludus.legacy.godot_gym_api.messages import (
    ACTION_KEY,
    AGENT_KEY,
    CONFIG_KEY,
    ENVIRONMENT_KEY,
    OBSERVATION_KEY,
    RESET_KEY,
    WORLD_KEY,
    State,
    check_message_module,
    decode_answer,
    encode_request,
)

__all__ = ["PARTS", "GodotClient"]

PARTS = (AGENT_KEY, WORLD_KEY, ENVIRONMENT_KEY)
"""What can be configured."""


class GodotClient:
    """A connection with one game; closed by :meth:`close` or by leaving the ``with`` block.

    Every method waits for the game's answer, for ``step_timeout_s`` seconds at most, and raises an
    ``EngineError`` if there is none, or a wrong one.

    Args:
        protobuf_message_module: The module that ``protoc`` made of the project's messages; None if
            the game answers in JSON. Answers in JSON are understood in either case.
        engine_address: Host and port at which the game listens.
        chunk_size: Without effect, for old programs.
        settings: Further fields of :class:`ConnectionSettings`, such as ``target`` or
            ``step_timeout_s``.

    Raises:
        ConfigError: An argument cannot be used.
        EngineStartError: The game did not start, or never listened.
        EngineCrashed: It ended before we were connected.
    """

    CONFIG_KEY = CONFIG_KEY
    RESET_KEY = RESET_KEY
    ACTION_KEY = ACTION_KEY
    OBSERVATION_KEY = OBSERVATION_KEY
    WORLD_KEY = WORLD_KEY
    AGENT_KEY = AGENT_KEY
    ENVIRONMENT_KEY = ENVIRONMENT_KEY

    DEFAULT_TIME_SPEED = 1.0
    DEFAULT_REPEAT_ACTION = 4

    def __init__(
        self,
        protobuf_message_module: Any = None,
        engine_address: tuple[str, int] = ("127.0.0.1", 9090),
        chunk_size: int = 65536,
        **settings: Any,
    ) -> None:
        check_message_module(protobuf_message_module)
        self.protobuf_message_module = protobuf_message_module
        self.chunk_size = chunk_size
        connection = _read_settings(engine_address, settings)
        self._conversation, self._address = open_conversation(connection)
        self.pid = self._conversation.pid

    @property
    def engine_address(self) -> tuple[str, int]:
        """Host and port at which the game listens; never port 0."""
        return self._address

    def request(self, request: Mapping[str, Any]) -> State:
        """Send any request; see :mod:`ludus.legacy.godot_gym_api.messages`.

        Returns:
            ``{"agent": data, "world": data}``, empty where nothing was asked for. Data is a
            protobuf message or :class:`~ludus.legacy.godot_gym_api.Data`.

        Raises:
            ActionError: The request is not JSON.
            SequenceError: The game is closed.
            EngineError: The game failed.
        """
        return self._conversation.ask(encode_request(request), self._read)

    def reset(self, requested_observation: Mapping[str, Any]) -> State:
        """Begin an episode; errors as :meth:`request`.

        Args:
            requested_observation: ``{"agent": …, "world": …}``: whose data is wanted; the game
                says what the values mean.
        """
        self._conversation.note_errors()
        return self.request({RESET_KEY: 1, OBSERVATION_KEY: requested_observation})

    def step(self, action: Any, requested_observation: Mapping[str, Any]) -> State:
        """Let the game run for one step with an action, any JSON value. Otherwise as `reset`."""
        self.begin_step(action, requested_observation)
        return self.end_step()

    def begin_step(self, action: Any, requested_observation: Mapping[str, Any]) -> None:
        """Send what :meth:`step` sends, and return at once; errors as :meth:`request`."""
        request = {ACTION_KEY: action, OBSERVATION_KEY: requested_observation}
        self._conversation.send(encode_request(request))

    def end_step(self) -> State:
        """Wait for the answer to :meth:`begin_step`; errors as :meth:`request`."""
        return self._conversation.receive(self._read)

    def configure(
        self,
        config: Mapping[str, Any] | None = None,
        *,
        agent: Mapping[str, Any] | None = None,
        world: Mapping[str, Any] | None = None,
        environment: Mapping[str, Any] | None = None,
    ) -> None:
        """Configure the game, and wait until it has taken it; errors as :meth:`request`.

        Args:
            config: ``{"agent": {…}, "world": {…}, "environment": {…}}``.
            agent: What the game's agent shall take.
            world: What its world shall take.
            environment: ``repeat_action`` and ``time_speed``.

        Raises:
            ConfigError: ``config`` has another key.
        """
        given = {AGENT_KEY: agent, WORLD_KEY: world, ENVIRONMENT_KEY: environment}
        parts = {**(config or {}), **{key: part for key, part in given.items() if part is not None}}
        unknown = [key for key in parts if key not in PARTS]
        if unknown:
            raise ConfigError(
                f"unknown part {', '.join(map(repr, unknown))} of a configuration",
                hint=f"a game has {', '.join(PARTS)}",
            )
        self.request({CONFIG_KEY: parts})

    def set_time_speed(self, time_speed: float) -> None:
        """Let game time pass ``time_speed`` times as fast; errors as :meth:`configure`."""
        self.configure(environment={"time_speed": time_speed})

    def set_repeat_action(self, n_repeats: int) -> None:
        """Let a step last ``n_repeats`` physics frames; errors as :meth:`configure`."""
        self.configure(environment={"repeat_action": n_repeats})

    def close(self) -> None:
        """End the conversation, and the game if we started it; may be called twice."""
        self._conversation.close()

    def __enter__(self) -> GodotClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _read(self, answer: bytes) -> State:
        return decode_answer(answer, self.protobuf_message_module)


def _read_settings(engine_address: tuple[str, int], settings: dict[str, Any]) -> ConnectionSettings:
    known = ConnectionSettings.__dataclass_fields__
    unknown = settings.keys() - known.keys()
    if unknown:
        raise ConfigError(
            f"unknown argument {', '.join(sorted(unknown))}", hint=f"there are {', '.join(known)}"
        )
    return ConnectionSettings(engine_address=engine_address, **settings)
