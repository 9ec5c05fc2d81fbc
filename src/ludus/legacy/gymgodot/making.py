"""Make environments and games for ``gymnasium.make("ludus/GymGodot-v0")`` and ``gymgodot:…``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ludus.errors import ConfigError, SetupError
from ludus.extras import install_hint
from ludus.legacy.addresses import GameAddress, check_one_game, read_address
from ludus.legacy.game import Declaration
from ludus.legacy.launching import GameLaunch
from ludus.legacy.spaces import check_space, max_message_bytes
from ludus.link import is_loopback

if TYPE_CHECKING:
    from ludus.legacy.gymgodot.env import GymGodotEnv
    from ludus.legacy.gymgodot.game import GymGodotGame

__all__ = ["Settings", "make", "make_rendering", "open_game"]

_USUAL_STEP_LENGTH = 2
"""Frames of a step in GymGodot unless the scene says otherwise, which the wire does not tell."""

_CHOICES = {
    "render_mode": (None, "rgb_array"),
    "proc_mode": ("process", "thread"),
    "compatibility": (None, "gym-0.21"),
}
_PACKAGES = {"websockets": "websockets", "PIL": "pillow"}
_MAX_PORT = 65535


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a user can set of a GymGodot game.

    Attributes:
        action_space: What the game takes: ``Discrete``, ``Box``, ``MultiDiscrete`` or
            ``MultiBinary``.
        observation_space: What the game shows; as ``action_space``.
        exeCmd: What the shell runs to start the game; the arguments for GymGodot are put at its
            end. None: somebody else starts it.
        window_render: Whether the game draws while it steps.
        env_fps: Frames in one second of game time.
        allow_remote: Let a game on another machine connect. GymGodot has no password: any program
            that reaches the port can play the game.
        start_timeout_s: How long it may take until the game has connected, seconds.
        step_timeout_s: How long an answer may take, seconds.
    """

    action_space: Any
    observation_space: Any
    exeCmd: str | None = None  # noqa: N815 - the name that GymGodot's users write
    window_render: bool = False
    env_fps: int = 60
    allow_remote: bool = False
    start_timeout_s: float = 60.0
    step_timeout_s: float = 60.0

    def __post_init__(self) -> None:
        _check_packages()
        check_space("action_space", self.action_space)
        check_space("observation_space", self.observation_space)


def make(
    *,
    serverIP: str = "127.0.0.1",  # noqa: N803 - the names that GymGodot's users write
    serverPort: str | int = 8000,  # noqa: N803
    action_space: Any = None,
    observation_space: Any = None,
    renderPath: str | Path | None = None,  # noqa: N803
    proc_mode: str = "process",
    render_mode: str | None = None,
    log_path: str | Path | None = None,
    compatibility: str | None = None,
    **settings: Any,
) -> GymGodotEnv:
    """Start a GymGodot project and wait until it has connected.

    Args:
        serverIP: Address at which Python waits for the game.
        serverPort: Port there; 0 takes a free one.
        action_space: What the game takes.
        observation_space: What the game shows.
        renderPath: What the game puts before the number of a saved frame, usually a folder with a
            slash at its end. Left out: a temporary folder with ``render_mode="rgb_array"``, else
            ``./render_frames/`` as the game sees it.
        proc_mode: Without effect, for old programs.
        render_mode: ``"rgb_array"``: ``render`` also returns the frame.
        log_path: File that gets a copy of what the game prints.
        compatibility: ``"gym-0.21"``: ``reset`` and ``step`` return what GymGodot's own environment
            returned: the observation alone, and four values.
        settings: Further fields of :class:`Settings`, such as ``exeCmd``.

    Raises:
        ConfigError: An argument cannot be used.
        SetupError: A package is missing.
        EngineStartError: The port is taken, or the game never connected.
        EngineCrashed: The command ended before the game connected.
    """
    read = Settings(action_space=action_space, observation_space=observation_space, **settings)
    given = {"render_mode": render_mode, "proc_mode": proc_mode, "compatibility": compatibility}
    for name, value in given.items():
        if value not in _CHOICES[name]:
            known = " or ".join(map(repr, _CHOICES[name]))
            raise ConfigError(f"{name} is {value!r}, expected {known}")
    from ludus.legacy.gymgodot.env import GymGodotEnv
    from ludus.legacy.gymgodot.frames import Frames

    path = None if renderPath is None else str(renderPath)
    frames = Frames(path, are_read=render_mode is not None)
    try:
        launch = _launch(read, log_path=log_path)
        game = _open("gymgodot", read, (serverIP, _port(serverPort)), launch, frames.render_path)
    except BaseException:
        frames.close()
        raise
    if compatibility is not None:
        from ludus.legacy.gymgodot.gym_021 import Gym021Env

        return Gym021Env(game, frames, render_mode)
    return GymGodotEnv(game, frames, render_mode)


