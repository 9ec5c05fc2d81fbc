"""Which processor cores the engines and the learner run on.

An engine that is pinned to one core runs up to twice as fast, because its worker threads no
longer wake each other across cores. Platforms without pinning (macOS, Windows) get no plan.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass

from ludus.errors import ConfigError

__all__ = ["CorePlan", "allowed_cores", "pin_current_process", "pinned_to", "plan_cores"]

_pin_lock = threading.Lock()


@dataclass(frozen=True)
class CorePlan:
    """Cores for each engine and for the process that learns.

    Attributes:
        engines: Per engine its cores, or None where cores cannot be chosen.
        learner: Cores of the learner, or None where they cannot be chosen.
    """

    engines: tuple[tuple[int, ...] | None, ...]
    learner: tuple[int, ...] | None


def allowed_cores() -> tuple[int, ...] | None:
    """Return the cores this process may use, or None where they cannot be chosen."""
    if sys.platform != "linux":
        return None
    return tuple(sorted(os.sched_getaffinity(0)))


def plan_cores(num_engines: int, allowed: tuple[int, ...] | None = None) -> CorePlan:
    """Give each engine one core, and the learner what is left.

    With as many engines as cores or more, engines share cores in turn and the learner may use
    all of them.

    Args:
        num_engines: How many engines will run.
        allowed: Cores to divide; by default those this process may use.
    """
    allowed = allowed_cores() if allowed is None else allowed
    if not allowed:
        return CorePlan(engines=(None,) * num_engines, learner=None)
    engines = tuple((allowed[index % len(allowed)],) for index in range(num_engines))
    left = allowed[num_engines:]
    return CorePlan(engines=engines, learner=left or allowed)


def pin_current_process(cores: tuple[int, ...] | None) -> None:
    """Restrict every thread of this process to ``cores``; None changes nothing."""
    if cores is None or sys.platform != "linux":
        return
    for thread in os.listdir("/proc/self/task"):  # noqa: PTH208 - names, not paths
        try:
            os.sched_setaffinity(int(thread), cores)
        except ProcessLookupError:
            continue  # the thread ended meanwhile


@contextmanager
def pinned_to(cores: tuple[int, ...] | None) -> Generator[None, None, None]:
    """Pin the calling thread for a moment, so that a process started meanwhile inherits it.

    A process keeps the affinity of the thread that starts it, and hands it on to every thread
    of its own; no other thread of this process is affected.

    Raises:
        ConfigError: This process may not use one of the cores.
    """
    if not cores or sys.platform != "linux":
        yield
        return
    with _pin_lock:
        before = os.sched_getaffinity(0)
        _pin_thread(cores, before)
        try:
            yield
        finally:
            os.sched_setaffinity(0, before)


def _pin_thread(cores: tuple[int, ...], allowed: set[int]) -> None:
    if sys.platform != "linux":
        return
    try:
        os.sched_setaffinity(0, cores)
    except OSError as error:
        raise ConfigError(
            f"an engine cannot be pinned to cores {list(cores)}: {error.strerror}",
            hint=f"cores this process may use: {sorted(allowed)}",
        ) from error
