"""One running GymGodot game with the spaces that its user has declared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ludus.errors import GameError
from ludus.legacy.conversation import Conversation
from ludus.legacy.game import Declaration, LegacyGame, Outcome, check_reset_parameters
from ludus.legacy.gymgodot.connecting import RENDERER_HINT
from ludus.legacy.gymgodot.messages import (
    CLOSE_REQUEST,
    RENDER_REQUEST,
    RESET_REQUEST,
    read_render,
    read_reset,
    read_step,
    step_request,
)
from ludus.legacy.spaces import to_action_list, to_observation

__all__ = ["GymGodotGame"]

_QUIT_S = 3.0


class GymGodotGame(LegacyGame):
    """A game with one agent. The wire has neither seeds nor parameters of a reset.

    Args:
        declaration: What the user says of it.
        conversation: With the game; closed with this object.
        port: At which it has connected.
    """

    def __init__(
        self, declaration: Declaration, conversation: Conversation[bytes], port: int
    ) -> None:
        super().__init__(declaration)
        self.port = port
        self._conversation = conversation
        self.pid = conversation.pid

    def reset(self, seed: int | None, parameters: Mapping[str, Any] | None) -> Sequence[Any]:
        """Begin an episode; see :meth:`LegacyGame.reset`."""
        hint = "GymGodot's reset takes nothing; Ludus's own add-on has parameters"
        check_reset_parameters(parameters, (), hint)
        self._conversation.note_errors()
        return (self._conversation.ask(RESET_REQUEST, self._read_reset),)

    def send(self, actions: Sequence[Any]) -> None:
        """Begin a step; see :meth:`LegacyGame.send`."""
        action = to_action_list(self.declaration.action_space, actions[0])
        self._conversation.send(step_request(action))

    def receive(self) -> Outcome:
        """Wait for the end of the step; see :meth:`LegacyGame.receive`."""
        return self._conversation.receive(self._read_step)

    def render(self) -> int:
        """Have the current frame saved; return Godot's error code.

        Raises:
            EngineError: The game failed.
        """
        try:
            return self._conversation.ask(RENDER_REQUEST, read_render)
        except GameError as error:
            raise GameError(error.message, RENDERER_HINT) from error

    def close(self) -> None:
        """Ask the game to quit, and end what is still there; may be called twice."""
        if self._conversation.is_open:
            self._conversation.say_goodbye(CLOSE_REQUEST, _QUIT_S)
        self._conversation.close()

    def _read_reset(self, message: bytes) -> Any:
        return self._observation(read_reset(message), "init_observation")

    def _read_step(self, message: bytes) -> Outcome:
        answer = read_step(message)
        observation = self._observation(answer.observation, "observation")
        return Outcome((observation,), (answer.reward,), (answer.is_done,), (False,))

    def _observation(self, value: Any, name: str) -> Any:
        return to_observation(self.declaration.observation_space, value, name)
