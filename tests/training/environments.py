"""Tiny Gymnasium environments with known answers."""

from __future__ import annotations

from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

Array = NDArray[Any]
LENGTH = 8


class Identity(gymnasium.Env[Any, Any]):
    """The observation is the action that pays; an episode is ``LENGTH`` steps."""

    def __init__(self, kind: str = "discrete") -> None:
        self.kind = kind
        self.observation_space = spaces.Box(-1.0, 4.0, (4,), np.float32)
        self.action_space: spaces.Space[Any] = spaces.Discrete(4)
        if kind == "multi_discrete":
            self.observation_space = spaces.Box(0.0, 1.0, (5,), np.float32)
            self.action_space = spaces.MultiDiscrete([2, 3])
        if kind == "continuous":
            self.observation_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
            self.action_space = spaces.Box(-2.0, 6.0, (2,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        self.steps = 0
        return self._draw(), {}

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        if self.kind == "continuous":
            middle, half = 2.0, 4.0
            reward = -float(np.mean(np.abs((np.asarray(action) - middle) / half - self.answer)))
        else:
            reward = float(np.equal(action, self.answer).mean())
        self.steps += 1
        return self._draw(), reward, self.steps >= LENGTH, False, {}

    def _draw(self) -> Array:
        if self.kind == "continuous":
            self.answer = self.np_random.uniform(-0.8, 0.8, 2)
            return self.answer.astype(np.float32)
        sizes = [2, 3] if self.kind == "multi_discrete" else [4]
        self.answer = np.asarray([self.np_random.integers(n) for n in sizes])
        one_hot = [np.eye(n)[i] for n, i in zip(sizes, self.answer, strict=True)]
        return np.concatenate(one_hot).astype(np.float32)


class Masked(Identity):
    """Identity where half of the wrong actions are forbidden, and never may be taken."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        observation, _ = super().reset(seed=seed)
        return observation, {"action_mask": self._mask()}

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        assert self.mask[action], "a forbidden action was taken"
        observation, reward, terminated, truncated, _ = super().step(action)
        return observation, reward, terminated, truncated, {"action_mask": self._mask()}

    def _mask(self) -> Array:
        self.mask = np.zeros(4, np.int8)
        self.mask[[int(self.answer[0]), (int(self.answer[0]) + 1) % 4]] = 1
        return self.mask


class Changing(gymnasium.Env[Any, Any]):
    """Pays an action unlike the last one: drawn ones earn half, the same one again nothing."""

    observation_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
    action_space = spaces.Discrete(2)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        self.steps, self.last = 0, None
        return np.zeros(1, np.float32), {}

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        is_other = self.last is not None and int(action) != self.last
        self.steps, self.last = self.steps + 1, int(action)
        return np.zeros(1, np.float32), float(is_other), self.steps >= LENGTH, False, {}


class Pictures(gymnasium.Env[Any, Any]):
    """Identity by pictures: the bright half tells the action; one step an episode."""

    def __init__(self) -> None:
        image = spaces.Box(0, 255, (12, 12, 1), np.uint8)
        number = spaces.Box(-np.inf, np.inf, (1,), np.float64)
        self.observation_space = spaces.Dict({"image": image, "number": number})
        self.action_space = spaces.Discrete(2, start=5)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        super().reset(seed=seed)
        self.answer = int(self.np_random.integers(2))
        image = np.zeros((12, 12, 1), np.uint8)
        image[:, 6 * self.answer : 6 * self.answer + 6] = 200
        return {"image": image, "number": self.np_random.normal(size=1)}, {}

    def step(self, action: Any) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        last = {"image": np.zeros((12, 12, 1), np.uint8), "number": np.zeros(1)}
        return last, float(action - 5 == self.answer), True, False, {}


class Constant(gymnasium.Env[Any, Any]):
    """Reward 1 in every step; the observation counts steps if episodes really end."""

    def __init__(self, ends_after: int | None = None) -> None:
        self.ends_after = ends_after
        self.observation_space = spaces.Box(0.0, 1.0, (1,), np.float32)
        self.action_space = spaces.Discrete(2)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        self.steps = 0
        return self._observe(), {}

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        self.steps += 1
        return self._observe(), 1.0, self.steps == self.ends_after, False, {}

    def _observe(self) -> Array:
        share = self.steps / self.ends_after if self.ends_after else 0.5
        return np.asarray([share], np.float32)


class Poisoned(Identity):
    """Rewards overflow after a while, so that a loss becomes infinite."""

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = super().step(action)
        self.total = getattr(self, "total", 0) + 1
        return observation, 1e30 if self.total > 40 else reward, terminated, truncated, info


class Lottery(gymnasium.Env[Any, Any]):
    """Half of the episodes last 1 step, half 9; the return is the length."""

    def __init__(self) -> None:
        self.observation_space = spaces.Box(0.0, 1.0, (1,), np.float32)
        self.action_space = spaces.Discrete(2)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        self.left = 1 if self.np_random.random() < 0.5 else 9
        return np.zeros(1, np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.left -= 1
        return np.zeros(1, np.float32), 1.0, self.left == 0, False, {}


class Recall(gymnasium.Env[Any, Any]):
    """The first observation shows one of four cues; only naming it in the last step pays."""

    def __init__(self) -> None:
        self.observation_space = spaces.Box(0.0, 1.0, (5,), np.float32)
        self.action_space = spaces.Discrete(4)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        self.answer = int(self.np_random.integers(4))
        self.left = int(self.np_random.integers(3, 7))
        return np.eye(5, dtype=np.float32)[self.answer], {}

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        self.left -= 1
        is_over = self.left == 0
        reward = float(is_over and action == self.answer)
        return np.asarray([0, 0, 0, 0, self.left == 1], np.float32), reward, is_over, False, {}


class Direction(gymnasium.Env[Any, Any]):
    """A point that moves up or down; naming which pays, and only two places together show it."""

    def __init__(self) -> None:
        self.observation_space = spaces.Box(-4.0, 4.0, (1,), np.float32)
        self.action_space = spaces.Discrete(2)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        self.place, self.steps = self.np_random.uniform(-1, 1), 0
        self._move()
        return np.asarray([self.place], np.float32), {}

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        # In the first step nothing shows it.
        reward = float(action == self.is_up) if self.steps else 0.0
        self.steps += 1
        self._move()
        return np.asarray([self.place], np.float32), reward, self.steps == 5, False, {}

    def _move(self) -> None:
        self.is_up = int(self.np_random.integers(2))
        self.place += 0.3 if self.is_up else -0.3


class Stairs(gymnasium.Env[Any, Any]):
    """Only the last of eight stairs pays; one action climbs each, others lead back to the floor."""

    HEIGHT = 8

    def __init__(self) -> None:
        self.observation_space = spaces.Box(0.0, 1.0, (self.HEIGHT,), np.float32)
        self.action_space = spaces.Discrete(4)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        self.height = 0
        return self._observe(), {}

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        self.height = self.height + 1 if action == self.height * 7 % 4 else 0
        is_up = self.height == self.HEIGHT
        return self._observe(), float(is_up), is_up, False, {}

    def _observe(self) -> Array:
        return np.eye(self.HEIGHT, dtype=np.float32)[self.height % self.HEIGHT]


def register() -> None:
    """Make the environments known to Gymnasium; a second call changes nothing."""
    if "Masked-v0" in gymnasium.registry:
        return
    add: Any = cast(Any, gymnasium).register
    for kind in ("discrete", "multi_discrete", "continuous"):
        add(f"Identity-{kind}-v0", Identity, kwargs={"kind": kind})
    add("Masked-v0", Masked)
    add("Changing-v0", Changing)
    add("Pictures-v0", Pictures)
    add("Poisoned-v0", Poisoned)
    add("Lottery-v0", Lottery)
    add("Recall-v0", Recall)
    add("Direction-v0", Direction)
    add("Stairs-v0", Stairs, max_episode_steps=30)
    add("Endless-v0", Constant)
    add("Truncated-v0", Constant, max_episode_steps=5)
    add("Terminated-v0", Constant, kwargs={"ends_after": 5})
