"""Files of another add-on in a game: find its classes, back up its files."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from ludus.addon import ADDON_PATH, LEGACY_PATH
from ludus.disk import write_atomically
from ludus.engine.bundled import bundled_root
from ludus.engine.kinds import EngineKind
from ludus.errors import SetupError

__all__ = ["back_up", "declared_classes", "is_hidden", "names_class", "own_classes"]

_OWN_PREFIX = "Ludus"
_CLASS_NAME = re.compile(r"^\s*class_name\s+(\w+)", re.MULTILINE)
_CACHES = {".godot", ".import"}


def own_classes(kind: EngineKind) -> dict[str, str]:
    """Return the classes for legacy games that come with Ludus, and their paths in a project."""
    root = bundled_root(kind)
    found = dict(_classes(root / LEGACY_PATH))
    return {name: file.relative_to(root).as_posix() for name, file in found.items()}


def names_class(root: Path, names: Collection[str]) -> bool:
    """Tell whether a script or scene of a game has one of these words, outside of our add-on."""
    own = {root / ADDON_PATH, root / LEGACY_PATH}
    word = re.compile(rf"\b(?:{'|'.join(map(re.escape, names))})\b")
    files = (file for ending in ("*.gd", "*.tscn", "*.tres") for file in root.rglob(ending))
    return any(
        word.search(file.read_text(encoding="utf-8", errors="replace"))
        for file in files
        if own.isdisjoint(file.parents) and file.is_file()
    )


def declared_classes(root: Path) -> Iterator[tuple[str, Path]]:
    """Yield all classes that a game declares."""
    own = {root / ADDON_PATH, root / LEGACY_PATH}
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
    kept = _free_folder(root, backup_dir)
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


def _replace(root: Path, file: Path, text: str, kept: Path) -> None:
    target = kept / file.relative_to(root)
    target.parent.mkdir(parents=True, exist_ok=True)
    file.rename(target)
    try:
        write_atomically(file, text.encode())
    except OSError:
        target.rename(file)
        raise


def _free_folder(root: Path, path: str) -> Path:
    folder, number = root / path, 0
    while folder.exists():
        number += 1
        folder = root / f"{path}-{number}"
    return folder


def _classes(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield all classes that scripts below a folder declare, but for those of Ludus's own names."""
    for file in sorted(folder.rglob("*.gd")):
        if is_hidden(file, folder) or file.is_symlink() or not file.is_file():
            continue
        found = _CLASS_NAME.search(file.read_text(encoding="utf-8", errors="replace"))
        if found and not found[1].startswith(_OWN_PREFIX):
            yield found[1], file
