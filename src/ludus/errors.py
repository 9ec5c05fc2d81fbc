"""Every error Ludus raises on purpose.

::

    LudusError
    ├── UsageError            the caller broke a rule (exit code 2)
    │   ├── TargetError       the target does not exist or cannot be run
    │   ├── ConfigError       a setting is unknown, of the wrong type or out of range
    │   ├── SequenceError     a method was called before the one it depends on
    │   ├── ArgumentError     an argument is unknown, or of the wrong type; a TypeError, too
    │   ├── ActionError       an action has the wrong shape, type or value
    │   └── PolicyFileError   a policy file is missing, malformed or contradicts itself
    ├── SetupError            the machine lacks something (exit code 3)
    │   ├── MissingExtra      a package is not installed; an ImportError, too
    │   └── EngineNotFound    no usable game engine on this machine
    ├── EngineError           the engine broke a rule (exit code 4)
    │   ├── EngineStartError  the process did not start or never connected
    │   ├── EngineCrashed     the process died
    │   ├── EngineTimeout     the process did not answer within the deadline
    │   ├── ProtocolError     the engine sent something that PROTOCOL.md does not allow
    │   └── GameError         the game reported a mistake of its own, or sent NaN
    └── RunError              a training run cannot go on (exit code 5)
        ├── MachineLost       a worker of the run died, or does not answer
        ├── CheckpointError   a checkpoint is missing, corrupt or of another spec
        ├── ParityError       an exported policy computes something else than the trained one
        └── DivergenceError   a loss became NaN or infinite
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection

from ludus.printing import printable

__all__ = [
    "ActionError",
    "ArgumentError",
    "CheckpointError",
    "ConfigError",
    "DivergenceError",
    "EngineCrashed",
    "EngineError",
    "EngineNotFound",
    "EngineStartError",
    "EngineTimeout",
    "GameError",
    "LudusError",
    "MachineLost",
    "MissingExtra",
    "ParityError",
    "PolicyFileError",
    "ProtocolError",
    "RunError",
    "SequenceError",
    "SetupError",
    "TargetError",
    "UsageError",
    "did_you_mean",
]


def did_you_mean(name: str, known: Collection[str], heading: str) -> str:
    """Return a hint about an unknown name: the known one most like it, or else all of them."""
    close = [each for each in known if _with_initials(each) == name]
    close = close or difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"did you mean {close[0]}?" if close else f"{heading}: {', '.join(known)}"


def _with_initials(name: str) -> str:
    """Return a name with the first letters of its words: ``ppo.lr`` for ``ppo.learning_rate``."""
    group, dot, last = name.rpartition(".")
    return group + dot + "".join(word[:1] for word in re.split("[-_]", last))


class LudusError(Exception):
    """Base of all errors: what happened, and a hint that says what to do.

    Attributes:
        message: What happened, what was expected, what came, and where.
        hint: What the reader can do about it; empty if nothing is known.
        exit_code: What the ``ludus`` command exits with.
    """

    exit_code = 1

    def __init__(self, message: str, hint: str = "") -> None:
        self.message = printable(message)  # some of it may be what a game said
        self.hint = printable(hint)
        super().__init__(self.message)

    def __str__(self) -> str:
        return f"{self.message}\nhint: {self.hint}" if self.hint else self.message


class UsageError(LudusError):
    """The caller broke a rule."""

    exit_code = 2


class TargetError(UsageError):
    """The target does not exist or cannot be run."""


class ConfigError(UsageError):
    """A setting is unknown, of the wrong type or out of range."""


class SequenceError(UsageError):
    """A method was called before the one it depends on."""


class ArgumentError(UsageError, TypeError):
    """An argument of a function is unknown, or of the wrong type.

    Libraries that try arguments one after the other look for Python's ``TypeError``.
    """


class ActionError(UsageError):
    """An action has the wrong shape, type or value."""


class PolicyFileError(UsageError):
    """A policy file is missing, malformed or contradicts itself (protocol/POLICY.md)."""


class SetupError(LudusError):
    """The machine lacks something that Ludus needs."""

    exit_code = 3


class MissingExtra(SetupError, ImportError):  # noqa: N818 - reads as what happened
    """A package that one feature needs is not installed; the hint installs it."""


class EngineNotFound(SetupError):  # noqa: N818 - reads as what happened
    """No usable game engine was found on this machine."""


class EngineError(LudusError):
    """The engine broke a rule."""

    exit_code = 4


class EngineStartError(EngineError):
    """The engine did not start, or never connected."""


class EngineCrashed(EngineError):  # noqa: N818 - reads as what happened
    """The engine process died; the text holds exit code, command and last log lines.

    Attributes:
        process_exit_code: What the process exited with, negative for a signal; None if it is not
            ours or not known.
    """

    def __init__(self, message: str, hint: str = "", process_exit_code: int | None = None) -> None:
        super().__init__(message, hint)
        self.process_exit_code = process_exit_code


class EngineTimeout(EngineError):  # noqa: N818 - reads as what happened
    """The engine did not answer within the deadline."""


class ProtocolError(EngineError):
    """The engine sent something that PROTOCOL.md does not allow."""


class GameError(EngineError):
    """The game reported a mistake of its own, or sent NaN or a wrong shape."""


class RunError(LudusError):
    """A training run cannot go on."""

    exit_code = 5


class MachineLost(RunError):  # noqa: N818 - reads as what happened
    """A worker of the run, or its machine, died, or does not answer."""


class CheckpointError(RunError):
    """A checkpoint is missing, corrupt, or belongs to another spec."""


class ParityError(RunError):
    """An exported policy computes something else than the trained one."""


class DivergenceError(RunError):
    """A loss became NaN or infinite."""
