"""Which Godot an exported game was made with, read from the head of its data."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

from ludus.engine.kinds import EngineKind

__all__ = ["exported_with"]

_MAGIC = b"GDPC"
_HEAD = struct.Struct("<4sII")
"""Magic, format of the pack, major version of Godot."""
_TAIL = struct.Struct("<Q4s")
"""What ends a program with embedded data: bytes of the data, magic."""
_KINDS = {3: EngineKind.GODOT3, 4: EngineKind.GODOT4}


def exported_with(program: Path) -> EngineKind | None:
    """Return the kind of Godot that ``program`` runs; None if it carries no data of Godot.

    The data (``.pck``) lies beside the program, in the resources of a macOS bundle, or at the end
    of the program itself. What cannot be read carries none: starting it tells why.
    """
    try:
        return _find_kind(program)
    except OSError:
        return None


def _find_kind(program: Path) -> EngineKind | None:
    for pack in _packs(program):
        if pack.is_file():
            with pack.open("rb") as file:
                return _kind(file, 0)
    with program.open("rb") as file:
        end = file.seek(0, 2)
        if end < _TAIL.size:
            return None
        file.seek(end - _TAIL.size)
        size, magic = _TAIL.unpack(file.read(_TAIL.size))
        return _kind(file, end - _TAIL.size - size) if magic == _MAGIC else None


def _packs(program: Path) -> list[Path]:
    """Return where Godot looks for the data, in its order."""
    resources = program.parent.parent / "Resources"
    places = [program.with_suffix(".pck"), program.with_name(program.name + ".pck")]
    return [*places, resources / f"{program.stem}.pck"]


def _kind(file: BinaryIO, start: int) -> EngineKind | None:
    if start < 0:
        return None
    file.seek(start)
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    magic, _, major = _HEAD.unpack(head)
    return _KINDS.get(major) if magic == _MAGIC else None
