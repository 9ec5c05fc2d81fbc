"""Programs that a run names are started if this user's Ludus made the run, or a person said so."""

from __future__ import annotations

import io
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import ludus
from ludus.cli.main import main
from ludus.errors import EngineError, UsageError
from ludus.runs.run_folder import RunFolder
from ludus.runs.saved import trained_config
from ludus.runs.trust import PROGRAM_SETTINGS, make_mark, require_trust
from ludus.training.loop import train


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "ludus"


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """A game that leaves a file where it was started, and ends."""
    path = tmp_path / "game.x86_64"
    path.write_text(f"#!/bin/sh\necho started >> {tmp_path / 'started'}\n")
    path.chmod(0o755)
    return path


@pytest.fixture
def run(trained: Path, program: Path, tmp_path: Path) -> Path:
    """A run of this user in that game."""
    folder = RunFolder(shutil.copytree(trained, tmp_path / "runs" / "run"))
    folder.write_config(replace(folder.read_config(), target=str(program)))
    return folder.path


def lose_mark(run: Path, **changes: Any) -> None:
    values = json.loads((run / "config.json").read_bytes())
    del values["made_by"]
    (run / "config.json").write_text(json.dumps({**values, **changes}))


def was_started(program: Path) -> bool:
    return (program.parent / "started").exists()


COMMANDS = {
    "train": ["train", "--resume", "RUN"],
    "explain": ["train", "--resume", "RUN", "--explain"],
    "config": ["train", "--config", "RUN/config.json"],
    "evaluate": ["evaluate", "RUN"],
    "random": ["evaluate", "RUN", "--random"],
    "play": ["play", "RUN", "--headless"],
    "play in the game": ["play", "RUN", "--in-engine", "--headless"],
    "record": ["record", "RUN", "--out", "film.mp4"],
    "export": ["export", "RUN"],
    "league": ["league", "RUN"],
    "sweep": ["sweep", "--config", "RUN/config.json", "--set", "ppo.gamma=0.9,0.99"],
}


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS.keys())
@pytest.mark.parametrize("by", ["nobody", "another key", "other programs"])
def test_no_command_starts_what_a_foreign_run_names(
    command: list[str], by: str, run: Path, program: Path, state: Path,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    if by == "nobody":
        lose_mark(run)
    elif by == "another key":
        (state / "run_key").unlink()
    else:
        other = Path(shutil.copy(program, tmp_path / "other.x86_64"))
        values = json.loads((run / "config.json").read_bytes())
        (run / "config.json").write_text(json.dumps({**values, "target": str(other)}))
        program = other
    assert main([word.replace("RUN", str(run)) for word in command]) == 2
    shown = capsys.readouterr().err
    assert f"  {program}\n" in shown
    assert "--trust" in shown
    assert not was_started(program)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["train", "evaluate", "play", "league"])
def test_trust_is_said_once(
    name: str, run: Path, program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    lose_mark(run)
    command = [word.replace("RUN", str(run)) for word in COMMANDS[name]]
    assert main([*command, "--trust"]) in {3, 4}  # it is no game, as starting it has shown
    assert was_started(program)
    assert main(command) in {3, 4}
    assert main(["evaluate", str(run)]) == 4
    assert was_started(program)
    other = Path(shutil.copytree(run, tmp_path / "copy"))
    assert main(["evaluate", str(other)]) == 2, "the answer is for that folder"
    values = json.loads((run / "config.json").read_bytes())
    (run / "config.json").write_text(json.dumps({**values, "target": shutil.copy(program, "b")}))
    assert main(["evaluate", str(run)]) == 2, "and for that program"


def test_a_run_of_this_user_never_asks(run: Path, program: Path, tmp_path: Path) -> None:
    moved = run.rename(tmp_path / "moved")
    with pytest.raises(EngineError):
        ludus.evaluate(moved)
    assert was_started(program)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("answer", "is_allowed"), [("y\n", True), ("\n", False), ("", False)])
def test_a_person_is_asked_once_and_shown_the_program(
    answer: str, is_allowed: bool, run: Path, program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lose_mark(run)
    for _ in range(2):
        shown = Terminal()
        monkeypatch.setattr("sys.stdin", Terminal(answer))
        monkeypatch.setattr("sys.stderr", shown)
        if is_allowed:
            trained_config(run)
        else:
            with pytest.raises(UsageError, match="was not made by your ludus"):
                trained_config(run)
        if _ == 0 or not is_allowed:
            assert f"  {program}\nStart it, now and later? [y/N] " in shown.getvalue()
        else:
            assert shown.getvalue() == ""


def test_examples_and_installed_environments_never_ask(
    small: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "config.json"
    file.write_text("{}")
    for target in ("cartpole", "godot3:cartpole", "bevy:shooter", "play", "gym:CartPole-v1",
                   "gym:gymnasium.envs:CartPole-v1", "127.0.0.1:11011"):  # fmt: skip
        require_trust(file, {"target": target, "scene": None, "bridge": {}})
    (tmp_path / "mine.py").write_text("")
    with pytest.raises(UsageError, match=f"\n  {tmp_path / 'mine.py'}"):
        require_trust(file, {"target": "gym:mine:Env-v0"})
    run = train(small()).path
    lose_mark(run)
    assert main(["evaluate", str(run), "--episodes", "1"]) == 0


@pytest.mark.parametrize("name", ["godot", "token_file", "scene"])
def test_other_settings_that_name_files_count(name: str, run: Path, program: Path) -> None:
    lose_mark(run, target="cartpole", **{name: str(program)})
    with pytest.raises(UsageError, match=str(program)):
        trained_config(run)
    trained_config(run, uses=[of for of in PROGRAM_SETTINGS if of != name])
    typed: dict[str, Any] = {name: "typed" if name == "scene" else Path("typed")}
    trained_config(run, **typed)


@pytest.mark.parametrize("value", ["touch started; true", "mine:reward", ["a list"]])
def test_what_a_bridge_would_start_counts(
    value: Any, run: Path, program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text("import pathlib\npathlib.Path('started').touch()\n")
    spaces = {"action_space": "Discrete(2)", "observation_space": "Box(0, 1, (1,))"}
    bridge = {"exeCmd": value, "start_timeout_s": 1.0, **spaces}
    lose_mark(run, target="gymgodot:127.0.0.1:0", bridge=bridge, num_worlds=1, num_engines=1)
    assert main(["evaluate", str(run)]) == 2
    assert not was_started(program)
    with pytest.raises(UsageError, match="exeCmd: "):
        trained_config(run)
    folder = RunFolder(run)
    folder.write_config(folder.read_config())
    trained_config(run)  # this user's now


def test_a_target_that_was_typed_never_asks(run: Path, program: Path) -> None:
    lose_mark(run)
    with pytest.raises(EngineError):
        ludus.evaluate(program, run)
    assert was_started(program)


def test_the_key_is_this_users_alone(state: Path) -> None:
    settings = {"target": "/bin/true"}
    mark = make_mark(settings)
    key = state / "run_key"
    assert key.stat().st_mode & 0o777 == 0o600
    assert make_mark(settings) == mark
    key.chmod(0o644)
    assert make_mark(settings) is None, "others may have read it"
    key.chmod(0o600)
    if os.geteuid() == 0:
        os.chown(key, 65534, -1)
        assert make_mark(settings) is None, "another user may have made it"
