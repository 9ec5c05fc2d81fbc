"""A GymGodot game with the methods of gym 0.21, for programs that cannot change."""

from __future__ import annotations

from typing import Any

import numpy as np

from ludus.legacy.gymgodot.env import GymGodotEnv

__all__ = ["Gym021Env"]


class Gym021Env(GymGodotEnv):
    """Returns what GymGodot's own environment returned.

    As there, observations are ``float32``, and ``step`` may come before the first ``reset`` and
    after the end of an episode. What expects five values of ``step``, such as the wrappers of
    Gymnasium and Stable-Baselines3 2, cannot take it.
    """

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begin an episode, and return the first observation alone, ``float32``."""
        observation, _ = super().reset(seed=seed, options=options)
        return np.asarray(observation, np.float32)

    def step(self, action: Any) -> Any:
        """Act once; return observation, reward, whether the episode has ended, and ``{}``."""
        self._needs_reset = False
        observation, reward, terminated, _, info = super().step(action)
        return np.asarray(observation, np.float32), reward, terminated, info

    def render(self, mode: str = "") -> Any:
        """Have the game save a frame, as :meth:`GymGodotEnv.render`; ``mode`` has no effect."""
        return super().render()

    def seed(self, seed: int | None = None) -> None:
        """Do nothing, as there: the wire has no seed."""
