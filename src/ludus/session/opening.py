"""Start a game, or find one that runs, and open a session with it."""

from __future__ import annotations

import contextlib
import functools
import logging
import os
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from ludus.engine import (
    RUN_SCENE,
    EngineKind,
    EngineProcess,
    GodotFlags,
    LaunchConfig,
    ensure_imported,
    executable_command,
    exported_version,
    godot_command,
    is_bevy_game,
    require_addon,
    with_display,
)
from ludus.errors import EngineCrashed, EngineStartError, EngineTimeout
from ludus.link import EngineAcceptor, Link, Listener, PendingConnection, connect, is_loopback
from ludus.session.engine_session import EngineSession, RendererMissing
from ludus.session.supervision import Supervision
from ludus.session.user_token import user_token
from ludus.target import Address, EngineTarget, Executable, Play, Scene, prepare
from ludus.wire.greeting import Greeting
from ludus.wire.handshake import EngineConfig
from ludus.wire.proof import MIN_TOKEN_LENGTH

__all__ = ["LaunchOptions", "open_session"]

TOKEN_VARIABLE = "LUDUS_TOKEN"
"""Environment variable with the token of a game that is started here (PROTOCOL.md §3)."""

_DRAW_ONLY_WHEN_ASKED = ("--disable-render-loop", "--resolution", "64x64")
_MIN_GREETING_S = 1.0
DEBUG_VIEW = "--ludus-debug-view"
"""Argument of a game that shows from the start what an agent sees and decides."""
_FIRST_GODOT_WITH_UNIX = (4, 6)
_TOKEN_HINT = (
    "put one into a file; start the game with --ludus-token-file=FILE, and Ludus with "
    "--token-file FILE"
)

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class LaunchOptions:
    """How a game is started and watched.

    Attributes:
        is_windowed: Open a window and draw.
        has_renderer: Start an engine that can draw for the cameras of agents, with no window to
            watch. A game that has such cameras gets one anyway; this saves the attempt without.
        gives_pictures: As ``has_renderer``, and all worlds look as in a window, so that pictures of
            them can be asked for (PROTOCOL.md §8).
        has_controls: Give people who watch keys for pause, single steps and slow motion.
        has_debug_view: Show what an agent sees and decides from the start, as in a film.
        is_real_time: Run at the speed of the game, not as fast as possible.
        cores: Cores the engine is pinned to; None: the system decides.
        log_path: File for the engine's output.
        start_timeout_s: How long it may take until the game has told its spec.
        step_timeout_s: How long an answer may take.
        play_timeout_s: How long to wait for somebody to press Play.
        engine_args: Further arguments for the engine itself, such as ``--write-movie``.
        token: Secret shared with a game that somebody else starts, at least 16 characters; empty:
            the one of this user on this machine. A game that is started here gets its own.
    """

    is_windowed: bool = False
    has_renderer: bool = False
    gives_pictures: bool = False
    has_controls: bool = False
    has_debug_view: bool = False
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
        return _attach(game, config, options)
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
    token = secrets.token_hex(32)
    with contextlib.closing(Listener(has_tcp=not _has_unix_sockets(game))) as listener:
        addresses = ",".join(listener.addresses)
        launch = LaunchConfig(
            command=_command(
                game, options, (f"--ludus-connect={addresses}", f"--ludus-parent={os.getpid()}")
            ),
            env={TOKEN_VARIABLE: token},
            cores=options.cores,
            log_path=options.log_path,
        )
        process = EngineProcess.start(launch)
        deadline = time.monotonic() + options.start_timeout_s
        try:
            connection = _await_engine(
                EngineAcceptor(
                    listener.sockets,
                    lambda: Greeting(token, takes_protocol_1=True),
                    options.start_timeout_s,
                ),
                options.start_timeout_s,
                Supervision(process).check_alive,
            )
        except EngineTimeout as error:
            report = process.describe_death()
            process.terminate()
            raise EngineStartError(
                f"the game never connected: {error.message}: {report}"
            ) from error
        except BaseException:
            process.terminate()
            raise
    hello = connection.greeting.hello
    if hello is not None and connection.greeting.version == 1:
        _warn_of_protocol_1(hello.engine, hello.upgrade)
    left_s = max(_MIN_GREETING_S, deadline - time.monotonic())
    return _converse(connection, left_s, process, config, options)


