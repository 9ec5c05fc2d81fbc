"""A game exported from Godot 3 runs as one, with the flags of Godot 3."""

from __future__ import annotations

import shlex
import subprocess
from pathlib import Path

import pytest

from ludus.engine import GodotFlags, InstalledEngine
from ludus.engine.launch import executable_command
from ludus.session import LaunchOptions, open_session
from ludus.wire.handshake import EngineConfig
from tests.godot.conftest import reset, step
from tests.godot3.conftest import make_project
from tests.targets import find_game

pytestmark = pytest.mark.engine

PRESETS = """\
[preset.0]
name="Linux"
platform="Linux/X11"
export_filter="all_resources"
include_filter=""
exclude_filter=""
[preset.0.options]
"""
EXPORT_TIMEOUT_S = 120.0


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory, godot3: InstalledEngine) -> Path:
    """The data as Godot exports them, beside a program that plays them."""
    folder = tmp_path_factory.mktemp("exported")
    project = make_project(tmp_path_factory.mktemp("games"))
    (project / "broken.gd").unlink()
    (project / "export_presets.cfg").write_text(PRESETS)
    engine = str(godot3.executable(headless=True))
    pack = folder / "game.pck"
    subprocess.run(
        [engine, "--path", str(project), "--export-pack", "Linux", str(pack)],
        check=True,
        capture_output=True,
        timeout=EXPORT_TIMEOUT_S,
    )
    program = folder / "game.x86_64"
    program.write_text(f'#!/bin/sh\nexec {shlex.join([engine, "--main-pack", str(pack)])} "$@"\n')
    program.chmod(0o755)
    return program


def test_it_gets_the_flags_of_godot_3(exported: Path) -> None:
    command = executable_command(exported, GodotFlags())
    assert "--headless" not in command
    assert "--no-window" in command


def test_it_trains(exported: Path) -> None:
    session = open_session(find_game(exported), EngineConfig(num_worlds=2), LaunchOptions())
    try:
        reset(session)
        batch = step(session, 5)["agent"]
        assert batch.observation["steps"].tolist() == [[5.0], [5.0]]
    finally:
        session.close()
