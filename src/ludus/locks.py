"""A lock between processes, held on a file; the system frees it when the holder dies."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Self

from ludus.errors import SetupError

__all__ = ["LockHeld", "TemporaryFolder", "file_lock", "try_lock"]

_POLL_S = 0.05
_HELD = ".held"
_FOLDER_FLAGS = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_DIRECTORY", 0)


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


class TemporaryFolder:
    """A new folder in the system's temporary directory, removed when closed.

    Its process holds a lock on it. A folder whose process was killed is removed when any process
    of the same user makes its next one; not on Windows, where folders cannot be locked.

    Args:
        purpose: Part of its name.

    Attributes:
        path: The folder, empty at first.
    """

    def __init__(self, purpose: str) -> None:
        _remove_abandoned_folders()
        new = Path(tempfile.mkdtemp(prefix=".ludus-"))
        self._descriptor = -1
        if os.name == "posix":
            self._descriptor = os.open(new, _FOLDER_FLAGS)
            with suppress(OSError):  # a file system without locks: nobody removes it then
                try_lock(self._descriptor)
        # Only now does it have a name that others look at.
        unique = new.name.removeprefix(".ludus-")
        self.path = new.rename(new.with_name(f"ludus-{purpose}-{unique}{_HELD}"))

    def close(self) -> None:
        """Remove the folder; may be called twice."""
        shutil.rmtree(self.path, ignore_errors=True)
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _remove_abandoned_folders() -> None:
    if os.name != "posix":
        return
    for path in Path(tempfile.gettempdir()).glob(f"ludus-*{_HELD}"):
        with suppress(OSError):  # it has just gone, or is another user's
            descriptor = os.open(path, _FOLDER_FLAGS)
            try:
                is_ours = os.fstat(descriptor).st_uid == os.geteuid()
                if is_ours and try_lock(descriptor):
                    shutil.rmtree(path, ignore_errors=True)
            finally:
                os.close(descriptor)
