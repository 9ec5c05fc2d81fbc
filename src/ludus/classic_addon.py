"""Let a project that was written for godot-ai use the add-on's classes of the same names.

The files that declare those classes are put aside. Where each stood, a script of one line stands
for it, so that scenes and scripts that name its path, or its UID, find it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ludus.addon import (
    ADDON_PATH,
    CLASSIC_PATH,
    AddonChange,
    godot4_root,
    install_addon,
    install_folder,
)
from ludus.engine.bundled import bundled_root
from ludus.errors import ConfigError, SetupError

__all__ = ["KEPT_PATH", "ClassicChange", "install_classic"]

KEPT_PATH = "godot-ai.old"
"""Where replaced files are kept; Godot does not look into it."""

_ROOT_CLASS = "AIBaseEnvironment"
_OWN_PREFIX = "Ludus"
_CLASS_NAME = re.compile(r"^\s*class_name\s+(\w+)", re.MULTILINE)
_STAND_IN = """\
extends "res://{path}"
## Stands where a file of godot-ai stood, for scenes and scripts that name its path.
## Made by `ludus addon install --classic`, which keeps that file in {kept}.
"""


@dataclass(frozen=True)
class ClassicChange:
    """What an installation did.

    Attributes:
        addon: To the add-on.
        classic: To the classes of godot-ai's names.
        replaced: Files of godot-ai that were put aside, relative to the project.
        kept: Folder that they lie in now, relative to the project; empty if none were.
    """

    addon: AddonChange
    classic: AddonChange
    replaced: tuple[str, ...] = ()
    kept: str = ""


def install_classic(project: Path, *, force: bool = False) -> ClassicChange:
    """Install the add-on with the classes of godot-ai's names, in the place of godot-ai's own.

    Repeating it changes nothing.

    Args:
        project: Folder of the project, or anything inside it.
        force: Overwrite files of the add-on that were changed by hand.

    Raises:
        TargetError: There is no Godot 4 project.
        ConfigError: Files of the add-on were changed by hand, or a class of the game has a name
            that the add-on needs.
        SetupError: The project cannot be written.
    """
    root = godot4_root(project)
    ours = _own_classes()
    theirs = {name: file for name, file in _declared_classes(root) if name in ours}
    _refuse_foreign_classes(root, theirs)
    addon = install_addon(root, force=force)
    classic = install_folder(root, CLASSIC_PATH, force=force)
    if not theirs:
        return ClassicChange(addon, classic)
    try:
        kept = _put_aside(root, theirs, ours)
    except OSError as error:
        raise SetupError(
            f"files of godot-ai in {root} could not be replaced: {error}",
            hint="the project folder must be writable, and the disk not full",
        ) from error
    names = sorted(file.relative_to(root).as_posix() for file in theirs.values())
    return ClassicChange(addon, classic, tuple(names), kept)


def _own_classes() -> dict[str, str]:
    """Return the classes of godot-ai's names that come with Ludus, and their paths in a project."""
    root = bundled_root()
    found = dict(_classes(root / CLASSIC_PATH))
    return {name: file.relative_to(root).as_posix() for name, file in found.items()}


def _declared_classes(root: Path) -> Iterator[tuple[str, Path]]:
    """Yield all classes that a game declares."""
    own = {root / ADDON_PATH, root / CLASSIC_PATH}
    return (found for found in _classes(root) if own.isdisjoint(found[1].parents))


def _classes(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield all classes that scripts below a folder declare, but for those of Ludus's own names."""
    for file in sorted(folder.rglob("*.gd")):
        folders = [parent for parent in file.parents if parent.is_relative_to(folder)]
        if ".godot" in file.parts or any((parent / ".gdignore").exists() for parent in folders):
            continue
        found = _CLASS_NAME.search(file.read_text(encoding="utf-8", errors="replace"))
        if found and not found[1].startswith(_OWN_PREFIX):
            yield found[1], file


def _refuse_foreign_classes(root: Path, theirs: dict[str, Path]) -> None:
    """Class names are unique: beside godot-ai's root class, all of these are godot-ai's."""
    if not theirs or _ROOT_CLASS in theirs:
        return
    rows = "\n".join(f"  {name}: {file.relative_to(root)}" for name, file in theirs.items())
    raise ConfigError(
        f"the game has classes of these names, which the classes of godot-ai need:\n{rows}",
        hint=f"rename them; they are not taken for godot-ai's, as there is no {_ROOT_CLASS}",
    )


def _put_aside(root: Path, theirs: dict[str, Path], ours: dict[str, str]) -> str:
    """Replace files of godot-ai; return where they are kept, relative to the project."""
    kept = _free_folder(root)
    kept.mkdir()
    (kept / ".gdignore").touch()
    # The root class comes last: until then a repetition knows whose the others are.
    for name in sorted(theirs, key=lambda name: name == _ROOT_CLASS):
        file = theirs[name]
        target = kept / file.relative_to(root)
        target.parent.mkdir(parents=True, exist_ok=True)
        text = _STAND_IN.format(path=ours[name], kept=kept.name)
        incoming = file.with_suffix(".gd.incoming")
        incoming.write_text(text, encoding="utf-8")
        file.rename(target)
        incoming.rename(file)
    return kept.name


def _free_folder(root: Path) -> Path:
    folder, number = root / KEPT_PATH, 0
    while folder.exists():
        number += 1
        folder = root / f"{KEPT_PATH}-{number}"
    return folder
