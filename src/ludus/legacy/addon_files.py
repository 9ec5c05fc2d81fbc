"""Files of another add-on in a game: find its classes, put its files aside."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from ludus.addon import ADDON_PATH, LEGACY_PATH, AddonChange
from ludus.engine.bundled import bundled_root
from ludus.engine.kinds import EngineKind
from ludus.errors import SetupError

__all__ = ["LegacyChange", "declared_classes", "is_hidden", "own_classes", "put_aside"]

_OWN_PREFIX = "Ludus"
_CLASS_NAME = re.compile(r"^\s*class_name\s+(\w+)", re.MULTILINE)
_CACHES = {".godot", ".import"}


@dataclass(frozen=True)
class LegacyChange:
    """What an installation did.

    Attributes:
        addon: To the add-on.
        legacy: To the folder with the classes of others' names.
        replaced: Files of the other add-on that were put aside, relative to the project.
        kept: Folder that they lie in now, relative to the project; empty if none were.
        without_action: Scenes with a node of GymGodot that does not say what an action is.
    """

    addon: AddonChange
    legacy: AddonChange
    replaced: tuple[str, ...] = ()
    kept: str = ""
    without_action: tuple[str, ...] = ()


def own_classes(kind: EngineKind) -> dict[str, str]:
    """Return the classes of others' names that come with Ludus, and their paths in a project."""
    root = bundled_root(kind)
    found = dict(_classes(root / LEGACY_PATH))
    return {name: file.relative_to(root).as_posix() for name, file in found.items()}


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


def put_aside(root: Path, stand_ins: Mapping[Path, str], kept_path: str) -> str:
    """Replace files, in order.

    Args:
        root: Folder of the project.
        stand_ins: What takes the place of each file; ``{kept}`` is where it is kept.
        kept_path: Where to keep them, relative to the project; a number is added if it exists.

    Returns:
        Where they are kept, relative to the project.

    Raises:
        SetupError: The project cannot be written.
    """
    kept = _free_folder(root, kept_path)
    try:
        kept.mkdir()
        (kept / ".gdignore").touch()
        for file, text in stand_ins.items():
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
    incoming = file.with_suffix(f"{file.suffix}.incoming")
    incoming.write_text(text, encoding="utf-8")
    file.rename(target)
    incoming.rename(file)


def _free_folder(root: Path, path: str) -> Path:
    folder, number = root / path, 0
    while folder.exists():
        number += 1
        folder = root / f"{path}-{number}"
    return folder


def _classes(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield all classes that scripts below a folder declare, but for those of Ludus's own names."""
    for file in sorted(folder.rglob("*.gd")):
        if is_hidden(file, folder):
            continue
        found = _CLASS_NAME.search(file.read_text(encoding="utf-8", errors="replace"))
        if found and not found[1].startswith(_OWN_PREFIX):
            yield found[1], file
