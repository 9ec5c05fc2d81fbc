"""Film a Gymnasium environment that renders to arrays; GymGodot games are some."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from ludus.errors import ConfigError, SetupError, TargetError
from ludus.folder_imports import look_in_current_folder
from ludus.legacy.registry import make_bridge_env
from ludus.play.players import MakePlayer
from ludus.pool import EnginePool
from ludus.record.film import Frame
from ludus.record.shot import Shot
from ludus.session.gymnasium_session import GymEnv, GymnasiumSession
from ludus.target import Legacy

__all__ = ["env_rate", "film_gymnasium", "make_rendering", "make_rendering_game"]

RENDER_MODE = "rgb_array"


def make_rendering(env_id: str, max_episode_steps: int | None) -> GymEnv:
    """Make an environment whose frames can be filmed.

    Raises:
        TargetError: There is no such environment, or it does not render to arrays.
    """
    look_in_current_folder(env_id.rpartition(":")[0])
    try:
        return gymnasium.make(
            env_id,
            max_episode_steps=max_episode_steps,
            render_mode=RENDER_MODE,
            disable_env_checker=True,
        )
    except (gymnasium.error.Error, ImportError, TypeError, ValueError) as error:
        raise TargetError(
            f"Gymnasium cannot make {env_id!r} with render_mode={RENDER_MODE!r}: {error}",
            "MODULE:ENV_ID imports a module first; the environment must take a render_mode",
        ) from error


def make_rendering_game(
    target: Legacy, settings: Mapping[str, Any], max_episode_steps: int | None
) -> GymEnv:
    """Start a game of a legacy bridge whose frames can be filmed; on a screen.

    Raises:
        TargetError: The bridge has no pictures, or there is no such game.
        ConfigError: A setting of the bridge cannot be used.
        EngineError: The game did not start, or never connected.
    """
    env = make_bridge_env(target, settings)
    if max_episode_steps is None:
        return env
    return gymnasium.wrappers.TimeLimit(env, max_episode_steps)


def env_rate(env: GymEnv) -> Fraction:
    """Return the frames per second that an environment says it has.

    Raises:
        ConfigError: It does not say.
    """
    rate = env.metadata.get("render_fps")
    if not isinstance(rate, int | float) or rate <= 0:
        raise ConfigError(
            f"the environment's metadata must give render_fps, a number above 0, not {rate!r}",
            hint='set metadata["render_fps"] in its class',
        )
    return Fraction(rate).limit_denominator(1000)


def film_gymnasium(env: GymEnv, player: MakePlayer, shot: Shot) -> dict[str, int]:
    """Film an environment: the first state of every episode, and the state after each step.

    Args:
        env: As :func:`make_rendering` makes it; closed afterwards.
        player: From the pool to the way to act in it.
        shot: What is taken.

    Returns:
        How many episodes have ended.

    Raises:
        TargetError: It renders something other than pictures.
        SetupError: It lacks a package to draw with.
        RunError: The film could not be written.
    """
    frames = itertools.count()

    def shoot(frame: Any) -> None:
        if shot.takes(next(frames)):
            shot.film.add(_checked(frame))

    filmed = _Filmed(env, shoot)
    with EnginePool(lambda _: GymnasiumSession([filmed])) as pool:
        return shot.play(pool, player, lambda: shot.is_full)


def _checked(frame: Any) -> Frame:
    array: NDArray[Any] = np.asarray(frame)
    if array.dtype != np.uint8 or array.shape[2:] != (3,):
        raise TargetError(
            f"render() returned {type(frame).__name__}, expected uint8[height, width, 3]",
            hint='the environment must follow render_mode="rgb_array"',
        )
    return array


class _Filmed(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Hands the first state of every episode, and the state after each step, to ``shoot``."""

    def __init__(self, env: GymEnv, shoot: Callable[[Any], None]) -> None:
        super().__init__(env)
        self._shoot = shoot
        self._is_first = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        # The pool begins an episode that may never be played: film it when a step follows.
        self._is_first = True
        return super().reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        if self._is_first:
            self._is_first = False
            self._shoot(self.render())
        result = super().step(action)
        self._shoot(self.render())
        return result

    def render(self) -> Any:
        try:
            return super().render()
        except gymnasium.error.DependencyNotInstalled as error:
            raise SetupError(f"the environment cannot draw: {error}") from error
