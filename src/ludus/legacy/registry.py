"""Which bridge a target means, and how its games are opened."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from importlib import import_module
from typing import Any

from ludus.errors import ConfigError
from ludus.legacy.addresses import GameAddress
from ludus.legacy.game import LegacyGame
from ludus.legacy.session import LegacySession

__all__ = [
    "BRIDGES",
    "Bridge",
    "GameAddress",
    "check_settings",
    "find_bridge",
    "open_bridge_session",
]


_NOT_OF_USERS = {"target", "log_path", "cores"}
"""Settings that follow from the target and the pool."""


@dataclass(frozen=True)
class Bridge:
    """Another project whose games can be driven.

    Attributes:
        prefix: How its targets begin.
        module: Home of ``Settings``, a dataclass of what the user can set, and of
            ``open_game(address, settings)``, which opens one game.
        form: What a target looks like.
        page: Where our documentation of it is.
    """

    prefix: str
    module: str
    form: str
    page: str

    @property
    def code(self) -> Any:
        """The module, which may need packages that not everybody has."""
        return import_module(self.module)

    def place_of(self, target: str) -> str:
        """Return what follows the prefix."""
        return target.removeprefix(self.prefix)


BRIDGES = (
    Bridge(
        "godot_gym_api:",
        "ludus.legacy.godot_gym_api.making",
        "godot_gym_api:PATH",
        "docs/godot_gym_api.md",
    ),
    Bridge("gymgodot:", "ludus.legacy.gymgodot.making", "gymgodot:PATH", "docs/gymgodot.md"),
    Bridge("http://", "ludus.legacy.bevy_rl.making", "http://HOST:PORT", "docs/bevy_rl.md"),
)


def find_bridge(target: str) -> Bridge | None:
    """Return the bridge that a target names; None if it names none."""
    return next((bridge for bridge in BRIDGES if target.startswith(bridge.prefix)), None)


def check_settings(bridge: Bridge, settings: Mapping[str, Any]) -> None:
    """Check that a bridge knows all settings, and has all that it needs.

    Raises:
        ConfigError: It does not, or has not.
    """
    parts = fields(bridge.code.Settings)
    known = [part.name for part in parts if part.name not in _NOT_OF_USERS]
    unknown = [name for name in settings if name not in known]
    if unknown:
        raise ConfigError(
            f"{bridge.form} has no setting {', '.join(unknown)}", hint=f"it has {', '.join(known)}"
        )
    missing = [part.name for part in parts if part.default is MISSING and part.name not in settings]
    if missing:
        raise ConfigError(
            f"{', '.join(missing)} must be given: games of this bridge do not report it",
            hint=f"in Python ludus.make({bridge.form!r}, {missing[0]}=…); a command cannot know "
            f"it: give the game an id and use gym:MODULE:ID, as {bridge.page} shows",
        )


def open_bridge_session(
    bridge: Bridge,
    address: GameAddress,
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
    code = bridge.code
    game: LegacyGame = code.open_game(address, code.Settings(**settings))
    return LegacySession(game, max_episode_steps)
