"""The content of an ``ERROR`` frame (PROTOCOL.md §9). No input or output."""

from __future__ import annotations

from ludus.errors import (
    EngineTimeout,
    GameError,
    LudusError,
    ProtocolError,
    SequenceError,
    UsageError,
)
from ludus.wire.handshake import GreetingRefused

__all__ = ["error_report"]

_CODES: tuple[tuple[type[LudusError], str], ...] = (
    (GameError, "game"),
    (ProtocolError, "frame"),
    (EngineTimeout, "timeout"),
    (SequenceError, "sequence"),
    (UsageError, "config"),
)
"""First match wins; any other error is ``internal``."""


def error_report(error: LudusError) -> dict[str, str]:
    """Return the content of the frame that reports ``error``."""
    if isinstance(error, GreetingRefused):
        return {"code": error.code, "message": error.message, "hint": error.hint}
    code = next((code for kind, code in _CODES if isinstance(error, kind)), "internal")
    return {"code": code, "message": error.message, "hint": error.hint}
