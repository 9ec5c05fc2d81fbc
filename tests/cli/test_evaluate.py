"""``ludus evaluate`` in an environment that needs no engine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import ludus
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
    assert f"{GAME}, random actions" in table


def test_a_game_needs_something_that_plays_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", GAME]) == 2
    assert "nothing was named that plays it" in capsys.readouterr().err


@pytest.mark.engine
def test_each_policy_has_its_own_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = ludus.train(
        "tag", num_worlds=4, num_engines=1, total_steps=256, evaluation_episodes=0, runs=tmp_path,
        ppo={"rollout_steps": 8, "hidden_sizes": [8]},
    )  # fmt: skip
    files = run.export(parity=False)
    policies = ["--policy", str(files["runner"]), "--policy", str(files["chaser"])]
    assert main(["evaluate", "tag", *policies, "--episodes", "4", "--json"]) == 0
    by_files = json.loads(capsys.readouterr().out)["policies"]
    assert main(["evaluate", str(run.path), "--episodes", "4", "--json"]) == 0
    by_run = json.loads(capsys.readouterr().out)["policies"]
    assert by_files.keys() == {"chaser", "runner"}
    for name in by_files:
        assert by_files[name]["returns"] == pytest.approx(by_run[name]["returns"], abs=1e-3)


def test_a_checkpoint_is_found_from_inside_it(
    trained: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = evaluation(capsys, trained)
    (newest,) = [path for path in Path(trained).glob("checkpoints/*") if path.name.endswith("64")]
    monkeypatch.chdir(newest)
    assert evaluation(capsys, ".") == whole
