"""Open games for ``ludus.make("gdrl:…")``."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ludus.errors import ConfigError, TargetError
from ludus.legacy.addon_files import is_forwarding
from ludus.legacy.addresses import GameAddress, check_one_game, read_address
from ludus.legacy.gdrl.addon import forwarding_scripts
from ludus.legacy.gdrl.connecting import Waiting, open_conversation
from ludus.legacy.gdrl.declaring import group_agents
from ludus.legacy.gdrl.game import GdrlGame
from ludus.legacy.gdrl.time_limits import TimeLimits
from ludus.legacy.launching import GameLaunch
from ludus.link import is_loopback

__all__ = ["FRAMES_PER_SECOND", "Settings", "open_game"]

_LOG = logging.getLogger(__name__)
FRAMES_PER_SECOND = 60
"""Of game time: its `sync.gd` sets as many ticks, whatever the project says."""
_USUAL_ACTION_REPEAT = 8
"""Ticks of a step unless the scene says otherwise, which the wire does not tell."""
_ADDON = "addons"


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a user can set of a game of Godot RL Agents.

    Attributes:
        action_repeat: Physics ticks of a step; None: what the scene says.
        speedup: Physics ticks in one drawn frame, up to 8; with 1, ``_process`` and timers see
            exactly the time that passes.
        env_seed: Seed of the game's random numbers; each further game has one more.
        reset_after: ``reset_after`` of the game's AIControllers: ends by this limit are
            truncations then. Takes ``action_repeat``, too.
        show_window: Whether a game that we start opens a window, which cameras take.
        game_arguments: What the game finds in its command line besides, as ``--key=value``.
        command: What the shell runs to start the game; arguments are put at its end.
        start_timeout_s: How long it may take until the game has connected, seconds.
        step_timeout_s: How long an answer may take, seconds.
    """

    action_repeat: int | None = None
    speedup: int = 1
    env_seed: int = 0
    reset_after: int | None = None
    show_window: bool = False
    game_arguments: Mapping[str, Any] | None = None
    command: str | None = None
    start_timeout_s: float = 60.0
    step_timeout_s: float = 60.0

    def __post_init__(self) -> None:
        for name in ("action_repeat", "speedup", "reset_after"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ConfigError(f"{name} is {value}, expected at least 1")
        if self.reset_after is not None and self.action_repeat is None:
            raise ConfigError(
                "reset_after counts physics ticks, so it takes action_repeat, too",
                hint="action_repeat is what the scene's Sync node has, 8 if it was not changed",
            )

    def arguments(self, number: int) -> tuple[str, ...]:
        """Return what the game that has this number is told."""
        given: dict[str, Any] = {"env_seed": self.env_seed + number, "speedup": self.speedup}
        if self.action_repeat is not None:
            given["action_repeat"] = self.action_repeat
        return tuple(
            f"--{key}={value}" for key, value in {**given, **(self.game_arguments or {})}.items()
        )


def open_game(address: GameAddress, settings: Settings) -> GdrlGame:
    """Start a game, or wait until one has connected.

    Args:
        address: A project, a scene or an exported game to start, or host and port at which Python
            waits for a game: one that ``command`` starts (port 0 takes a free one), or that
            somebody else starts, such as the editor (port 11008).
        settings: Those of the user.

    Raises:
        ConfigError: A setting cannot be used.
        TargetError: There is no such game, or stock Godot cannot run it.
        EngineError: The game did not start, or never connected.
    """
    found = read_address(address)
    target = found if isinstance(found, Path) else None
    if target is not None:
        _check_scripts(target)
        if settings.command is not None:
            raise ConfigError(
                f"both {target} and command are given, which say how the game starts",
                hint="with command, name the address: gdrl:127.0.0.1:0",
            )
    launch = GameLaunch(
        target=target,
        command=settings.command,
        frames_per_second=FRAMES_PER_SECOND,
        is_windowed=settings.show_window,
        log_path=address.log_path,
        cores=address.cores,
        engine_args=address.engine_args,
        has_engine_arguments=True,
    )
    where = ("127.0.0.1", 0) if isinstance(found, Path) else found
    if not is_loopback(where[0]):
        raise ConfigError(
            f"{where[0]} is not this machine: games of Godot RL Agents connect to 127.0.0.1",
            hint=f"gdrl:127.0.0.1:{where[1]}",
        )
    check_one_game(
        address,
        has_free_port=launch.is_ours and where[1] == 0,
        hint="name the project, gdrl:PATH, or port 0 with command",
    )
    return _open(address, settings, launch, where)


def _open(
    address: GameAddress, settings: Settings, launch: GameLaunch, where: tuple[str, int]
) -> GdrlGame:
    waiting = Waiting(
        address=where,
        start_timeout_s=settings.start_timeout_s,
        step_timeout_s=settings.step_timeout_s,
    )
    conversation, info = open_conversation(launch, settings.arguments(address.number), waiting)
    try:
        policies = group_agents(info)
    except BaseException:
        conversation.close()
        raise
    if settings.reset_after is None and address.number == 0:
        _LOG.info(
            "games of Godot RL Agents do not tell time limits from other ends: every end that "
            "they report counts as terminated (reset_after marks time limits)"
        )
    ticks = settings.action_repeat or _USUAL_ACTION_REPEAT
    limits = TimeLimits(len(info.policies), settings.reset_after, ticks)
    name = f"gdrl:{address.address}"
    return GdrlGame(name, policies, conversation, FRAMES_PER_SECOND / ticks, limits)


def _check_scripts(target: Path) -> None:
    """Refuse a project whose scripts are all in C#, or whose ``sync.gd`` is ours.

    Stock Godot ignores C#, and our script connects to no trainer of Godot RL Agents.

    Raises:
        TargetError: It is one.
    """
    root = target if target.is_dir() else target.parent
    if any(is_forwarding(script) for script in forwarding_scripts(root)):
        raise TargetError(
            f"{root} has Ludus's script in the place of sync.gd, so that it does not speak the "
            "protocol of Godot RL Agents",
            hint=f"leave out gdrl: (ludus train {root}), or put the original back: "
            f"ludus addon install --legacy --undo {root}",
        )
    kinds = {
        file.suffix
        for file in root.rglob("*")
        if file.suffix in {".cs", ".gd"} and _ADDON not in file.relative_to(root).parts
    }
    if kinds == {".cs"}:
        raise TargetError(
            f"the scripts of {root} are all in C#, which stock Godot does not run",
            hint='start it with the .NET build: gdrl:127.0.0.1:0 with command="godot-mono '
            f'--headless --path {root}", or name an exported game',
        )
