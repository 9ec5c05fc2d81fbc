"""What a running run is asked to do: by the game, or by files in its folder ``control``.

A request is a JSON object, the same in both ways (PROTOCOL.md §8)::

    {"kind": "set_mode", "policy": "hero", "mode": "train" | "frozen" | "deterministic"}
    {"kind": "save"}
    {"kind": "stop"}

A file holds one request; it is written under another name and renamed, read in the order of names,
and removed when it has been read.
"""

from __future__ import annotations

import json
import logging
import time
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from ludus.disk import disk_errors, write_atomically
from ludus.train.policy_config import Mode

__all__ = ["MODES", "Request", "SaveRequest", "SetMode", "StopRequest", "read_request",
           "send_request", "take_requests"]  # fmt: skip

MAX_BYTES = 4096
MODES: tuple[Mode, ...] = typing.get_args(Mode)

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SetMode:
    """Let a policy learn, act frozen, or act deterministically."""

    policy: str
    mode: Mode

    def to_json(self) -> dict[str, Any]:
        """Return the request as JSON values."""
        return {"kind": "set_mode", "policy": self.policy, "mode": self.mode}


@dataclass(frozen=True)
class SaveRequest:
    """Write a checkpoint now."""

    def to_json(self) -> dict[str, Any]:
        """Return the request as JSON values."""
        return {"kind": "save"}


@dataclass(frozen=True)
class StopRequest:
    """End training, with a checkpoint."""

    def to_json(self) -> dict[str, Any]:
        """Return the request as JSON values."""
        return {"kind": "stop"}


Request = SetMode | SaveRequest | StopRequest


def read_request(values: Mapping[str, Any], policies: Iterable[str]) -> Request | None:
    """Return what ``values`` ask for; None, with a warning, if that is nothing we know."""
    known = list(policies)
    match values:
        case {"kind": "set_mode", "policy": str(policy), "mode": str(mode)}:
            if policy in known and mode in MODES:
                return SetMode(policy, mode)
        case {"kind": "save"}:
            return SaveRequest()
        case {"kind": "stop"}:
            return StopRequest()
        case _:
            pass
    text = json.dumps(values, default=str)[:200]
    log.warning("request left out: %s; policies: %s; modes: %s", text, known, MODES)
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
    """Read and remove the requests in ``folder``, oldest first; malformed ones with a warning."""
    if not folder.is_dir():
        return []
    found: list[Mapping[str, Any]] = []
    for path in sorted(folder.glob("*.json")):
        try:
            values: Any = json.loads(path.read_bytes()[:MAX_BYTES])
        except (OSError, ValueError) as error:
            log.warning("request %s left out: %s", path, error)
            values = None
        if isinstance(values, dict):
            found.append(cast(dict[str, Any], values))
        path.unlink(missing_ok=True)
    return found
