"""A game that was exported, as ``exeCmd``: with GymGodot's node or ours, a window or none."""

from __future__ import annotations

import contextlib
import shlex
import shutil
import subprocess
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from ludus.engine import EngineKind, find_engine
from ludus.legacy.addon import install_legacy_addon
from ludus.record.screen import screen
from tests.legacy.gymgodot.conftest import left_processes
from tests.legacy.gymgodot.test_drop_in import FIVE_STEPS, PROJECT

pytestmark = [pytest.mark.engine, pytest.mark.games, pytest.mark.screen]

PRESET = """\
[preset.0]

name="Linux/X11"
platform="Linux/X11"
runnable=true
custom_features=""
export_filter="all_resources"
include_filter=""
exclude_filter=""
export_path=""
script_export_mode=1
script_encryption_key=""

[preset.0.options]

binary_format/64_bits=true
"""


@pytest.fixture(scope="module", params=["theirs", "ours"])
def pack(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The game as the editor exports it, scripts compiled; a folder that has nothing else."""
    folder = tmp_path_factory.mktemp("exported")
    project = folder / "project"
    shutil.copytree(PROJECT, project)
    if request.param == "ours":
        install_legacy_addon(project)
    (project / "export_presets.cfg").write_text(PRESET)
    made = folder / "game" / "game.pck"
    made.parent.mkdir()
    engine = find_engine(EngineKind.GODOT3).executable(headless=True)
    command = [engine, "--no-window", "--path", project, "--export-pack", "Linux/X11", made]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    return made


@pytest.mark.parametrize("is_windowed", [False, True])
def test_an_exported_game_plays(pack: Path, tmp_path: Path, is_windowed: bool) -> None:
    program = find_engine(EngineKind.GODOT3).executable(headless=not is_windowed)
    start = [str(program), "--main-pack", pack.name, "./cartpole.tscn"]
    with screen() if is_windowed else contextlib.nullcontext():
        env = gymnasium.make(
            "server-v0",
            serverPort=0,
            exeCmd=f"cd {shlex.quote(str(pack.parent))} && {shlex.join(start)}",
            action_space=gymnasium.spaces.Discrete(2),
            observation_space=gymnasium.spaces.Box(-np.inf, np.inf, (4,)),
            window_render=is_windowed,
            renderPath=f"{tmp_path}/",
        )
        try:
            assert not env.reset()[0].any()
            for expected in FIVE_STEPS:
                assert env.step(0)[0] == pytest.approx(np.array(expected), abs=1e-6)
            if is_windowed:
                env.render()
                assert (tmp_path / "0.png").stat().st_size > 0
        finally:
            env.close()
    assert "godot" not in " ".join(left_processes())
