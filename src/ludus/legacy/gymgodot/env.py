"""A GymGodot game as ``gymnasium.Env``."""

from __future__ import annotations

from typing import Any

import gymnasium

from ludus.errors import SequenceError
from ludus.legacy.game import Declaration
from ludus.legacy.gymgodot.declared_game import DeclaredGame
from ludus.legacy.gymgodot.frames import Frames, check_saved
from ludus.legacy.gymgodot.game import Game

__all__ = ["GymGodotEnv"]


class GymGodotEnv(gymnasium.Env[Any, Any]):
    """One game, one agent.

    The game's seed is its own affair: the wire has none. Each call of ``render`` has the game save
    the current frame; with ``render_mode="rgb_array"`` it is returned, too.

    Args:
        game: Closed with the environment, as are the frames.
        frames: Where the game saves frames.
        declaration: What it takes and shows.
        render_mode: ``"rgb_array"`` or None.
    """

    def __init__(
        self,
        game: Game,
        frames: Frames,
        declaration: Declaration,
        render_mode: str | None = None,
    ) -> None:
        self.game = game
        self.frames = frames
        self.action_space = declaration.action_space
        self.observation_space = declaration.observation_space
        self.render_mode = render_mode
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": declaration.steps_per_second,
        }
        self._declared = DeclaredGame(game, declaration)
        self._needs_reset = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Seeds ``np_random`` only; the game is not told.
            options: The wire has none.

        Raises:
            UsageError: An option was given.
            EngineError: The game failed.
        """
        super().reset(seed=seed)
        self._needs_reset = True
        (observation,) = self._declared.reset(seed, options)
        self.frames.restart()
        self._needs_reset = False
        return observation, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act once.

        Returns:
            Observation, reward, terminated, False (the wire knows no truncation), info.

        Raises:
            SequenceError: The episode has ended, or never begun: call ``reset``.
            ActionError: The action does not fit ``action_space``.
            EngineError: The game failed.
        """
        if self._needs_reset:
            raise SequenceError("step outside an episode", hint="call reset() first")
        self._declared.send([action])
        outcome = self._declared.receive()
        self._needs_reset = outcome.terminated[0]
        return outcome.observations[0], outcome.rewards[0], outcome.terminated[0], False, {}

    def render(self) -> Any:
        """Have the game save the current frame as the next numbered PNG.

        Returns:
            ``uint8[height, width, 3]`` with ``render_mode="rgb_array"``, else None.

        Raises:
            GameError: The game could not save it.
            EngineError: The game failed.
        """
        file = self.frames.next_file()
        check_saved(self.game.render(), file)
        return self.frames.read(file) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Ask the game to quit, and end what is still there; may be called twice."""
        self.game.close()
        self.frames.close()
