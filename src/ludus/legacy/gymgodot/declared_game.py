"""A GymGodot game together with the spaces that its user has declared."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ludus.errors import GameError, UsageError
from ludus.legacy.game import Declaration, Outcome
from ludus.legacy.gymgodot.game import Game
from ludus.legacy.gymgodot.spaces import to_action_list, to_observation

__all__ = ["DeclaredGame"]


class DeclaredGame:
    """A :class:`~ludus.legacy.game.LegacyGame` with one agent.

    The game's seed is its own affair: the wire has none.

    Args:
        game: Closed with this object, and if it sends what does not fit.
        declaration: What the user says of it.
    """

    methods: Mapping[str, Callable[..., Any]] = {}
    """None: the wire has no calls."""

    def __init__(self, game: Game, declaration: Declaration) -> None:
        self._game = game
        self._declaration = declaration

    @property
    def declaration(self) -> Declaration:
        """What the user says of it."""
        return self._declaration

    def reset(self, seed: int | None, parameters: Mapping[str, Any] | None) -> Sequence[Any]:
        """Begin an episode.

        Args:
            seed: Without effect.
            parameters: The wire has none.

        Raises:
            UsageError: There are parameters.
            GameError: The observation does not fit the space.
            EngineError: The game failed.
        """
        if parameters:
            raise UsageError(
                f"unknown reset option {', '.join(map(str, parameters))}",
                hint="GymGodot's reset takes nothing; Ludus's own add-on has parameters",
            )
        return (self._observation(self._game.reset(), "init_observation"),)

    def send(self, actions: Sequence[Any]) -> None:
        """Begin a step; errors as :meth:`LegacyGame.send`."""
        self._game.begin_step(to_action_list(self._declaration.action_space, actions[0]))

    def receive(self) -> Outcome:
        """Wait for the end of the step; errors as :meth:`LegacyGame.receive`."""
        answer = self._game.end_step()
        observation = self._observation(answer.observation, "observation")
        return Outcome((observation,), (answer.reward,), (answer.is_done,), (False,))

    def close(self) -> None:
        """Ask the game to quit, and end what is still there; may be called twice."""
        self._game.close()

    def _observation(self, value: Any, name: str) -> Any:
        try:
            return to_observation(self._declaration.observation_space, value, name)
        except GameError:
            self._game.close()
            raise
