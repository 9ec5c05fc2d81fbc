"""The token of this user on this machine: games that a person starts here read the same file."""

from __future__ import annotations

import os
import secrets
import stat
import sys
from pathlib import Path

from ludus.errors import SetupError
from ludus.wire.proof import MIN_TOKEN_LENGTH

__all__ = ["user_token", "user_token_path"]

_MAX_BYTES = 4096
_OTHERS = stat.S_IRWXG | stat.S_IRWXO


def user_token_path() -> Path:
    """Return where the token lies; the add-ons look in the same place (PROTOCOL.md §3)."""
    if sys.platform == "win32":
        cache = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        cache = Path.home() / "Library" / "Caches"
    else:
        named = Path(os.environ.get("XDG_CACHE_HOME", ""))
        cache = named if named.is_absolute() else Path.home() / ".cache"
    return cache / "ludus" / "token"


def user_token() -> str:
    """Return the token, which is made where there is none yet.

    Raises:
        SetupError: It cannot be kept where others cannot read it.
    """
    path = user_token_path()
    try:
        try:
            return _read(path)
        except FileNotFoundError:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            _write(path)
            return _read(path)
    except OSError as error:
        raise SetupError(
            f"the file {path} with the token of this user cannot be used: {error}",
            hint="games that you start yourself, and that have no --ludus-token-file, look there",
        ) from error


def _read(path: Path) -> str:
    # Not waiting for the other end of a pipe, nor going where a link points.
    flags = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    number = os.open(path, os.O_RDONLY | flags)
    with os.fdopen(number, "rb") as file:
        found = os.fstat(number)
        if os.name == "posix" and (found.st_uid != os.geteuid() or found.st_mode & _OTHERS):
            raise SetupError(
                f"the file {path} is not yours alone, so the token in it is no secret",
                hint="delete it; a new one is made",
            )
        token = file.read(_MAX_BYTES).decode("utf-8", "replace").strip()
    if len(token) < MIN_TOKEN_LENGTH:
        raise SetupError(f"the file {path} holds no token", hint="delete it; a new one is made")
    return token


def _write(path: Path) -> None:
    """Write a new token, whole from the first moment; keep one that somebody else has written."""
    draft = path.with_name(f".{path.name}-{secrets.token_hex(8)}")
    number = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with os.fdopen(number, "w", encoding="utf-8") as file:
            file.write(secrets.token_hex(32) + "\n")
        try:
            os.link(draft, path)
        except FileExistsError:
            return
    finally:
        draft.unlink()
