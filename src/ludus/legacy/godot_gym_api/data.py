"""The fields of an answer in JSON, read as those of a protobuf message are."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Iterator, Mapping
from typing import Any, cast

__all__ = ["BYTES_KEY", "Data", "to_fields"]

BYTES_KEY = "$bytes"
"""Key of an object that stands for bytes, in base 64."""


class Data(Mapping[str, Any]):
    """Fields by name: ``data["place"]`` or ``data.place``.

    Args:
        fields: What the game sent.
    """

    def __init__(self, fields: Mapping[str, Any]) -> None:
        self._fields = dict(fields)

    def __getitem__(self, name: str) -> Any:
        return self._fields[name]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # copying and pickling ask for these
            raise AttributeError(name)
        try:
            return self.__dict__["_fields"][name]
        except KeyError as error:
            names = ", ".join(self.__dict__.get("_fields", {})) or "nothing"
            raise AttributeError(f"the game sent no {name!r}; it sent {names}") from error

    def __iter__(self) -> Iterator[str]:
        return iter(self._fields)

    def __len__(self) -> int:
        return len(self._fields)

    def __repr__(self) -> str:
        return f"Data({self._fields!r})"


def to_fields(value: Any) -> Any:
    """Return a JSON value with its objects as :class:`Data`, or as bytes where they stand for them.

    Raises:
        ValueError: What should be base 64 is none.
        RecursionError: It is nested too deeply.
    """
    if isinstance(value, list):
        items = cast(list[Any], value)
        return [to_fields(item) if isinstance(item, dict | list) else item for item in items]
    if not isinstance(value, dict):
        return value
    fields = cast(dict[str, Any], value)
    if len(fields) == 1 and BYTES_KEY in fields:
        return _bytes(fields[BYTES_KEY])
    return Data(
        {
            name: to_fields(field) if isinstance(field, dict | list) else field
            for name, field in fields.items()
        }
    )


def _bytes(text: Any) -> bytes:
    if not isinstance(text, str):
        raise ValueError(f"{BYTES_KEY} is not a text")
    try:
        return base64.b64decode(text, validate=True)
    except binascii.Error as error:
        raise ValueError(f"{BYTES_KEY} is not base 64: {error}") from error
