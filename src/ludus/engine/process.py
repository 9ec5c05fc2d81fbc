"""Run one game process: start it pinned, drain its output, end it and all it started."""

from __future__ import annotations

import os
import shlex
import signal
import weakref
from pathlib import Path

from ludus.engine.affinity import pinned_to
from ludus.engine.launch import LaunchConfig
from ludus.engine.output import OutputDrain, mark_errors
from ludus.engine.process_group import ProcessGroup
from ludus.errors import EngineStartError

__all__ = ["EngineProcess"]

NUM_SHOWN_LINES = 20

_DRAIN_TIMEOUT_S = 1.0
# States of a process's first thread: proc_pid_stat(5).
_STATES = dict(R="computing", S="asleep", D="waiting for a disk", T="stopped", t="stopped")


class EngineProcess:
    """A running game.

    It is ended by `terminate`, by leaving the ``with`` block, when the object is collected,
    and when Python exits, whichever comes first. An unhandled SIGTERM ends Python without any of
    this; the game then ends itself, since its trainer is gone.

    A forked copy of this object can observe the process but does not end it.
    """

    def __init__(self, config: LaunchConfig, group: ProcessGroup, output: OutputDrain) -> None:
        self._config = config
        self._group = group
        self._output = output
        self._finalizer = weakref.finalize(self, group.terminate, config.grace_s)

    @classmethod
    def start(cls, config: LaunchConfig) -> EngineProcess:
        """Start a process.

        Raises:
            EngineStartError: The program is missing or cannot be executed.
            ConfigError: It cannot be pinned to the cores asked for.
        """
        env = {**os.environ, **config.env}
        try:
            with pinned_to(config.cores):
                group = ProcessGroup(config.command, env, config.folder)
        except (OSError, ValueError) as error:
            raise EngineStartError(
                f"the engine cannot be started: {error}\ncommand: {shlex.join(config.command)}",
                hint="check that the program exists and is executable (ludus engine doctor)",
            ) from error
        pipe = group.popen.stdout
        assert pipe is not None
        return cls(config, group, OutputDrain(pipe, config.num_last_lines, config.log_path))

    @property
    def pid(self) -> int:
        """Process id of the engine."""
        return self._group.pid

    @property
    def is_alive(self) -> bool:
        """Whether the process still runs."""
        return self.poll() is None

    def poll(self) -> int | None:
        """Return the exit code, negative for a signal, or None while it runs."""
        return self._group.poll()

    def wait(self, timeout_s: float) -> int | None:
        """Wait for the end; return the exit code, or None if it still runs."""
        return self._group.wait(timeout_s)

    def last_lines(self, count: int | None = None) -> list[str]:
        """Return the newest lines the process wrote, oldest first."""
        self._await_rest()
        return self._output.last_lines(count)

    @property
    def script_errors(self) -> list[str]:
        """The errors of the game's scripts, as the engine printed them; cheap if none."""
        self._await_rest()
        return self._output.script_errors()

    def describe_death(self) -> str:
        """Say how the process ended, with its command line and its last lines of output.

        Lines that report a mistake are marked by ``!``, and shown even if other lines followed.
        """
        code = self.poll()
        activity = _describe_activity(self.pid) if code is None else ""
        marked = mark_errors(self.last_lines())
        last, earlier = marked[-NUM_SHOWN_LINES:], marked[:-NUM_SHOWN_LINES]
        errors = [line for line in earlier if line.startswith("  !")][-NUM_SHOWN_LINES:]
        lines = [
            _describe_exit(code) + activity,
            f"command: {shlex.join(self._config.command)}",
            *(["errors it reported before:", *errors] if errors else []),
            "last lines of its output:",
            *(last or ["  (none)"]),
        ]
        return "\n".join(lines)

    def _await_rest(self) -> None:
        """Wait until the last output of a process that has ended is read."""
        if self._group.popen.returncode is not None:
            self._output.join(_DRAIN_TIMEOUT_S)

    def terminate(self) -> None:
        """End the process and all it started; politely, then by force. Harmless if repeated."""
        self._group.terminate(self._config.grace_s)
        if self._group.is_ours:
            self._finalizer.detach()
            self._output.join(_DRAIN_TIMEOUT_S)

    def __enter__(self) -> EngineProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.terminate()

    def __repr__(self) -> str:
        return f"<EngineProcess {self.pid} {_describe_exit(self.poll())}>"


_WINDOWS_ERROR = 0xC0000000
"""Exit codes of Windows from here on are errors (NTSTATUS), which no program chooses."""
_WINDOWS_ERRORS = {
    0xC0000005: "access violation",
    0xC000001D: "illegal instruction",
    0xC00000FD: "stack overflow",
    0xC0000135: "a DLL is missing",
    0xC000013A: "Ctrl-C, or its window was closed",
    0xC0000374: "heap corruption",
    0xC0000409: "it aborted",
}


def _describe_exit(code: int | None) -> str:
    if code is None:
        return "the process is still running"
    if code >= _WINDOWS_ERROR:
        what = _WINDOWS_ERRORS.get(code, "an error of Windows")
        return f"the process crashed with status 0x{code:08X} ({what})"
    if code >= 0:
        return f"the process ended with exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"the process was killed by {name}"


def _describe_activity(pid: int) -> str:
    """Say what a running process does, on Linux: one in a loop computes, one in a lock sleeps."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    state, user_ticks, system_ticks = fields[0], int(fields[11]), int(fields[12])
    cpu_s = (user_ticks + system_ticks) / os.sysconf("SC_CLK_TCK")
    return f" ({_STATES.get(state, state)}, {cpu_s:.1f} s of processor time so far)"
