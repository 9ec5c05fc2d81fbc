"""A GymGodot game as ``gymnasium.Env``, which has the game save frames."""

from __future__ import annotations

from typing import Any

from ludus.legacy.env import LegacyEnv
from ludus.legacy.gymgodot.frames import Frames, check_saved
from ludus.legacy.gymgodot.game import GymGodotGame

__all__ = ["GymGodotEnv"]


class GymGodotEnv(LegacyEnv):
    """Each call of ``render`` has the game save a frame; with ``"rgb_array"`` it is returned, too.

    Args:
        game: Closed with the environment, as are the frames.
        frames: Where the game saves frames.
        render_mode: ``"rgb_array"`` or None.
    """

    game: GymGodotGame

    def __init__(self, game: GymGodotGame, frames: Frames, render_mode: str | None = None) -> None:
        super().__init__(game, render_mode)
        self.frames = frames
        rate = game.declaration.steps_per_second
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": rate}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; see :meth:`LegacyEnv.reset`."""
        first = super().reset(seed=seed, options=options)
        self.frames.restart()
        return first

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
