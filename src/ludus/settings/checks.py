"""What a setting may be, as metadata of its field; :class:`Settings` holds every field to it."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from ludus.errors import ConfigError

__all__ = [
    "ABOVE_0",
    "AT_LEAST_0",
    "AT_LEAST_1",
    "FROM_0_TO_1",
    "ONLY_1",
    "Check",
    "Settings",
    "one_of",
    "optional",
    "require",
    "setting",
]

T = TypeVar("T")


@dataclass(frozen=True)
class Check:
    """What values of a setting are allowed.

    Attributes:
        expected: Ends the sentence "it must be …".
        is_met: Whether a value is allowed.
    """

    expected: str
    is_met: Callable[[Any], bool]


AT_LEAST_0 = Check("at least 0", lambda value: value >= 0)
AT_LEAST_1 = Check("at least 1", lambda value: value >= 1)
ONLY_1 = Check("1 in this command", lambda value: value == 1)
ABOVE_0 = Check("above 0", lambda value: value > 0)
FROM_0_TO_1 = Check("from 0 to 1", lambda value: 0 <= value <= 1)


def optional(check: Check) -> Check:
    """Return a check that allows None, too."""
    return Check(f"{check.expected} or none", lambda value: value is None or check.is_met(value))


def one_of(values: Collection[str]) -> Check:
    """Return a check that allows these values only."""
    return Check(" or ".join(map(repr, values)), lambda value: value in values)


def setting(default: T, check: Check) -> T:
    """Return a field with a default and a check."""
    made: Any = field(default=default, metadata={"check": check})
    return made


def require(is_met: bool, name: str, expected: str, value: object) -> None:
    """Raise a ``ConfigError`` about a setting unless ``is_met``."""
    if not is_met:
        raise ConfigError(f"{name} must be {expected}, not {value!r}")


@dataclass(frozen=True)
class Settings:
    """Base of all settings.

    Raises:
        ConfigError: A value is not allowed.
    """

    def __post_init__(self) -> None:
        for part in fields(self):
            check = part.metadata.get("check")
            if check is not None:
                value = getattr(self, part.name)
                require(check.is_met(value), part.name, check.expected, value)
