"""``ludus evaluate`` in an environment that needs no engine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from ludus.cli.main import main
from tests.cli.short_runs import short_run

GAME = "gym:CartPole-v1"


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(short_run(tmp_path_factory.mktemp("runs")))


def evaluation(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main(["evaluate", *arguments, "--episodes", "6", "--json"]) == 0
    return json.loads(capsys.readouterr().out)["policies"]["agent"]


def test_actions_are_drawn_only_if_asked_for(
    trained: str, capsys: pytest.CaptureFixture[str]
) -> None:
    probable = evaluation(capsys, trained)
    assert evaluation(capsys, trained, "--deterministic") == probable
    drawn = evaluation(capsys, trained, "--stochastic")
    assert evaluation(capsys, trained, "--stochastic", "agent") == drawn != probable

    assert main(["evaluate", trained, "--stochastic", "nobody"]) == 2
    assert "there is no policy 'nobody'" in capsys.readouterr().err


def test_the_share_of_episodes_that_reach_a_goal(
    trained: str, capsys: pytest.CaptureFixture[str]
) -> None:
    middle = sorted(evaluation(capsys, trained, "--stochastic")["returns"])[3]
    goal = ["--stochastic", "--goal-return", str(middle)]
    counted = evaluation(capsys, trained, *goal)
    share = sum(each >= middle for each in counted["returns"]) / 6
    assert counted["share_reaching"] == share < 1.0
    assert main(["evaluate", trained, "--episodes", "6", *goal]) == 0
    assert f"{share:.1%}" in capsys.readouterr().out


def test_random_play_in_a_run_and_in_a_game(
    trained: str, capsys: pytest.CaptureFixture[str]
) -> None:
    in_game = evaluation(capsys, GAME, "--random", "--num-worlds", "2")
    # The run was trained with two worlds.
    assert evaluation(capsys, trained, "--random") == in_game
    assert in_game["std_return"] > 0.0
    assert main(["evaluate", GAME, "--random"]) == 0
    table = capsys.readouterr().out
    assert "mean" in table
    assert "± std" in table


def test_a_game_needs_something_that_plays_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", GAME]) == 2
    assert "nothing was named that plays it" in capsys.readouterr().err


def test_a_checkpoint_is_found_from_inside_it(
    trained: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = evaluation(capsys, trained)
    (newest,) = [path for path in Path(trained).glob("checkpoints/*") if path.name.endswith("64")]
    monkeypatch.chdir(newest)
    assert evaluation(capsys, ".") == whole
