"""Start a GymGodot game, and wait until it has connected; Python is the server here."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass

from ludus.errors import EngineCrashed, EngineTimeout
from ludus.legacy.conversation import Conversation, Patience
from ludus.legacy.gymgodot.framing import WebSocketFraming
from ludus.legacy.launching import GameLaunch
from ludus.legacy.listening import await_game, listen
from ludus.link import ByteStream

__all__ = ["DEFAULT_RENDER_PATH", "Address", "open_conversation"]

DEFAULT_RENDER_PATH = "./render_frames/"
"""Where the game saves frames unless told otherwise; as seen from the game's working folder."""

_HANDSHAKE_S = 5.0
_TAKEN_HINT = (
    "close the environment that uses this port, or choose another serverPort (0 takes a free one)"
)
_ABSENT_HINT = (
    "the scene needs an enabled GymGodot node, and exeCmd must pass on the arguments put at its "
    "end; if loading takes longer, raise start_timeout_s"
)
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
    with contextlib.closing(listen((address.host, address.port), _TAKEN_HINT)) as listener:
        port = int(listener.getsockname()[1])
        arguments = (f"--serverIP={address.host}", f"--serverPort={port}")
        watch = launch.start((*arguments, f"--renderPath={render_path}"))
        try:
            client = await_game(
                listener,
                address.start_timeout_s,
                watch,
                lambda stream: _PendingClient(stream, address.max_message_bytes),
                _ABSENT_HINT,
            )
        except EngineCrashed as error:
            watch.close()
            if _NO_SCREEN in error.message:
                raise EngineCrashed(error.message, RENDERER_HINT) from error
            raise
        except BaseException:
            watch.close()
            raise
    patience = Patience(address.step_timeout_s, _SILENCE_HINT)
    return Conversation(client.stream, client.framing, watch, patience), port


class _PendingClient:
    """A client that has yet to shake hands."""

    def __init__(self, stream: ByteStream, max_message_bytes: int) -> None:
        self.stream = stream
        self.framing = WebSocketFraming(max_message_bytes)
        self._deadline = time.monotonic() + _HANDSHAKE_S

    def is_game(self, check: Callable[[], None]) -> bool:
        """Answer what has come, without waiting; return whether the handshake is over."""
        if self.stream.is_readable():
            data = self.stream.receive(self._deadline, check)
            self.stream.send(self.framing.feed(data), _HANDSHAKE_S)
        elif time.monotonic() > self._deadline:
            raise EngineTimeout("it did not shake hands in time")
        return not self.framing.is_connecting
