"""Imports of Godot projects, kept from one test to the next and from one run to the next.

An import starts Godot's editor, which takes three seconds of a core, and most projects of the tests
look alike to it: what it writes depends on the classes and resources of a project, not on what its
scripts do.
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
_NAMES = re.compile(rb"^(?:config/name|run/main_scene)=.*", re.MULTILINE)
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
        shutil.copytree(kept, project.root, dirs_exist_ok=True)

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


def _key(engine: InstalledEngine, root: Path) -> str:
    digest = hashlib.sha256(f"{engine.path} {engine.version_text}".encode())
    for file in sorted(_files(root)):
        digest.update(f"\0{file.relative_to(root)}\0".encode())
        digest.update(_what_is_imported(file))
    return digest.hexdigest()[:32]


def _what_is_imported(file: Path) -> bytes:
    data = file.read_bytes()
    match file.suffix:
        case ".gd":
            return b"\n".join(_CLASS_LINES.findall(data))
        case ".tscn" | ".tres":
            return data.partition(b"\n")[0]  # has the UID
        case ".godot":
            return _NAMES.sub(b"", data)
        case _:
            return data


def _files(root: Path) -> list[Path]:
    found: list[Path] = []
    for folder, folders, names in os.walk(root):
        folders[:] = [name for name in folders if not name.startswith(".")]
        found += [Path(folder, name) for name in names]
    return found
