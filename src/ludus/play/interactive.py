"""Play a game for people to watch, or let a person play it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ludus.engine import EngineProcess, GodotFlags, LaunchConfig, resolve_target
from ludus.errors import EngineCrashed, SetupError
from ludus.play.command_line import play_command
from ludus.play.random_actions import RandomActions
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.session import LaunchOptions
from ludus.spec.batch import ActionBatch, Batch, Batches

__all__ = [
    "Act",
    "OnEpisode",
    "PlayConfig",
    "Player",
    "play_by_hand",
    "play_episodes",
    "random_player",
    "require_screen",
]

POLL_S = 0.2
SCRIPT_STEPS = 1000
CLOSED_BY_HAND = 0

Act = Callable[[int, Batches], Mapping[str, ActionBatch]]
"""From the number of the step and what all agents see to what they do."""
Player = Callable[[EnginePool, int], Act]
"""From a pool and a seed to the way to act in it."""
OnEpisode = Callable[[str, int, float, int], None]
"""Is told policy, number, return and length of every episode that ends."""


@dataclass(frozen=True, kw_only=True)
class PlayConfig:
    """What to play, and how it is shown.

    Attributes:
        target: As for :func:`ludus.make`.
        scene: Scene of the project; None: its main scene.
        seed: Seed of the world and of samples.
        is_headless: Open no window and play as fast as possible.
        num_episodes: Episodes of every policy; None: until the window is closed.
        ticks_per_step: Physics ticks per decision; None: what the agents say.
        max_episode_steps: Steps until truncation; None: what the agents say.
        godot: Engine to use; None: the one that is found.
    """

    target: str | Path
    scene: str | Path | None = None
    seed: int = 0
    is_headless: bool = False
    num_episodes: int | None = None
    ticks_per_step: int | None = None
    max_episode_steps: int | None = None
    godot: Path | None = None


def require_screen() -> None:
    """Make sure that a window can be opened where somebody sees it.

    Raises:
        SetupError: There is no screen.
    """
    has_screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform == "linux" and not has_screen:
        raise SetupError(
            "there is no screen to open a window on (neither DISPLAY nor WAYLAND_DISPLAY is set)",
            hint="use --headless to play without a window and print the returns",
        )


def random_player(pool: EnginePool, seed: int) -> Act:
    """Take random legal actions."""
    seeds = [seed + world for world in range(pool.spec.num_worlds)]
    return RandomActions(pool.spec, seeds, SCRIPT_STEPS).at


def play_episodes(config: PlayConfig, player: Player, on_episode: OnEpisode) -> None:
    """Play one world until enough episodes have ended or the window is closed.

    Args:
        config: What to play, and how it is shown.
        player: Decides what agents do.
        on_episode: Is told of every episode that ends.

    Raises:
        TargetError: The target cannot be run.
        EngineError: The engine failed.
    """
    launch = LaunchOptions(is_windowed=not config.is_headless, is_real_time=not config.is_headless)
    settings = PoolConfig(
        scene=config.scene,
        ticks_per_step=config.ticks_per_step,
        max_episode_steps=config.max_episode_steps,
        godot=config.godot,
        is_pinned=config.is_headless,
        launch=launch,
    )
    try:
        with open_pool(config.target, settings) as pool:
            _play(pool, config, player, on_episode)
    except EngineCrashed as error:
        if config.is_headless or error.process_exit_code != CLOSED_BY_HAND:
            raise


def play_by_hand(config: PlayConfig) -> None:
    """Start the game in a window with no trainer, and wait until it is closed.

    Raises:
        TargetError: The target cannot be started.
        EngineCrashed: The game failed.
    """
    target = resolve_target(config.target, scene=config.scene, godot=config.godot)
    command = play_command(target, GodotFlags(headless=False, fixed_fps=None))
    with EngineProcess.start(LaunchConfig(command=command)) as process:
        while (exit_code := process.wait(POLL_S)) is None:
            pass
        if exit_code != 0:
            raise EngineCrashed(f"the game failed: {process.describe_death()}")


def _play(pool: EnginePool, config: PlayConfig, player: Player, on_episode: OnEpisode) -> None:
    act = player(pool, config.seed)
    tally = _Tally(pool, on_episode)
    batches = pool.reset(config.seed)
    step = 0
    while config.num_episodes is None or tally.fewest < config.num_episodes:
        following = pool.step(act(step, batches))
        tally.record(batches, following)
        batches = following
        step += 1


class _Tally:
    """Returns and lengths of episodes, policy by policy."""

    def __init__(self, pool: EnginePool, on_episode: OnEpisode) -> None:
        self._on_episode = on_episode
        sizes = {name: pool.num_agents(name) for name in pool.policies}
        self._returns: dict[str, NDArray[np.float64]] = {n: np.zeros(s) for n, s in sizes.items()}
        self._lengths = {n: np.zeros(s, np.int64) for n, s in sizes.items()}
        self._num_episodes = dict.fromkeys(sizes, 0)

    @property
    def fewest(self) -> int:
        """Episodes of the policy that has finished fewest."""
        return min(self._num_episodes.values())

    def record(self, before: Batches, after: Batches) -> None:
        for name, batch in after.items():
            self._record(name, before[name].active, batch)

    def _record(self, name: str, acted: NDArray[np.bool_], batch: Batch) -> None:
        returns, lengths = self._returns[name], self._lengths[name]
        returns[acted] += batch.reward[acted]
        lengths[acted] += 1
        for slot in batch.final_index:
            self._num_episodes[name] += 1
            self._on_episode(
                name, self._num_episodes[name], float(returns[slot]), int(lengths[slot])
            )
            returns[slot] = lengths[slot] = 0
