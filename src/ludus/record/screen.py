"""A screen for what this process itself draws on, where the machine has none."""

from __future__ import annotations

import os
import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager

from ludus.engine import EngineProcess, LaunchConfig, has_screen, with_display
from ludus.errors import SetupError

__all__ = ["screen", "variables"]

START_TIMEOUT_S = 20.0
_POLL_S = 0.02
# Tells where the screen is, and keeps it until the process that asked for it is gone.
_HOLD = 'echo "$DISPLAY $XAUTHORITY"; while kill -0 "$0" 2> /dev/null; do sleep 1; done'


@contextmanager
def screen() -> Generator[None]:
    """Let this process, and games that are started inside, open windows.

    Where there is no screen, Xvfb is started, which only this user's programs may draw on, and
    ended afterwards.

    Raises:
        SetupError: There is neither a screen nor Xvfb, or Xvfb does not start.
    """
    if has_screen():
        yield
        return
    command = with_display(("/bin/sh", "-c", _HOLD, str(os.getpid())))
    with EngineProcess.start(LaunchConfig(command=command)) as server:
        display, _, authority = _await_answer(server).partition(" ")
        with variables({"DISPLAY": display, "XAUTHORITY": authority}):
            yield


@contextmanager
def variables(values: Mapping[str, str]) -> Generator[None]:
    """Set environment variables for what is started inside."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _await_answer(server: EngineProcess) -> str:
    deadline = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline:
        for line in server.last_lines():
            if line.startswith(":"):
                return line.strip()
        if server.wait(_POLL_S) is not None:
            break
    raise SetupError(
        f"Xvfb did not provide a screen: {server.describe_death()}",
        hint="start Xvfb by hand to see why",
    )
