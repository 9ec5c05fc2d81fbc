"""Sockets with deadlines: listen for an engine, or connect to one, and exchange whole frames."""

from __future__ import annotations

import contextlib
import ipaddress
import os
import selectors
import socket
import time
from collections.abc import Callable

from ludus.errors import EngineTimeout, ProtocolError
from ludus.link.busy_poller import BusyPoller
from ludus.locks import TemporaryFolder
from ludus.wire.frames import HEADER_BYTES, FrameType, decode_header

__all__ = ["BACKLOG", "Link", "LinkClosed", "Listener", "connect", "is_loopback", "listen_tcp"]

_POLL_INTERVAL_S = 0.05
BACKLOG = 128
"""A client that does not fit into this queue connects a second later, when TCP tries again."""


class LinkClosed(Exception):  # noqa: N818 - an event, which the session explains
    """The other side has closed the connection."""


class Link:
    """One connection that carries frames.

    Every read and write has the same deadline, in seconds, counted from its beginning.

    Args:
        connection: Open socket.
        timeout_s: That deadline.
        received: What was read of the connection before, and comes first.
    """

    def __init__(self, connection: socket.socket, timeout_s: float, received: bytes = b"") -> None:
        self._socket = connection
        self._poller: BusyPoller | None = None
        self._timeout_s = timeout_s
        self._pending = received
        connection.settimeout(timeout_s)
        if connection.family != getattr(socket, "AF_UNIX", None):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    @property
    def timeout_s(self) -> float:
        """Deadline of every read and write, seconds."""
        return self._timeout_s

    @timeout_s.setter
    def timeout_s(self, value: float) -> None:
        self._timeout_s = value
        self._socket.settimeout(value)

    @property
    def socket(self) -> socket.socket:
        """The socket itself, for measurements below the level of frames."""
        return self._socket

    def send(self, frame: bytes | bytearray) -> None:
        """Send a whole frame.

        Raises:
            LinkClosed: The other side has gone.
            EngineTimeout: It does not read.
        """
        try:
            self._socket.sendall(frame)
        except TimeoutError as error:
            raise EngineTimeout(f"the engine read nothing for {self._timeout_s:g} s") from error
        except OSError as error:
            raise LinkClosed(str(error)) from error

    @property
    def has_pending(self) -> bool:
        """Whether bytes came together with the last frame that do not belong to it."""
        return bool(self._pending)

    def receive_into(self, buffer: bytearray, expected: FrameType) -> int | None:
        """Read one frame, header included, into ``buffer``.

        Returns:
            Length of the payload, which lies behind the 8 bytes of the header. None if another
            frame than the expected one comes, which is then left for :meth:`receive`.

        Raises:
            LinkClosed: The other side has gone.
            EngineTimeout: No whole frame came in time.
            ProtocolError: The header is not allowed, or the frame is larger than ``buffer``.
        """
        have = len(self._pending)
        buffer[:have] = self._pending
        self._pending = b""
        view = memoryview(buffer)
        deadline = time.monotonic() + self._timeout_s
        while have < HEADER_BYTES:
            have += self._read(view[have:], deadline)
        frame_type, num_bytes = decode_header(buffer)
        if frame_type is not expected:
            self._pending = bytes(view[:have])
            return None
        end = HEADER_BYTES + num_bytes
        if end > len(view):
            room = len(view) - HEADER_BYTES
            raise ProtocolError(
                f"{frame_type.name} frame of {num_bytes} bytes, expected at most {room}"
            )
        while have < end:
            have += self._read(view[have:end], deadline)
        if have > end:
            self._pending = bytes(view[end:have])
        return num_bytes

    def receive(self) -> tuple[FrameType, bytes]:
        """Read one frame of any size; returns type and payload. Errors as :meth:`receive_into`."""
        deadline = time.monotonic() + self._timeout_s
        header = self._read_exactly(HEADER_BYTES, deadline)
        frame_type, num_bytes = decode_header(header)
        return frame_type, self._read_exactly(num_bytes, deadline)

    def _read_exactly(self, num_bytes: int, deadline: float) -> bytes:
        data = bytearray(self._pending[:num_bytes])
        self._pending = self._pending[num_bytes:]
        while len(data) < num_bytes:
            piece = bytearray(min(num_bytes - len(data), 1 << 20))
            count = self._read(memoryview(piece), deadline)
            data += piece[:count]
        return bytes(data)

    def spin(self, spin_s: float) -> None:
        """Poll for ``spin_s`` seconds before a read sleeps; :class:`BusyPoller` says when not."""
        if self._poller is not None:
            self._poller.close()
        self._poller = BusyPoller(self._socket, spin_s) if spin_s > 0.0 else None

    def _read(self, view: memoryview, deadline: float) -> int:
        try:
            count = None if self._poller is None else self._poller.read(view)
            if count is None:
                count = self._socket.recv_into(view)
        except TimeoutError as error:
            raise EngineTimeout(f"the engine was silent for {self._timeout_s:g} s") from error
        except OSError as error:
            raise LinkClosed(str(error)) from error
        if count == 0:
            raise LinkClosed("end of stream")
        if time.monotonic() > deadline:
            raise EngineTimeout(f"the engine sent no whole frame within {self._timeout_s:g} s")
        return count

    def close(self) -> None:
        """Close the connection; may be called twice."""
        self._pending = b""
        if self._poller is not None:
            self._poller.close()
        self._socket.close()


