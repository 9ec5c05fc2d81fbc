"""References of a project to parts of the add-on that have moved or are gone."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from ludus.disk import write_atomically

__all__ = ["find_dropped", "moved_scripts", "rewrite_references"]

_SUFFIXES = {".cfg", ".gd", ".godot", ".tres", ".tscn"}
"""Text files that name scripts. Binary scenes find theirs by uid, which moves along."""

_DROPPED = re.compile(
    rb"\bLudus(?:Simulation|SimulationHost|Training|Pace)\b"
    rb"|(?:\bLudus|/root/Ludus[\"']\))\.(?:start_training|play_round|write_policies)\b"
    rb"|addons/ludus/ludus_(?:simulation|simulation_host|training|pace)\.gd"
)
"""What Godot 3's add-on had until version 0.1.0: simulations in code, and guided training."""

_AUTOLOAD_TYPE = re.compile(rb"(:\s*|->\s*|\bas\s+)LudusBridge\b(?!\s*\.)")
"""The autoload as a type: the class of that name is no longer a node and has only its enums."""


def moved_scripts(bundled: Iterable[str]) -> dict[str, str]:
    """Map the names that scripts had in a flat folder to where they are now.

    The first versions had all scripts side by side, and all names began with ``ludus_``. Now only
    those of scripts that users place, extend or name do.

    Args:
        bundled: Files of the add-on, relative to its folder.
    """
    moved: dict[str, str] = {}
    for path in bundled:
        folder, _, name = path.rpartition("/")
        if folder and name.endswith(".gd"):
            moved[name if name.startswith("ludus_") else f"ludus_{name}"] = path
    return moved


def rewrite_references(root: Path, folder: str, moved: dict[str, str]) -> tuple[str, ...]:
    """Rewrite what a Godot 4 project says of scripts that have moved, in all of its text files.

    These are the paths in scenes, resources, scripts and settings, and the type ``LudusBridge`` of
    variables that hold the autoload, which becomes ``Node``.

    Args:
        root: Folder of the project.
        folder: Folder of the add-on in it, which is left alone itself.
        moved: Old names to new paths, both relative to that folder.

    Returns:
        The files that were changed, relative to the project.

    Raises:
        OSError: A file cannot be read or written.
    """
    if not moved:
        return ()
    prefix = f"res://{folder}/".encode()
    names = "|".join(re.escape(name) for name in sorted(moved))
    pattern = re.compile(re.escape(prefix) + rb"(" + names.encode() + rb")\b")
    changed: list[str] = []
    for file in _text_files(root, root / folder):
        before = file.read_bytes()
        after = pattern.sub(lambda match: prefix + moved[match[1].decode()].encode(), before)
        if file.suffix == ".gd":
            after = _AUTOLOAD_TYPE.sub(rb"\1Node", after)
        if after != before:
            mode = file.stat().st_mode
            write_atomically(file, after)
            file.chmod(mode)
            changed.append(file.relative_to(root).as_posix())
    return tuple(changed)


def find_dropped(root: Path, folder: str) -> tuple[str, ...]:
    """List the files of a Godot 3 project that use what its add-on no longer has.

    Args:
        root: Folder of the project.
        folder: Folder of the add-on in it, which is left out.

    Raises:
        OSError: A file cannot be read.
    """
    files = (file for file in _text_files(root, root / folder) if file.suffix != ".godot")
    return tuple(
        file.relative_to(root).as_posix() for file in files if _DROPPED.search(file.read_bytes())
    )


def _text_files(root: Path, left_out: Path) -> Iterator[Path]:
    for place, folders, names in os.walk(root):
        here = Path(place)
        folders[:] = sorted(
            name for name in folders if not name.startswith(".") and here / name != left_out
        )
        for name in sorted(names):
            file = here / name
            if file.suffix in _SUFFIXES and not file.is_symlink():
                yield file
