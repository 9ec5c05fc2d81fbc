"""Typed access to the messages and files of a game, with errors that name the place."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from reprlib import repr as short
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ludus.errors import GameError, ProtocolError

__all__ = ["Fields", "as_numbers", "short"]

MAX_NAME = 100
NUMBERS = {int, float, type(None)}
"""None is what becomes of NaN in Godot's JSON."""

_HINT = "look for a division by zero in get_state, apply_action or get_score"
_NAME = re.compile(r"\w[\w .\-]*")


class Fields:
    """Typed access to one JSON object.

    Args:
        values: The object.
        where: What it is, such as ``"init"``, for messages.
    """

    def __init__(self, values: Mapping[str, Any], where: str) -> None:
        self._values = values
        self.where = where

    def has(self, key: str) -> bool:
        """Return whether there is such a field."""
        return key in self._values

    def all(self) -> Iterable[tuple[str, Any]]:
        """Return all fields."""
        return self._values.items()

    def get(self, key: str) -> Any:
        """Return a field as it is; raise ``ProtocolError`` if it is missing."""
        if key not in self._values:
            had = ", ".join(map(str, list(self._values)[:12])) or "nothing"
            raise ProtocolError(f"{self.where}: {key} is missing; it has {had}")
        return self._values[key]

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text; ``default`` if the field is missing and there is one."""
        if default is not None and key not in self._values:
            return default
        value = self.get(key)
        if not isinstance(value, str):
            raise self.error(key, "a text", value)
        return value

    def name(self, key: str, default: str | None = None) -> str:
        """Return a name that is also one of a file."""
        value = self.text(key, default)
        if not _NAME.fullmatch(value) or len(value) > MAX_NAME:
            letters = "letters, digits, _ - . and blanks"
            raise self.error(key, f"a name of {letters}, {MAX_NAME} at most", value)
        return value

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false; numbers count as in GDScript."""
        value = self._values.get(key, default)
        if not isinstance(value, bool | int | float):
            raise self.error(key, "true or false", value)
        return bool(value)

    def count(self, key: str, low: int, high: int) -> int:
        """Return a whole number in ``[low, high]``; ``5.0`` is one, as Godot makes such."""
        value = self.get(key)
        is_whole = type(value) is int or (isinstance(value, float) and value.is_integer())
        if not is_whole:
            raise self.error(key, "a whole number", value)
        if not low <= value <= high:
            raise self.error(key, f"from {low} to {high}", value)
        return int(value)

    def table(self, key: str) -> dict[str, Any]:
        """Return an object."""
        value = self.get(key)
        if not isinstance(value, dict):
            raise self.error(key, "an object", value)
        return cast(dict[str, Any], value)

    def items(self, key: str) -> list[Any]:
        """Return a list."""
        value = self.get(key)
        if not isinstance(value, list):
            raise self.error(key, "a list", value)
        return cast(list[Any], value)

    def error(self, key: str, expected: str, value: object) -> ProtocolError:
        """Return the error that a field is not what was expected."""
        return ProtocolError(f"{self.where}: {key} must be {expected}, not {short(value)}")


def as_numbers(value: Any, where: str) -> NDArray[np.float32]:
    """Return a flat list of finite numbers as ``float32[n]``.

    Raises:
        ProtocolError: It is not a list of numbers.
        GameError: One of them is NaN, infinite, or too large for 32 bits.
    """
    if not isinstance(value, list):
        raise ProtocolError(f"{where} must be a list of numbers, not {short(value)}")
    items = cast(list[Any], value)
    if not set(map(type, items)) <= NUMBERS:
        index = next(index for index, item in enumerate(items) if type(item) not in NUMBERS)
        raise ProtocolError(f"{where}[{index}] must be a number, not {short(items[index])}")
    return as_finite(items, where)


def as_finite(items: Any, where: str) -> NDArray[np.float32]:
    """Return numbers as an array, None as NaN; errors as :func:`as_numbers`."""
    try:
        with np.errstate(over="ignore"):
            numbers = np.array(items, np.float64).astype(np.float32)
    except OverflowError:  # an integer of more than 308 digits
        raise GameError(f"{where} has a number without bounds", _HINT) from None
    is_wrong = ~np.isfinite(numbers)
    if is_wrong.any():
        index = int(np.flatnonzero(is_wrong)[0])
        what = "NaN" if np.isnan(numbers[index]) else "infinite"
        raise GameError(f"{where}[{index}] is {what}", _HINT)
    return numbers