def _has_unix_sockets(game: Scene | Executable) -> bool:
    """Return whether a game that is started here connects by a Unix socket."""
    if isinstance(game, Scene):
        engine = game.find_engine()
        return engine.kind is EngineKind.GODOT4 and engine.version >= _FIRST_GODOT_WITH_UNIX
    return is_bevy_game(game.path) or (exported_version(game.path) or ()) >= _FIRST_GODOT_WITH_UNIX


def _await_engine(
    acceptor: EngineAcceptor, timeout_s: float, check: Callable[[], None]
) -> PendingConnection:
    """Wait for the first engine that proves itself; drop all others.

    Args:
        acceptor: Where engines come; closed afterwards.
        timeout_s: Longest wait, seconds.
        check: Called about ten times a second; raises if waiting has become pointless.

    Raises:
        GreetingRefused: The game has ended, because it was refused.
        EngineTimeout: None came in time.
    """
    deadline = time.monotonic() + timeout_s
    with contextlib.closing(acceptor):
        try:
            while time.monotonic() < deadline:
                if proven := acceptor.await_proven():
                    for other in proven[1:]:
                        other.socket.close()
                    return proven[0]
                check()
        except EngineCrashed as error:
            # The game has printed what it was told; a stranger that was refused has not.
            if acceptor.refusal is not None and acceptor.refusal.message in error.message:
                raise acceptor.refusal from error
            raise
    refused = "" if acceptor.refusal is None else f"; one was refused: {acceptor.refusal}"
    raise EngineTimeout(f"no engine connected within {timeout_s:g} s{refused}")


@functools.cache
def _warn_of_protocol_1(engine: str, upgrade: str) -> None:
    """Say once what an old add-on cannot do."""
    log.warning(
        "the game's add-on (%s, protocol 1) cannot prove who it is; it is trusted because it was "
        "started here: %s",
        engine,
        upgrade,
    )


def _converse(
    connection: PendingConnection,
    timeout_s: float,
    process: EngineProcess | None,
    config: EngineConfig,
    options: LaunchOptions,
) -> EngineSession:
    link = Link(connection.socket, timeout_s, bytes(connection.received))
    supervision = Supervision(process)
    return EngineSession(link, config, supervision, connection.greeting, options.step_timeout_s)


def _command(
    game: Scene | Executable, options: LaunchOptions, user_args: tuple[str, ...]
) -> tuple[str, ...]:
    project = game.project if isinstance(game, Scene) else None
    has_renderer = options.is_windowed or options.has_renderer or options.gives_pictures
    if options.gives_pictures:
        user_args = (*user_args, "--ludus-pictures")
    if options.has_controls:
        user_args = (*user_args, "--ludus-controls")
    if options.has_debug_view:
        user_args = (*user_args, DEBUG_VIEW)
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


def _attach(game: Address, config: EngineConfig, options: LaunchOptions) -> EngineSession:
    token = _token_for(game, options.token)
    try:
        link = connect((game.host, game.port), options.start_timeout_s)
    except OSError as error:
        raise EngineStartError(
            f"no game answers at {game.host}:{game.port}: {error}",
            hint=f"start the game with `-- --ludus-listen={game.host}:{game.port}`",
        ) from error
    return EngineSession(link, config, Supervision(None), Greeting(token), options.step_timeout_s)


def _await_play(game: Play, config: EngineConfig, options: LaunchOptions) -> EngineSession:
    token = options.token or user_token()
    try:
        listener = Listener((game.host, game.port))
    except OSError as error:
        raise EngineStartError(
            f"cannot listen at {game.host}:{game.port}: {error}",
            hint="another trainer may be waiting there; end it first",
        ) from error
    with contextlib.closing(listener):
        acceptor = EngineAcceptor(
            listener.sockets, lambda: Greeting(token), options.start_timeout_s
        )
        connection = _await_engine(acceptor, options.play_timeout_s, lambda: None)
    return _converse(connection, options.start_timeout_s, None, config, options)


def _token_for(game: Address, token: str) -> str:
    """Return the token that a listening game knows: the one given, or this user's."""
    if not is_loopback(game.host) and len(token) < MIN_TOKEN_LENGTH:
        raise EngineStartError(
            f"a game on another machine ({game.host}) needs a token of at least 16 characters",
            hint=_TOKEN_HINT,
        )
    return token or user_token()
