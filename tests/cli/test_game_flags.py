from __future__ import annotations

import importlib
import re
from dataclasses import fields

import pytest

from ludus.cli.main import COMMANDS, main, parse
from ludus.settings.pool_config import GameConfig


@pytest.mark.parametrize(
    "command",
    ["train", "sweep", "evaluate", "play", "record", "league", "check", "bench", "cluster"],
)
def test_commands_that_open_a_game_have_the_same_flags(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "--help"]) == 0
    shown = capsys.readouterr().out
    for part in fields(GameConfig):
        if part.name == "bridge":  # its settings are flags of their own
            continue
        assert re.search(rf"--{part.name.replace('_', '-')}[ ,]", shown), part.name
    assert ("--worlds " in shown) == (command == "bench")


@pytest.mark.parametrize(
    "line",
    [
        "train cartpole",
        "sweep cartpole",
        "evaluate cartpole --random",
        "play cartpole",
        "record cartpole",
        "league runs/x",
        "check cartpole",
        "bench cartpole",
        "cluster check cartpole",
    ],
)
def test_engines_are_left_unpinned_on_request(line: str) -> None:
    name, *arguments = line.split()
    module = importlib.import_module(COMMANDS[name][0])
    assert parse(module, name, arguments).is_pinned
    assert not parse(module, name, [*arguments, "--no-is-pinned"]).is_pinned


@pytest.mark.parametrize("command", ["play", "check"])
def test_commands_that_need_one_engine_say_so(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "gym:CartPole-v1", "--num-engines", "2"]) == 2
    assert "num_engines must be 1 in this command, not 2" in capsys.readouterr().err
