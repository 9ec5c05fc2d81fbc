"""Pictures of worlds, drawn when they are asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.errors import LudusError, SetupError
from ludus.pool import EnginePool
from ludus.session.gymnasium_session import GymnasiumSession

__all__ = ["RENDER_MODES", "Renderer"]

RENDER_MODES = ("human", "rgb_array")


class Renderer:
    """Draws the worlds of a pool.

    Args:
        pool: The game.
        mode: One of :data:`RENDER_MODES`, or None.
        obstacle: Why the game was started without a renderer although pictures were asked for.
    """

    def __init__(
        self, pool: EnginePool, mode: str | None, obstacle: LudusError | None = None
    ) -> None:
        self.mode = mode
        self._pool = pool
        self._obstacle = obstacle

    def picture(self, world: int) -> NDArray[np.uint8]:
        """Return what a world looks like now, ``uint8[height, width, 3]``.

        Raises:
            SetupError: Nothing here can draw; the text says what is missing.
            TargetError: The game gives no pictures.
        """
        if self._obstacle is not None:
            raise SetupError(
                f"this machine cannot draw the game: {self._obstacle.message}", self._obstacle.hint
            )
        engine, local = divmod(world, self._pool.spec.num_worlds)
        session = self._pool.sessions[engine]
        if isinstance(session, GymnasiumSession):
            return np.asarray(session.render(local), np.uint8)
        from ludus.record.picture_film import take_picture

        return take_picture(self._pool, world)

    def metadata(self) -> dict[str, Any]:
        """Return the part of an environment's metadata that concerns rendering."""
        spec = self._pool.spec
        return {
            "render_modes": list(RENDER_MODES),
            "render_fps": spec.tick_rate / spec.ticks_per_step,
        }
