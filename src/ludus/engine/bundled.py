"""The Godot project that comes with Ludus: the add-on and the examples."""

from __future__ import annotations

import importlib.metadata
import shutil
import tempfile
from pathlib import Path

from ludus.engine.cache import require_cache_root
from ludus.engine.locks import file_lock
from ludus.errors import SetupError

__all__ = ["bundled_root", "example_names", "package_version", "runnable_bundled_root"]

_COPY_TIMEOUT_S = 120.0
_NOT_COPIED = shutil.ignore_patterns(".godot", "__pycache__")


def package_version() -> str:
    """Return the installed version of Ludus, or ``0+checkout`` if it is not installed."""
    try:
        return importlib.metadata.version("ludus-rl")
    except importlib.metadata.PackageNotFoundError:
        return "0+checkout"


def bundled_root() -> Path:
    """Return the folder with the add-on and the examples, which may be read-only.

    Raises:
        SetupError: This installation of Ludus has none.
    """
    for folder in (_in_wheel(), _in_checkout()):
        if (folder / "addons" / "ludus").is_dir() or (folder / "project.godot").is_file():
            return folder
    raise SetupError(
        f"this installation of Ludus lacks its Godot project (looked at {_in_wheel()} and "
        f"{_in_checkout()})",
        hint="install Ludus again: pip install --force-reinstall ludus-rl",
    )


def example_names() -> list[str]:
    """List the bundled examples; empty if there are none."""
    try:
        examples = bundled_root() / "examples"
    except SetupError:
        return []
    return sorted(file.stem for file in examples.glob("*/*.tscn") if file.stem == file.parent.name)


def runnable_bundled_root() -> Path:
    """Return the bundled project in a place where Godot may write its import cache.

    In a checkout that is the project itself; what a wheel brought is copied to the user cache,
    once per version.

    Raises:
        SetupError: It is missing, or cannot be copied.
    """
    root = bundled_root()
    if root != _in_wheel():
        return root
    target = require_cache_root() / "bundled" / package_version()
    try:
        with file_lock(target.parent / ".copy.lock", _COPY_TIMEOUT_S):
            if not target.is_dir():
                _copy_whole(root, target)
    except OSError as error:
        raise SetupError(
            f"the bundled examples cannot be copied to {target}: {error}",
            hint="make sure that the user cache can be written and the disk is not full",
        ) from error
    return target


def _in_wheel() -> Path:
    return _package_folder() / "_bundled" / "godot4"


def _in_checkout() -> Path:
    return _package_folder().parent.parent / "engines" / "godot4"


def _package_folder() -> Path:
    return Path(__file__).resolve().parents[1]


def _copy_whole(source: Path, target: Path) -> None:
    incoming = Path(tempfile.mkdtemp(prefix=".incoming-", dir=target.parent))
    try:
        shutil.copytree(source, incoming / "project", ignore=_NOT_COPIED)
        (incoming / "project").rename(target)
    finally:
        shutil.rmtree(incoming, ignore_errors=True)
