"""Which programs a run may start: those of runs that this user's Ludus made, or a person allowed.

A run folder names what it was trained in, and may come from anybody. ``config.json`` has a mark, an
HMAC over the programs that it names with a key of this user. A run without it that names a
program other than Ludus's own examples asks once, for that folder and those programs::

    <user state>/ludus/run_key          32 random bytes, mode 0600
    <user state>/ludus/trusted.json     folders, and the programs that were allowed in each
"""

from __future__ import annotations

import contextlib
import hmac
import json
import os
import secrets
import stat
import sys
from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any, cast

from ludus.disk import disk_errors, plain_file_opener, read_json, write_atomically
from ludus.errors import TargetError, UsageError
from ludus.printing import printable
from ludus.settings.plain import MARK
from ludus.target import GYMNASIUM_PREFIX, LEGACY_PREFIXES, Address, Example, Play, parse_target

__all__ = ["IS_TRUSTING", "PROGRAM_SETTINGS", "make_mark", "require_trust"]

PROGRAM_SETTINGS = ("target", "scene", "godot", "token_file", "bridge")
"""Settings that name what is started, or read and sent."""
IS_TRUSTING: ContextVar[bool] = ContextVar("IS_TRUSTING", default=False)
"""Whether the command has ``--trust``."""
KEY_BYTES = 32


def make_mark(settings: Mapping[str, Any]) -> str | None:
    """Return the mark of a run with these settings; None where this user can have no key."""
    key = _key()
    return None if key is None else _mark(key, _programs(settings))


def require_trust(file: Path, used: Mapping[str, Any]) -> None:
    """Make sure that the user wants to start what a run names.

    Args:
        file: Its ``config.json``, or a file like that.
        used: Those of :data:`PROGRAM_SETTINGS` that are taken from it, by name.

    Raises:
        UsageError: Ludus did not make the run, and nobody has allowed its programs.
        RunError: The answer cannot be kept.
    """
    programs = _programs(used)
    if set(programs) <= _marked(file):
        return
    folder, trusted = str(file.parent.resolve()), _read_trusted()
    if set(programs) <= set(trusted.get(folder, ())):
        return
    listed = "\n".join(f"  {printable(program)}" for program in programs)
    text = f"{file.parent} was not made by your ludus, and names what is to be started:\n{listed}"
    if not IS_TRUSTING.get() and not _ask(text):
        raise UsageError(text, "if you trust who made it, say so once: --trust")
    root = _state()
    if root is not None:
        trusted[folder] = sorted({*trusted.get(folder, ()), *programs})
        with disk_errors(str(root / "trusted.json")):
            root.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_atomically(root / "trusted.json", json.dumps(trusted, indent=2).encode())


def _marked(file: Path) -> set[str]:
    """Return the programs that a file names under this user's mark."""
    key = _key()
    try:
        values: Any = read_json(file)
    except (OSError, ValueError):
        return set()
    if key is None or not isinstance(values, dict):
        return set()
    settings = cast(dict[str, Any], values)
    found, programs = settings.get(MARK), _programs(settings)
    is_ours = hmac.compare_digest(str(found).encode(), _mark(key, programs).encode())
    return set(programs) if is_ours else set()


def _ask(text: str) -> bool:
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    sys.stderr.write(f"{printable(text)}\nStart it, now and later? [y/N] ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in {"y", "yes"}


# --- what a run names ---------------------------------------------------------------------------


def _programs(settings: Mapping[str, Any]) -> list[str]:
    """Return what these settings would start or read: absolute paths, and settings of a bridge."""
    found = _of_target(settings.get("target"), settings.get("scene"))
    for name in ("godot", "token_file"):
        if value := settings.get(name):
            found.append(_absolute(str(value)))
    bridge = settings.get("bridge")
    if isinstance(bridge, Mapping):
        for name, value in cast(Mapping[str, Any], bridge).items():
            found += _of_bridge(name, value)
    return found


def _of_bridge(name: str, value: Any) -> list[str]:
    """Return what a setting of a legacy bridge would start: a command, a file, a function."""
    if name.endswith("_space") or isinstance(value, bool | int | float | None):
        return []
    text = str(value)
    module = text.partition(":")[0].partition(".")[0]
    return [
        f"{name}: {text}",
        *([_absolute(text)] if _exists(text) else []),
        *(_in_current_folder(module) if module.isidentifier() else []),
    ]


def _of_target(target: Any, scene: Any) -> list[str]:
    text = str(target or "")
    if text.startswith(GYMNASIUM_PREFIX):
        module, colon, _ = text.removeprefix(GYMNASIUM_PREFIX).partition(":")
        return _in_current_folder(module.partition(".")[0]) if colon else []
    if text.startswith(LEGACY_PREFIXES):
        place = text.partition(":")[2]
        return [_absolute(place)] if _exists(place) else []
    with contextlib.suppress(TargetError):
        if isinstance(parse_target(text), Example | Address | Play):
            return [_absolute(str(scene))] if scene and _exists(str(scene)) else []
    return [_absolute(text)] if text else []


def _in_current_folder(module: str) -> list[str]:
    """Return the file of a module of the current folder; none if it is installed."""
    here = Path.cwd()
    spec = PathFinder.find_spec(module, [str(here)]) if module else None
    if spec is None:
        return []
    others = [path for path in sys.path if path and Path(path) != here]
    if PathFinder.find_spec(module, others) is not None:
        return []
    return [spec.origin or str(here / module)]


def _exists(text: str) -> bool:
    try:
        return bool(text) and Path(text).expanduser().exists()
    except (OSError, ValueError, RuntimeError):
        return False


def _absolute(text: str) -> str:
    try:
        return str(Path(text).expanduser().resolve())
    except (OSError, ValueError, RuntimeError):
        return text


# --- the user's key and answers -----------------------------------------------------------------


def _state() -> Path | None:
    try:
        import platformdirs
    except ImportError:
        return None
    return platformdirs.user_state_path("ludus", appauthor=False)


def _key() -> bytes | None:
    """Return this user's key, made if there is none; None if it cannot be kept to this user."""
    root = _state()
    if root is None:
        return None
    path = root / "run_key"
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            _create_key(path)
        return _read_key(path)
    except OSError:
        return None


def _create_key(path: Path) -> None:
    """Write a key beside ``path`` and link it there: never half, and once for all processes."""
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
    if path.exists():
        return
    try:
        with os.fdopen(os.open(temporary, flags, 0o600), "wb") as file:
            file.write(secrets.token_bytes(KEY_BYTES))
        os.link(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _read_key(path: Path) -> bytes | None:
    with open(path, "rb", opener=plain_file_opener) as file:
        status = os.fstat(file.fileno())
        key = file.read(KEY_BYTES + 1)
    is_private = os.name == "nt" or (
        status.st_uid == os.geteuid() and not stat.S_IMODE(status.st_mode) & 0o077
    )
    return key if is_private and len(key) == KEY_BYTES else None


def _mark(key: bytes, programs: Sequence[str]) -> str:
    text = json.dumps(["ludus run", *programs]).encode()
    return hmac.new(key, text, "sha256").hexdigest()


def _read_trusted() -> dict[str, list[str]]:
    root = _state()
    try:
        values: Any = {} if root is None else read_json(root / "trusted.json")
    except (OSError, ValueError):
        return {}
    if not isinstance(values, dict):
        return {}
    folders = cast(dict[str, Any], values)
    return {
        folder: [str(program) for program in cast(list[Any], programs)]
        for folder, programs in folders.items()
        if isinstance(programs, list)
    }
