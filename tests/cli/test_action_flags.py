"""``--stochastic`` and ``--deterministic`` mean the same in every command that has agents act."""

from __future__ import annotations

from typing import Any

import pytest

from ludus.cli.evaluate import EvaluateCommand
from ludus.cli.league import LeagueCommand
from ludus.cli.main import main
from ludus.cli.play import PlayCommand
from ludus.cli.record import RecordCommand

COMMANDS: dict[str, tuple[type, list[str]]] = {
    "evaluate": (EvaluateCommand, ["run"]),
    "league": (LeagueCommand, ["run"]),
    "play": (PlayCommand, ["target"]),
    "record": (RecordCommand, ["target", "out"]),
}


def command(name: str, **flags: Any) -> Any:
    kind, needed = COMMANDS[name]
    return kind(**dict.fromkeys(needed, "runs/x"), **flags)


@pytest.mark.parametrize("name", COMMANDS)
def test_each_flag_says_the_same_everywhere(name: str) -> None:
    is_league = name == "league"
    assert command(name).choose(default=is_league) is is_league
    for default in (False, True):
        stochastic = () if name == "evaluate" else True
        assert command(name, stochastic=stochastic).choose(default=default) is True
        assert command(name, deterministic=True).choose(default=default) is False


def test_names_choose_the_policies_that_draw() -> None:
    assert command("evaluate", stochastic=("hero",)).choose() == ("hero",)


@pytest.mark.parametrize("name", COMMANDS)
def test_both_flags_are_refused(
    name: str, tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path / "film.mp4")] if name == "record" else []
    assert main([name, "runs/x", *out, "--stochastic", "--deterministic"]) == 2
    assert "--stochastic and --deterministic exclude each other" in capsys.readouterr().err
