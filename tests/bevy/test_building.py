"""Bevy examples are found and built, and their executables recognised."""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from ludus.engine import GodotFlags, bundled, executable_command
from ludus.engine.bevy_build import bevy_example_names, build_bevy_example
from ludus.engine.exported import is_bevy_game
from ludus.errors import SetupError, TargetError
from ludus.target import Executable
from tests.bevy.conftest import TARGET
from tests.targets import find_game

pytestmark = [pytest.mark.engine, pytest.mark.bevy, pytest.mark.timeout(180, func_only=True)]

FLAGS = GodotFlags(user_args=("--ludus-connect=unix:/a",))


def test_the_example_is_a_target(executable: Path) -> None:
    assert TARGET in bevy_example_names()
    target = find_game(TARGET)
    assert target == Executable(executable)
    assert target.name == "cartpole"
    with pytest.raises(TargetError, match="decides itself"):
        find_game(TARGET, scene="res://a.tscn")


def test_unknown_examples_are_told_of_known_ones() -> None:
    with pytest.raises(TargetError) as caught:
        find_game("bevy:cartpool")
    assert "close: bevy:cartpole" in caught.value.message


def test_executables_are_recognised(executable: Path, tmp_path: Path) -> None:
    assert is_bevy_game(executable)
    command = (str(executable), "--ludus-connect=unix:/a")
    assert executable_command(executable, FLAGS) == (*command, "--ludus-headless")
    watched = replace(FLAGS, headless=False, fixed_fps=None)
    assert executable_command(executable, watched) == (*command, "--ludus-real-time")
    other = Path(sys.executable)
    assert not is_bevy_game(other)
    assert "--headless" in executable_command(other, FLAGS)
    empty = tmp_path / "empty"
    empty.touch()
    assert not is_bevy_game(empty)
    assert not is_bevy_game(tmp_path / "missing")


def test_without_cargo_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(SetupError) as caught:
        build_bevy_example("cartpole")
    assert "needs Cargo" in caught.value.message
    assert "rustup" in caught.value.hint


BROKEN = {
    "Cargo.toml": '[workspace]\nresolver = "3"\nmembers = ["examples/*"]\n',
    "Cargo.lock": 'version = 4\n\n[[package]]\nname = "broken"\nversion = "0.1.0"\n',
    "examples/broken/Cargo.toml": """\
[package]
name = "broken"
version = "0.1.0"
autobins = false

[[example]]
name = "broken"
path = "src/main.rs"
""",
    "examples/broken/src/main.rs": "fn main() { nothing }\n",
}


def test_an_example_that_does_not_compile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert shutil.which("cargo"), "these tests need Cargo"
    for name, text in BROKEN.items():
        file = tmp_path / "engines" / "bevy" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    monkeypatch.setattr(bundled, "_package_folder", lambda: tmp_path / "src" / "ludus")
    monkeypatch.delenv("CARGO_TARGET_DIR", raising=False)
    assert bevy_example_names() == ["bevy:broken"]
    with pytest.raises(SetupError, match="bevy:broken cannot be built: Cargo ended with 101"):
        build_bevy_example("broken")
