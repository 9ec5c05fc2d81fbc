"""Which bridge a target means, and how its games are opened."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

import gymnasium

from ludus.errors import ConfigError, TargetError
from ludus.legacy.addresses import GameAddress
from ludus.legacy.game import LegacyGame
from ludus.legacy.session import LegacySession
from ludus.legacy.setting_text import read_setting
from ludus.target import Legacy, Scene, parse_target

__all__ = [
    "BRIDGES",
    "Bridge",
    "GameAddress",
    "bridge_of",
    "find_bridge",
    "find_window",
    "make_bridge_env",
    "open_bridge_session",
    "read_settings",
]


_NOT_OF_USERS = {"target", "log_path", "cores"}
"""Settings that follow from the target and the pool."""
_FLAGS = {
    "action_space": '--action-space "Discrete(2)"',
    "observation_space": '--observation-space "Box(-inf, inf, (4,))"',
}


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

    @property
    def setting_names(self) -> list[str]:
        """What a user can set."""
        return [part.name for part in fields(self.code.Settings) if part.name not in _NOT_OF_USERS]

    @property
    def has_window(self) -> bool:
        """Whether Ludus can open its games in a window, and tell their engine more."""
        return "show_window" in self.setting_names

    def is_switch(self, name: str) -> bool:
        """Tell whether a setting is true or false."""
        return get_type_hints(self.code.Settings)[name] is bool

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
    Bridge("gdrl:", "ludus.legacy.gdrl.making", "gdrl:PATH", "docs/godot_rl_agents.md"),
    Bridge("gymgodot:", "ludus.legacy.gymgodot.making", "gymgodot:PATH", "docs/gymgodot.md"),
    Bridge("http://", "ludus.legacy.bevy_rl.making", "http://HOST:PORT", "docs/bevy_rl.md"),
)


def find_bridge(target: str) -> Bridge | None:
    """Return the bridge that a target names; None if it names none."""
    return next((bridge for bridge in BRIDGES if target.startswith(bridge.prefix)), None)


def bridge_of(target: Legacy) -> Bridge:
    """Return the bridge of a target that is known to have one."""
    bridge = find_bridge(target.name)
    assert bridge is not None, "a test holds the prefixes of targets and bridges together"
    return bridge


def read_settings(bridge: Bridge, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of a user with texts read, such as those of a command line.

    Raises:
        ConfigError: The bridge does not know one, lacks one, or cannot read one.
    """
    _check_names(bridge, settings)
    hints = get_type_hints(bridge.code.Settings)
    return {
        name: read_setting(name, value, hints[name]) if isinstance(value, str) else value
        for name, value in settings.items()
    }


def _check_names(bridge: Bridge, settings: Mapping[str, Any]) -> None:
    parts = fields(bridge.code.Settings)
    known = bridge.setting_names
    unknown = [name for name in settings if name not in known]
    if unknown:
        raise ConfigError(
            f"{bridge.form} has no setting {', '.join(unknown)}", hint=f"it has {', '.join(known)}"
        )
    missing = [part.name for part in parts if part.default is MISSING and part.name not in settings]
    if missing:
        raise ConfigError(
            f"{', '.join(missing)} must be given: games of this bridge do not report it",
            hint=f"{_FLAGS.get(missing[0], '--' + missing[0].replace('_', '-') + ' MODULE:NAME')}; "
            f"in Python ludus.make({bridge.form!r}, {missing[0]}=…) ({bridge.page})",
        )


def find_window(target: Legacy) -> tuple[Scene, int] | None:
    """Return the project of a target and its frames per second, if Ludus can show it in a window.

    The frames are those of game time, while Python plays.
    """
    bridge = bridge_of(target)
    if not bridge.has_window:
        return None
    place = Path(bridge.place_of(target.name)).expanduser()
    game = parse_target(place) if place.exists() else None
    return (game, bridge.code.FRAMES_PER_SECOND) if isinstance(game, Scene) else None


def make_bridge_env(target: Legacy, settings: Mapping[str, Any]) -> gymnasium.Env[Any, Any]:
    """Return one game as an environment whose ``render`` returns frames.

    Raises:
        TargetError: The wire has no pictures of the screen.
        ConfigError: A setting is unknown, missing or cannot be used.
        EngineError: The game did not start, or never connected.
    """
    bridge = bridge_of(target)
    code = bridge.code
    if not hasattr(code, "make_rendering"):
        raise TargetError(
            f"{target.name} cannot be filmed: the wire of {bridge.form} has no pictures of the "
            "screen",
            hint="--dataset NAME-v0 records its steps",
        )
    address = GameAddress(address=bridge.place_of(target.name))
    return code.make_rendering(address, code.Settings(**read_settings(bridge, settings)))


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
    code = bridge.code
    game: LegacyGame = code.open_game(address, code.Settings(**read_settings(bridge, settings)))
    return LegacySession(game, max_episode_steps)
