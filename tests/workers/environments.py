"""The tiny environments of tests/training, for processes that import this module by name."""

from __future__ import annotations

from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import spaces

from tests.training.environments import Constant, register

WIDTH = 28_000


class Wide(Constant):
    """Shows as much in each step as a picture does."""

    def __init__(self) -> None:
        super().__init__(ends_after=5)
        self.observation_space = spaces.Box(0.0, 1.0, (WIDTH,), np.float32)

    def _observe(self) -> Any:
        return np.full(WIDTH, super()._observe()[0], np.float32)


register()
if "Wide-v0" not in gymnasium.registry:
    cast(Any, gymnasium).register("Wide-v0", Wide)
