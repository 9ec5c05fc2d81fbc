"""Start a game, or find one that runs, and open a session with it."""

from __future__ import annotations

import contextlib
import os
import time
from dataclasses import dataclass, replace
from pathlib import Path

from ludus.engine import (
    RUN_SCENE,
    EngineProcess,
    GodotFlags,
    LaunchConfig,
    ensure_imported,
    executable_command,
    godot_command,
    require_addon,
    with_display,
)
from ludus.errors import EngineStartError, EngineTimeout
from ludus.link import Link, Listener, connect
from ludus.session.engine_session import EngineSession, RendererMissing
from ludus.session.supervision import Supervision
from ludus.target import Address, EngineTarget, Executable, Play, Scene, prepare
from ludus.wire.handshake import EngineConfig

__all__ = ["LaunchOptions", "open_session"]

_DRAW_ONLY_WHEN_ASKED = ("--disable-render-loop", "--resolution", "64x64")
_MIN_GREETING_S = 1.0


@dataclass(frozen=True, kw_only=True)
class LaunchOptions:
    """How a game is started and watched.

    Attributes:
        is_windowed: Open a window and draw.
        has_renderer: Start an engine that can draw for the cameras of agents, with no window to
            watch. A game that has such cameras gets one anyway; this saves the attempt without.
        gives_pictures: As ``has_renderer``, and all worlds look as in a window, so that pictures of
            them can be asked for (PROTOCOL.md §8).
        is_real_time: Run at the speed of the game, not as fast as possible.
        cores: Cores the engine is pinned to; None: the system decides.
        log_path: File for the engine's output.
        start_timeout_s: How long it may take until the game has told its spec.
        step_timeout_s: How long an answer may take.
        play_timeout_s: How long to wait for somebody to press Play.
        engine_args: Further arguments for the engine itself, such as ``--write-movie``.
        token: Secret shared with a game on another machine, at least 16 characters.
    """

    is_windowed: bool = False
    has_renderer: bool = False
    gives_pictures: bool = False
    is_real_time: bool = False
    cores: tuple[int, ...] | None = None
    log_path: Path | None = None
    start_timeout_s: float = 60.0
    step_timeout_s: float = 60.0
    play_timeout_s: float = 600.0
    engine_args: tuple[str, ...] = ()
    token: str = ""


def open_session(
    target: EngineTarget, config: EngineConfig, options: LaunchOptions | None = None
) -> EngineSession:
    """Open a session with ``target``.

    Raises:
        TargetError: The target cannot be run.
        EngineNotFound: There is no engine to run it with.
        SetupError: It has cameras, and nothing here can draw.
        EngineError: The engine did not start, died, froze or broke the protocol.
    """
    options = options or LaunchOptions()
    game = prepare(target)
    if isinstance(game, Address):
        return _converse(_connect(game, options), None, config, options)
    if isinstance(game, Play):
        return _await_play(game, config, options)
    if isinstance(game, Scene):
        config = replace(config, scene=config.scene or game.path)
    try:
        return _launch(game, config, options)
    except RendererMissing:
        if options.is_windowed or options.has_renderer or options.gives_pictures:
            raise
    return _launch(game, config, replace(options, has_renderer=True))


def _launch(
    game: Scene | Executable, config: EngineConfig, options: LaunchOptions
) -> EngineSession:
    with contextlib.closing(Listener()) as listener:
        addresses = ",".join(listener.addresses)
        launch = LaunchConfig(
            command=_command(
                game, options, (f"--ludus-connect={addresses}", f"--ludus-parent={os.getpid()}")
            ),
            cores=options.cores,
            log_path=options.log_path,
        )
        process = EngineProcess.start(launch)
        deadline = time.monotonic() + options.start_timeout_s
        try:
            link = listener.accept(options.start_timeout_s, Supervision(process).check_alive)
        except EngineTimeout as error:
            report = process.describe_death()
            process.terminate()
            raise EngineStartError(
                f"the game never connected: {error.message}: {report}"
            ) from error
        except BaseException:
            process.terminate()
            raise
    link.timeout_s = max(_MIN_GREETING_S, deadline - time.monotonic())
    return _converse(link, process, config, options)


def _converse(
    link: Link, process: EngineProcess | None, config: EngineConfig, options: LaunchOptions
) -> EngineSession:
    return EngineSession(link, config, Supervision(process), options.token, options.step_timeout_s)


def _command(
    game: Scene | Executable, options: LaunchOptions, user_args: tuple[str, ...]
) -> tuple[str, ...]:
    project = game.project if isinstance(game, Scene) else None
    has_renderer = options.is_windowed or options.has_renderer or options.gives_pictures
    if options.gives_pictures:
        user_args = (*user_args, "--ludus-pictures")
    unseen = () if options.is_windowed or not has_renderer else _DRAW_ONLY_WHEN_ASKED
    flags = GodotFlags(
        headless=not has_renderer,
        fixed_fps=None if options.is_real_time else (project.ticks_per_second if project else 60),
        user_args=user_args,
        engine_args=(*unseen, *options.engine_args),
    )
    if isinstance(game, Executable):
        command = executable_command(game.path, flags)
    else:
        project = game.project
        require_addon(project)
        engine = game.find_engine()
        ensure_imported(engine, project)
        command = godot_command(engine, project.root, RUN_SCENE, flags)
    return with_display(command) if has_renderer else command


def _connect(game: Address, options: LaunchOptions) -> Link:
    _check_token(game.host, options.token)
    try:
        return connect((game.host, game.port), options.start_timeout_s)
    except OSError as error:
        raise EngineStartError(
            f"no game answers at {game.host}:{game.port}: {error}",
            hint=f"start the game with `-- --ludus-listen={game.host}:{game.port}`",
        ) from error


def _await_play(game: Play, config: EngineConfig, options: LaunchOptions) -> EngineSession:
    try:
        listener = Listener((game.host, game.port))
    except OSError as error:
        raise EngineStartError(
            f"cannot listen at {game.host}:{game.port}: {error}",
            hint="another trainer may be waiting there; end it first",
        ) from error
    with contextlib.closing(listener):
        link = listener.accept(options.play_timeout_s, lambda: None)
    link.timeout_s = options.start_timeout_s
    return _converse(link, None, config, options)


def _check_token(host: str, token: str) -> None:
    is_local = host in {"localhost", "::1"} or host.startswith("127.")
    if not is_local and len(token) < 16:
        raise EngineStartError(
            f"a game on another machine ({host}) needs a token of at least 16 characters",
            hint="put one into a file; start the game with --ludus-token-file=FILE, and Ludus with "
            "--token-file FILE",
        )
