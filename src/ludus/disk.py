"""Files that are either whole or absent, and one error for all that a disk can do."""

from __future__ import annotations

import errno
import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from ludus.errors import RunError

__all__ = ["disk_errors", "sync_folder", "write_atomically", "write_synced"]

FULL = {errno.ENOSPC, errno.EDQUOT}


@contextmanager
def disk_errors(what: str) -> Generator[None, None, None]:
    """Turn an ``OSError`` into a ``RunError`` that says what could not be written.

    Args:
        what: Such as ``"checkpoint runs/x/checkpoints/step-1"``.
    """
    try:
        yield
    except OSError as error:
        is_full = error.errno in FULL
        reason = "the disk is full" if is_full else str(error)
        hint = (
            "free some space; what was saved before is intact"
            if is_full
            else "check that the folder exists and may be written to"
        )
        raise RunError(f"cannot write {what}: {reason}", hint) from error


def write_synced(path: Path, data: bytes) -> None:
    """Write a file and wait until the disk has it."""
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that readers see the old one or the new one, whatever happens."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        write_synced(temporary, data)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Wait until the disk has a folder's list of files; Windows needs and offers no such thing."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
