"""Start a GymGodot game, and wait until it has connected; Python is the server here."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass

from ludus.errors import EngineCrashed, EngineStartError, EngineTimeout, ProtocolError
from ludus.legacy.conversation import Conversation, Patience
from ludus.legacy.gymgodot.framing import WebSocketFraming
from ludus.legacy.launching import GameLaunch, GameWatch
from ludus.link import ByteStream, LinkClosed, is_strangers, listen_tcp

__all__ = ["DEFAULT_RENDER_PATH", "Address", "open_conversation"]

DEFAULT_RENDER_PATH = "./render_frames/"
"""Where the game saves frames unless told otherwise; as seen from the game's working folder."""

_POLL_S = 0.01
_HANDSHAKE_S = 5.0
_MAX_PENDING = 64
"""With one more, the oldest is dropped: a game shakes hands at once."""
_NO_SCREEN = "Display is not available"
_SILENCE_HINT = (
    "a game that is paused or hangs never answers; if a step really takes longer, raise "
    "step_timeout_s"
)
RENDERER_HINT = (
    "saving frames takes a renderer: run godot3, not godot3-server, on a desktop or in "
    "`xvfb-run -a -s '-screen 0 1280x1024x24' godot3 …`"
)


@dataclass(frozen=True, kw_only=True)
class Address:
    """Where Python waits for a game, and for how long.

    Attributes:
        host: Address to listen at.
        port: Port there; 0 takes a free one.
        max_message_bytes: Longest message that the game may send.
        start_timeout_s: How long it may take until the game has connected, seconds.
        step_timeout_s: How long an answer may take, seconds.
    """

    host: str = "127.0.0.1"
    port: int = 0
    max_message_bytes: int
    start_timeout_s: float = 60.0
    step_timeout_s: float = 60.0


def open_conversation(
    launch: GameLaunch, address: Address, render_path: str = DEFAULT_RENDER_PATH
) -> tuple[Conversation[bytes], int]:
    """Start a game and wait until it has connected; return the conversation and the port.

    Args:
        launch: How the game is started.
        address: Where it connects.
        render_path: What the game puts before the number of a saved frame.

    Raises:
        TargetError: The target cannot be run.
        EngineStartError: The port is taken, or the game never connected.
        EngineCrashed: The command ended before the game connected.
    """
    with contextlib.closing(_listen(address.host, address.port)) as listener:
        port = int(listener.getsockname()[1])
        arguments = (f"--serverIP={address.host}", f"--serverPort={port}")
        watch = launch.start((*arguments, f"--renderPath={render_path}"))
        try:
            stream, framing = _await_game(listener, address, watch)
        except BaseException:
            watch.close()
            raise
    patience = Patience(address.step_timeout_s, _SILENCE_HINT)
    return Conversation(stream, framing, watch, patience), port


def _listen(host: str, port: int) -> socket.socket:
    try:
        return listen_tcp((host, port))
    except OSError as error:
        raise EngineStartError(
            f"cannot wait for a game at {host}:{port}: {error.strerror or error}",
            hint="close the environment that uses this port, or choose another serverPort "
            "(0 takes a free one)",
        ) from error


def _await_game(
    listener: socket.socket, address: Address, watch: GameWatch
) -> tuple[ByteStream, WebSocketFraming]:
    """Wait for a game; other clients are disconnected, and none keeps the game waiting."""
    deadline = time.monotonic() + address.start_timeout_s
    refused = ""
    pending: list[_PendingClient] = []
    listener.setblocking(False)
    try:
        while time.monotonic() < deadline:
            _check_alive(watch)
            refused = _accept(listener, address, pending) or refused
            for client in list(pending):
                try:
                    if client.has_shaken_hands(watch.check_alive):
                        pending.remove(client)
                        return client.stream, client.framing
                except (ProtocolError, EngineTimeout, LinkClosed) as error:
                    refused = f"; what did connect was no game: {error}"
                    pending.remove(client)
                    client.stream.close()
            time.sleep(_POLL_S)
    finally:
        for client in pending:
            client.stream.close()
    raise EngineStartError(
        f"no game connected within {address.start_timeout_s:g} s{refused} at "
        f"{address.host}:{listener.getsockname()[1]}{watch.report()}",
        hint="the scene needs an enabled GymGodot node, and exeCmd must pass on the "
        "arguments put at its end; if loading takes longer, raise start_timeout_s",
    )


def _accept(listener: socket.socket, address: Address, pending: list[_PendingClient]) -> str:
    """Accept a client, if there is one; return why it was rejected, if it was."""
    try:
        connection, _ = listener.accept()
    except (BlockingIOError, ConnectionError):
        return ""
    except OSError as error:  # too many files are open
        return f"; a connection could not be accepted: {error.strerror}"
    if is_strangers(connection):
        connection.close()
        return "; what did connect was another user's program"
    pending.append(
        _PendingClient(ByteStream(connection), WebSocketFraming(address.max_message_bytes))
    )
    if len(pending) > _MAX_PENDING:
        pending.pop(0).stream.close()
    return ""


class _PendingClient:
    """A client that has yet to shake hands."""

    def __init__(self, stream: ByteStream, framing: WebSocketFraming) -> None:
        self.stream = stream
        self.framing = framing
        self._deadline = time.monotonic() + _HANDSHAKE_S

    def has_shaken_hands(self, check: Callable[[], None]) -> bool:
        """Answer what has come, without waiting; return whether the handshake is over."""
        if self.stream.is_readable():
            data = self.stream.receive(self._deadline, check)
            self.stream.send(self.framing.feed(data), _HANDSHAKE_S)
        elif time.monotonic() > self._deadline:
            raise EngineTimeout("it did not shake hands in time")
        return not self.framing.is_connecting


def _check_alive(watch: GameWatch) -> None:
    try:
        watch.check_alive()
    except EngineCrashed as error:
        if _NO_SCREEN in error.message:
            raise EngineCrashed(error.message, RENDERER_HINT) from error
        raise
