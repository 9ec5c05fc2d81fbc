"""An engine that is a thread: it speaks the protocol as a test tells it to, right or wrong."""

from __future__ import annotations

import contextlib
import json
import socket
import struct
import threading
from collections.abc import Callable, Iterable
from typing import Any

from ludus.link import Link
from ludus.session import EngineSession
from ludus.wire.greeting import Greeting
from tests.wire.golden import load
from tests.wire.reference import (
    FRAME_NUMBERS,
    encode_batch,
    frame,
    json_frame,
    make_proof,
    quiet_batch,
)

HELLO = load("hello").content
TOKEN = "a token of 16 characters"
FLAT = load("spec_flat").content
POLICIES = load("spec_policies").content

_NAMES = {number: name for name, number in FRAME_NUMBERS.items()}
_TIMEOUT_S = 10.0


class Talk:
    """The engine's end of a connection."""

    def __init__(self, connection: socket.socket, spec: dict[str, Any]) -> None:
        connection.settimeout(_TIMEOUT_S)
        self._socket = connection
        self.spec = spec
        self.welcome: dict[str, Any] = {}
        self.received: list[tuple[str, bytes]] = []

    def raw(self, data: bytes) -> None:
        with contextlib.suppress(ConnectionError):  # the trainer may have gone
            self._socket.sendall(data)

    def json(self, name: str, value: Any) -> None:
        self.raw(json_frame(name, value))

    def batch(self, **changes: Any) -> None:
        """Send a ``BATCH`` in which nothing happens, but for ``changes`` of its content."""
        self.raw(self.batch_frame(**changes))

    def batch_frame(self, **changes: Any) -> bytes:
        return frame("BATCH", encode_batch(self.spec, {**quiet_batch(self.spec), **changes}))

    def read(self) -> tuple[str, bytes]:
        """Read one frame; ``("", b"")`` when the trainer has gone."""
        header = self._read_exactly(8)
        if len(header) < 8:
            return "", b""
        num_bytes, number = struct.unpack_from("<IB", header)
        self.received.append((_NAMES[number], self._read_exactly(num_bytes)))
        return self.received[-1]

    def _read_exactly(self, num_bytes: int) -> bytes:
        data = b""
        while len(data) < num_bytes:
            try:
                piece = self._socket.recv(num_bytes - len(data))
            except ConnectionError:
                return b""
            if not piece:
                return b""
            data += piece
        return data

    def greet(self, hello: dict[str, Any] = HELLO) -> None:
        """Go through the handshake, and send the spec."""
        self.json("HELLO", hello)
        self.prove(hello)
        name, payload = self.read()
        assert name == "WELCOME", name
        self.welcome = json.loads(payload)
        self.json("SPEC", self.spec)

    def prove(self, hello: dict[str, Any] = HELLO, token: str = TOKEN) -> None:
        """Answer the challenge that follows a ``HELLO``; ``token`` is what the engine knows."""
        self.answer(hello, *self.read(), token)

    def answer(self, hello: dict[str, Any], name: str, payload: bytes, token: str) -> None:
        """Answer a challenge that was read."""
        assert name == "CHALLENGE", (name, payload)
        challenge = json.loads(payload)
        nonces = hello["nonce"], challenge["nonce"]
        self.json("PROOF", {"proof": make_proof(token, "engine", *nonces)})

    def serve(self) -> None:
        """Answer requests until the trainer goes; a step's entries hold its number."""
        step = 0
        while (name := self.read()[0]) in {"RESET", "STEP", "PING", "CALL"}:
            step = 0 if name == "RESET" else step + 1
            self.raw(frame("BATCH", self._quiet(step, is_reset=name == "RESET")))

    def _quiet(self, step: int, *, is_reset: bool) -> bytes:
        return encode_batch(self.spec, quiet_batch(self.spec, is_reset=is_reset, value=step))

    def wait_for_the_end(self) -> None:
        """Read until the trainer has gone."""
        while self.read()[0]:
            pass

    def close(self) -> None:
        self._socket.close()


class FakeEngine:
    """Runs ``behaviour`` beside the test; :meth:`join` raises what it raised."""

    def __init__(self, behaviour: Callable[[Talk], None], spec: dict[str, Any] = FLAT) -> None:
        self.ours, theirs = socket.socketpair()
        self.talk = Talk(theirs, spec)
        self._behaviour = behaviour
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def link(self, timeout_s: float = 5.0) -> Link:
        """Return the trainer's end."""
        return Link(self.ours, timeout_s)

    def greeting(self) -> Greeting:
        """Return the trainer's part of a greeting that has not begun."""
        return Greeting(TOKEN)

    def join(self) -> None:
        self._thread.join(_TIMEOUT_S)
        assert not self._thread.is_alive(), "the fake engine hangs"
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        try:
            self._behaviour(self.talk)
        except BaseException as error:
            self._error = error
        finally:
            self.talk.close()


def end_all(sessions: Iterable[EngineSession], engines: Iterable[FakeEngine]) -> None:
    """Close the sessions, then wait for their engines, which raise what went wrong there."""
    for session in sessions:
        session.close()
    for engine in engines:
        engine.join()
