"""Which files of the current folder a command runs."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from ludus.folder_imports import look_in_current_folder

SCRIPT = [str(Path(sys.executable).with_name("ludus"))]
MODULE = [sys.executable, "-m", "ludus"]

SERVER = [sys.executable, "-P", "-m", "ludus.cli"]
"""As a game starts its trainer."""

HOSTILE = ("_winapi", "nt", "dill", "org", "pynvml", "onnx", "optuna", "wandb")
"""Names that the standard library, PyTorch and Ludus try to import, there or not."""
ALL_COMMANDS = """
from ludus.cli.main import COMMANDS, main
for command in COMMANDS:
    assert main([command, "--help"]) == 0, command
    main([command, "no-such-thing"])
"""

GAMES = """
import gymnasium
import near

near.check()
gymnasium.register("Game-v0", entry_point="game:Game", max_episode_steps=4)
"""
GAME = """
import multiprocessing
import gymnasium
import numpy as np

class Game(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-1, 1, (1,))
    action_space = gymnasium.spaces.Discrete(2)
    method = "spawn"

    def reset(self, *, seed=None, options=None):
        return np.zeros(1, np.float32), {}

    def step(self, action):
        import late
        late.check()
        if self.method:
            with multiprocessing.get_context(self.method).Pool(1) as pool:
                worker = pool.apply_async(late.work_elsewhere)
                assert worker.get(timeout=60) == "late in a worker"
        Game.method = {"spawn": "forkserver"}.get(self.method)
        return np.zeros(1, np.float32), 0.0, False, False, {}
"""
NEIGHBOUR = """
def check():
    pass

def work_elsewhere():
    import in_worker
    return in_worker.TEXT
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, with hostile files; one that runs leaves its name in ``ran``."""
    for name in HOSTILE:
        (tmp_path / f"{name}.py").write_text(
            f"open({str(tmp_path / 'ran')!r}, 'a').write('{name} ')\n"
        )
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def finders(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget afterwards what was imported, and how."""
    for name in ("multiprocessing.pool", "multiprocessing.spawn"):  # they cannot be loaded twice
        importlib.import_module(name)
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path])
    monkeypatch.setattr(sys, "modules", sys.modules.copy())


def run(command: list[str], *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*command, *arguments], capture_output=True, text=True, timeout=200, check=False
    )


@pytest.mark.slow
@pytest.mark.parametrize("command", [SCRIPT, MODULE, SERVER], ids=["script", "module", "server"])
@pytest.mark.parametrize("arguments", ["engine list", "train --help"])
def test_no_file_of_the_current_folder_runs(
    folder: Path, command: list[str], arguments: str
) -> None:
    done = run(command, *arguments.split())
    assert done.returncode == 0, done.stderr
    assert not (folder / "ran").exists(), (folder / "ran").read_text()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="forkserver")
def test_no_command_runs_a_file_of_the_current_folder(folder: Path) -> None:
    done = run([sys.executable, "-P", "-c", ALL_COMMANDS])
    assert done.returncode == 0, done.stderr
    assert not (folder / "ran").exists(), (folder / "ran").read_text()


@pytest.mark.slow
def test_a_game_and_its_neighbours_are_imported_and_nothing_else(folder: Path) -> None:
    (folder / "my_games.py").write_text(GAMES)
    (folder / "game.py").write_text(GAME)
    for name in ("near", "late"):
        (folder / f"{name}.py").write_text(NEIGHBOUR)
    (folder / "in_worker.py").write_text("TEXT = 'late in a worker'\n")
    settings = ["--total-steps", "16", "--num-worlds", "1", "--num-engines", "1"]
    settings += ["--ppo.rollout-steps", "8", "--evaluation-episodes", "0"]
    done = run(MODULE, "train", "gym:my_games:Game-v0", *settings)
    assert done.returncode == 0, done.stderr
    assert not (folder / "ran").exists(), (folder / "ran").read_text()


@pytest.mark.usefixtures("finders")
def test_libraries_may_not_import_from_there(
    folder: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "a_game.py").write_text("import a_library, a_neighbour\n")
    (folder / "a_neighbour.py").write_text("")
    site = folder / ".venv"  # the libraries' folder lies in the current folder
    site.mkdir()
    (site / "a_library.py").write_text(
        "def try_import():\n"
        "    try:\n        import dill\n    except ImportError:\n        return False\n"
        "    return True\n"
    )
    monkeypatch.setattr(sys, "path", [str(site), *sys.path])
    look_in_current_folder("a_game")
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    a_game: Any = importlib.import_module("a_game")
    assert not a_game.a_library.try_import()
    assert not (folder / "ran").exists()


@pytest.mark.usefixtures("finders")
def test_installed_packages_come_first(folder: Path) -> None:
    (folder / "gymnasium.py").write_text("")
    (folder / "colorsys.py").write_text("raise AssertionError")
    sys.modules.pop("colorsys", None)
    look_in_current_folder("gymnasium")
    look_in_current_folder("colorsys")
    import colorsys

    assert colorsys.__file__ != str(folder / "colorsys.py")
    assert str(folder) not in {getattr(finder, "folder", "") for finder in sys.meta_path}


@pytest.mark.usefixtures("finders")
def test_a_package_folder(folder: Path) -> None:
    (folder / "a_package").mkdir()
    (folder / "a_package" / "__init__.py").write_text("")
    (folder / "a_package" / "games.py").write_text("import a_friend\n")
    (folder / "a_friend.py").write_text("")
    look_in_current_folder("a_package.games")
    games: Any = importlib.import_module("a_package.games")
    assert games.a_friend.__file__ == os.fspath(folder / "a_friend.py")
