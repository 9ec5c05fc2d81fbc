"""Typed access to the JSON of a policy file, with errors that name the field."""

from __future__ import annotations

import base64
import math
import sys
from collections.abc import Callable
from reprlib import repr as short
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from ludus.errors import PolicyFileError
from ludus.model.checking import MAX_PARAMETERS

__all__ = ["Fields", "is_number", "short"]

_MAX_ITEMS = 64
_MAX_DIMENSIONS = 4
_MAX_FLOAT = sys.float_info.max

Part = TypeVar("Part")


class Fields:
    """Typed access to one JSON object, with errors that name the place."""

    def __init__(self, value: Any, where: str) -> None:
        self._where = where
        if not isinstance(value, dict):
            place = where.removesuffix(".") or "the whole"
            kind = type(value).__name__
            raise PolicyFileError(f"policy file: {place}: expected an object, got {kind}")
        self._object = cast(dict[str, Any], value)

    def error(self, key: str, what: str) -> PolicyFileError:
        """Return the error that names a field."""
        return PolicyFileError(
            f"policy file: {self._where}{key}: {what}",
            hint="export the policy again with `ludus export`",
        )

    def get(self, key: str) -> Any:
        """Return a field as it is."""
        if key not in self._object:
            raise self.error(key, "missing")
        return self._object[key]

    def text(self, key: str) -> str:
        """Return a text."""
        value = self.get(key)
        if not isinstance(value, str):
            raise self.error(key, f"expected a text, got {short(value)}")
        return value

    def flag(self, key: str) -> bool:
        """Return true or false."""
        value = self.get(key)
        if not isinstance(value, bool):
            raise self.error(key, f"expected true or false, got {short(value)}")
        return value

    def number(self, key: str) -> float:
        """Return a finite number."""
        return self._finite(key, self.get(key))

    def integer(self, key: str, low: int, high: int) -> int:
        """Return an integer between two bounds."""
        value = self.number(key)
        if value != value // 1 or not low <= value <= high:
            raise self.error(key, f"expected an integer from {low} to {high}, got {value}")
        return int(value)

    def pair(self, key: str) -> tuple[float, float]:
        """Return two finite numbers."""
        value = self._list(key)
        if len(value) != 2:
            raise self.error(key, f"expected two numbers, got {short(value)}")
        return self._finite(key, value[0]), self._finite(key, value[1])

    def part(self, key: str) -> Fields:
        """Return an object inside this one."""
        return Fields(self.get(key), f"{self._where}{key}.")

    def optional(self, key: str, read: Callable[[Fields], Part]) -> Part | None:
        """Read an object inside this one, or return None where it is null."""
        return None if self.get(key) is None else read(self.part(key))

    def parts(self, key: str, read: Callable[[Fields], Part]) -> tuple[Part, ...]:
        """Read a list of objects."""
        values = self._list(key)
        if len(values) > _MAX_ITEMS:
            raise self.error(key, f"expected at most {_MAX_ITEMS} items, got {len(values)}")
        places = (f"{self._where}{key}[{i}]." for i in range(len(values)))
        return tuple(
            read(Fields(value, place)) for value, place in zip(values, places, strict=True)
        )

    def tensor(self, key: str) -> NDArray[np.float32]:
        """Return the numbers of ``{"shape": …, "data": …}``."""
        return self.part(key)._as_tensor()

    def _as_tensor(self) -> NDArray[np.float32]:
        sizes = self._list("shape")
        if not 1 <= len(sizes) <= _MAX_DIMENSIONS:
            raise self.error("shape", f"expected 1 to {_MAX_DIMENSIONS} sizes, got {len(sizes)}")
        shape = tuple(self._size(size) for size in sizes)
        if math.prod(shape) > MAX_PARAMETERS:
            raise self.error("shape", f"more than {MAX_PARAMETERS} numbers")
        try:
            data = base64.b64decode(self.text("data"), validate=True)
        except ValueError as error:
            raise self.error("data", f"no base64: {error}") from error
        if len(data) != 4 * math.prod(shape):
            expected = f"{4 * math.prod(shape)} bytes for {list(shape)} float32"
            raise self.error("data", f"expected {expected}, got {len(data)}")
        return np.frombuffer(data, "<f4").reshape(shape).astype(np.float32)

    def _size(self, value: Any) -> int:
        if not is_number(value) or value != value // 1 or not 0 <= value <= MAX_PARAMETERS:
            raise self.error("shape", f"expected sizes, got {short(value)}")
        return int(value)

    def _list(self, key: str) -> list[Any]:
        value = self.get(key)
        if not isinstance(value, list):
            raise self.error(key, f"expected a list, got {short(value)}")
        return cast(list[Any], value)

    def _finite(self, key: str, value: Any) -> float:
        if not is_number(value) or not -_MAX_FLOAT <= value <= _MAX_FLOAT:
            raise self.error(key, f"expected a finite number, got {short(value)}")
        return float(value)


def is_number(value: Any) -> bool:
    """Return whether a JSON value is a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)
