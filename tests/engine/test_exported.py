from __future__ import annotations

import struct
from pathlib import Path

import pytest

from ludus.engine.exported import exported_with
from ludus.engine.kinds import EngineKind


def pack(major: int) -> bytes:
    return struct.pack("<4s5I", b"GDPC", 1 if major == 3 else 2, major, 6, 2, 0) + bytes(64)


def program_at(folder: Path, tail: bytes = b"") -> Path:
    program = folder / "game.x86_64"
    program.write_bytes(b"\x7fELF" + bytes(100) + tail)
    return program


@pytest.mark.parametrize(("major", "kind"), [(3, EngineKind.GODOT3), (4, EngineKind.GODOT4)])
@pytest.mark.parametrize("name", ["game.pck", "game.x86_64.pck"])
def test_data_beside_the_program(tmp_path: Path, name: str, major: int, kind: EngineKind) -> None:
    (tmp_path / name).write_bytes(pack(major))
    assert exported_with(program_at(tmp_path)) is kind


@pytest.mark.parametrize(("major", "kind"), [(3, EngineKind.GODOT3), (4, EngineKind.GODOT4)])
def test_data_inside_the_program(tmp_path: Path, major: int, kind: EngineKind) -> None:
    data = pack(major)
    tail = data + struct.pack("<Q4s", len(data), b"GDPC")
    assert exported_with(program_at(tmp_path, tail)) is kind


def test_data_in_a_bundle(tmp_path: Path) -> None:
    for folder in ("MacOS", "Resources"):
        (tmp_path / "Contents" / folder).mkdir(parents=True)
    program = tmp_path / "Contents/MacOS/game"
    program.write_bytes(bytes(100))
    (tmp_path / "Contents/Resources/game.pck").write_bytes(pack(4))
    assert exported_with(program) is EngineKind.GODOT4


@pytest.mark.parametrize(
    "tail",
    [b"", struct.pack("<Q4s", 1 << 40, b"GDPC"), struct.pack("<Q4s", 2, b"GDPC"), pack(7)],
    ids=["none", "a size beyond the file", "a size below the head", "not at the end"],
)
def test_a_program_without_data(tmp_path: Path, tail: bytes) -> None:
    assert exported_with(program_at(tmp_path, tail)) is None


def test_an_unknown_version_of_godot_is_not_recognised(tmp_path: Path) -> None:
    (tmp_path / "game.pck").write_bytes(pack(7))
    assert exported_with(program_at(tmp_path)) is None


@pytest.mark.parametrize("size", [0, 3, 11])
def test_files_too_small_for_data_have_none(tmp_path: Path, size: int) -> None:
    program = tmp_path / "game"
    program.write_bytes(bytes(size))
    assert exported_with(program) is None


def test_a_missing_program_has_no_data(tmp_path: Path) -> None:
    assert exported_with(tmp_path / "game") is None
