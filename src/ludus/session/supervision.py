"""Watch an engine's process, and explain a broken or silent connection by what became of it."""

from __future__ import annotations

import time

from ludus.engine import EngineProcess
from ludus.errors import EngineCrashed, EngineError, EngineTimeout, GameError

__all__ = ["Supervision"]

_SETTLE_S = 3.0
_OUTPUT_SETTLE_S = 0.1


class Supervision:
    """Watches the process of one engine; does nothing for a game that Ludus did not start."""

    def __init__(self, process: EngineProcess | None) -> None:
        self._process = process

    @property
    def pid(self) -> int | None:
        """Process id; None if the process is not ours."""
        return None if self._process is None else self._process.pid

    def check_alive(self) -> None:
        """Raise if the process has ended.

        Raises:
            EngineCrashed: The text holds exit code, command line and last lines of output.
        """
        if self._process is not None and not self._process.is_alive:
            raise EngineCrashed(
                f"the engine ended before it connected: {self._process.describe_death()}",
                hint="look for errors in the lines above",
            )

    def explain(self, what: str) -> EngineError:
        """Return the error for a connection that ended."""
        if self._process is None:
            return EngineCrashed(what, hint="was the game stopped?")
        self._process.wait(_SETTLE_S)
        return EngineCrashed(
            f"{what}: {self._process.describe_death()}",
            process_exit_code=self._process.poll(),
        )

    def explain_silence(self, error: EngineTimeout) -> EngineTimeout:
        """Return the error for an engine that does not answer."""
        if self._process is None:
            return error
        return EngineTimeout(
            f"{error.message}: {self._process.describe_death()}",
            hint="the game may hang in a loop; if a step really takes longer, raise step_timeout_s",
        )

    def check_script_errors(self) -> None:
        """Raise if the game's scripts have failed.

        Raises:
            GameError: The text holds the lines that the engine printed.
        """
        if self._process is not None and self._process.script_errors:
            time.sleep(_OUTPUT_SETTLE_S)
            raise GameError(
                f"a script of the game failed:{self.script_errors()}",
                hint="`at:` is followed by the script and its line",
            )

    def script_errors(self) -> str:
        """Return what the engine printed about its scripts, as lines to add to a message."""
        if self._process is None:
            return ""
        time.sleep(_OUTPUT_SETTLE_S)
        return "".join(f"\n  {line}" for line in self._process.script_errors)

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.terminate()
