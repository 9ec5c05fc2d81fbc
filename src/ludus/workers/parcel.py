"""A game on its way to other machines: its files, known by their content.

A node keeps each game once, in the user cache under ``games/<hash>``; sent again are only games
whose files have changed.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from ludus.engine.cache import require_cache_root
from ludus.errors import SetupError
from ludus.target import (
    CargoPackage,
    Example,
    Executable,
    Scene,
    parse_target,
    prepare,
    split_addresses,
)

__all__ = ["Parcel", "find_parcel", "has_parcel", "unpack_parcel"]

BESIDE = ("assets", "data_*", "*.so", "*.so.*", "*.dylib", "*.framework")
"""What a program may need that lies beside it: Bevy's assets, C# of Godot, native extensions."""

LEFT_OUT = {".git", ".godot", ".import", "__pycache__"}
"""Folders of projects that each machine makes for itself."""

KEEP_S = 14 * 24 * 3600.0
"""Seconds that a game is kept after a run has used it."""

Files = dict[str, tuple[bool, bytes]]
"""By relative path: whether it is a program, and the content."""


@dataclass(frozen=True)
class Parcel:
    """The files of a game.

    Attributes:
        folder: What the paths are relative to.
        paths: Of the files, sorted.
        digest: SHA-256 of paths and contents, hexadecimal.
        target: What to open there, relative to the folder that a node keeps it in.
        scene: Scene of a project.
    """

    folder: Path
    paths: tuple[str, ...]
    digest: str
    target: str
    scene: str | None = None

    def settings(self) -> dict[str, Any]:
        """Return the settings that open it on the machine that this is called on, which has it."""
        return {"target": str(_place(self.digest) / self.target), "scene": self.scene}

    def read(self) -> Files:
        """Return all files."""
        return {
            path: (os.access(self.folder / path, os.X_OK), (self.folder / path).read_bytes())
            for path in self.paths
        }


def find_parcel(target: str, scene: str | Path | None, godot: Path | None) -> Parcel | None:
    """Return the files of what is to be played; None where every machine has it already.

    Args:
        target: As the user named it.
        scene: Scene to run instead of the main scene.
        godot: Engine to use.

    Raises:
        TargetError: There is no such target.
        SetupError: Its files cannot be read, or an example could not be built.
    """
    if split_addresses(target):
        return None
    parsed = parse_target(target, scene=scene, godot=godot)
    if not isinstance(parsed, Example | CargoPackage | Executable | Scene):
        return None
    game = prepare(parsed)
    if isinstance(game, Executable):
        folder = game.path.parent
        found = [game.path, *folder.glob(f"{game.path.stem}.*")]
        found += [each for pattern in BESIDE for each in folder.glob(pattern)]
        return _pack(folder, found, game.path.name, None)
    if isinstance(parsed, Example) or not isinstance(game, Scene):
        return None
    root = game.project.root
    return _pack(root, [root], ".", game.path)


def _pack(folder: Path, found: list[Path], target: str, scene: str | None) -> Parcel:
    files: set[Path] = set()
    for each in found:
        if each.is_dir():
            for place, folders, names in os.walk(each):
                folders[:] = [name for name in folders if name not in LEFT_OUT]
                files |= {Path(place, name) for name in names}
        else:
            files.add(each)
    paths = sorted(file.relative_to(folder).as_posix() for file in files if file.is_file())
    total = hashlib.sha256()
    try:
        for path in paths:
            content = hashlib.sha256((folder / path).read_bytes()).hexdigest()
            is_program = os.access(folder / path, os.X_OK)
            total.update(f"{path}\0{is_program}\0{content}\n".encode(errors="surrogateescape"))
    except OSError as error:
        raise SetupError(
            f"the game cannot be sent to other machines: {error}", "make its files readable"
        ) from None
    return Parcel(folder, tuple(paths), total.hexdigest(), target, scene)


def has_parcel(digest: str) -> bool:
    """Return whether this machine keeps a game; it is kept for a while longer then."""
    with contextlib.suppress(OSError):
        os.utime(_place(digest))
    return _place(digest).is_dir()


def unpack_parcel(digest: str, files: Files) -> None:
    """Keep a game on this machine, and forget those that were not used for long.

    Args:
        digest: Of the parcel.
        files: Its files.

    Raises:
        SetupError: It cannot be written.
    """
    place = _place(digest)
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        incoming = Path(tempfile.mkdtemp(prefix=".incoming-", dir=place.parent))
        try:
            for path, (is_program, content) in files.items():
                assert ".." not in PurePosixPath(path).parts, "paths are relative to the folder"
                file = incoming / path
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(content)
                file.chmod(0o755 if is_program else 0o644)
            incoming.rename(place)
        finally:
            shutil.rmtree(incoming, ignore_errors=True)
    except OSError as error:
        if not place.is_dir():  # otherwise another run was quicker
            raise SetupError(
                f"the game cannot be kept in {place}: {error}",
                "make room in the user cache, or remove its folder games",
            ) from None
    for other in place.parent.iterdir():
        if time.time() - other.stat().st_mtime > KEEP_S:
            shutil.rmtree(other, ignore_errors=True)


def _place(digest: str) -> Path:
    return require_cache_root() / "games" / digest
