"""``gymnasium.make("ludus/GymGodot-v0", …)``, with the arguments that GymGodot's own class has."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ludus.errors import ConfigError, SetupError
from ludus.legacy.game import Declaration
from ludus.legacy.gymgodot.spaces import check_space, max_message_bytes

if TYPE_CHECKING:
    from ludus.legacy.gymgodot.env import GymGodotEnv

__all__ = ["USUAL_STEP_LENGTH", "check_host", "check_packages", "make"]

USUAL_STEP_LENGTH = 2
"""Frames of a step in GymGodot unless the scene says otherwise, which the wire does not tell."""

_RENDER_MODES = (None, "rgb_array")
_PROC_MODES = ("process", "thread")
_PACKAGES = {"websockets": "websockets", "PIL": "pillow"}
_MAX_PORT = 65535


def make(
    *,
    serverIP: str = "127.0.0.1",  # noqa: N803 - the names that GymGodot's users write
    serverPort: str | int = 8000,  # noqa: N803
    exeCmd: str | None = None,  # noqa: N803
    action_space: Any = None,
    observation_space: Any = None,
    window_render: bool = False,
    renderPath: str | Path | None = None,  # noqa: N803
    env_fps: int = 60,
    proc_mode: str = "process",
    render_mode: str | None = None,
    allow_remote: bool = False,
    start_timeout_s: float = 60.0,
    step_timeout_s: float = 60.0,
    log_path: str | Path | None = None,
) -> GymGodotEnv:
    """Start a GymGodot project and wait until it has connected.

    Args:
        serverIP: Address at which Python waits for the game.
        serverPort: Port there; 0 takes a free one.
        exeCmd: What the shell runs, such as ``cd PROJECT && godot3-server ./Scene.tscn``; the
            arguments for GymGodot are put at its end. None: somebody else starts the game.
        action_space: What the game takes: ``Discrete``, ``Box``, ``MultiDiscrete`` or
            ``MultiBinary``.
        observation_space: What the game shows; as ``action_space``.
        window_render: Whether the game draws while it steps.
        renderPath: What the game puts before the number of a saved frame, usually a folder with a
            slash at its end. Left out: a temporary folder with ``render_mode="rgb_array"``, else
            ``./render_frames/`` as the game sees it.
        env_fps: Frames in one second of game time.
        proc_mode: Taken for old programs; there is no second process or thread any more.
        render_mode: ``"rgb_array"``: ``render`` also returns the frame.
        allow_remote: Let a game on another machine connect. GymGodot has no secret by which to
            know it: whoever reaches the port can play the game.
        start_timeout_s: How long it may take until the game has connected, seconds.
        step_timeout_s: How long an answer may take, seconds.
        log_path: File that gets a copy of what the game prints.

    Raises:
        ConfigError: An argument cannot be used.
        SetupError: A package is missing.
        EngineStartError: The port is taken, or the game never connected.
        EngineCrashed: The command ended before the game connected.
    """
    check_packages()
    check_space("action_space", action_space)
    check_space("observation_space", observation_space)
    _check_choice("render_mode", render_mode, _RENDER_MODES)
    _check_choice("proc_mode", proc_mode, _PROC_MODES)
    check_host(serverIP, allow_remote=allow_remote)
    settings = {
        "host": serverIP,
        "port": _port(serverPort),
        "command": exeCmd,
        "is_windowed": window_render,
        "frames_per_second": env_fps,
        "max_message_bytes": max_message_bytes(observation_space),
        "start_timeout_s": start_timeout_s,
        "step_timeout_s": step_timeout_s,
        "log_path": None if log_path is None else Path(log_path),
    }
    return _open(settings, renderPath, action_space, observation_space, render_mode)


def _open(
    settings: dict[str, Any],
    render_path: str | Path | None,
    action_space: Any,
    observation_space: Any,
    render_mode: str | None,
) -> GymGodotEnv:
    from ludus.legacy.gymgodot.env import GymGodotEnv
    from ludus.legacy.gymgodot.frames import Frames
    from ludus.legacy.gymgodot.game import Game, GameConfig

    path = None if render_path is None else str(render_path)
    frames = Frames(path, are_read=render_mode is not None)
    try:
        game = Game(GameConfig(**settings, render_path=frames.render_path))
    except BaseException:
        frames.close()
        raise
    declaration = Declaration(
        name="gymgodot",
        observation_space=observation_space,
        action_space=action_space,
        steps_per_second=game.frames_per_second / USUAL_STEP_LENGTH,
    )
    return GymGodotEnv(game, frames, declaration, render_mode)


def check_packages() -> None:
    """Check that what the wire and its frames take is installed.

    Raises:
        SetupError: It is not.
    """
    missing = [name for module, name in _PACKAGES.items() if find_spec(module) is None]
    if missing:
        raise SetupError(
            f"driving GymGodot projects needs the package {' and '.join(missing)}",
            hint="pip install ludus-rl[gymgodot]",
        )


def _check_choice(name: str, value: str | None, known: tuple[str | None, ...]) -> None:
    if value not in known:
        names = " or ".join(repr(choice) for choice in known)
        raise ConfigError(f"{name} is {value!r}, expected {names}")


def check_host(host: str, *, allow_remote: bool) -> None:
    """Refuse to let other machines connect unless that was asked for.

    Raises:
        ConfigError: It was not.
    """
    if not allow_remote and host != "localhost" and not host.startswith("127."):
        raise ConfigError(
            f"serverIP {host!r} lets other machines connect",
            hint="GymGodot knows no password; allow_remote=True if you trust the network",
        )


def _port(port: str | int) -> int:
    try:
        number = int(port)
    except ValueError:
        number = -1
    if not 0 <= number <= _MAX_PORT:
        raise ConfigError(f"serverPort is {port!r}, expected 0 to {_MAX_PORT}")
    return number
