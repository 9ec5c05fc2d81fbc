"""The server of godot-ai games: sockets, a thread for each client, deadlines.

Messages are answered one at a time in one thread, for all clients: no locks are needed,
and PyTorch keeps to the number of threads that was set, which it remembers per thread. A client
that breaks the rules is told so and dropped; the others notice nothing.
"""

from __future__ import annotations

import json
import logging
import queue
import socket
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from ludus.errors import EngineTimeout, LudusError, ProtocolError, SetupError
from ludus.link import ByteStream, LinkClosed, is_strangers, listen_tcp
from ludus.serve.godot_ai.json_stream import JsonStream

__all__ = ["Answering", "Server", "ServerConfig"]

POLL_S = 0.1
LINGER_S = 1.0
"""How long a client that is dropped may go on sending."""

log = logging.getLogger(__name__)


class Answering(Protocol):
    """What messages mean."""

    def answer(self, message: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the answer to one message; never raises."""
        ...

    def close(self) -> None:
        """Save what has to be saved; called once, when no message comes any more."""
        ...


@dataclass(frozen=True)
class ServerConfig:
    """Where to listen, and how long to wait.

    Attributes:
        port: TCP port on the loopback address; 0 takes a free one.
        message_timeout_s: How long a client may take to send the rest of a message, or to take an
            answer. Between messages it may be silent for ever.
        max_clients: Most clients at once. With one more, the oldest that has said nothing yet is
            dropped; if all have, the new one is rejected.
    """

    port: int
    message_timeout_s: float = 10.0
    max_clients: int = 32


class Server:
    """Listens from the start; serves in :meth:`run`.

    Attributes:
        port: Where it listens.

    Raises:
        SetupError: The port is taken, or may not be used.
    """

    def __init__(self, config: ServerConfig) -> None:
        self._config = config
        self._socket = _listen(config.port)
        self.port = int(self._socket.getsockname()[1])
        self._requests: queue.SimpleQueue[_Request] = queue.SimpleQueue()
        self._is_stopping = threading.Event()

    def run(self, answering: Answering, is_stopping: Callable[[], bool]) -> None:
        """Serve until ``is_stopping``; then end all connections, and close ``answering``.

        All messages are answered in the thread that calls this.
        """
        acceptor = threading.Thread(target=self._accept_all, name="acceptor", daemon=True)
        acceptor.start()
        try:
            while not is_stopping():
                try:
                    request = self._requests.get(timeout=POLL_S)
                except queue.Empty:
                    continue
                request.answer(answering)
        finally:
            self._is_stopping.set()
            acceptor.join(self._config.message_timeout_s)
            answering.close()

    def _accept_all(self) -> None:
        """Start a thread for each client that comes."""
        clients: list[_Client] = []
        with self._socket:
            while not self._is_stopping.is_set():
                clients = [client for client in clients if client.is_alive()]
                client = self._accept()
                if client is None:
                    continue
                if len(clients) >= self._config.max_clients:
                    silent = next((other for other in clients if other.is_silent), None)
                    if silent is None:
                        client.turn_away(f"{len(clients)} clients are connected already")
                        continue
                    silent.drop()
                    clients.remove(silent)
                clients.append(client)
                client.start()
        for client in clients:
            client.join(self._config.message_timeout_s)

    def _accept(self) -> _Client | None:
        """Wait a moment for a client."""
        try:
            connection, address = self._socket.accept()
        except TimeoutError:
            return None
        except OSError as error:  # the client has gone already, or too many files are open
            log.warning("a client could not be accepted: %s", error)
            time.sleep(POLL_S)
            return None
        if is_strangers(connection):
            log.warning("%s:%d was dropped: it is another user's, or gone", *address[:2])
            connection.close()
            return None
        stream = ByteStream(connection, f"{address[0]}:{address[1]}")
        return _Client(stream, self._config, self._requests, self._is_stopping)


class _Request:
    """A message that waits for its answer."""

    def __init__(self, message: dict[str, Any]) -> None:
        self._message = message
        self._answer: Mapping[str, Any] | None = None
        self._is_done = threading.Event()

    def answer(self, answering: Answering) -> None:
        """Find the answer, and wake up who waits for it."""
        try:
            self._answer = answering.answer(self._message)
        finally:
            self._is_done.set()

    def wait(self, is_stopping: threading.Event) -> Mapping[str, Any] | None:
        """Return the answer, None if there will be none."""
        while not self._is_done.wait(POLL_S):
            if is_stopping.is_set():
                return None
        return self._answer


class _Client(threading.Thread):
    """One connection.

    Attributes:
        is_silent: Whether it has sent no message yet.
    """

    def __init__(
        self,
        stream: ByteStream,
        config: ServerConfig,
        requests: queue.SimpleQueue[_Request],
        is_stopping: threading.Event,
    ) -> None:
        super().__init__(name=stream.peer, daemon=True)
        self.is_silent = True
        self._is_dropped = threading.Event()
        self._stream = stream
        self._timeout_s = config.message_timeout_s
        self._requests = requests
        self._is_stopping = is_stopping
        self._json = JsonStream()
        self._last_error = ""

    def run(self) -> None:
        """Have messages answered until the client goes, breaks the rules, or the server stops."""
        log.info("%s connected", self.name)
        try:
            while (message := self._receive()) is not None:
                self.is_silent = False
                request = _Request(message)
                self._requests.put(request)
                answer = request.wait(self._is_stopping)
                if answer is None:
                    break
                self._log_error(str(answer.get("error", "")))
                self._stream.send(json.dumps(answer).encode(), self._timeout_s)
        except LudusError as error:
            self._refuse(error)
            log.warning("%s was dropped: %s", self.name, error)
        except LinkClosed as error:
            log.info("%s", error)
        else:
            log.info("%s: the connection has ended", self.name)
        finally:
            self._stream.close()

    def drop(self) -> None:
        """Have the connection closed soon, if it still waits for a message."""
        self._is_dropped.set()

    def turn_away(self, reason: str) -> None:
        """End the connection before anything was said."""
        self._refuse(SetupError(reason))
        self._stream.close()

    def _refuse(self, error: LudusError) -> None:
        """Tell the client what is wrong, if it still listens."""
        deadline = time.monotonic() + LINGER_S
        try:
            self._stream.send(json.dumps({"error": str(error)}).encode(), LINGER_S)
            self._stream.shut_down()
            while True:  # closing with unread data would destroy what was sent last
                self._stream.receive(deadline, _do_nothing)
        except (OSError, LinkClosed, EngineTimeout):
            return

    def _receive(self) -> dict[str, Any] | None:
        """Return the next message; None once the client has gone or the server stops.

        Raises:
            ProtocolError: Something else than a message came.
            EngineTimeout: The rest of a message did not come.
            LinkClosed: The connection broke.
        """
        deadline = time.monotonic() + self._timeout_s
        while (message := self._json.take()) is None:
            num_bytes = self._json.num_pending_bytes
            if num_bytes == 0:
                deadline = time.monotonic() + self._timeout_s
            try:
                self._json.feed(self._stream.receive(deadline, self._check_stopping))
            except _Stopping:
                return None
            except EngineTimeout:
                if num_bytes:
                    raise EngineTimeout(
                        f"the rest of a message did not come within {self._timeout_s:g} s; there "
                        f"are {num_bytes} bytes of it"
                    ) from None
            except LinkClosed:
                if num_bytes:
                    text = "the connection ended in the middle of a message"
                    raise ProtocolError(text) from None
                raise
        return message

    def _check_stopping(self) -> None:
        if self._is_stopping.is_set() or self._is_dropped.is_set():
            raise _Stopping

    def _log_error(self, error: str) -> None:
        """Log an error, but not again and again."""
        if error and error != self._last_error:
            log.warning("%s: %s", self.name, error)
        self._last_error = error


class _Stopping(Exception):  # noqa: N818 - an event
    """The server ends, or has dropped this client."""


def _do_nothing() -> None:
    pass


def _listen(port: int) -> socket.socket:
    try:
        listener = listen_tcp(("127.0.0.1", port))
    except (OSError, OverflowError) as error:
        raise SetupError(
            f"cannot listen at 127.0.0.1:{port}: {error}",
            "another server is there, ludus serve or the game's own; end it, or choose --port",
        ) from error
    listener.settimeout(POLL_S)
    return listener
