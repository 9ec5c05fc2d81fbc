"""Imports of Godot projects, kept from one test to the next and from one run to the next.

An import starts Godot's editor, which takes three to eight seconds of a core, and most projects of
the tests look alike to it: what a game needs of it depends on the named classes and on resources
such as pictures, not on scripts without a name, on scenes, or on settings of the running game.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from ludus.engine import InstalledEngine, Project

__all__ = ["KeptImports"]

_Import = Callable[[InstalledEngine, Project, float], None]
# What Godot's cache of global classes is made of.
_CLASS_LINES = re.compile(rb"^(?:class_name|extends|@icon|@tool|@abstract)\b.*", re.MULTILINE)
_IS_NAMED = re.compile(rb"^class_name\b", re.MULTILINE)
_BASE_BY_PATH = re.compile(rb"^extends\s+[\"'](res://)?(.+?)[\"']", re.MULTILINE)
# Sections of project.godot that are for the running game.
_SECTION = re.compile(rb"^(?=\[\w+\]$)", re.MULTILINE)
_OF_THE_GAME = (b"[application]", b"[autoload]", b"[debug]", b"[display]", b"[input]", b"[physics]")
# Text that Godot reads as it is.
_UNCHANGED = (".json", ".md", ".toml", ".txt")
# Made while games run or for the editor's window.
_NOT_KEPT = ("editor", "shader_cache", "ludus_import*")


class KeptImports:
    """Imports a project by copying what the import of one like it wrote.

    Args:
        folder: Where imports are kept.
        run_import: Imports a project, given engine, project and the longest time in seconds.
    """

    def __init__(self, folder: Path, run_import: _Import) -> None:
        self._folder = folder
        self._run_import = run_import

    def run(self, engine: InstalledEngine, project: Project, timeout_s: float) -> None:
        """Import a project."""
        kept = self._folder / _key(engine, project.root)
        if not kept.is_dir():
            self._keep(kept, engine, project, timeout_s)
        foreign = _without_script(kept, project.root)
        shutil.copytree(kept, project.root, ignore=foreign, dirs_exist_ok=True)

    def _keep(
        self, kept: Path, engine: InstalledEngine, project: Project, timeout_s: float
    ) -> None:
        before = set(_files(project.root))
        self._run_import(engine, project, timeout_s)
        with tempfile.TemporaryDirectory(dir=self._folder) as scratch:
            made = Path(scratch) / "made"
            ignored = shutil.ignore_patterns(*_NOT_KEPT)
            shutil.copytree(project.root / ".godot", made / ".godot", ignore=ignored)
            for file in set(_files(project.root)) - before:
                beside = made / file.relative_to(project.root)
                beside.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(file, beside)
            if not kept.exists():  # else another process was faster
                made.rename(kept)


def _without_script(kept: Path, root: Path) -> Callable[[str, list[str]], set[str]]:
    """Return what names the kept files about scripts that a project does not have."""

    def ignored(folder: str, names: list[str]) -> set[str]:
        place = root / Path(folder).relative_to(kept)
        ids = {name for name in names if name.endswith(".uid")}
        return {name for name in ids if not (place / name.removesuffix(".uid")).exists()}

    return ignored


def _key(engine: InstalledEngine, root: Path) -> str:
    digest = hashlib.sha256(f"{engine.path} {engine.version_text}".encode())
    for file in sorted(_files(root)):
        if (content := _what_is_imported(file, root)) is not None:
            digest.update(f"\0{file.relative_to(root)}\0".encode())
            digest.update(content)
    return digest.hexdigest()[:32]


def _what_is_imported(file: Path, root: Path) -> bytes | None:
    """Return the part of a file that an import depends on, or None if it does not."""
    data = file.read_bytes()
    match file.suffix:
        case ".gd":
            return _class_lines(file, root) if _IS_NAMED.search(data) else None
        case ".tscn" | ".tres":
            head = data.partition(b"\n")[0]
            return head if b"uid=" in head else None
        case ".godot":
            sections = _SECTION.split(data)
            return b"".join(part for part in sections if not part.startswith(_OF_THE_GAME))
        case suffix if suffix in _UNCHANGED:
            return None
        case _:
            return data


def _class_lines(file: Path, root: Path) -> bytes:
    """Return what the cache of global classes says of a script, and of nameless ones below it."""
    data = file.read_bytes()
    lines = _CLASS_LINES.findall(data)
    if base := _BASE_BY_PATH.search(data):
        path = (root if base[1] else file.parent) / base[2].decode()
        lines += [_class_lines(path, root)] if path.is_file() else []
    return b"\n".join(lines)


def _files(root: Path) -> list[Path]:
    found: list[Path] = []
    for folder, folders, names in os.walk(root):
        folders[:] = [name for name in folders if not name.startswith(".")]
        found += [Path(folder, name) for name in names]
    return found
