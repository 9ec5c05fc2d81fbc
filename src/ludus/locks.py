"""A lock between processes, held on a file; the system frees it when the holder dies."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from ludus.errors import SetupError

__all__ = ["LockHeld", "file_lock", "try_lock"]

_POLL_S = 0.05


class LockHeld(SetupError):  # noqa: N818 - reads as what happened
    """Another process holds the lock."""


if sys.platform == "win32":
    import msvcrt

    def try_lock(descriptor: int) -> bool:
        """Lock an open file, or on POSIX a folder; return False if another process has it."""
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

    def _unlock(descriptor: int) -> None:
        os.lseek(descriptor, 0, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_UNLCK, 1)

else:
    import fcntl

    def try_lock(descriptor: int) -> bool:
        """Lock an open file, or on POSIX a folder; return False if another process has it."""
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def _unlock(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_UN)


@contextmanager
def file_lock(path: Path, timeout_s: float) -> Generator[None, None, None]:
    """Hold an exclusive lock on ``path``, which is created and left behind empty.

    Raises:
        LockHeld: Somebody else held the lock for ``timeout_s`` seconds.
        OSError: The file cannot be created.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    owner = os.getpid()
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        _wait_for(descriptor, path, timeout_s)
        try:
            yield
        finally:
            if os.getpid() == owner:  # a forked copy shares the lock, and would free it for both
                _unlock(descriptor)
    finally:
        os.close(descriptor)


def _wait_for(descriptor: int, path: Path, timeout_s: float) -> None:
    deadline = time.monotonic() + timeout_s
    while not try_lock(descriptor):
        if time.monotonic() >= deadline:
            raise LockHeld(
                f"another process has held {path} for {timeout_s:.0f} s",
                hint="wait for it, or end it if it hangs",
            )
        time.sleep(_POLL_S)
