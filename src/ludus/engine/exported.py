"""What an executable was made with: Godot 3, Godot 4 or ``bevy_ludus``."""

from __future__ import annotations

import mmap
import struct
from pathlib import Path
from typing import BinaryIO

from ludus.engine.kinds import EngineKind

__all__ = ["exported_version", "exported_with", "is_bevy_game"]

_BEVY_SIGNATURE = b"This game is made with bevy_ludus and speaks the Ludus protocol."
"""What a game made with ``bevy_ludus`` answers to ``--ludus-about``."""
_MAGIC = b"GDPC"
_HEAD = struct.Struct("<4sIII")
"""Magic, format of the pack, major and minor version of Godot."""
_TAIL = struct.Struct("<Q4s")
"""The end of a program with embedded data: size of the data in bytes, magic."""
_KINDS = {3: EngineKind.GODOT3, 4: EngineKind.GODOT4}


def is_bevy_game(program: Path) -> bool:
    """Tell whether an executable was made with ``bevy_ludus``; False if it cannot be read."""
    try:
        with (
            program.open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content,
        ):
            return content.find(_BEVY_SIGNATURE) >= 0
    except (OSError, ValueError):  # an empty file cannot be mapped
        return False


def exported_with(program: Path) -> EngineKind | None:
    """Return the Godot that ``program`` was exported with; errors as :func:`exported_version`."""
    version = exported_version(program)
    return None if version is None else _KINDS.get(version[0])


def exported_version(program: Path) -> tuple[int, int] | None:
    """Return major and minor version of that Godot; None if ``program`` has no data of Godot.

    The data (``.pck``) lies beside the program, in the resources of a macOS bundle, or at the end
    of the program itself. If it cannot be read, the result is None: starting the program will
    report the reason.
    """
    resources = program.parent.parent / "Resources"
    # Where Godot looks for the data, in its order.
    packs = (
        program.with_suffix(".pck"),
        program.with_name(program.name + ".pck"),
        resources / f"{program.stem}.pck",
    )
    try:
        for pack in packs:
            if pack.is_file():
                with pack.open("rb") as file:
                    return _version_of_data(file, 0)
        with program.open("rb") as file:
            end = file.seek(0, 2) - _TAIL.size
            if end < 0:
                return None
            file.seek(end)
            size, magic = _TAIL.unpack(file.read(_TAIL.size))
            return _version_of_data(file, end - size) if magic == _MAGIC else None
    except OSError:
        return None


def _version_of_data(file: BinaryIO, start: int) -> tuple[int, int] | None:
    if start < 0:
        return None
    file.seek(start)
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    magic, _, major, minor = _HEAD.unpack(head)
    return (major, minor) if magic == _MAGIC else None
