"""The process of a bridge's game, if we started it: its script errors, its end."""

from __future__ import annotations

import time
from pathlib import Path

from ludus.engine import EngineProcess, LaunchConfig
from ludus.errors import GameError
from ludus.session.supervision import Supervision

__all__ = ["GameWatch"]

_SCRIPT_ERROR_S = 1.0


class GameWatch(Supervision):
    """Watches the game of a wire that has no word for a mistake.

    Args:
        process: The game; None if somebody else started it.
    """

    def __init__(self, process: EngineProcess | None = None) -> None:
        super().__init__(process)
        self._known_errors: set[str] = set()

    @classmethod
    def start(
        cls,
        command: tuple[str, ...],
        log_path: Path | None = None,
        cores: tuple[int, ...] | None = None,
    ) -> GameWatch:
        """Start a game; it ends with :meth:`close`, and at the latest with this process.

        Raises:
            EngineStartError: It cannot be started.
        """
        return cls(
            EngineProcess.start(LaunchConfig(command=command, log_path=log_path, cores=cores))
        )

    def note_errors(self) -> None:
        """Take the script errors so far for known; new ones explain a missing answer."""
        if self._process is not None:
            self._known_errors = set(self._process.script_errors)

    def check_new_errors(self, began: float) -> None:
        """Raise early if a script has failed since :meth:`note_errors`: no answer will come.

        Args:
            began: When waiting for the answer began, on the clock of ``time.monotonic``, seconds;
                nothing is looked at in the first second.

        Raises:
            GameError: A script has failed; the text holds what the engine printed.
        """
        if self._process is None or time.monotonic() - began < _SCRIPT_ERROR_S:
            return
        if set(self._process.script_errors) - self._known_errors:
            raise GameError(
                f"a script of the game failed:{self.script_errors()}",
                hint="the script and its line stand behind `at:`",
            )

    def report(self) -> str:
        """Return what became of the game, to add to a message; nothing if it is not ours."""
        return "" if self._process is None else f": {self._process.describe_death()}"

    def wait(self, timeout_s: float) -> None:
        """Wait for the end of the game, if it is ours."""
        if self._process is not None:
            self._process.wait(timeout_s)
