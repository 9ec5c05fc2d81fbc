"""Files that are either whole or absent, read with care, and one error for what a disk can do."""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

from ludus.errors import RunError

__all__ = ["disk_errors", "parse_json", "plain_file_opener", "read_json", "read_plain_file",
           "sync_folder", "write_atomically", "write_synced"]  # fmt: skip

FULL = {errno.ENOSPC, errno.EDQUOT}
MAX_DEPTH = 64
"""Of JSON files: Python gives up at about 1000, elsewhere in each version."""


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
    """Write a new file and wait until the disk has it; what is in its place goes first.

    A link there is not followed: a project or a run from somebody else may have one.
    """
    path.unlink(missing_ok=True)
    with path.open("xb") as file:
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


def plain_file_opener(path: str, flags: int) -> int:
    """Open plain files only; ``opener`` of Python's ``open``.

    A pipe in the place of a file would be waited for, and a device might do anything.

    Raises:
        OSError: There is something else at ``path``, or it cannot be opened.
    """
    descriptor = os.open(path, flags | getattr(os, "O_NONBLOCK", 0), 0o666)
    if stat.S_ISREG(os.fstat(descriptor).st_mode):
        return descriptor
    os.close(descriptor)
    raise OSError(errno.EINVAL, "not a plain file", path)


def read_plain_file(path: Path, max_bytes: int | None = None) -> bytes:
    """Return what a plain file holds.

    Raises:
        OSError: It is missing, no plain file, longer than ``max_bytes``, or may not be read.
    """
    with open(path, "rb", opener=plain_file_opener) as file:
        data = file.read() if max_bytes is None else file.read(max_bytes + 1)
    if max_bytes is not None and len(data) > max_bytes:
        raise OSError(errno.EFBIG, f"longer than {max_bytes} bytes", str(path))
    return data


def read_json(path: Path, max_bytes: int | None = None) -> Any:
    """Return the value in a JSON file.

    Raises:
        OSError: As :func:`read_plain_file`.
        ValueError: It is not JSON, or nested too deeply.
    """
    return parse_json(read_plain_file(path, max_bytes))


def parse_json(data: bytes) -> Any:
    """Return a JSON value; raise ``ValueError`` if it is not JSON, or nested too deeply."""
    try:
        value: Any = json.loads(data)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if _is_deeper(value, MAX_DEPTH):
        raise ValueError("nested too deeply")
    return value


def _is_deeper(value: Any, max_depth: int) -> bool:
    """Return whether lists and objects are nested more than ``max_depth`` deep."""
    level: list[Any] = [value]
    for _ in range(max_depth + 1):
        inner: list[Any] = []
        for item in level:
            if isinstance(item, dict):
                inner += cast(dict[str, Any], item).values()
            elif isinstance(item, list):
                inner += cast(list[Any], item)
        level = inner
    return bool(level)
