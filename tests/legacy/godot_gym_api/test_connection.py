"""How long a connection waits, whatever its game does or leaves undone."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator

import pytest

from ludus.errors import EngineTimeout
from ludus.legacy.godot_gym_api.connection import Connection

LONG = b"x" * (1 << 24)
"""More than the system keeps for a game that does not read."""


@pytest.fixture
def ends() -> Iterator[tuple[Connection, socket.socket]]:
    """Our end of a connection, and the game's."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        ours = Connection(socket.create_connection(listener.getsockname()), len(LONG))
        theirs = listener.accept()[0]
    yield ours, theirs
    ours.close()
    theirs.close()


def test_a_check_now_and_then(ends: tuple[Connection, socket.socket]) -> None:
    checks: list[float] = []
    start = time.monotonic()
    with pytest.raises(EngineTimeout, match="no answer came in time"):
        ends[0].receive(start + 0.6, lambda: checks.append(time.monotonic() - start))
    assert time.monotonic() - start >= 0.6
    assert 1 <= len(checks) <= 3
    assert checks[0] >= 0.2


def test_a_short_wait_is_short(ends: tuple[Connection, socket.socket]) -> None:
    waited = [seconds_without_answer(ends[0], 0.02) for _ in range(5)]
    assert 0.02 <= min(waited) < 0.1  # the best of five: a busy machine makes some longer


def seconds_without_answer(connection: Connection, timeout_s: float) -> float:
    start = time.monotonic()
    with pytest.raises(EngineTimeout):
        connection.receive(start + timeout_s, lambda: None)
    return time.monotonic() - start


def test_a_check_ends_the_wait(ends: tuple[Connection, socket.socket]) -> None:
    def check() -> None:
        raise RuntimeError("pointless")

    with pytest.raises(RuntimeError, match="pointless"):
        ends[0].receive(time.monotonic() + 60.0, check)


def test_a_game_that_does_not_read(ends: tuple[Connection, socket.socket]) -> None:
    with pytest.raises(EngineTimeout, match=r"the game read nothing for 0\.5 s"):
        ends[0].send(LONG, 0.5)


def test_a_long_request_to_a_game_that_reads_late(ends: tuple[Connection, socket.socket]) -> None:
    ours, theirs = ends
    echo = threading.Thread(target=read_late_and_answer, args=(theirs,))
    echo.start()
    ours.send(LONG, 30.0)
    assert ours.receive(time.monotonic() + 30.0, lambda: None) == LONG
    assert not ours.has_unread()
    echo.join()


def read_late_and_answer(theirs: socket.socket) -> None:
    time.sleep(0.6)  # two waits of the sender
    with theirs.makefile("rb") as stream:
        theirs.sendall(stream.read(4 + len(LONG)))


def test_what_nobody_asked_for(ends: tuple[Connection, socket.socket]) -> None:
    ours, theirs = ends
    assert not ours.has_unread()
    theirs.sendall(b"\0")
    while not ours.has_unread():
        time.sleep(0.01)
    assert ours.has_unread()  # to look takes nothing


def test_an_end_is_nothing_unread(ends: tuple[Connection, socket.socket]) -> None:
    ours, theirs = ends
    theirs.shutdown(socket.SHUT_WR)
    time.sleep(0.1)
    assert not ours.has_unread()
