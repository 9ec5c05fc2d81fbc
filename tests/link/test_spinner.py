"""Looking for bytes without sleeping, and leaving the core alone where that is in vain."""

from __future__ import annotations

import itertools
import socket
from collections.abc import Callable, Iterator

import pytest

from ludus.link.busy_poller import Spinner

SPIN_S = 0.003
QUICK = itertools.repeat(0.000_01)
"""Seconds between two looks on a core of one's own."""


class Clock:
    """Goes on by the next of some pauses each time it is read."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.num_looks = 0
        self.pauses: Iterator[float] = QUICK

    def __call__(self) -> float:
        self.now += next(self.pauses)
        self.num_looks += 1
        return self.now

    def looks(self, read: Callable[[], object]) -> int:
        """Return how often one read looked."""
        before = self.num_looks
        assert read() is None
        return self.num_looks - before - 1


class Spun:
    """A spinner with a clock of its own, and the other end of its connection."""

    def __init__(self, spin_s: float = SPIN_S) -> None:
        self.ours, self.theirs = socket.socketpair()
        self.clock = Clock()
        self.spinner = Spinner(self.ours, spin_s, self.clock)
        self.buffer = bytearray(10)

    def read(self) -> int | None:
        return self.spinner.read(memoryview(self.buffer))

    def look_in_vain(self, count: int, pause_s: float) -> None:
        """Look so many times while nothing comes, so many seconds apart."""
        for _ in range(count):
            self.clock.now += pause_s
            assert self.read() is None

    def lose_core(self, count: int) -> None:
        """Find something so many times, each time after 2 ms on another core."""
        for _ in range(count):
            self.theirs.sendall(b"1")
            self.clock.pauses = iter([0.0, 0.002])
            assert self.read() == 1
        self.clock.pauses = QUICK

    def rest(self, seconds: float) -> None:
        """Let a respite pass that takes so long."""
        self.clock.now += 0.98 * seconds
        assert self.clock.looks(self.read) == 0
        self.clock.now += 0.02 * seconds

    def close(self) -> None:
        self.spinner.close()
        self.ours.close()
        self.theirs.close()


def late(spun: Spun) -> Iterator[float]:
    """Send three bytes the next time the clock is read."""
    spun.theirs.sendall(b"123")
    yield from QUICK


@pytest.fixture
def spun() -> Iterator[Spun]:
    made = Spun()
    yield made
    made.close()


def test_it_looks_for_as_long_as_it_may(spun: Spun) -> None:
    assert spun.clock.looks(spun.read) == pytest.approx(SPIN_S / 0.000_01, abs=2)


def test_it_takes_what_is_there_and_sees_the_end(spun: Spun) -> None:
    spun.theirs.sendall(b"123")
    assert spun.read() == 3
    assert bytes(spun.buffer[:3]) == b"123"
    spun.theirs.close()
    assert spun.read() == 0


def test_it_leaves_a_core_that_it_loses(spun: Spun) -> None:
    spun.lose_core(6)
    spun.rest(0.1)
    spun.theirs.sendall(b"123")
    assert spun.read() == 3


def test_it_rests_longer_where_it_soon_loses_the_core_again(spun: Spun) -> None:
    for respite_s in (0.1, 0.2, 0.4, 0.8, 1.0, 1.0):
        spun.lose_core(6)
        spun.rest(respite_s)
    spun.clock.now += 1.0
    spun.lose_core(6)
    spun.rest(0.1)


def test_it_rests_where_looking_is_in_vain(spun: Spun) -> None:
    spun.look_in_vain(6, pause_s=0.01)
    assert spun.clock.looks(spun.read) == 0


@pytest.mark.parametrize(("count", "pause_s"), [(5, 0.01), (20, 0.03)])
def test_in_vain_now_and_then_is_nothing(count: int, pause_s: float, spun: Spun) -> None:
    spun.look_in_vain(count, pause_s)
    assert spun.clock.looks(spun.read) > 0


def test_to_lose_the_core_now_and_then_is_nothing(spun: Spun) -> None:
    spun.lose_core(5)
    assert spun.clock.looks(spun.read) > 0


def test_a_long_look_on_a_core_of_its_own_is_nothing(spun: Spun) -> None:
    for _ in range(20):
        spun.clock.pauses = itertools.chain([0.0], itertools.repeat(0.0009, 3), late(spun))
        assert spun.read() == 3
    spun.clock.pauses = QUICK
    assert spun.clock.looks(spun.read) > 0


def test_the_connection_outlives_it(spun: Spun) -> None:
    spun.spinner.close()
    spun.spinner.close()
    spun.theirs.sendall(b"1")
    assert spun.ours.recv(1) == b"1"
