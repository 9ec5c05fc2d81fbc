"""Where Ludus keeps what it installs, and the record that makes a folder an engine.

Layout of the user cache::

    engines/<kind>/<name>/engine.json     an installed engine; the record is written last
    engines/<kind>/.incoming-*            an installation under way or broken off
    engines/<kind>/.install.lock
    templates/<kind>/<name>/              an export template; see `template`
    screens/<name>/Xvfb                   for virtual screens; see `install_screen`
    bundled/<kind>/<version>/             a writable copy of the bundled project
    cores/<host>/core-<number>.lock       held while a pool has pinned an engine to that core
"""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

from ludus.engine.kinds import EngineKind, Version
from ludus.errors import SetupError

__all__ = ["RECORD_NAME", "CacheRecord", "cache_root", "cached_records", "require_cache_root"]

RECORD_NAME = "engine.json"

_log = logging.getLogger(__name__)


def cache_root() -> Path | None:
    """Return the user cache of Ludus, or None where ``platformdirs`` is not installed."""
    try:
        import platformdirs
    except ImportError:
        return None
    return platformdirs.user_cache_path("ludus", appauthor=False)


def require_cache_root() -> Path:
    """Return the user cache of Ludus.

    Raises:
        SetupError: ``platformdirs`` is not installed.
    """
    root = cache_root()
    if root is None:
        raise SetupError(
            "the user cache cannot be located, because platformdirs is not installed",
            hint='pip install "ludus-rl[engine]"',
        )
    return root


@dataclass(frozen=True)
class CacheRecord:
    """The contents of ``engine.json``.

    Attributes:
        version: Numbers of the version.
        version_text: What the engine calls itself.
        route: How it came here: ``official`` or ``debian``.
        has_rendering: Whether it was installed to open windows as well.
        executable: Path inside the folder of the executable that runs without a window.
        window_executable: Path of the one that opens a window; the same one for Godot 4.
    """

    version: Version
    version_text: str
    route: str
    has_rendering: bool
    executable: str
    window_executable: str

    def write(self, folder: Path) -> None:
        """Make ``folder`` an installed engine."""
        (folder / RECORD_NAME).write_text(json.dumps(asdict(self), indent=2), encoding="utf-8")

    @classmethod
    def read(cls, folder: Path) -> CacheRecord:
        """Read the record of an installed engine.

        Raises:
            OSError: There is none.
            ValueError: It is not a record.
        """
        data: Any = json.loads((folder / RECORD_NAME).read_text(encoding="utf-8"))
        if not isinstance(data, dict):
            raise ValueError("not a JSON object")
        return cls._from_json(cast("dict[str, Any]", data))

    @classmethod
    def _from_json(cls, data: dict[str, Any]) -> CacheRecord:
        try:
            return cls(
                version=tuple(int(part) for part in data["version"]),
                version_text=str(data["version_text"]),
                route=str(data["route"]),
                has_rendering=bool(data["has_rendering"]),
                executable=str(data["executable"]),
                window_executable=str(data["window_executable"]),
            )
        except (KeyError, TypeError) as error:
            raise ValueError(f"record lacks or misspells {error}") from error


def cached_records(kind: EngineKind) -> list[tuple[Path, CacheRecord]]:
    """List complete installations of one kind: newest first, those that can render first."""
    root = cache_root()
    folder = root / "engines" / kind if root else None
    if folder is None or not folder.is_dir():
        return []
    found: list[tuple[Path, CacheRecord]] = []
    for entry in folder.iterdir():
        record = _record_or_none(entry)
        if record is not None:
            found.append((entry, record))
    found.sort(key=lambda item: (item[1].version, item[1].has_rendering), reverse=True)
    return found


def _record_or_none(folder: Path) -> CacheRecord | None:
    if folder.name.startswith(".") or not (folder / RECORD_NAME).is_file():
        return None
    try:
        record = CacheRecord.read(folder)
    except (OSError, ValueError) as error:
        _log.warning("ignoring %s: %s", folder / RECORD_NAME, error)
        return None
    return record if (folder / record.executable).is_file() else None
