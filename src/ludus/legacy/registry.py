"""Which bridge a target means, and how its games are opened."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from ludus.errors import ConfigError
from ludus.legacy.game import LegacyGame
from ludus.legacy.session import LegacySession

__all__ = [
    "BRIDGES",
    "Bridge",
    "GameAddress",
    "GamePlace",
    "check_settings",
    "find_bridge",
    "open_bridge_session",
]


@dataclass(frozen=True, kw_only=True)
class GameAddress:
    """Which game of a bridge to open, and where it stands among others.

    Attributes:
        address: What stands behind the prefix of the target.
        num_games: How many are opened in all.
        cores: Cores that a game which we start is pinned to; None: the system decides.
        log_path: File for what a game that we start prints.
    """

    address: str
    num_games: int = 1
    cores: tuple[int, ...] | None = None
    log_path: Path | None = None


GamePlace = GameAddress
"""The name of earlier versions."""


@dataclass(frozen=True)
class Bridge:
    """Another project whose games can be driven.

    Attributes:
        prefix: How its targets begin.
        module: Home of ``open_game(place, *, …)``, which opens one game. Its keyword-only
            parameters are the settings that the user has.
        form: What a target looks like.
        page: Where our documentation of it is.
    """

    prefix: str
    module: str
    form: str
    page: str

    def opener(self) -> Callable[..., LegacyGame]:
        """Import what opens one game, which may need packages that not everybody has."""
        return import_module(self.module).open_game

    def place_of(self, target: str) -> str:
        """Return what stands behind the prefix."""
        return target.removeprefix(self.prefix)


BRIDGES = (
    Bridge(
        "godot_gym_api:",
        "ludus.legacy.godot_gym_api.opening",
        "godot_gym_api:PATH",
        "docs/godot_gym_api.md",
    ),
    Bridge("gymgodot:", "ludus.legacy.gymgodot.opening", "gymgodot:PATH", "docs/gymgodot.md"),
    Bridge("http://", "ludus.legacy.bevy_rl.opening", "http://HOST:PORT", "docs/bevy_rl.md"),
)


def find_bridge(target: str) -> Bridge | None:
    """Return the bridge that a target names; None if it names none."""
    return next((bridge for bridge in BRIDGES if target.startswith(bridge.prefix)), None)


def check_settings(bridge: Bridge, settings: Mapping[str, Any]) -> None:
    """Check that a bridge knows all settings, and has all that it needs.

    Raises:
        ConfigError: It does not, or has not.
    """
    parameters = inspect.signature(bridge.opener()).parameters.values()
    known = {part.name: part for part in parameters if part.kind is part.KEYWORD_ONLY}
    unknown = [name for name in settings if name not in known]
    if unknown:
        raise ConfigError(
            f"{bridge.form} has no setting {', '.join(unknown)}", hint=f"it has {', '.join(known)}"
        )
    needed = [name for name, part in known.items() if part.default is part.empty]
    missing = [name for name in needed if name not in settings]
    if missing:
        raise ConfigError(
            f"{', '.join(missing)} must be given: games of this bridge do not tell",
            hint=f"in Python ludus.make({bridge.form!r}, {missing[0]}=…); a command cannot know "
            f"it: give the game an id and use gym:MODULE:ID, as {bridge.page} shows",
        )


def open_bridge_session(
    bridge: Bridge,
    place: GameAddress,
    settings: Mapping[str, Any],
    max_episode_steps: int | None = None,
) -> LegacySession:
    """Open a session with one game.

    Raises:
        ConfigError: A setting is unknown, missing or cannot be used.
        TargetError: There is no such game, or its spaces cannot be trained.
        SetupError: A package or an engine is missing.
        EngineError: The game did not start, or never connected.
    """
    check_settings(bridge, settings)
    return LegacySession(bridge.opener()(place, **settings), max_episode_steps)
