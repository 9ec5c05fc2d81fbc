"""Files of another add-on in a game: find its classes, back up its files and put them back."""

from __future__ import annotations

import itertools
import re
import shutil
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from ludus.addon import ADDON_PATH, GDRL_PATH, LEGACY_PATH
from ludus.disk import write_atomically
from ludus.engine.bundled import bundled_root
from ludus.engine.kinds import EngineKind
from ludus.errors import ConfigError, SetupError

__all__ = [
    "back_up",
    "declared_classes",
    "find_backup",
    "is_forwarding",
    "is_hidden",
    "names_class",
    "own_classes",
    "refuse_changed",
    "restore",
]

_OWN_PREFIX = "Ludus"
_CLASS_NAME = re.compile(r"^\s*class_name\s+(\w+)", re.MULTILINE)
_CACHES = {".godot", ".import"}
_FORWARDING_SIGN = "# Made by `ludus addon install --legacy`"
"""In every script that takes the place of another add-on's."""


def own_classes(kind: EngineKind) -> dict[str, str]:
    """Return the classes for legacy games that come with Ludus, and their paths in a project."""
    root = bundled_root(kind)
    found = dict(_classes(root / LEGACY_PATH))
    return {name: file.relative_to(root).as_posix() for name, file in found.items()}


def names_class(root: Path, names: Collection[str]) -> bool:
    """Tell whether a script or scene of a game has one of these words, outside of our add-on."""
    own = {root / path for path in (ADDON_PATH, LEGACY_PATH, GDRL_PATH)}
    word = re.compile(rf"\b(?:{'|'.join(map(re.escape, names))})\b")
    files = (file for ending in ("*.gd", "*.tscn", "*.tres") for file in root.rglob(ending))
    return any(
        word.search(file.read_text(encoding="utf-8", errors="replace"))
        for file in files
        if own.isdisjoint(file.parents) and file.is_file()
    )


def declared_classes(root: Path) -> Iterator[tuple[str, Path]]:
    """Yield all classes that a game declares."""
    own = {root / path for path in (ADDON_PATH, LEGACY_PATH, GDRL_PATH)}
    return (found for found in _classes(root) if own.isdisjoint(found[1].parents))


def is_hidden(file: Path, root: Path) -> bool:
    """Tell whether Godot does not look into a folder that ``file`` lies in."""
    folders = [parent for parent in file.parents if parent.is_relative_to(root)]
    return not _CACHES.isdisjoint(file.parts) or any(
        (parent / ".gdignore").exists() for parent in folders
    )


def back_up(root: Path, replacements: Mapping[Path, str], backup_dir: str) -> str:
    """Replace files, in order, and keep them.

    Args:
        root: Folder of the project.
        replacements: What takes the place of each file; ``{kept}`` is the folder of the backup.
        backup_dir: That folder, relative to the project, where Godot does not look; a number is
            added if it exists.

    Returns:
        The folder, relative to the project.

    Raises:
        SetupError: The project cannot be written.
    """
    kept = next(folder for folder in _backup_folders(root / backup_dir) if not folder.exists())
    try:
        kept.mkdir()
        (kept / ".gdignore").touch()
        for file, text in replacements.items():
            _replace(root, file, text.replace("{kept}", kept.name), kept)
    except OSError as error:
        raise SetupError(
            f"files in {root} could not be replaced: {error}",
            hint="the project folder must be writable, and the disk not full",
        ) from error
    return kept.name


def is_forwarding(file: Path) -> bool:
    """Tell whether a script takes the place of another add-on's."""
    return _FORWARDING_SIGN in file.read_text(encoding="utf-8", errors="replace")


def find_backup(root: Path, backup_dir: str) -> Path | None:
    """Return the newest folder that :func:`back_up` has made under a name."""
    found: Path | None = None
    for folder in _backup_folders(root / backup_dir):
        if not folder.exists():
            break
        found = folder
    return found


def refuse_changed(root: Path, kept: Path) -> None:
    """Raise if a script in the place of a file of a backup is not the one that was put there.

    Raises:
        ConfigError: It is not.
    """
    names = _kept_files(kept)
    changed = [name for name in names if (root / name).exists() and not is_forwarding(root / name)]
    if changed:
        rows = "\n".join(f"  {name}" for name in changed)
        raise ConfigError(
            f"these files have changed since the originals were moved to {kept.name}:\n{rows}",
            hint="use --force to put the originals back in their place",
        )


def restore(root: Path, kept: Path) -> tuple[str, ...]:
    """Put back all files of a backup, and remove its folder.

    Returns:
        The files, relative to the project.

    Raises:
        SetupError: The project cannot be written.
    """
    names = _kept_files(kept)
    try:
        for name in names:
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (kept / name).replace(root / name)
        shutil.rmtree(kept)
    except OSError as error:
        raise SetupError(
            f"files in {root} could not be put back: {error}",
            hint="the project folder must be writable, and the disk not full",
        ) from error
    return names


def _kept_files(kept: Path) -> tuple[str, ...]:
    files = (file for file in sorted(kept.rglob("*")) if file.is_file())
    return tuple(file.relative_to(kept).as_posix() for file in files if file != kept / ".gdignore")


def _replace(root: Path, file: Path, text: str, kept: Path) -> None:
    target = kept / file.relative_to(root)
    target.parent.mkdir(parents=True, exist_ok=True)
    file.rename(target)
    try:
        write_atomically(file, text.encode())
    except OSError:
        target.rename(file)
        raise


def _backup_folders(first: Path) -> Iterator[Path]:
    yield first
    for number in itertools.count(1):
        yield first.with_name(f"{first.name}-{number}")


def _classes(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield all classes that scripts below a folder declare, but for those of Ludus's own names."""
    for file in sorted(folder.rglob("*.gd")):
        if is_hidden(file, folder) or file.is_symlink() or not file.is_file():
            continue
        found = _CLASS_NAME.search(file.read_text(encoding="utf-8", errors="replace"))
        if found and not found[1].startswith(_OWN_PREFIX):
            yield found[1], file
