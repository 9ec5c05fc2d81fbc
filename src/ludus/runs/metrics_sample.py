"""A few lines out of a ``metrics.jsonl``, however long it is.

A run of days writes hundreds of megabytes; a curve of a few dozen points needs as many lines.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, BinaryIO, cast

__all__ = ["sample_metrics"]

MAX_LINE_BYTES = 1 << 20
TAIL_BYTES = 1 << 16
WHOLE_BYTES = 1 << 18
"""Files up to this size are read as a whole."""


def sample_metrics(path: Path, count: int) -> list[dict[str, Any]]:
    """Return at most ``count`` lines, evenly spaced over the file, and the last one besides.

    What is no metrics of an update is left out: lines cut short by a kill, other people's files.
    """
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            found = _whole(file, count) if size <= WHOLE_BYTES else _spread(file, size, count)
            last = _last(file, size)
    except OSError:
        return []
    if last is not None and (not found or found[-1]["agent_steps"] < last["agent_steps"]):
        found.append(last)
    return found


def _whole(file: BinaryIO, count: int) -> list[dict[str, Any]]:
    file.seek(0)
    found = [line for text in file.read(WHOLE_BYTES).splitlines() if (line := _parse(text))]
    chosen = {len(found) * index // count for index in range(count)} if found else set[int]()
    return [found[index] for index in sorted(chosen)]


def _spread(file: BinaryIO, size: int, count: int) -> list[dict[str, Any]]:
    """Return the lines that begin after ``count`` evenly spaced places of a file."""
    found: list[dict[str, Any]] = []
    read_until = -1
    for index in range(count):
        place = size * index // count
        if place < read_until:
            continue  # the line that was read last reaches beyond
        file.seek(max(0, place - 1))
        if place:
            file.readline(MAX_LINE_BYTES)  # the rest of a line that began before
        line = _parse(file.readline(MAX_LINE_BYTES))
        read_until = file.tell()
        if line is not None:
            found.append(line)
    return found


def _last(file: BinaryIO, size: int) -> dict[str, Any] | None:
    """Return the last whole line."""
    for num_bytes in (TAIL_BYTES, 16 * TAIL_BYTES):
        file.seek(max(0, size - num_bytes))
        for text in reversed(file.read(num_bytes).splitlines()):
            if (line := _parse(text)) is not None:
                return line
        if num_bytes >= size:
            break
    return None


def _parse(text: bytes) -> dict[str, Any] | None:
    """Return a line as :class:`~ludus.runs.metrics.MetricsLog` writes it, None for others."""
    try:
        line: Any = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(line, dict):
        return None
    values = cast(dict[str, Any], line)
    policies, steps = values.get("policies"), values.get("agent_steps")
    is_sound = isinstance(policies, dict) and isinstance(steps, int | float)
    return values if is_sound else None
