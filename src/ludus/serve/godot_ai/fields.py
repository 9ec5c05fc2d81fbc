"""Typed access to the messages and files of a game, with errors that name the place."""

from __future__ import annotations

import re
from collections.abc import Iterable
from reprlib import repr as short
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ludus.errors import GameError, ProtocolError
from ludus.wire.json_object import JsonObject

__all__ = ["Fields", "as_numbers", "short"]

MAX_NAME = 100
NUMBERS = {int, float, type(None)}
"""None is what becomes of NaN in Godot's JSON."""

_HINT = "look for a division by zero in get_state, apply_action or get_score"
_NAME = re.compile(r"\w[\w .\-]*")


class Fields(JsonObject):
    """Typed access to one JSON object, for what a game for godot-ai sends."""

    def all(self) -> Iterable[tuple[str, Any]]:
        """Return all fields."""
        return self._fields.items()

    def file_name(self, key: str) -> str:
        """Return a name that is also one of a file."""
        value = self.text(key)
        if not _NAME.fullmatch(value) or len(value) > MAX_NAME:
            letters = "letters, digits, _ - . and blanks"
            raise self.unexpected(key, f"a name of {letters}, {MAX_NAME} at most", value)
        return value

    def is_true(self, key: str, default: bool) -> bool:
        """Return true or false; numbers count as in GDScript."""
        value = self._fields.get(key, default)
        if not isinstance(value, bool | int | float):
            raise self.unexpected(key, "true or false", value)
        return bool(value)


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
