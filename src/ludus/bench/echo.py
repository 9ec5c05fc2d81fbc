"""A bare blocking socket echo between Python and Godot."""

from __future__ import annotations

import contextlib
import socket
import statistics
import time
from pathlib import Path

from ludus.engine import (
    CorePlan,
    EngineKind,
    EngineProcess,
    InstalledEngine,
    LaunchConfig,
    pinned_to,
)
from ludus.link import Listener
from ludus.session.supervision import Supervision

__all__ = ["measure_echo"]

_SCRIPT = Path(__file__).with_name("echo.gd")
_START_TIMEOUT_S = 30.0
_UNIX_SINCE = (4, 6)


def measure_echo(
    engine: InstalledEngine,
    sizes: tuple[int, int],
    num_echoes: int,
    plan: CorePlan,
) -> float | None:
    """Return the median time of an echo, microseconds; None for engines other than Godot 4.

    Args:
        engine: The engine to echo with.
        sizes: Bytes of a request and of an answer.
        num_echoes: How many to time.
        plan: Cores of the engine and of this process.
    """
    if engine.kind is not EngineKind.GODOT4:
        return None
    with contextlib.closing(Listener()) as listener:
        has_unix = engine.version[:2] >= _UNIX_SINCE
        address = listener.addresses[0 if has_unix else -1]
        arguments = (address, str(sizes[0]), str(sizes[1]))
        program = str(engine.executable(headless=True))
        command = (program, "--headless", "-s", str(_SCRIPT), "--", *arguments)
        with EngineProcess.start(LaunchConfig(command=command, cores=plan.engines[0])) as process:
            link = listener.accept(_START_TIMEOUT_S, Supervision(process).check_alive)
            try:
                with pinned_to(plan.learner):
                    return _time_echoes(link.socket, sizes, num_echoes)
            finally:
                link.close()


def _time_echoes(connection: socket.socket, sizes: tuple[int, int], num_echoes: int) -> float:
    request, answer = bytes(sizes[0]), bytearray(sizes[1])
    times: list[float] = []
    for _ in range(num_echoes):
        began = time.perf_counter()
        connection.sendall(request)
        have = 0
        while have < sizes[1]:
            have += connection.recv_into(memoryview(answer)[have:])
        times.append(time.perf_counter() - began)
    return statistics.median(times) * 1e6
