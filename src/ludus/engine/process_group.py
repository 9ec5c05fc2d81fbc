"""Start a process in its own group, and end the whole group.

On POSIX the group is a session; a process that leaves it on purpose (``setsid``) is not
followed. On Windows the tree of child processes is ended by ``taskkill``.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

__all__ = ["CMD", "ProcessGroup", "pin_group", "windows_command_line"]

CMD = ("cmd", "/d", "/s", "/c")
"""The shell of Windows, without what the user's registry has it run first."""
_POLL_S = 0.005
_REST_GRACE_S = 2.0


class ProcessGroup:
    """A started process and everything it starts.

    Only the process that created this object may end it; in a forked copy `terminate` does
    nothing. All methods may be called from any thread and from a signal handler.

    Args:
        command: Program and arguments.
        env: Complete environment.
        folder: Working folder.

    Raises:
        OSError: The program cannot be started.
    """

    def __init__(self, command: Sequence[str], env: Mapping[str, str], folder: Path | None) -> None:
        self._creator_pid = os.getpid()
        self._lock = threading.RLock()
        self._is_ending = False
        self.popen: subprocess.Popen[bytes] = subprocess.Popen(
            windows_command_line(command) if sys.platform == "win32" else command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=folder,
            env=env,
            bufsize=0,
            start_new_session=sys.platform != "win32",
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )

    @property
    def pid(self) -> int:
        """Id of the process that was started."""
        return self.popen.pid

    @property
    def is_ours(self) -> bool:
        """Whether the calling process created this one."""
        return os.getpid() == self._creator_pid

    def poll(self) -> int | None:
        """Return the exit code (negative: the signal), or None while it runs.

        If the process has died without having been told to end, the rest of its group is
        killed.
        """
        if not self.is_ours:
            return self.popen.returncode
        with self._lock:
            if self.popen.returncode is None and self._has_exited():
                if not self._is_ending:
                    self._signal_group(_KILL)
                self.popen.wait()
            return self.popen.returncode

    def wait(self, timeout_s: float) -> int | None:
        """Wait for the end; return the exit code, or None if it still runs."""
        deadline = time.monotonic() + timeout_s
        while (code := self.poll()) is None and time.monotonic() < deadline:
            time.sleep(_POLL_S)
        return code

    def terminate(self, grace_s: float) -> None:
        """End the group: politely, then by force after ``grace_s`` seconds."""
        if not self.is_ours or self.poll() is not None:
            return
        self._is_ending = True
        self._signal_group(signal.SIGTERM)
        if self.wait(grace_s) is not None and self._is_group_gone(_REST_GRACE_S):
            return
        self._signal_group(_KILL)
        self.wait(grace_s + 5.0)

    def _is_group_gone(self, timeout_s: float) -> bool:
        """Wait for processes it had started to clean up (Xvfb removes its lock file)."""
        if sys.platform == "win32":
            return True
        deadline = time.monotonic() + timeout_s
        while _has_living_member(self.pid):
            if time.monotonic() > deadline:
                return False
            time.sleep(_POLL_S)
        return True

    def _has_exited(self) -> bool:
        """Check without reaping, so that the id of the group cannot be reused."""
        if sys.platform == "win32" or not hasattr(os, "waitid"):
            return self.popen.poll() is not None
        options = os.WEXITED | os.WNOHANG | os.WNOWAIT
        try:
            return os.waitid(os.P_PID, self.pid, options) is not None
        except ChildProcessError:
            return True

    def _signal_group(self, number: int) -> None:
        if sys.platform == "win32":
            subprocess.run(
                ["taskkill", "/F", "/T", "/PID", str(self.pid)],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                check=False,
            )
            return
        # An empty group is not an error; macOS reports it as a lack of permission.
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, number)


def windows_command_line(command: Sequence[str]) -> str:
    """Return a command as Windows takes it: one text.

    ``cmd /s /c`` takes off the first and the last quote of what follows, and reads the rest as it
    stands, so quotes inside may not be escaped as programs written in C want them.
    """
    if tuple(command[:-1]) == CMD:
        return f'{" ".join(CMD)} "{command[-1]}"'
    return subprocess.list2cmdline(command)


def _has_living_member(group: int) -> bool:
    """Tell whether any process of a group still runs.

    A dead one whose parent is dead belongs to the group until the first process of the machine
    reaps it; in a container that may take seconds, or never happen.
    """
    try:
        os.killpg(group, 0)
    except (ProcessLookupError, PermissionError):
        return False
    if sys.platform != "linux":
        return True
    return any(_living_members(group))


def _living_members(group: int) -> Iterator[Path]:
    """Yield the folders in /proc of a group's processes."""
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it has just ended
            text = stat.read_text(encoding="utf-8", errors="replace")
            state, _parent, own_group = text.rpartition(")")[2].split()[:3]  # proc_pid_stat(5)
            if int(own_group) == group and state not in {"Z", "X"}:
                yield stat.parent


def pin_group(group: int, cores: Sequence[int]) -> None:
    """Let all threads of a group's processes run on ``cores`` only; Linux."""
    if sys.platform != "linux":
        return
    for process in _living_members(group):
        threads: list[Path] = []
        with contextlib.suppress(OSError):  # the process has just ended
            threads = list((process / "task").iterdir())
        for thread in threads:
            # The thread has just ended, or the cores were taken from this process (cpusets).
            with contextlib.suppress(OSError):
                os.sched_setaffinity(int(thread.name), cores)


_KILL = getattr(signal, "SIGKILL", signal.SIGTERM)
