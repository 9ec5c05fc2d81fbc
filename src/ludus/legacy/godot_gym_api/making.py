"""Make environments and games for ``ludus/GodotGymApi-v0`` and ``godot_gym_api:…``."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from ludus.errors import ConfigError
from ludus.legacy.addresses import GameAddress, check_one_game, read_address
from ludus.legacy.env import LegacyEnv
from ludus.legacy.godot_gym_api.client import GodotClient
from ludus.legacy.godot_gym_api.connecting import ConnectionSettings
from ludus.legacy.godot_gym_api.game import GodotGymApiGame, Task

__all__ = ["Settings", "make", "open_game"]


@dataclass(frozen=True, kw_only=True)
class Settings(ConnectionSettings, Task):
    """What a user can set of a game for godot_gym_api.

    Attributes:
        protobuf_message_module: The compiled messages; None if the game answers in JSON.
        engine_address: Where the game listens; None: 127.0.0.1:9090, or what the target says.
    """

    protobuf_message_module: Any = None
    engine_address: Any = None

    def __post_init__(self) -> None:
        self.check()

    def open(self, name: str, engine_address: tuple[str, int], **more: Any) -> GodotGymApiGame:
        """Start a game, or connect with one; what is given here comes before the settings."""
        names = [part.name for part in fields(ConnectionSettings)]
        connection = {part: getattr(self, part) for part in names} | more
        connection["engine_address"] = engine_address
        client = GodotClient(self.protobuf_message_module, **connection)
        return GodotGymApiGame(name, client, self, self.frames_per_second)


def make(
    *,
    action_space: Any = None,
    observation_space: Any = None,
    get_reward: Any = None,
    is_terminated: Any = None,
    render_mode: str | None = None,
    **settings: Any,
) -> LegacyEnv:
    """Connect with a game, or start one.

    Args:
        action_space: What the game takes; this and the next three must be given: see :class:`Task`.
        observation_space: What is observed.
        get_reward: Returns the reward for a state ``{"agent": data, "world": data}``.
        is_terminated: Returns whether the episode has ended in a state.
        render_mode: Only None: the wire has no pictures of the screen.
        settings: Further fields of :class:`Settings`, such as ``engine_address`` and ``target``.

    Raises:
        ConfigError: An argument cannot be used.
        EngineStartError: The game did not start, or never listened.
        EngineCrashed: It ended before we were connected.
    """
    if render_mode is not None:
        raise ConfigError(f"render_mode is {render_mode!r}, expected None")
    known = [part.name for part in fields(Settings)]
    unknown = [name for name in settings if name not in known]
    if unknown:
        raise ConfigError(
            f"unknown argument {', '.join(unknown)}", hint=f"there are {', '.join(known)}"
        )
    read = Settings(
        action_space=action_space,
        observation_space=observation_space,
        get_reward=get_reward,
        is_terminated=is_terminated,
        **settings,
    )
    address = read.engine_address or ConnectionSettings.engine_address
    return LegacyEnv(read.open("godot_gym_api", address))


def open_game(address: GameAddress, settings: Settings) -> GodotGymApiGame:
    """Start a game, or connect with one, for ``ludus.make("godot_gym_api:…")``.

    Args:
        address: A project or scene to start, or host and port at which a game listens: one that
            ``command`` starts, or that somebody else starts.
        settings: Those of the user.

    Raises:
        ConfigError: A setting cannot be used.
        TargetError: There is no such project.
        EngineError: The game did not start, or never listened.
    """
    found = read_address(address)
    target = found if isinstance(found, Path) else None
    where = settings.engine_address or ConnectionSettings.engine_address
    if not isinstance(found, Path):
        if settings.engine_address is not None:
            raise ConfigError(
                f"two addresses are given: {address.address} and engine_address "
                f"{settings.engine_address}",
                hint="engine_address is for a project: godot_gym_api:PATH",
            )
        where = found
    is_ours = target is not None or settings.command is not None
    check_one_game(
        address,
        has_free_port=is_ours and where[1] == 0,
        hint="with our classes in the game (docs/godot_gym_api.md), port 0 takes a free one: "
        'godot_gym_api:PATH with engine_address=("127.0.0.1", 0)',
    )
    return settings.open(
        f"godot_gym_api:{address.address}",
        where,
        target=target,
        log_path=address.log_path,
        cores=address.cores,
    )
