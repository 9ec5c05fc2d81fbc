"""``GodotEnvironment``, the base class that programs for godot_gym_api extend."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium

from ludus.legacy.godot_gym_api.client import GodotClient
from ludus.legacy.godot_gym_api.messages import State

__all__ = ["GodotEnvironment"]


class GodotEnvironment(gymnasium.Env[Any, Any]):
    """Connects with a game; a subclass sets the spaces and writes ``reset`` and ``step``.

    A subclass may set ``_requested_observation``; all data of agent and world is asked for
    otherwise. Arguments, and what may be raised, are those of :class:`GodotClient`.

    Args:
        protobuf_message_module: The compiled messages; None if the game answers in JSON.
        engine_address: Host and port at which the game listens.
        engine_chunk_size: Without effect, for old programs.
        settings: Further fields of
            :class:`~ludus.legacy.godot_gym_api.connecting.ConnectionSettings`.
    """

    WORLD_KEY = GodotClient.WORLD_KEY
    AGENT_KEY = GodotClient.AGENT_KEY
    ENVIRONMENT_KEY = GodotClient.ENVIRONMENT_KEY

    _requested_observation: Mapping[str, Any]

    def __init__(
        self,
        protobuf_message_module: Any = None,
        engine_address: tuple[str, int] = ("127.0.0.1", 9090),
        engine_chunk_size: int = 65536,
        **settings: Any,
    ) -> None:
        super().__init__()
        self._godot_client = GodotClient(
            protobuf_message_module, engine_address, engine_chunk_size, **settings
        )
        if not hasattr(self, "_requested_observation"):
            self._requested_observation = {self.AGENT_KEY: [], self.WORLD_KEY: []}

    def close(self) -> None:
        """End the conversation, and the game if we started it; may be called twice."""
        self._godot_client.close()

    def _godot_step(self, action: Any) -> State:
        """Act once; returns ``{"agent": data, "world": data}``."""
        return self._godot_client.step(action, self._requested_observation)

    def _godot_reset(self) -> State:
        """Begin an episode; returns ``{"agent": data, "world": data}``."""
        return self._godot_client.reset(self._requested_observation)

    def _godot_configure(self, config: Mapping[str, Any]) -> None:
        """Configure agent, world and environment."""
        self._godot_client.configure(config)

    def _godot_set_time_speed(self, time_speed: float) -> None:
        """Let game time pass ``time_speed`` times as fast."""
        self._godot_client.set_time_speed(time_speed)

    def _godot_set_repeat_action(self, n_repeats: int) -> None:
        """Let a step last ``n_repeats`` physics frames."""
        self._godot_client.set_repeat_action(n_repeats)
