"""Looking for bytes without sleeping, and leaving the core alone where that takes long."""

from __future__ import annotations

import itertools
import socket
from collections.abc import Callable, Iterator

import pytest

from ludus.spinner import Spinner

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

    def look_long(self, count: int, pause_s: float) -> None:
        """Look for 4 ms in vain so many times, so many seconds apart."""
        for _ in range(count):
            self.clock.now += pause_s
            self.clock.pauses = iter([0.0, 0.004])
            assert self.read() is None
        self.clock.pauses = QUICK

    def close(self) -> None:
        self.spinner.close()
        self.ours.close()
        self.theirs.close()


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


def test_it_leaves_a_core_that_others_want_for_a_second(spun: Spun) -> None:
    spun.look_long(3, pause_s=0.02)
    spun.theirs.sendall(b"123")
    assert spun.clock.looks(spun.read) == 0
    spun.clock.now += 0.9
    assert spun.clock.looks(spun.read) == 0
    spun.clock.now += 0.1
    assert spun.read() == 3


@pytest.mark.parametrize(("count", "pause_s"), [(2, 0.02), (20, 0.06)])
def test_a_long_look_now_and_then_is_nothing(count: int, pause_s: float, spun: Spun) -> None:
    spun.look_long(count, pause_s)
    assert spun.clock.looks(spun.read) > 0


def test_what_came_late_is_read(spun: Spun) -> None:
    spun.look_long(2, pause_s=0.02)
    spun.theirs.sendall(b"123")
    spun.clock.pauses = iter([0.0, 0.004])
    assert spun.read() == 3
    spun.clock.pauses = QUICK
    assert spun.clock.looks(spun.read) == 0


def test_the_connection_outlives_it(spun: Spun) -> None:
    spun.spinner.close()
    spun.spinner.close()
    spun.theirs.sendall(b"1")
    assert spun.ours.recv(1) == b"1"
