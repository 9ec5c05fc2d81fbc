"""Requests to one running game and its answers: deadlines, errors that explain, one way to end."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from ludus.errors import (
    EngineCrashed,
    EngineError,
    EngineTimeout,
    GameError,
    ProtocolError,
    SequenceError,
)
from ludus.legacy.launching import GameWatch
from ludus.link import ByteStream, LinkClosed

__all__ = ["Conversation", "Framing", "Patience"]

_NUM_SHOWN = 60

Message = TypeVar("Message")
Message_co = TypeVar("Message_co", covariant=True)
Answer = TypeVar("Answer")


class Framing(Protocol[Message_co]):
    """How a wire cuts its stream of bytes into messages; no input or output happens here."""

    def encode(self, payload: bytes) -> bytes:
        """Return the bytes of one request; raises ``LinkClosed`` if the peer has said goodbye."""
        ...

    def feed(self, data: bytes) -> bytes:
        """Take in bytes of any length; return what the wire itself answers, mostly nothing."""
        ...

    def take(self) -> Message_co | None:
        """Return the next whole message, None if there is none.

        Raises:
            ProtocolError: The game broke the wire, or its message is too long.
            LinkClosed: The game has ended the conversation.
        """
        ...

    @property
    def has_pending(self) -> bool:
        """Whether part of a message has come."""
        ...


@dataclass(frozen=True)
class Patience:
    """How long to wait for a game, and what to advise when it does not come or go on.

    Attributes:
        step_timeout_s: How long an answer may take, seconds.
        silence_hint: For a game that does not answer.
        gone_hint: Hint when a game that we did not start disconnects.
    """

    step_timeout_s: float
    silence_hint: str
    gone_hint: str = "was the game stopped?"


class Conversation(Generic[Message]):
    """Sends requests, and receives an answer to each.

    Any error in between closes the conversation, and ends the game if we started it; every later
    request raises ``SequenceError``.

    Args:
        stream: Open connection; closed with this object.
        framing: How the wire is cut into messages.
        watch: The game's process, if it is ours; ended with this object.
        patience: Deadlines.
    """

    def __init__(
        self, stream: ByteStream, framing: Framing[Message], watch: GameWatch, patience: Patience
    ) -> None:
        self._stream: ByteStream | None = stream
        self._framing = framing
        self._watch = watch
        self._patience = patience
        self._request, self._began = b"", 0.0

    @property
    def pid(self) -> int | None:
        """Process id of the game; None if it is not ours."""
        return self._watch.pid

    def ask(self, request: bytes, read: Callable[[Message], Answer]) -> Answer:
        """Send a request and return what ``read`` makes of its answer."""
        self.send(request)
        return self.receive(read)

    def send(self, request: bytes) -> None:
        """Send a request and return at once.

        Raises:
            SequenceError: The conversation is closed.
            EngineCrashed: The game died, or hung up.
            EngineTimeout: It does not read.
            ProtocolError: It sent something that nobody had asked for.
        """
        stream = self._open_stream()
        try:
            stream = self._prepare(stream)
            self._request, self._began = request, time.monotonic()
            stream.send(self._framing.encode(request), self._patience.step_timeout_s)
        except (LinkClosed, EngineTimeout) as error:
            raise self._explain(stream, error) from error
        except BaseException:
            self.close()
            raise

    def receive(self, read: Callable[[Message], Answer]) -> Answer:
        """Wait for the answer to :meth:`send`; return what ``read`` makes of it.

        Raises:
            SequenceError: The conversation is closed.
            EngineCrashed: The game died, or hung up.
            EngineTimeout: It did not answer.
            ProtocolError: It broke its wire.
            GameError: A script of it failed.
        """
        message = self._await_message()
        try:
            return read(message)
        except BaseException:
            self.close()
            raise

    def note_errors(self) -> None:
        """Take the script errors so far for known; new ones explain a missing answer."""
        self._watch.note_errors()

    def say_goodbye(self, request: bytes, timeout_s: float) -> None:
        """Ask the game to quit, and wait until it has hung up and, if it is ours, ended."""
        stream = self._open_stream()
        deadline = time.monotonic() + timeout_s
        try:
            stream.send(self._framing.encode(request), timeout_s)
        except (LinkClosed, EngineTimeout):
            return
        with contextlib.suppress(LinkClosed, EngineTimeout, ProtocolError, GameError):
            while True:
                self._feed(stream, deadline)
                self._framing.take()
        self._disconnect()
        self._watch.wait(timeout_s)

    def close(self) -> None:
        """End the conversation, and the game if we started it; may be called twice."""
        self._disconnect()
        self._watch.close()

    @property
    def is_open(self) -> bool:
        """Whether requests can be sent."""
        return self._stream is not None

    def _disconnect(self) -> None:
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.close()

    def _await_message(self) -> Message:
        stream = self._open_stream()
        deadline = self._began + self._patience.step_timeout_s
        try:
            while (message := self._framing.take()) is None:
                self._feed(stream, deadline)
        except (LinkClosed, EngineTimeout) as error:
            raise self._explain(stream, error) from error
        except BaseException:
            # After an interrupt between request and answer, the two sides are out of step.
            self.close()
            raise
        return message

    def _prepare(self, stream: ByteStream) -> ByteStream:
        """Return the stream for the next request, on which nothing may be under way."""
        if stream.is_readable():
            self._feed(stream, time.monotonic() + self._patience.step_timeout_s)
        if self._framing.take() is not None or self._framing.has_pending:
            raise ProtocolError(f"{stream.peer} sent an answer that nobody had asked for")
        return stream

    def _feed(self, stream: ByteStream, deadline: float) -> None:
        reply = self._framing.feed(stream.receive(deadline, self._check))
        if reply:
            stream.send(reply, self._patience.step_timeout_s)

    def _open_stream(self) -> ByteStream:
        if self._stream is None:
            raise SequenceError(
                "the game is closed, or an error ended it", hint="make a new environment"
            )
        return self._stream

    def _check(self) -> None:
        self._watch.check_new_errors(self._began)

    def _explain(self, stream: ByteStream, error: LinkClosed | EngineTimeout) -> EngineError:
        """Close the conversation; return the error that says what became of the game."""
        patience = self._patience
        self._disconnect()  # a game may end only once we have hung up
        try:
            if isinstance(error, LinkClosed):
                if self._watch.pid is None:
                    return EngineCrashed(str(error), patience.gone_hint)
                return self._watch.explain(str(error))
            silent = EngineTimeout(
                f"{stream.peer} did not answer {_shown(self._request)} within "
                f"{patience.step_timeout_s:g} s",
                hint=patience.silence_hint,
            )
            return self._watch.explain_silence(silent)
        finally:
            self.close()


def _shown(request: bytes) -> str:
    text = request.split(b"\r\n", 1)[0].decode(errors="replace")
    return text if len(text) <= _NUM_SHOWN else f"{text[:_NUM_SHOWN]}…"
