"""Looking for bytes without sleeping, and leaving the core alone where that is in vain."""

from __future__ import annotations

import itertools
import socket
from collections.abc import Callable, Iterator

import pytest

from ludus.link.busy_poller import BusyPoller

SPIN_S = 0.003
QUICK = itertools.repeat(0.000_01)
"""Seconds between two looks on a core of one's own."""


class Clock:
    """Goes on by the next of some pauses each time it is read."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.num_polls = 0
        self.pauses: Iterator[float] = QUICK

    def __call__(self) -> float:
        self.now += next(self.pauses)
        self.num_polls += 1
        return self.now

    def polls(self, read: Callable[[], object]) -> int:
        """Return how often one read polled."""
        before = self.num_polls
        assert read() is None
        return self.num_polls - before - 1


class PolledSocket:
    """A poller with a clock of its own, and the other end of its connection."""

    def __init__(self, spin_s: float = SPIN_S) -> None:
        self.ours, self.theirs = socket.socketpair()
        self.clock = Clock()
        self.poller = BusyPoller(self.ours, spin_s, self.clock)
        self.buffer = bytearray(10)

    def read(self) -> int | None:
        return self.poller.read(memoryview(self.buffer))

    def poll_empty(self, count: int, pause_s: float) -> None:
        """Poll `count` times while nothing arrives, `pause_s` apart."""
        for _ in range(count):
            self.clock.now += pause_s
            assert self.read() is None

    def be_preempted(self, count: int) -> None:
        """Read `count` times, losing the core for 2 ms each time."""
        for _ in range(count):
            self.theirs.sendall(b"1")
            self.clock.pauses = iter([0.0, 0.002])
            assert self.read() == 1
        self.clock.pauses = QUICK

    def rest(self, seconds: float) -> None:
        """Let a backoff of `seconds` pass."""
        self.clock.now += 0.98 * seconds
        assert self.clock.polls(self.read) == 0
        self.clock.now += 0.02 * seconds

    def close(self) -> None:
        self.poller.close()
        self.ours.close()
        self.theirs.close()


def late(polled: PolledSocket) -> Iterator[float]:
    """Send three bytes the next time the clock is read."""
    polled.theirs.sendall(b"123")
    yield from QUICK


@pytest.fixture
def polled() -> Iterator[PolledSocket]:
    made = PolledSocket()
    yield made
    made.close()


def test_polling_lasts_as_long_as_asked(polled: PolledSocket) -> None:
    assert polled.clock.polls(polled.read) == pytest.approx(SPIN_S / 0.000_01, abs=2)


def test_data_and_end_of_stream_are_read(polled: PolledSocket) -> None:
    polled.theirs.sendall(b"123")
    assert polled.read() == 3
    assert bytes(polled.buffer[:3]) == b"123"
    polled.theirs.close()
    assert polled.read() == 0


def test_repeated_preemption_stops_polling(polled: PolledSocket) -> None:
    polled.be_preempted(6)
    polled.rest(0.1)
    polled.theirs.sendall(b"123")
    assert polled.read() == 3


def test_backoff_doubles_up_to_one_second(polled: PolledSocket) -> None:
    for backoff_s in (0.1, 0.2, 0.4, 0.8, 1.0, 1.0):
        polled.be_preempted(6)
        polled.rest(backoff_s)
    polled.clock.now += 1.0
    polled.be_preempted(6)
    polled.rest(0.1)


def test_repeated_empty_polls_stop_polling(polled: PolledSocket) -> None:
    polled.poll_empty(6, pause_s=0.01)
    assert polled.clock.polls(polled.read) == 0


@pytest.mark.parametrize(("count", "pause_s"), [(5, 0.01), (20, 0.03)])
def test_rare_empty_polls_are_tolerated(count: int, pause_s: float, polled: PolledSocket) -> None:
    polled.poll_empty(count, pause_s)
    assert polled.clock.polls(polled.read) > 0


def test_rare_preemption_is_tolerated(polled: PolledSocket) -> None:
    polled.be_preempted(5)
    assert polled.clock.polls(polled.read) > 0


def test_slow_polls_that_find_data_are_tolerated(polled: PolledSocket) -> None:
    for _ in range(20):
        polled.clock.pauses = itertools.chain([0.0], itertools.repeat(0.0009, 3), late(polled))
        assert polled.read() == 3
    polled.clock.pauses = QUICK
    assert polled.clock.polls(polled.read) > 0


def test_closing_leaves_the_connection_open(polled: PolledSocket) -> None:
    polled.poller.close()
    polled.poller.close()
    polled.theirs.sendall(b"1")
    assert polled.ours.recv(1) == b"1"
