"""What follows the prefix of a target: a project or a scene, or an address."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ludus.errors import ConfigError, TargetError

__all__ = ["GameAddress", "check_one_game", "read_address"]

_ADDRESS = re.compile(r"^(?P<host>[\w.-]+):(?P<port>\d{1,5})$", re.ASCII)
_MAX_PORT = 65535


@dataclass(frozen=True, kw_only=True)
class GameAddress:
    """Which game of a bridge to open, and which of several it is.

    Attributes:
        address: What follows the prefix of the target.
        num_games: How many are opened in all.
        number: Which of them it is, from 0.
        cores: Cores that a game which we start is pinned to; None: the system decides.
        log_path: File for what a game that we start prints.
        engine_args: Further arguments for the engine of a game that we start.
    """

    address: str
    num_games: int = 1
    number: int = 0
    cores: tuple[int, ...] | None = None
    log_path: Path | None = None
    engine_args: tuple[str, ...] = ()


def read_address(game: GameAddress) -> Path | tuple[str, int]:
    """Return the path of a project or scene, or host and port.

    Raises:
        TargetError: It is neither.
    """
    path = Path(game.address).expanduser()
    if game.address and path.exists():
        return path
    match = _ADDRESS.match(game.address)
    if match is None or int(match["port"]) > _MAX_PORT:
        raise TargetError(
            f"there is no project and no scene {game.address!r}",
            hint="after the prefix comes a project folder, a .tscn, or HOST:PORT",
        )
    return match["host"], int(match["port"])


def check_one_game(game: GameAddress, *, has_free_port: bool, hint: str) -> None:
    """Refuse to open several games where they would get into each other's way.

    Args:
        game: How many games there are.
        has_free_port: Whether we start the games, and each takes a free port.
        hint: How to have that.

    Raises:
        ConfigError: There are several, and they cannot be told apart.
    """
    if game.num_games > 1 and not has_free_port:
        raise ConfigError(
            f"{game.num_games} games cannot share one port: num_engines must be 1", hint=hint
        )