class Listener:
    """Waits for one engine, on a Unix socket where there is one, on loopback TCP where that may be.

    Args:
        tcp_address: Host and port; port 0 takes a free one.
        has_tcp: Whether to listen at a port even where there is a Unix socket, which other users
            cannot reach.

    Attributes:
        addresses: Where the engine can connect, best first (PROTOCOL.md §10).
        sockets: What listens there.
    """

    def __init__(
        self, tcp_address: tuple[str, int] = ("127.0.0.1", 0), *, has_tcp: bool = True
    ) -> None:
        self._folder: TemporaryFolder | None = None
        self.sockets: list[socket.socket] = []
        self.addresses: list[str] = []
        is_unix = tcp_address[1] == 0 and hasattr(socket, "AF_UNIX") and self._listen_unix()
        if has_tcp or not is_unix:
            self._listen_tcp(tcp_address)

    def _listen_unix(self) -> bool:
        """Listen in a new folder of this user; return False if its path is too long."""
        self._folder = TemporaryFolder("engine")
        path = self._folder.path / "engine"
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            listener.bind(os.fspath(path))
        except OSError:
            listener.close()
            return False
        listener.listen(BACKLOG)
        self._add(listener, f"unix:{path}")
        return True

    def _listen_tcp(self, address: tuple[str, int]) -> None:
        try:
            listener = listen_tcp(address, BACKLOG)
        except OSError:
            self.close()
            raise
        host, port = listener.getsockname()
        self._add(listener, f"tcp:{host}:{port}")

    def _add(self, listener: socket.socket, address: str) -> None:
        listener.setblocking(False)
        self.sockets.append(listener)
        self.addresses.append(address)

    def accept(self, timeout_s: float, check: Callable[[], None]) -> Link:
        """Wait for the first client, and take it unproven.

        :class:`~ludus.link.acceptor.EngineAcceptor` asks for a proof.

        Args:
            timeout_s: Longest wait, seconds; also the deadline of the link.
            check: Called every 50 ms; raises if waiting has become pointless.

        Raises:
            EngineTimeout: Nothing connected in time.
        """
        deadline = time.monotonic() + timeout_s
        with selectors.DefaultSelector() as selector:
            for listener in self.sockets:
                selector.register(listener, selectors.EVENT_READ)
            while time.monotonic() < deadline:
                for key, _ in selector.select(_POLL_INTERVAL_S):
                    with contextlib.suppress(BlockingIOError, ConnectionError):
                        listener = key.fileobj
                        assert isinstance(listener, socket.socket)
                        return Link(listener.accept()[0], timeout_s)
                check()
        raise EngineTimeout(f"no engine connected within {timeout_s:g} s")

    def close(self) -> None:
        """Stop listening; links that were accepted stay."""
        for listener in self.sockets:
            listener.close()
        self.sockets.clear()
        if self._folder is not None:
            self._folder.close()
            self._folder = None


def connect(address: tuple[str, int], timeout_s: float) -> Link:
    """Connect to an engine that listens.

    Raises:
        OSError: Nothing listens there, or it did not answer in time.
    """
    return Link(socket.create_connection(address, timeout_s), timeout_s)


def is_loopback(host: str) -> bool:
    """Return whether a host, as a name or a number, is this machine and no other."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def listen_tcp(address: tuple[str, int], backlog: int = 16) -> socket.socket:
    """Listen at an address; port 0 takes a free one.

    Raises:
        OSError: Somebody listens there already, or the address is not of this machine.
        OverflowError: That is no port.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        if os.name == "posix":  # elsewhere it would let two servers share a port
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(backlog)
    except BaseException:
        listener.close()
        raise
    return listener
