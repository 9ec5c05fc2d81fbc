"""Play a game for people to watch, or let a person play it."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

from ludus.engine import EngineProcess, GodotFlags, LaunchConfig
from ludus.errors import EngineCrashed, SetupError
from ludus.play.command_line import play_command
from ludus.play.episodes import EpisodeCounter, OnEpisode
from ludus.play.players import MakePlayer
from ludus.play.playing import Play
from ludus.play.watched import WatchedPlayer
from ludus.pool import PoolConfig, open_pool
from ludus.session import LaunchOptions
from ludus.settings.checks import AT_LEAST_1, ONLY_1, optional, setting
from ludus.settings.pool_config import GameConfig
from ludus.target import check_accepted, parse_target

__all__ = [
    "CLOSED_BY_HAND",
    "CONTROLS",
    "PlayConfig",
    "play_by_hand",
    "play_episodes",
    "require_screen",
]

POLL_S = 0.2
CLOSED_BY_HAND = 0
"""Exit code of a game whose window was closed."""
LONGEST_PAUSE_S = 7 * 24 * 3600.0
CONTROLS = ("--ludus-controls",)
"""Gives a game keys for pause, single steps and slow motion."""


@dataclass(frozen=True, kw_only=True)
class PlayConfig(GameConfig):
    """What to play, and how it is shown.

    Attributes:
        target: What docs/targets.md lists for ``play``.
        seed: Seed of worlds and samples.
        is_headless: Open no window, play as fast as possible and print the returns.
        num_episodes: Episodes of every policy; None: until the window is closed.
    """

    target: str | Path
    num_engines: int = setting(1, ONLY_1)
    seed: int = 0
    is_headless: bool = False
    num_episodes: int | None = setting(None, optional(AT_LEAST_1))


def require_screen() -> None:
    """Make sure that a window can be opened where somebody sees it.

    Raises:
        SetupError: There is no screen.
    """
    has_screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform == "linux" and not has_screen:
        raise SetupError(
            "there is no screen to open a window on (neither DISPLAY nor WAYLAND_DISPLAY is set)",
            hint="use --headless to play without a window and print the returns, "
            "or a virtual screen: xvfb-run -a ludus play …",
        )


def play_episodes(config: PlayConfig, player: MakePlayer, on_episode: OnEpisode) -> None:
    """Play one world until enough episodes have ended or the window is closed.

    Args:
        config: What to play, and how it is shown.
        player: Decides what agents do.
        on_episode: Gets every episode that ends, ``num_episodes`` of each policy at most.

    Raises:
        TargetError: The target cannot be run.
        EngineError: The engine failed.
    """
    target = parse_target(config.target, scene=config.scene, godot=config.godot)
    check_accepted("play", target)
    launch = LaunchOptions()
    if not config.is_headless:
        launch = LaunchOptions(
            is_windowed=True, is_real_time=True, has_controls=True, step_timeout_s=LONGEST_PAUSE_S
        )
    settings = PoolConfig.of(
        config, is_pinned=config.is_pinned and config.is_headless, launch=launch
    )
    try:
        with open_pool(target, settings) as pool:
            counter = EpisodeCounter(pool.policies, config.num_episodes, on_episode)
            Play(pool, WatchedPlayer(pool, player(pool)), config.seed).run(counter)
    except EngineCrashed as error:
        if config.is_headless or error.process_exit_code != CLOSED_BY_HAND:
            raise


def play_by_hand(config: PlayConfig) -> None:
    """Start the game in a window with no trainer, and wait until it is closed.

    Raises:
        TargetError: The target cannot be started.
        EngineCrashed: The game failed.
    """
    target = parse_target(config.target, scene=config.scene, godot=config.godot)
    check_accepted("play", target)
    command = play_command(target, GodotFlags(headless=False, fixed_fps=None, user_args=CONTROLS))
    with EngineProcess.start(LaunchConfig(command=command)) as process:
        while (exit_code := process.wait(POLL_S)) is None:
            pass
        if exit_code != CLOSED_BY_HAND:
            raise EngineCrashed(f"the game failed: {process.describe_death()}")