def make_rendering(address: GameAddress, settings: Settings) -> GymGodotEnv:
    """Start a game that draws, as an environment that returns its frames; errors as open_game."""
    from ludus.legacy.gymgodot.env import GymGodotEnv
    from ludus.legacy.gymgodot.frames import Frames

    frames = Frames(None, are_read=True)
    try:
        game = open_game(address, replace(settings, window_render=True), frames.render_path)
    except BaseException:
        frames.close()
        raise
    return GymGodotEnv(game, frames, "rgb_array")


def open_game(
    address: GameAddress, settings: Settings, render_path: str | None = None
) -> GymGodotGame:
    """Start a game, or wait until one has connected, for ``ludus.make("gymgodot:…")``.

    Args:
        address: A project or scene to start, or host and port at which Python waits for a game: one
            that ``exeCmd`` starts (port 0 takes a free one), or that somebody else starts.
        settings: Those of the user.
        render_path: What the game puts before the number of a saved frame.

    Raises:
        ConfigError: A setting cannot be used.
        TargetError: There is no such project.
        EngineError: The game did not start, or never connected.
    """
    found = read_address(address)
    target = found if isinstance(found, Path) else None
    if target is not None and settings.exeCmd is not None:
        raise ConfigError(
            f"both {target} and exeCmd are given, which say how the game starts",
            hint="with exeCmd, name the address: gymgodot:127.0.0.1:0",
        )
    launch = _launch(settings, target=target, log_path=address.log_path, cores=address.cores)
    host, port = ("127.0.0.1", 0) if isinstance(found, Path) else found
    check_one_game(
        address,
        has_free_port=launch.is_ours and port == 0,
        hint="name the project, gymgodot:PATH, or port 0 with exeCmd",
    )
    return _open(f"gymgodot:{address.address}", settings, (host, port), launch, render_path)


def _launch(settings: Settings, **more: Any) -> GameLaunch:
    return GameLaunch(
        command=settings.exeCmd,
        is_windowed=settings.window_render,
        frames_per_second=settings.env_fps,
        **more,
    )


def _open(
    name: str,
    settings: Settings,
    address: tuple[str, int],
    launch: GameLaunch,
    render_path: str | None = None,
) -> GymGodotGame:
    host, port = address
    if not settings.allow_remote and not is_loopback(host):
        raise ConfigError(
            f"serverIP {host!r} lets other machines connect",
            hint="GymGodot has no password; allow_remote=True if you trust the network",
        )
    from ludus.legacy.gymgodot.connecting import DEFAULT_RENDER_PATH, Address, open_conversation
    from ludus.legacy.gymgodot.game import GymGodotGame

    where = Address(
        host=host,
        port=port,
        max_message_bytes=max_message_bytes(settings.observation_space),
        start_timeout_s=settings.start_timeout_s,
        step_timeout_s=settings.step_timeout_s,
    )
    declaration = Declaration(
        name=name,
        observation_space=settings.observation_space,
        action_space=settings.action_space,
        steps_per_second=settings.env_fps / _USUAL_STEP_LENGTH,
    )
    conversation, at = open_conversation(launch, where, render_path or DEFAULT_RENDER_PATH)
    return GymGodotGame(declaration, conversation, at)


def _check_packages() -> None:
    missing = [name for module, name in _PACKAGES.items() if find_spec(module) is None]
    if missing:
        raise SetupError(
            f"driving GymGodot projects needs the package {' and '.join(missing)}",
            hint=install_hint("gymgodot"),
        )


def _port(port: str | int) -> int:
    try:
        number = int(port)
    except ValueError:
        number = -1
    if not 0 <= number <= _MAX_PORT:
        raise ConfigError(f"serverPort is {port!r}, expected 0 to {_MAX_PORT}")
    return number
