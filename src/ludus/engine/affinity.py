"""Which processor cores the engines and the learner run on, agreed upon between processes.

An engine that is pinned to one core runs up to twice as fast, because its worker threads no
longer wake each other across cores. Platforms without pinning (macOS, Windows) get no plan.
Two engines on one core get half of it each, so a pool locks a file per core in the user's cache,
and takes cores that no other pool has locked. The system frees the locks of a process that dies.
"""

from __future__ import annotations

import logging
import os
import socket
import sys
import threading
from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

from ludus.engine.cache import cache_root
from ludus.errors import ConfigError
from ludus.locks import LockHeld, file_lock

__all__ = [
    "CorePlan",
    "ReservedCores",
    "allowed_cores",
    "pinned_to",
    "plan_cores",
    "reserve_cores",
]

_log = logging.getLogger(__name__)

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
    return _plan(num_engines, allowed, allowed[:num_engines], ())


def _plan(
    num_engines: int, allowed: tuple[int, ...], taken: Sequence[int], others: Sequence[int]
) -> CorePlan:
    """Give engines the cores in ``taken`` first, then those of ``others``; what is left learns."""
    order = [*taken, *others] or allowed
    engines = tuple((order[index % len(order)],) for index in range(num_engines))
    left = tuple(core for core in allowed if core not in {*taken, *others})
    return CorePlan(engines=engines, learner=left or allowed)


@dataclass(frozen=True)
class ReservedCores:
    """Cores of a pool, locked until `close`; see :func:`reserve_cores`."""

    plan: CorePlan
    _locks: ExitStack = field(default_factory=ExitStack, repr=False)

    def close(self) -> None:
        """Leave the cores to others; may be called twice."""
        self._locks.close()

    def __enter__(self) -> ReservedCores:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def reserve_cores(num_engines: int) -> ReservedCores:
    """Choose cores as `plan_cores` does, those first that no other pool of this user has locked.

    With fewer free cores than engines, the remaining engines share cores with others. Where the
    cache cannot be written to, nothing is locked, and every pool begins with the first core.
    """
    allowed = allowed_cores()
    root = cache_root()
    if not allowed or root is None:
        return ReservedCores(plan_cores(num_engines, allowed))
    # The cache may lie in a home folder that several machines mount.
    folder = root / "cores" / (socket.gethostname() or "localhost")
    taken: list[int] = []
    others: list[int] = []
    locks = ExitStack()
    for core in allowed:
        if len(taken) == num_engines:
            break
        try:
            locks.enter_context(file_lock(folder / f"core-{core}.lock", timeout_s=0.0))
        except LockHeld:
            others.append(core)
        except OSError as error:
            _log.debug("cores are not agreed upon with other processes: %s", error)
            locks.close()
            return ReservedCores(plan_cores(num_engines, allowed))
        else:
            taken.append(core)
    return ReservedCores(_plan(num_engines, allowed, taken, others), locks)


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
        try:
            os.sched_setaffinity(0, cores)
        except OSError as error:
            raise ConfigError(
                f"an engine cannot be pinned to cores {list(cores)}: {error.strerror}",
                hint=f"cores this process may use: {sorted(before)}",
            ) from error
        try:
            yield
        finally:
            os.sched_setaffinity(0, before)
