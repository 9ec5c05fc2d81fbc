"""The projects that come with Ludus, one for each engine: the add-on and the examples."""

from __future__ import annotations

import importlib.metadata
import shutil
import tempfile
from pathlib import Path

from ludus.engine.cache import require_cache_root
from ludus.engine.kinds import EngineKind
from ludus.errors import SetupError
from ludus.locks import file_lock

__all__ = [
    "bevy_workspace",
    "bundled_root",
    "example_names",
    "find_example",
    "package_version",
    "runnable_bundled_root",
]

_COPY_TIMEOUT_S = 120.0
_NOT_COPIED = shutil.ignore_patterns(".godot", ".import", "__pycache__")


def package_version() -> str:
    """Return the installed version of Ludus, or ``0+checkout`` if it is not installed."""
    try:
        return importlib.metadata.version("ludus-rl")
    except importlib.metadata.PackageNotFoundError:
        return "0+checkout"


def bundled_root(kind: EngineKind = EngineKind.GODOT4) -> Path:
    """Return the folder with the add-on and the examples, which may be read-only.

    Raises:
        SetupError: This installation of Ludus has none.
    """
    in_checkout = _package_folder().parent.parent / "engines" / kind
    for folder in (_in_wheel(kind), in_checkout):
        if (folder / "addons" / "ludus").is_dir() or (folder / "project.godot").is_file():
            return folder
    raise SetupError(
        f"this installation of Ludus lacks its Godot project (searched "
        f"{_in_wheel(kind)} and {in_checkout})",
        hint="install Ludus again: pip install --force-reinstall ludus-rl",
    )


def bevy_workspace() -> Path | None:
    """Return the Cargo workspace of the Bevy examples, which may be read-only; None without one."""
    package = _package_folder()
    places = (package / "_bundled" / "bevy", package.parent.parent / "engines" / "bevy")
    return next((place for place in places if (place / "Cargo.toml").is_file()), None)


def example_names() -> list[str]:
    """List the bundled examples: those of Godot 4, then those of Godot 3 as ``godot3:NAME``."""
    godot3 = [f"{EngineKind.GODOT3}:{name}" for name in _examples_of(EngineKind.GODOT3)]
    return _examples_of(EngineKind.GODOT4) + godot3


def find_example(text: str) -> tuple[EngineKind, str] | None:
    """Return engine and name of a bundled example: ``NAME`` is for Godot 4, unless it says so.

    Args:
        text: ``NAME``, ``godot4:NAME`` or ``godot3:NAME``.
    """
    prefix, colon, name = text.rpartition(":")
    kind = EngineKind(prefix) if prefix in list(EngineKind) else EngineKind.GODOT4
    is_known = name in _examples_of(kind) and (not colon or prefix == kind)
    return (kind, name) if is_known else None


def _examples_of(kind: EngineKind) -> list[str]:
    try:
        examples = bundled_root(kind) / "examples"
    except SetupError:
        return []
    return sorted(file.stem for file in examples.glob("*/*.tscn") if file.stem == file.parent.name)


def runnable_bundled_root(kind: EngineKind = EngineKind.GODOT4) -> Path:
    """Return the bundled project in a place where Godot may write its import cache.

    In a checkout that is the project itself; that of a wheel is copied to the user cache, once
    per version.

    Raises:
        SetupError: It is missing, or cannot be copied.
    """
    root = bundled_root(kind)
    if root != _in_wheel(kind):
        return root
    target = require_cache_root() / "bundled" / kind / package_version()
    try:
        with file_lock(target.parent / ".copy.lock", _COPY_TIMEOUT_S):
            if not target.is_dir():
                incoming = Path(tempfile.mkdtemp(prefix=".incoming-", dir=target.parent))
                try:
                    shutil.copytree(root, incoming / "project", ignore=_NOT_COPIED)
                    (incoming / "project").rename(target)
                finally:
                    shutil.rmtree(incoming, ignore_errors=True)
    except OSError as error:
        raise SetupError(
            f"the bundled examples cannot be copied to {target}: {error}",
            hint="make sure that the user cache can be written and the disk is not full",
        ) from error
    return target


def _in_wheel(kind: EngineKind) -> Path:
    return _package_folder() / "_bundled" / kind


def _package_folder() -> Path:
    return Path(__file__).resolve().parents[1]
