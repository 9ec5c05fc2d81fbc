"""JSON as Godot writes it.

``JSON.stringify`` never refuses a number: NaN becomes ``null`` or, before 4.5, ``nan``; infinity
becomes ``1e99999`` or ``inf``. It does not escape control characters in strings. All of that is
accepted here, so that the caller can say which number is wrong.
"""

from __future__ import annotations

import contextlib
import json
import re
from typing import Any

import orjson

__all__ = ["parse_godot_json"]

_TEXT_OR_NUMBER = re.compile(r'"(?:[^"\\]|\\.)*"|-?\b(?:nan|inf)\b', re.DOTALL)
_decode = json.JSONDecoder(strict=False).decode
_NUMBERS = {"nan": "NaN", "-nan": "NaN", "inf": "Infinity", "-inf": "-Infinity"}


def parse_godot_json(data: bytes) -> Any:
    """Return a JSON value; raise ``ValueError`` if ``data`` is not UTF-8 or not JSON.

    Integers beyond 64 bits, which Godot does not have, may become floats.
    """
    with contextlib.suppress(orjson.JSONDecodeError):  # several times faster, but strict
        return orjson.loads(data)
    text = data.decode("utf-8")
    try:
        return _parse(text)
    except ValueError:
        if "nan" not in text and "inf" not in text:
            raise
        return _parse(_TEXT_OR_NUMBER.sub(lambda found: _NUMBERS.get(found[0], found[0]), text))


def _parse(text: str) -> Any:
    try:
        return _decode(text)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
