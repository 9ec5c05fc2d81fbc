"""Start a game of Godot RL Agents, and wait until it has connected; Python is the server here."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass

from ludus.errors import EngineTimeout, ProtocolError
from ludus.legacy.conversation import Conversation, Patience
from ludus.legacy.gdrl.messages import (
    ENV_INFO_REQUEST,
    HANDSHAKE,
    EnvInfo,
    is_env_info,
    read_env_info,
)
from ludus.legacy.launching import GameLaunch
from ludus.legacy.length_framing import LengthFraming
from ludus.legacy.listening import await_game, listen
from ludus.link import ByteStream

__all__ = ["Waiting", "open_conversation"]

_INTRODUCTION_S = 15.0
_MAX_MESSAGE_BYTES = 1 << 28
_TAKEN_HINT = "close what uses this port; gdrl:PATH takes a free one"
_ABSENT_HINT = (
    "the scene needs a Sync node whose control_mode is Training, with AIControllers that it "
    "trains; files of Blender are imported only where Blender is; if loading takes longer, "
    "raise start_timeout_s"
)
_SILENCE_HINT = (
    "a game that is paused or hangs never answers; if a step really takes longer, raise "
    "step_timeout_s"
)


@dataclass(frozen=True, kw_only=True)
class Waiting:
    """Where Python waits for a game, and for how long.

    Attributes:
        address: Host and port; port 0 takes a free one.
        start_timeout_s: How long it may take until the game has connected, seconds.
        step_timeout_s: How long an answer may take, seconds.
    """

    address: tuple[str, int] = ("127.0.0.1", 0)
    start_timeout_s: float = 60.0
    step_timeout_s: float = 60.0


def open_conversation(
    launch: GameLaunch, arguments: tuple[str, ...], waiting: Waiting
) -> tuple[Conversation[bytes], EnvInfo]:
    """Start a game and wait until it has connected; return what it says of itself.

    Args:
        launch: How the game is started.
        arguments: What it is told besides the port.
        waiting: Where it connects.

    Raises:
        TargetError: The target cannot be run.
        EngineStartError: The port is taken, or the game never connected.
        EngineCrashed: The game ended before it connected.
        ProtocolError: What it says of itself cannot be read.
    """
    with contextlib.closing(listen(waiting.address, _TAKEN_HINT)) as listener:
        watch = launch.start((f"--port={listener.getsockname()[1]}", *arguments))
        try:
            client = await_game(
                listener, waiting.start_timeout_s, watch, _Introduction, _ABSENT_HINT
            )
        except BaseException:
            watch.close()
            raise
    patience = Patience(waiting.step_timeout_s, _SILENCE_HINT)
    conversation = Conversation(client.stream, client.framing, watch, patience)
    try:
        return conversation, read_env_info(client.message)
    except BaseException:
        conversation.close()
        raise


class _Introduction:
    """A client that is asked who it is, as soon as it has connected."""

    def __init__(self, stream: ByteStream) -> None:
        self.stream = stream
        self.framing = LengthFraming(_MAX_MESSAGE_BYTES)
        self.message = b""
        self._deadline = time.monotonic() + _INTRODUCTION_S
        for request in (HANDSHAKE, ENV_INFO_REQUEST):
            stream.send(self.framing.encode(request), _INTRODUCTION_S)

    def is_game(self, check: Callable[[], None]) -> bool:
        """Take in what has come, without waiting; return whether it has said what it is."""
        if self.stream.is_readable():
            self.framing.feed(self.stream.receive(self._deadline, check))
        elif time.monotonic() > self._deadline:
            raise EngineTimeout("it did not say what it is in time")
        message = self.framing.take()
        if message is None:
            return False
        if not is_env_info(message):
            raise ProtocolError("it answered something else than env_info")
        self.message = message
        return True
