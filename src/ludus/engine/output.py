"""Read what a process writes: all of a short tool's output, the last lines of a game's."""

from __future__ import annotations

import logging
import os
import re
import subprocess
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

from ludus.disk import plain_file_opener

__all__ = ["ERROR_MARKS", "OutputDrain", "count_errors", "mark_errors", "run_captured"]

ERROR_MARKS = ("SCRIPT ERROR", "ERROR:", "Parse Error", "USER ERROR", "panicked at", "Traceback")
MAX_LINE_BYTES = 4000
MAX_COUNTED_BYTES = 1 << 26
MAX_REPORT_LINES = 16

_READ_BYTES = 1 << 16
_log = logging.getLogger(__name__)


def run_captured(
    command: Sequence[str], timeout_s: float, env: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a tool to its end; ``stdout`` of the result also holds what it wrote to stderr.

    Args:
        command: Program and arguments.
        timeout_s: How long it may take.
        env: Complete environment; None passes on this process's own.

    Raises:
        OSError: The program cannot be started.
        subprocess.TimeoutExpired: It took too long, and was killed.
    """
    return subprocess.run(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        env=env,
        timeout=timeout_s,
        check=False,
    )


class OutputDrain:
    """A daemon thread that reads a pipe until its end, so that the writer never blocks.

    Args:
        pipe: Read end; the drain closes it.
        num_last_lines: How many lines to keep.
        log_path: File that gets a copy; a full disk ends the copy, not the reading.
    """

    def __init__(self, pipe: IO[bytes], num_last_lines: int, log_path: Path | None) -> None:
        self._pipe = pipe
        self._lines: deque[str] = deque(maxlen=num_last_lines)
        self._partial = b""
        self._has_script_error = False
        self._lock = threading.Lock()
        self._log_file = None if log_path is None else _open_log(log_path)
        self._thread = threading.Thread(target=self._run, name="ludus-output", daemon=True)
        self._thread.start()

    def last_lines(self, count: int | None = None) -> list[str]:
        """Return the newest lines, oldest first; an unfinished line counts."""
        with self._lock:
            lines = list(self._lines)
            if self._partial:
                lines.append(_decode(self._partial))
        return lines if count is None else lines[max(0, len(lines) - count) :]

    def script_errors(self) -> list[str]:
        """Return the errors of the game's scripts, as the engine printed them; cheap if none.

        An error that was printed many times, as by every agent in every tick, is listed once.
        """
        if not self._has_script_error:
            return []
        reports: list[list[str]] = []
        for line in mark_errors(self.last_lines()):
            if not line.startswith("  !"):
                continue
            if not reports or _begins_report(line):
                reports.append([])
            reports[-1].append(line[4:])
        return [line for report in dict.fromkeys(map(tuple, reports)) for line in report]

    def join(self, timeout_s: float) -> None:
        """Wait until everything written has been read."""
        self._thread.join(timeout_s)

    def _run(self) -> None:
        with self._pipe:
            while chunk := self._read():
                self._copy_to_log(chunk)
                with self._lock:
                    text = self._partial + chunk
                    *finished, rest = text.split(b"\n")
                    self._has_script_error |= b"SCRIPT ERROR" in text
                    self._lines.extend(_decode(line) for line in finished)
                    self._partial = rest[-MAX_LINE_BYTES:]
        self._close_log()

    def _read(self) -> bytes:
        try:
            return os.read(self._pipe.fileno(), _READ_BYTES)
        except (OSError, ValueError):
            return b""

    def _copy_to_log(self, chunk: bytes) -> None:
        if self._log_file is None:
            return
        try:
            self._log_file.write(chunk)
        except OSError as error:
            _log.warning("the rest of the engine's log is lost: %s", error)
            self._close_log()

    def _close_log(self) -> None:
        log_file, self._log_file = self._log_file, None
        if log_file is not None:
            log_file.close()


def count_errors(path: Path, start: int = 0) -> dict[str, int]:
    """Return how often each error stands in an engine's log, with the place in the game.

    Args:
        path: The log; one that cannot be read has no errors.
        start: Byte to begin at.
    """
    counts: dict[str, int] = {}
    try:
        with path.open("rb") as file:
            file.seek(start)
            lines = [_decode(line).rstrip() for line in file.read(MAX_COUNTED_BYTES).split(b"\n")]
    except OSError:
        return counts
    for i, line in enumerate(lines):
        if _begins_report(line):
            place = _place_in_game(lines[i + 1 : i + 1 + MAX_REPORT_LINES])
            text = line.partition("ERROR: ")[2] or line
            error = f"{text} ({place})" if place else text
            counts[error] = counts.get(error, 0) + 1
    return counts


def _place_in_game(lines: Sequence[str]) -> str:
    """Return the first place in a script of the game that the lines after an error name."""
    places: list[str] = []
    for line in lines:
        if _begins_report(line) or not line.startswith(" "):
            break
        places += re.findall(r"\((res://[^)]*)\)", line)
    own = [place for place in places if not place.startswith("res://addons/ludus/")]
    return next(iter(own + places), "")


def mark_errors(lines: list[str]) -> list[str]:
    """Put ``!`` before lines that report a mistake (and where it is), ``|`` before the others."""
    marked: list[str] = []
    is_error = False
    for line in lines:
        goes_on = is_error and line.lstrip().startswith(("at:", "GDScript backtrace", "["))
        is_error = goes_on or _begins_report(line)
        marked.append(f"  {'!' if is_error else '|'} {line}")
    return marked


def _begins_report(line: str) -> bool:
    return any(mark in line for mark in ERROR_MARKS)


def _open_log(path: Path) -> IO[bytes] | None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return open(path, "ab", buffering=0, opener=plain_file_opener)
    except OSError as error:
        _log.warning("the engine's log cannot be written: %s", error)
        return None


def _decode(line: bytes) -> str:
    return line[:MAX_LINE_BYTES].decode(errors="replace").rstrip("\r")
