"""A screen of its own for a game that is filmed, where the machine has none."""

from __future__ import annotations

import os
import secrets
import shutil
import struct
import sys
import tempfile
import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path

from ludus.engine import EngineProcess, LaunchConfig
from ludus.errors import SetupError

__all__ = ["screen", "variables"]

SIZE = "1920x1200x24"
START_TIMEOUT_S = 20.0
_POLL_S = 0.02
_ANY_FAMILY = 0xFFFF
_COOKIE_NAME = b"MIT-MAGIC-COOKIE-1"


@contextmanager
def screen() -> Generator[None]:
    """Let games that are started inside open a window.

    Where there is no screen, Xvfb is started, which only this user's programs may draw on, and
    ended afterwards.

    Raises:
        SetupError: There is neither a screen nor Xvfb, or Xvfb does not start.
    """
    if sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        yield
        return
    program = shutil.which("Xvfb")
    if program is None:
        raise SetupError(
            "filming needs a screen, and there is neither one nor Xvfb",
            hint="install Xvfb (Debian: apt install xvfb)",
        )
    with tempfile.TemporaryDirectory(prefix="ludus-screen-") as folder:
        authority = Path(folder) / "authority"
        authority.write_bytes(_authority(secrets.token_bytes(16)))
        # With `-terminate` it goes when the game goes, even if nobody is left to end it.
        flags = ("-screen", "0", SIZE, "-nolisten", "tcp", "-terminate", "-auth", str(authority))
        launch = LaunchConfig(command=(program, "-displayfd", "1", *flags))
        with EngineProcess.start(launch) as server:
            display = f":{_await_number(server)}"
            with variables({"DISPLAY": display, "XAUTHORITY": str(authority)}):
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


def _await_number(server: EngineProcess) -> int:
    """Return the number of the display that Xvfb has found free, and prints."""
    deadline = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline:
        for line in server.last_lines():
            if line.strip().isdigit():
                return int(line)
        if server.wait(_POLL_S) is not None:
            break
    raise SetupError(f"Xvfb gave no screen: {server.describe_death()}", hint="try Xvfb by hand")


def _authority(cookie: bytes) -> bytes:
    """Return a file for XAUTHORITY that lets in whoever has the cookie, on any display."""
    fields = (b"", b"", _COOKIE_NAME, cookie)
    return struct.pack(">H", _ANY_FAMILY) + b"".join(
        struct.pack(">H", len(value)) + value for value in fields
    )
