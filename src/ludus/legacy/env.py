"""One legacy game with one agent as ``gymnasium.Env``."""

from __future__ import annotations

from typing import Any

import gymnasium

from ludus.errors import SequenceError
from ludus.legacy.game import LegacyGame

__all__ = ["LegacyEnv"]


class LegacyEnv(gymnasium.Env[Any, Any]):
    """Has exactly the spaces that the user has declared, and begins no episode by itself.

    So it wraps the game and not a session, as ``ludus.make`` does: a session has spaces of its
    own, and begins the next episode in the step that ends one, before a last frame can be saved.

    Args:
        game: Closed with the environment.
        render_mode: As Gymnasium means it.
    """

    def __init__(self, game: LegacyGame, render_mode: str | None = None) -> None:
        self.game = game
        self.action_space = game.declaration.action_space
        self.observation_space = game.declaration.observation_space
        self.render_mode = render_mode
        self._needs_reset = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Seeds ``np_random`` only; the game is not told.
            options: Parameters of the reset, where the bridge has some.

        Raises:
            UsageError: The bridge has no such option.
            EngineError: The game failed.
        """
        super().reset(seed=seed)
        self._needs_reset = True
        (observation,) = self.game.reset(seed, options)
        self._needs_reset = False
        return observation, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act once.

        Returns:
            Observation, reward, terminated, False (the wires know no truncation), info.

        Raises:
            SequenceError: The episode has ended, or never begun: call ``reset``.
            ActionError: The action does not fit ``action_space``.
            GameError: Observation or reward are not finite, or of another shape.
            EngineError: The game failed.
        """
        if self._needs_reset:
            raise SequenceError("step outside an episode", hint="call reset() first")
        self.game.send([action])
        (observation,), (reward,), (is_terminated,) = self.game.receive()[:3]
        self._needs_reset = is_terminated
        return observation, reward, is_terminated, False, {}

    def close(self) -> None:
        """End the game, if it is ours; may be called twice."""
        self.game.close()
