"""What a game asks of its trainer (PROTOCOL.md §8, "Requests"). No input or output."""

from __future__ import annotations

import re
from reprlib import repr as _short
from typing import Any, cast

from ludus.errors import ProtocolError

__all__ = ["CAPABILITY", "MAX_REQUESTS", "MODES", "read_requests"]

CAPABILITY = "requests"
MAX_REQUESTS = 256
MAX_TEXT_LENGTH = 128
MODES = ("train", "frozen", "deterministic")

_WORD = re.compile(rf"[a-z][a-z0-9_]{{0,{MAX_TEXT_LENGTH - 1}}}")


def read_requests(value: Any) -> list[dict[str, Any]]:
    """Check the answer to ``take_requests``.

    Returns:
        The requests, oldest first. Each has a ``kind``, a word. ``set_mode`` has a ``policy``, a
        text that need not name a policy there is, and a ``mode`` of :data:`MODES`. Other kinds
        come as they are, also those that this version does not know.

    Raises:
        ProtocolError: It is no list of requests, or too long; the text names the place.
    """
    if not isinstance(value, list):
        raise _wrong("take_requests()", "a list", value)
    requests = cast(list[Any], value)
    if len(requests) > MAX_REQUESTS:
        raise ProtocolError(f"{len(requests)} requests at once, the limit is {MAX_REQUESTS}")
    for i, request in enumerate(requests):
        _check(request, f"take_requests()[{i}]")
    return requests


def _check(request: Any, where: str) -> None:
    if not isinstance(request, dict):
        raise _wrong(where, "an object", request)
    parts = cast(dict[str, Any], request)
    kind = parts.get("kind")
    if not isinstance(kind, str) or _WORD.fullmatch(kind) is None:
        raise _wrong(f"{where}.kind", "a word in lower case", kind)
    if kind == "set_mode":
        _check_set_mode(parts, where)


def _check_set_mode(parts: dict[str, Any], where: str) -> None:
    policy, mode = parts.get("policy"), parts.get("mode")
    if not isinstance(policy, str) or not 0 < len(policy) <= MAX_TEXT_LENGTH:
        raise _wrong(f"{where}.policy", f"a name of at most {MAX_TEXT_LENGTH} characters", policy)
    if not isinstance(mode, str) or mode not in MODES:
        raise _wrong(f"{where}.mode", " or ".join(MODES), mode)


def _wrong(where: str, expected: str, value: Any) -> ProtocolError:
    return ProtocolError(f"{where}: expected {expected}, got {_short(value)}")
