"""Which processor cores the engines and the learner run on, agreed upon between processes.

An engine that is pinned to one core runs up to twice as fast, because its worker threads no
longer wake each other across cores. Platforms without pinning (macOS, Windows) get no plan.
Two engines on one core get half of it each, so a pool locks a file per core in the user's cache,
and takes cores that no other pool has locked. With more engines than cores nobody pins, since
engines that may run anywhere crowd onto the cores of those that may not: a pool that finds too few
cores locks ``waiting.lock`` until it gets them, and the others unpin their engines meanwhile. The
system frees the locks of a process that dies.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import sys
import threading
import time
from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from ludus.engine.cache import cache_root
from ludus.engine.process_group import pin_group
from ludus.errors import ConfigError
from ludus.locks import LockHeld, file_lock

__all__ = [
    "CorePlan",
    "ReservedCores",
    "allowed_cores",
    "cpu_quota",
    "num_cores",
    "pinned_to",
    "plan_cores",
    "reserve_cores",
]

_log = logging.getLogger(__name__)

_pin_lock = threading.Lock()

_LOOK_S = 1.0
"""How often a pool looks whether others came or went: it takes some 10 µs."""


@dataclass(frozen=True)
class CorePlan:
    """Cores for each engine and for the process that learns.

    Attributes:
        engines: Per engine its cores, or None where the system chooses.
        learner: Cores of the learner, or None where the system chooses.
    """

    engines: tuple[tuple[int, ...] | None, ...]
    learner: tuple[int, ...] | None


def allowed_cores() -> tuple[int, ...] | None:
    """Return the cores this process may use, or None where they cannot be chosen."""
    if sys.platform != "linux":
        return None
    return tuple(sorted(os.sched_getaffinity(0)))


def cpu_quota(root: Path = Path("/")) -> float | None:
    """Return how many cores' worth of time this process may use; None without a limit.

    Control groups set it: those of containers (`docker run --cpus`, `limits.cpu` of Kubernetes).

    Args:
        root: Where ``/proc`` and ``/sys`` lie.
    """
    quotas: list[float] = []
    with contextlib.suppress(OSError):
        for line in (root / "proc/self/cgroup").read_text().splitlines():
            _, controllers, path = line.split(":", 2)
            if not controllers:
                quotas += _quotas(root / "sys/fs/cgroup", path, "cpu.max")
            elif "cpu" in controllers.split(","):
                quotas += _quotas(root / f"sys/fs/cgroup/{controllers}", path, "cpu.cfs_quota_us")
    return min(quotas, default=None)


def _quotas(mount: Path, path: str, name: str) -> Iterator[float]:
    """Yield the quotas of a control group and those above it."""
    group = mount / path.strip("/")
    # Inside a container the path may be the host's, and the mount the group itself.
    for folder in (group, *group.parents):
        with contextlib.suppress(OSError, ValueError):  # "max": no limit
            words = (folder / name).read_text().split()
            if name != "cpu.max":
                words.append((folder / "cpu.cfs_period_us").read_text())
            if (quota := int(words[0])) > 0:
                yield quota / int(words[1])
        if folder == mount:
            return


def num_cores() -> float:
    """Return how many cores this process may keep busy: fewer than all under a quota."""
    quota = cpu_quota()
    count = len(allowed_cores() or ()) or os.cpu_count() or 1
    return count if quota is None else min(count, quota)


def plan_cores(num_engines: int, allowed: tuple[int, ...] | None = None) -> CorePlan:
    """Give each engine one core, and the learner what is left, or all if nothing is left.

    With more engines than cores nothing is pinned: engines that share cores in turn were measured
    at 0.74 (3 on 2 cores) and 0.89 (4) of the steps that the system's own choice gives.

    Args:
        num_engines: How many engines will run.
        allowed: Cores to divide; by default those this process may use.
    """
    allowed = allowed_cores() if allowed is None else allowed
    if not allowed or num_engines > len(allowed):
        return CorePlan(engines=(None,) * num_engines, learner=None)
    return _plan(allowed[:num_engines], allowed)


def _plan(taken: Sequence[int], allowed: tuple[int, ...], others: Sequence[int] = ()) -> CorePlan:
    """Give the engines the cores in ``taken``; what neither they nor ``others`` have learns."""
    left = tuple(core for core in allowed if core not in {*taken, *others})
    return CorePlan(engines=tuple((core,) for core in taken), learner=left or allowed)


@dataclass
class ReservedCores:
    """Cores of a pool until `close`; see :func:`reserve_cores`.

    Attributes:
        plan: Where its engines run now.
    """

    plan: CorePlan
    _locks: _CoreLocks | None = None
    _last_look: float = 0.0

    def look_again(self) -> bool:
        """Follow other pools that came or went; return whether that changed ``plan``.

        Cheap enough for every step, as it does nothing most of the time.
        """
        now = time.monotonic()
        if self._locks is None or now < self._last_look + _LOOK_S:
            return False
        self._last_look = now
        before = self.plan
        with contextlib.suppress(OSError):  # the cache cannot be written to any more
            self.plan = self._locks.plan()
        return self.plan != before

    def pin(self, pids: Sequence[int | None]) -> None:
        """Move running engines to where ``plan`` has them.

        Args:
            pids: Of each engine the process that leads its group; None if it is not ours.
        """
        for pid, cores in zip(pids, self.plan.engines, strict=True):
            if pid is not None and self._locks is not None:
                pin_group(pid, cores or self._locks.allowed)

    def close(self) -> None:
        """Leave the cores to others; may be called twice."""
        if self._locks is not None:
            self._locks.close()
            self._locks = None

    def __enter__(self) -> ReservedCores:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def reserve_cores(num_engines: int) -> ReservedCores:
    """Choose cores that no other pool of this user has locked, one for each engine.

    Nothing is pinned while fewer are free than there are engines, here or in another pool. Nor
    under a quota of processor time (a container's): the processes it shares the machine with have
    locks of their own, and all would begin with the first core. Where the cache cannot be written
    to, nothing is locked, and every pool begins with the first core.
    """
    allowed, root, quota = allowed_cores(), cache_root(), cpu_quota()
    if not allowed or (quota is not None and quota < len(allowed)):
        return ReservedCores(CorePlan((None,) * num_engines, None))
    if root is None:
        return ReservedCores(plan_cores(num_engines, allowed))
    # The cache may lie in a home folder that several machines mount.
    folder = root / "cores" / (socket.gethostname() or "localhost")
    locks = _CoreLocks(folder, allowed, num_engines)
    try:
        return ReservedCores(locks.plan(), locks, time.monotonic())
    except OSError as error:
        _log.debug("cores are not agreed upon with other processes: %s", error)
        locks.close()
        return ReservedCores(plan_cores(num_engines, allowed))


class _CoreLocks:
    """What one pool has locked: the cores of its engines, or while it waits ``waiting.lock``.

    Args:
        folder: Where the files lie.
        allowed: Cores that this process may use.
        num_engines: How many cores the pool needs.
    """

    def __init__(self, folder: Path, allowed: tuple[int, ...], num_engines: int) -> None:
        self.allowed = allowed
        self._folder = folder
        self._num_engines = num_engines
        self._taken: list[int] = []
        self._others: list[int] = []
        self._cores = ExitStack()
        self._waiting: ExitStack | None = None

    def plan(self) -> CorePlan:
        """Take cores unless some were taken before, and return where engines should run now.

        Raises:
            OSError: The files cannot be locked.
        """
        if self._taken or self._take_cores():
            self._stop_waiting()
            if not self._is_anyone_waiting():
                return _plan(self._taken, self.allowed, self._others)
        elif self._waiting is None:
            self._waiting = self._lock("waiting")  # None: another pool waits, too
        return CorePlan((None,) * self._num_engines, None)

    def close(self) -> None:
        """Free all locks."""
        self._taken = []
        self._cores.close()
        self._stop_waiting()

    def _take_cores(self) -> bool:
        """Lock one core for each engine, or none at all."""
        if self._num_engines > len(self.allowed):
            return False
        taken: list[int] = []
        self._others = []
        with ExitStack() as locks:
            for core in self.allowed:
                if (lock := self._lock(f"core-{core}")) is None:
                    self._others.append(core)
                    continue
                locks.enter_context(lock)
                taken.append(core)
                if len(taken) == self._num_engines:
                    self._cores, self._taken = locks.pop_all(), taken
                    return True
        return False

    def _is_anyone_waiting(self) -> bool:
        # Of two that ask at the same moment one may see the other's lock; it asks again soon.
        lock = self._lock("waiting")
        if lock is not None:
            lock.close()
        return lock is None

    def _stop_waiting(self) -> None:
        if self._waiting is not None:
            self._waiting.close()
            self._waiting = None

    def _lock(self, name: str) -> ExitStack | None:
        """Lock a file; return what frees it, or None if another pool has it."""
        lock = ExitStack()
        try:
            lock.enter_context(file_lock(self._folder / f"{name}.lock", timeout_s=0.0))
        except LockHeld:
            return None
        return lock


@contextmanager
def pinned_to(cores: tuple[int, ...] | None) -> Generator[None, None, None]:
    """Pin the calling thread for a moment, so that a process started meanwhile inherits it.

    A process inherits the affinity of the thread that starts it, and so do all of its threads.
    Other threads of this process are not affected.

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
