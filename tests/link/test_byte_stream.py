"""How long a byte stream waits, whatever its peer does or leaves undone."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator

import pytest

from ludus.errors import EngineTimeout
from ludus.link import ByteStream, LinkClosed

LONG = b"x" * (1 << 24)
"""More than the system keeps for a peer that does not read."""


@pytest.fixture(params=[0.0, 200e-6], ids=["blocking", "polling"])
def ends(request: pytest.FixtureRequest) -> Iterator[tuple[ByteStream, socket.socket]]:
    """Our end of a connection, and the peer's."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        ours = ByteStream(socket.create_connection(listener.getsockname()), spin_s=request.param)
        theirs = listener.accept()[0]
    yield ours, theirs
    ours.close()
    theirs.close()


def nothing() -> None:
    pass


@pytest.mark.slow
def test_check_is_called_four_times_a_second(ends: tuple[ByteStream, socket.socket]) -> None:
    checks: list[float] = []
    start = time.monotonic()
    with pytest.raises(EngineTimeout, match="no answer came in time"):
        ends[0].receive(start + 0.6, lambda: checks.append(time.monotonic() - start))
    assert time.monotonic() - start >= 0.6
    assert 1 <= len(checks) <= 3
    assert checks[0] >= 0.2


def test_short_deadline_is_kept(ends: tuple[ByteStream, socket.socket]) -> None:
    waited = [seconds_without_answer(ends[0], 0.02) for _ in range(5)]
    assert 0.02 <= min(waited) < 0.1  # the best of five: a busy machine makes some longer


def seconds_without_answer(stream: ByteStream, timeout_s: float) -> float:
    start = time.monotonic()
    with pytest.raises(EngineTimeout):
        stream.receive(start + timeout_s, nothing)
    return time.monotonic() - start


def test_check_can_end_the_wait(ends: tuple[ByteStream, socket.socket]) -> None:
    def check() -> None:
        raise RuntimeError("pointless")

    with pytest.raises(RuntimeError, match="pointless"):
        ends[0].receive(time.monotonic() + 60.0, check)


@pytest.mark.slow
def test_peer_that_never_reads_times_out(ends: tuple[ByteStream, socket.socket]) -> None:
    with pytest.raises(EngineTimeout, match=r"the game read nothing for 0\.5 s"):
        ends[0].send(LONG, 0.5)


@pytest.mark.slow
def test_long_message_to_a_peer_that_reads_late(ends: tuple[ByteStream, socket.socket]) -> None:
    ours, theirs = ends
    echo = threading.Thread(target=read_late_and_answer, args=(theirs,))
    echo.start()
    ours.send(LONG, 30.0)
    num_bytes, deadline = 0, time.monotonic() + 30.0
    while num_bytes < len(LONG):
        num_bytes += len(ours.receive(deadline, nothing))
    assert num_bytes == len(LONG)
    assert not ours.is_readable()
    echo.join()


def read_late_and_answer(theirs: socket.socket) -> None:
    time.sleep(0.6)  # two waits of the sender
    with theirs.makefile("rb") as stream:
        theirs.sendall(stream.read(len(LONG)))


def test_is_readable_takes_nothing(ends: tuple[ByteStream, socket.socket]) -> None:
    ours, theirs = ends
    assert not ours.is_readable()
    theirs.sendall(b"\0")
    while not ours.is_readable():
        time.sleep(0.01)
    assert ours.is_readable()
    assert ours.receive(time.monotonic() + 5.0, nothing) == b"\0"


def test_end_of_stream_is_reported(ends: tuple[ByteStream, socket.socket]) -> None:
    ours, theirs = ends
    theirs.shutdown(socket.SHUT_WR)
    with pytest.raises(LinkClosed, match="the game closed the connection"):
        ours.receive(time.monotonic() + 5.0, nothing)
