"""Processes that a round has started: found by a mark in their environment, on Linux."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Iterable
from pathlib import Path

__all__ = ["MARK", "kill_all", "marked_processes"]

MARK = "LUDUS_CAMPAIGN"


def marked_processes(value: str) -> list[int]:
    """Return the ids of the living processes in whose environment :data:`MARK` has ``value``."""
    entry = f"{MARK}={value}".encode()
    found: list[int] = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):  # it has just ended, or is another user's
            if entry in path.read_bytes().split(b"\0"):
                found.append(int(path.parent.name))
    return sorted(found)


def kill_all(pids: Iterable[int]) -> None:
    """End processes by force."""
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
