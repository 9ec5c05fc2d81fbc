"""Requests to a running run: from the game, or as files in its folder ``control``.

A request is a JSON object, the same in both ways (PROTOCOL.md §8)::

    {"kind": "set_mode", "policy": "hero", "mode": "train" | "frozen" | "deterministic"}
    {"kind": "save"}
    {"kind": "stop"}

and, from a game that guides its training with ``ludus serve``::

    {"kind": "start"}
    {"kind": "play_round"}
    {"kind": "write_policies"}

A file holds one request. It is written under another name and renamed; the trainer reads files in
the order of their names and removes them.
"""

from __future__ import annotations

import json
import logging
import time
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, cast

from ludus.disk import disk_errors, read_json, write_atomically
from ludus.errors import UsageError
from ludus.settings.policy_config import Mode

__all__ = ["MODES", "PlayRound", "Request", "SaveRequest", "SetMode", "StartRequest",
           "StopRequest", "WritePolicies", "parse_request", "read_request", "send_request",
           "take_requests"]  # fmt: skip

MAX_BYTES = 4096
MODES: tuple[Mode, ...] = typing.get_args(Mode)

log = logging.getLogger(__name__)


class _Kind:
    """A request; its fields are the other keys of the JSON object."""

    kind: ClassVar[str]

    def to_json(self) -> dict[str, Any]:
        """Return the request as JSON values."""
        return {"kind": self.kind, **vars(self)}


@dataclass(frozen=True)
class SetMode(_Kind):
    """Let a policy learn, act frozen, or act deterministically."""

    kind = "set_mode"
    policy: str
    mode: Mode


@dataclass(frozen=True)
class SaveRequest(_Kind):
    """Write a checkpoint now."""

    kind = "save"


@dataclass(frozen=True)
class StopRequest(_Kind):
    """End training, with a checkpoint."""

    kind = "stop"


@dataclass(frozen=True)
class StartRequest(_Kind):
    """Train until told to stop."""

    kind = "start"


@dataclass(frozen=True)
class PlayRound(_Kind):
    """Play one episode in every world with the most probable actions; nothing learns."""

    kind = "play_round"


@dataclass(frozen=True)
class WritePolicies(_Kind):
    """Write every policy as a file for the game."""

    kind = "write_policies"


Request = SetMode | SaveRequest | StopRequest | StartRequest | PlayRound | WritePolicies

_SIMPLE: dict[str, Request] = {
    request.kind: request
    for request in (SaveRequest(), StopRequest(), StartRequest(), PlayRound(), WritePolicies())
}


def parse_request(values: Mapping[str, Any], policies: Iterable[str]) -> Request:
    """Return what ``values`` ask for.

    Raises:
        UsageError: The request is unknown, or there is no such policy.
    """
    known = list(policies)
    match values:
        case {"kind": "set_mode", "policy": str(policy), "mode": str(mode)}:
            if policy in known and mode in MODES:
                return SetMode(policy, mode)
        case {"kind": str(kind)} if kind in _SIMPLE:
            return _SIMPLE[kind]
        case _:
            pass
    text = json.dumps(values, default=str)[:200]
    raise UsageError(
        f"unknown request: {text}", f"policies: {', '.join(known)}; modes: {', '.join(MODES)}"
    )


def read_request(values: Mapping[str, Any], policies: Iterable[str]) -> Request | None:
    """Return what ``values`` ask for; None, with a warning, if the request is unknown."""
    try:
        return parse_request(values, policies)
    except UsageError as error:
        log.warning("%s; %s", error.message, error.hint)
        return None


def send_request(folder: Path, request: Request) -> Path:
    """Leave a request for the run that looks into ``folder``.

    Returns:
        The file, which is gone once the run has taken the request.

    Raises:
        RunError: The file cannot be written.
    """
    with disk_errors(f"a request in {folder}"):
        folder.mkdir(exist_ok=True)
        data = json.dumps(request.to_json()).encode()
        path = folder / f"{time.time_ns():020d}.json"
        write_atomically(path, data)
    return path


def take_requests(folder: Path) -> list[Mapping[str, Any]]:
    """Read and remove the requests in ``folder``, oldest first; malformed ones with a warning.

    What cannot be removed is no request: it would be carried out again and again.
    """
    if not folder.is_dir():
        return []
    found: list[Mapping[str, Any]] = []
    for path in sorted(folder.glob("*.json")):
        values: Any = None
        try:
            values = read_json(path, MAX_BYTES)
        except (OSError, ValueError) as error:
            _warn_once(f"ignoring the request {path}: {error}")
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            _warn_once(f"ignoring the request {path}, which cannot be removed: {error}")
            continue
        if isinstance(values, dict):
            found.append(cast(dict[str, Any], values))
    return found


@lru_cache(maxsize=64)
def _warn_once(text: str) -> None:
    log.warning("%s", text)
