"""Where Ludus keeps what it installs, and the record that makes a folder an installation.

Layout of the user cache::

    engines/<kind>/<name>/engine.json     an installed engine; the record is written last
    engines/<kind>/.incoming-*            an installation in progress or interrupted
    engines/<kind>/.install.lock
    templates/<kind>/<release>-<installer>/template.json    an installed export template
    screens/<name>/Xvfb                   for virtual screens; see `screen`
    bundled/<kind>/<version>/             a writable copy of the bundled project
    cores/<host>/core-<number>.lock       held while a pool has pinned an engine to that core
    cores/<host>/waiting.lock             held while a pool finds fewer free cores than it needs
"""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Self

from ludus.engine.kinds import EngineKind, Version
from ludus.errors import SetupError
from ludus.extras import install_hint

__all__ = ["EngineRecord", "TemplateRecord", "cache_root", "cached_engines", "require_cache_root"]

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
            hint=install_hint("engine"),
        )
    return root


@dataclass(frozen=True, kw_only=True)
class _Record:
    """What is known of an installation; written last, and read back from its folder.

    Attributes:
        version_text: What the program calls itself.
        route: Name of the installer: ``official`` or ``debian``.
        executable: Path of the program inside the folder.
    """

    file_name: ClassVar[str]

    version_text: str
    route: str
    executable: str

    def write(self, folder: Path) -> None:
        """Make ``folder`` an installation."""
        text = json.dumps(asdict(self), indent=2)
        (folder / self.file_name).write_text(text, encoding="utf-8")

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the record of an installation.

        Raises:
            OSError: There is none.
            ValueError: It is not a record.
        """
        data: Any = json.loads((folder / cls.file_name).read_text(encoding="utf-8"))
        try:
            for name in ("version_text", "route", "executable"):
                if not isinstance(data[name], str):
                    raise TypeError(name)
            return cls(**{field.name: data[field.name] for field in fields(cls)})
        except (KeyError, TypeError) as error:
            raise ValueError(f"a field is missing or has the wrong type: {error}") from error

    @classmethod
    def read_all(cls, folder: str) -> list[tuple[Path, Self]]:
        """List the complete installations in a folder of the user cache, by name."""
        root = cache_root()
        found: list[tuple[Path, Self]] = []
        for file in sorted((root / folder).glob(f"[!.]*/{cls.file_name}")) if root else []:
            try:
                record = cls.read(file.parent)
            except (OSError, ValueError) as error:
                _log.warning("ignoring %s: %s", file, error)
                continue
            if (file.parent / record.executable).is_file():
                found.append((file.parent, record))
        return found


@dataclass(frozen=True, kw_only=True)
class EngineRecord(_Record):
    """The contents of ``engine.json``.

    Attributes:
        version: Numbers of the version.
        has_rendering: Whether what it needs to open a window was installed as well.
        window_executable: Path of the program that opens a window; the same one for Godot 4.
    """

    file_name = "engine.json"

    version: Version
    has_rendering: bool
    window_executable: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "version", tuple(int(part) for part in self.version))


@dataclass(frozen=True, kw_only=True)
class TemplateRecord(_Record):
    """The contents of ``template.json``.

    Attributes:
        prefix: Path inside the folder of the libraries that its games need; empty: none.
    """

    file_name = "template.json"

    prefix: str


def cached_engines(kind: EngineKind) -> list[tuple[Path, EngineRecord]]:
    """List complete installations of one kind: newest first, those that can render first."""
    found = EngineRecord.read_all(f"engines/{kind}")
    return sorted(found, key=lambda item: (item[1].version, item[1].has_rendering), reverse=True)
