"""What a game that guides its training says of it (PROTOCOL.md §3). No input or output."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from reprlib import repr as _short
from typing import Any, cast

from ludus.errors import ProtocolError
from ludus.wire.frames import MAX_WORLDS

__all__ = ["CAPABILITY", "Training", "read_training"]

CAPABILITY = "guided"
MAX_SEED = 2**63 - 1
MAX_UPDATES = 2**53

_RUN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")


@dataclass(frozen=True)
class Training:
    """What a game wants to be trained like.

    Attributes:
        run: Name of the run; None leaves it to the trainer.
        num_worlds: Worlds to ask for.
        seed: Of a new run; None draws one.
        checkpoint_every_updates: Updates between two checkpoints that are never removed; None
            makes no such ones.
    """

    run: str | None = None
    num_worlds: int = 1
    seed: int | None = None
    checkpoint_every_updates: int | None = None


def read_training(value: Any) -> Training:
    """Read the key ``training`` of a ``HELLO``.

    Raises:
        ProtocolError: It is no object, or a value is of the wrong type or out of range.
    """
    if not isinstance(value, Mapping):
        raise _wrong("training", "an object", value)
    parts = cast(Mapping[str, Any], value)
    return Training(
        run=_run(parts.get("run")),
        num_worlds=_whole(parts, "num_worlds", 1, MAX_WORLDS) or 1,
        seed=_whole(parts, "seed", 0, MAX_SEED),
        checkpoint_every_updates=_whole(parts, "checkpoint_every_updates", 1, MAX_UPDATES),
    )


def _run(value: Any) -> str | None:
    if value is None or (isinstance(value, str) and _RUN.fullmatch(value)):
        return value
    expected = "1 to 64 letters a to z, digits, '-', '_' and '.', first no dot or dash"
    raise _wrong("training.run", expected, value)


def _whole(parts: Mapping[str, Any], name: str, low: int, high: int) -> int | None:
    value = parts.get(name)
    if value is None:
        return None
    # Engines whose JSON knows only floats send whole ones.
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise _wrong(f"training.{name}", f"a whole number from {low} to {high}", value)
    return value


def _wrong(where: str, expected: str, value: Any) -> ProtocolError:
    return ProtocolError(
        f"HELLO.{where}: expected {expected}, got {_short(value)}",
        "look at the settings of the game's LudusTraining",
    )
