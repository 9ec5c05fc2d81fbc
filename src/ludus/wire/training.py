"""The training settings of a game that guides its training (PROTOCOL.md §3). No I/O."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from ludus.wire.frames import MAX_WORLDS
from ludus.wire.json_object import JsonObject

__all__ = ["CAPABILITY", "Training", "read_training"]

CAPABILITY = "guided"
MAX_SEED = 2**63 - 1
MAX_UPDATES = 2**53

_RUN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")


@dataclass(frozen=True)
class Training:
    """How a game asks to be trained.

    Attributes:
        run: Name of the run; None: the trainer chooses it.
        num_worlds: Worlds to ask for.
        seed: Seed of a new run; None: random.
        checkpoint_every_updates: Updates between two checkpoints that are kept for good; None: no
            checkpoint is.
    """

    run: str | None = None
    num_worlds: int = 1
    seed: int | None = None
    checkpoint_every_updates: int | None = None


def read_training(value: Any) -> Training:
    """Read the key ``training`` of a ``HELLO``.

    Raises:
        ProtocolError: It is not an object, or a value has the wrong type or is out of range.
    """
    reader = JsonObject(
        value, "HELLO.training", "look at the settings of the game's LudusTraining node"
    )
    run = reader.optional("run")
    if run is not None and not (isinstance(run, str) and _RUN.fullmatch(run)):
        expected = "1 to 64 letters a to z, digits, '_', '-' and '.', the first not '-' or '.'"
        raise reader.unexpected("run", expected, run)
    return Training(
        run=run,
        num_worlds=reader.optional_integer("num_worlds", 1, MAX_WORLDS) or 1,
        seed=reader.optional_integer("seed", 0, MAX_SEED),
        checkpoint_every_updates=reader.optional_integer(
            "checkpoint_every_updates", 1, MAX_UPDATES
        ),
    )
