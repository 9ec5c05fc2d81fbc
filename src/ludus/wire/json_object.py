"""Typed access to the JSON that an engine sends; every error names the field."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from reprlib import repr as _short
from typing import Any, cast

from ludus.errors import ProtocolError

__all__ = ["JsonObject", "read_objects"]

_MAX_FLOAT = sys.float_info.max


class JsonObject:
    """One JSON object; each method checks one field and raises ``ProtocolError``.

    Whole floats count as integers: Godot's JSON writes every number as a float.

    Args:
        value: What should be an object.
        where: Its place, such as ``spec.policies[0]``, for errors.
        hint: Hint of every error.
    """

    def __init__(self, value: Any, where: str, hint: str = "") -> None:
        self.where, self.hint = where, hint
        if not isinstance(value, dict):
            raise ProtocolError(f"{where}: expected an object, got {_short(value)}", hint)
        self._fields = cast(dict[str, Any], value)

    def error(self, key: str, what: str) -> ProtocolError:
        """Return the error that a field is wrong."""
        return ProtocolError(f"{self.where}.{key}: {what}", self.hint)

    def unexpected(self, key: str, expected: str, value: Any) -> ProtocolError:
        """Return the error that a field has the wrong type or value."""
        return self.error(key, f"expected {expected}, got {_short(value)}")

    def names(self) -> list[str]:
        """Return the names of all fields."""
        return list(self._fields)

    def get(self, key: str) -> Any:
        """Return a required field of any type."""
        if key not in self._fields:
            raise self.error(key, "missing")
        return self._fields[key]

    def optional(self, key: str) -> Any:
        """Return a field of any type, None if it is missing."""
        return self._fields.get(key)

    def integer(self, key: str, low: int, high: int) -> int:
        """Return an integer in ``[low, high]``."""
        value = self.get(key)
        # value // 1 is NaN for infinity, and exact for integers that no float can hold.
        if isinstance(value, bool) or not isinstance(value, int | float) or value != value // 1:
            raise self.unexpected(key, "an integer", value)
        if not low <= value <= high:
            raise self.unexpected(key, f"{low} to {high}", value)
        return int(value)

    def optional_integer(self, key: str, low: int, high: int) -> int | None:
        """Return an integer in ``[low, high]``; None if it is missing or null."""
        return None if self.optional(key) is None else self.integer(key, low, high)

    def number(self, key: str, value: Any) -> float:
        """Return ``value``, the field ``key`` or an element of it, as a finite float."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.unexpected(key, "a number", value)
        if not -_MAX_FLOAT <= value <= _MAX_FLOAT:  # JSON integers may exceed any float
            raise self.unexpected(key, "a finite number", value)
        return float(value)

    def text(self, key: str, default: str | None = None) -> str:
        """Return a string; a missing one is an error unless there is a default."""
        value = self.get(key) if default is None else self._fields.get(key, default)
        if not isinstance(value, str):
            raise self.unexpected(key, "a text", value)
        return value

    def name(self, key: str, max_length: int) -> str:
        """Return a name (PROTOCOL.md §1) of 1 to ``max_length`` characters."""
        value = self.text(key)
        self.check_name(key, value, max_length)
        return value

    def check_name(self, key: str, value: str, max_length: int) -> None:
        """Refuse a string that is no name, the field ``key`` or a key of it."""
        if not 1 <= len(value) <= max_length:
            raise self.unexpected(key, f"a name of 1 to {max_length} characters", value)
        if not value.isprintable() or value != value.strip():
            what = "a name without control characters, and without a space at either end"
            raise self.unexpected(key, what, value)

    def choice(self, key: str, choices: Sequence[str]) -> str:
        """Return one of some strings."""
        value = self.text(key)
        if value not in choices:
            raise self.unexpected(key, f"one of {', '.join(choices)}", value)
        return value

    def flag(self, key: str) -> bool:
        """Return a boolean."""
        value = self.get(key)
        if not isinstance(value, bool):
            raise self.unexpected(key, "true or false", value)
        return value

    def items(self, key: str) -> list[Any]:
        """Return a list of anything."""
        value = self.get(key)
        if not isinstance(value, list):
            raise self.unexpected(key, "a list", value)
        return cast(list[Any], value)

    def child(self, key: str) -> JsonObject:
        """Return an object."""
        return JsonObject(self.get(key), f"{self.where}.{key}", self.hint)

    def children(self, key: str, low: int, high: int) -> list[JsonObject]:
        """Return a list of ``low`` to ``high`` objects."""
        return read_objects(self.get(key), f"{self.where}.{key}", low, high, self.hint)


def read_objects(value: Any, where: str, low: int, high: int, hint: str = "") -> list[JsonObject]:
    """Return the ``low`` to ``high`` objects of a list.

    Raises:
        ProtocolError: It is not such a list.
    """
    if not isinstance(value, list):
        raise ProtocolError(f"{where}: expected a list, got {_short(value)}", hint)
    items = cast(list[Any], value)
    if not low <= len(items) <= high:
        raise ProtocolError(f"{where}: expected {low} to {high} items, got {len(items)}", hint)
    return [JsonObject(item, f"{where}[{i}]", hint) for i, item in enumerate(items)]
