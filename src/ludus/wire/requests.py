"""What a game asks of its trainer (PROTOCOL.md §8, "Requests"). No input or output."""

from __future__ import annotations

import re
from typing import Any

from ludus.wire.json_object import read_objects

__all__ = ["CAPABILITY", "MAX_REQUESTS", "MODES", "read_requests"]

CAPABILITY = "requests"
MAX_REQUESTS = 256
MAX_TEXT_LENGTH = 128
MODES = ("train", "frozen", "deterministic")

_WORD = re.compile(rf"[a-z][a-z0-9_]{{0,{MAX_TEXT_LENGTH - 1}}}")


def read_requests(value: Any) -> list[dict[str, Any]]:
    """Check the answer to ``take_requests``.

    Returns:
        The requests, oldest first. Each has a ``kind``, a word. ``set_mode`` has a ``policy``,
        which need not exist, and a ``mode`` of :data:`MODES`. Other kinds are returned unchecked,
        even those that this version does not know.

    Raises:
        ProtocolError: It is not a list of requests, or too long; the text names the place.
    """
    for reader in read_objects(value, "take_requests()", 0, MAX_REQUESTS):
        kind = reader.text("kind")
        if not _WORD.fullmatch(kind):
            raise reader.unexpected("kind", "a word in lower case", kind)
        if kind == "set_mode":
            reader.name("policy", MAX_TEXT_LENGTH)
            reader.choice("mode", MODES)
    return value
