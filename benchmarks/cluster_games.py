"""Games of `benchmarks/cluster.py`, for processes that import this module by name.

`Sleeping-v0` spends its time waiting, as a game does that plays elsewhere; `Wide-<n>-v0` observes n
floats and `Pixels-v0` a picture of 84 × 84, both at no cost.
"""

from __future__ import annotations

import os
import time
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import spaces

SLEEP_MS = "LUDUS_SLEEP_MS"
"""Environment variable: how long a step of `Sleeping-v0` waits."""

WIDTHS = (4, 64, 1024)
"""Numbers that `Wide-<n>-v0` observes."""

LENGTH = 100
"""Steps of an episode."""


class Wide(gymnasium.Env[Any, Any]):
    """Shows the same observation in every step."""

    def __init__(self, shape: tuple[int, ...] = (4,), dtype: type = np.float32) -> None:
        high = 255 if dtype == np.uint8 else 1.0
        self.observation_space = spaces.Box(0, high, shape, dtype)
        self.action_space = spaces.Discrete(4)
        self._observation = self.observation_space.sample()
        self._steps = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        self._steps = 0
        return self._observation, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Count."""
        self._steps += 1
        return self._observation, float(action == 0), self._steps >= LENGTH, False, {}


class Sleeping(Wide):
    """Waits in every step."""

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Wait."""
        time.sleep(float(os.environ[SLEEP_MS]) / 1000)
        return super().step(action)


register: Any = cast(Any, gymnasium).register
register("Sleeping-v0", Sleeping)
register("Pixels-v0", Wide, kwargs={"shape": (84, 84, 1), "dtype": np.uint8})
for width in WIDTHS:
    register(f"Wide-{width}-v0", Wide, kwargs={"shape": (width,)})
