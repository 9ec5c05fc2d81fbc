"""What a setting may be, as metadata of its field; :class:`Settings` holds every field to it."""

from __future__ import annotations

import functools
import types
import typing
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, fields, is_dataclass
from numbers import Integral, Real
from pathlib import Path
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
    """Base of all settings. A text is taken where a path is expected.

    Raises:
        ConfigError: A value has the wrong type or is not allowed.
    """

    def __post_init__(self) -> None:
        kinds = _kinds(type(self))
        for part in fields(self):
            value = getattr(self, part.name)
            if part.name in kinds:
                value = _require_kind(part.name, value, kinds[part.name])
                object.__setattr__(self, part.name, value)
            check = part.metadata.get("check")
            if check is not None:
                require(check.is_met(value), part.name, check.expected, value)


_NAMES: dict[type, str] = {
    int: "a whole number", float: "a number", bool: "true or false", str: "a text",
    Path: "a path", types.NoneType: "none", tuple: "a tuple",
}  # fmt: skip


@functools.cache
def _kinds(of: type[Settings]) -> dict[str, tuple[type, ...]]:
    """Return the types that fields may have, where classes can tell."""
    kinds: dict[str, tuple[type, ...]] = {}
    for name, hint in typing.get_type_hints(of).items():
        is_union = typing.get_origin(hint) in {types.UnionType, typing.Union}
        options = typing.get_args(hint) if is_union else (hint,)
        classes = [tuple if typing.get_origin(one) is tuple else one for one in options]
        if all(one in _NAMES or is_dataclass(one) for one in classes):
            kinds[name] = tuple(classes)
    return kinds


def _require_kind(name: str, value: Any, kinds: tuple[type, ...]) -> Any:
    """Return ``value`` as one of ``kinds``; NumPy's numbers become Python's."""
    if isinstance(value, str) and str not in kinds and Path in kinds:
        return Path(value)
    expected = " or ".join(_NAMES.get(kind, kind.__name__) for kind in kinds)
    if isinstance(value, bool):
        require(bool in kinds, name, expected, value)
    elif int in kinds and isinstance(value, Integral):
        return int(value)
    elif float in kinds and isinstance(value, Real):
        return float(value)
    require(isinstance(value, kinds), name, expected, value)
    return value
