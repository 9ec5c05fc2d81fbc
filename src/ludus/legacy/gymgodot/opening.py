"""Open GymGodot games for ``ludus.make("gymgodot:…")``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ludus.errors import ConfigError
from ludus.legacy.game import Declaration
from ludus.legacy.gymgodot.making import USUAL_STEP_LENGTH, check_host, check_packages
from ludus.legacy.gymgodot.spaces import check_space, max_message_bytes
from ludus.legacy.places import check_one_game, read_place
from ludus.legacy.registry import GameAddress

if TYPE_CHECKING:
    from ludus.legacy.gymgodot.declared_game import DeclaredGame

__all__ = ["open_game"]


def open_game(
    place: GameAddress,
    *,
    action_space: Any,
    observation_space: Any,
    exeCmd: str | None = None,  # noqa: N803 - the name that GymGodot's users write
    window_render: bool = False,
    env_fps: int = 60,
    allow_remote: bool = False,
    start_timeout_s: float = 60.0,
    step_timeout_s: float = 60.0,
) -> DeclaredGame:
    """Start a game, or wait until one has connected; the arguments of :func:`.making.make`.

    Args:
        place: A project or scene to start, or host and port at which Python waits for a game: one
            that ``exeCmd`` starts (port 0 takes a free one), or that somebody else starts.
        action_space: What the game takes.
        observation_space: What the game shows.
        exeCmd: What the shell runs to start the game.
        window_render: Whether the game draws while it steps.
        env_fps: Frames in one second of game time.
        allow_remote: Let a game on another machine connect.
        start_timeout_s: How long it may take until the game has connected, seconds.
        step_timeout_s: How long an answer may take, seconds.

    Raises:
        ConfigError: A setting cannot be used.
        TargetError: There is no such project.
        SetupError: A package is missing.
        EngineError: The game did not start, or never connected.
    """
    check_packages()
    check_space("action_space", action_space)
    check_space("observation_space", observation_space)
    found = read_place(place)
    from ludus.legacy.gymgodot.declared_game import DeclaredGame
    from ludus.legacy.gymgodot.game import Game, GameConfig

    target = found if isinstance(found, Path) else None
    host, port = ("127.0.0.1", 0) if isinstance(found, Path) else found
    check_host(host, allow_remote=allow_remote)
    _check_start(place, target, exeCmd, port)
    config = GameConfig(
        host=host,
        port=port,
        target=target,
        command=exeCmd,
        is_windowed=window_render,
        frames_per_second=env_fps,
        max_message_bytes=max_message_bytes(observation_space),
        start_timeout_s=start_timeout_s,
        step_timeout_s=step_timeout_s,
        log_path=place.log_path,
        cores=place.cores,
    )
    declaration = Declaration(
        name=f"gymgodot:{place.address}",
        observation_space=observation_space,
        action_space=action_space,
        steps_per_second=env_fps / USUAL_STEP_LENGTH,
    )
    return DeclaredGame(Game(config), declaration)


def _check_start(place: GameAddress, target: Path | None, command: str | None, port: int) -> None:
    if target is not None and command is not None:
        raise ConfigError(
            f"both {target} and exeCmd are given, which say how the game starts",
            hint="with exeCmd, name the address: gymgodot:127.0.0.1:0",
        )
    check_one_game(
        place,
        has_free_port=target is not None or (command is not None and port == 0),
        hint="name the project, gymgodot:PATH, or port 0 with exeCmd",
    )
