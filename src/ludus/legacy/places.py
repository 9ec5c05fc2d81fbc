"""What stands behind the prefix of a target: a project or a scene, or an address."""

from __future__ import annotations

import re
from pathlib import Path

from ludus.errors import ConfigError, TargetError
from ludus.legacy.registry import GameAddress

__all__ = ["check_one_game", "read_place"]

_ADDRESS = re.compile(r"^(?P<host>[\w.-]+):(?P<port>\d{1,5})$", re.ASCII)
_MAX_PORT = 65535


def read_place(place: GameAddress) -> Path | tuple[str, int]:
    """Return the path of a project or scene, or host and port.

    Raises:
        TargetError: It is neither.
    """
    path = Path(place.address).expanduser()
    if place.address and path.exists():
        return path
    match = _ADDRESS.match(place.address)
    if match is None or int(match["port"]) > _MAX_PORT:
        raise TargetError(
            f"there is no project and no scene {place.address!r}",
            hint="behind the prefix stands a project folder, a .tscn, or HOST:PORT",
        )
    return match["host"], int(match["port"])


def check_one_game(place: GameAddress, *, has_free_port: bool, hint: str) -> None:
    """Refuse to open several games where they would get into each other's way.

    Args:
        place: How many games there are.
        has_free_port: Whether we start the games, and each takes a free port.
        hint: How to have that.

    Raises:
        ConfigError: There are several, and they cannot be told apart.
    """
    if place.num_games > 1 and not has_free_port:
        raise ConfigError(
            f"{place.num_games} games cannot share one port: num_engines must be 1", hint=hint
        )
