"""What a game of Godot RL Agents looks like from here, in real Godot 4."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ludus
from ludus.check import CheckConfig, run_checks
from ludus.cli.main import main
from ludus.session import Session
from ludus.spec import ContinuousAction, DiscreteAction
from ludus.spec.batch import ActionBatch
from tests.legacy.gdrl.conftest import TICKS, ages, begin, places, step

pytestmark = pytest.mark.engine

Opened = Callable[..., Session]


def test_game_declares_policies_and_spaces(opened: Opened) -> None:
    walker, watcher = opened().spec.policies
    assert (walker.name, watcher.name) == ("walker", "watcher")
    assert (walker.num_agents, walker.agents_per_world, walker.episode) == (2, 2, "agent")
    assert [agent.path for agent in (*walker.agents, *watcher.agents)] == ["0", "2", "1"]
    assert [(e.name, e.dtype, e.shape) for e in walker.observation] == [
        ("obs", "float32", (3,)),
        ("is_near", "float32", (2,)),
    ]
    assert walker.action == (DiscreteAction("hop", 3), ContinuousAction("move", 2, -1.0, 1.0))
    assert [(e.name, e.dtype, e.shape) for e in watcher.observation] == [
        ("camera_2d", "uint8", (2, 3, 4))
    ]


def test_each_agent_gets_its_own_action_and_reward(opened: Opened) -> None:
    session = opened()
    begin(session)
    for total in (1.0, 2.0):
        batch = step(session, 1.0, -0.5)
        assert places(batch) == [total, -0.5 * total]
        assert batch.reward.tolist() == [1.0, -0.5]
        assert batch.observation["is_near"].tolist() == [[1.0 * (total >= 1), 1.0 * (total < 1)],
                                                         [0.0, 1.0]]  # fmt: skip
    assert batch.observation["obs"][:, 2].tolist() == [1.0, 0.0]  # a bool in the observation


def test_image_has_the_rows_that_were_sent(opened: Opened) -> None:
    session = opened()
    image = begin(session)["watcher"].observation["camera_2d"]
    expected = np.arange(24, dtype=np.uint8)
    expected[23] = 0
    assert np.array_equal(image[0], expected.reshape(2, 3, 4))
    hop = ActionBatch(np.ones((1, 1), np.int64), np.zeros((1, 0), np.float32))
    rest = ActionBatch(np.zeros((2, 1), np.int64), np.zeros((2, 2), np.float32))
    session.send({"walker": rest, "watcher": hop})
    assert session.receive()["watcher"].observation["camera_2d"][0, 1, 2, 3] == 10


def test_agent_that_ended_goes_on_at_once(opened: Opened) -> None:
    session = opened()
    begin(session)
    step(session, 2.0, 0.5)
    batch = step(session, 2.0, 0.5)
    assert batch.terminated.tolist() == [True, False]
    assert not batch.truncated.any()
    assert batch.active.all()
    assert batch.final_index.tolist() == [0]
    before = places(batch)
    assert before[0] < 3.0, "the game has begun again within the step"
    assert places(step(session, 0.5, 0.5)) == [before[0] + 0.5, 1.5]


def test_reset_shows_what_the_first_action_meets(opened: Opened) -> None:
    session = opened()
    begin(session)
    step(session, 1.0, 0.0)
    first = begin(session)["walker"]
    assert not (first.terminated.any() or first.truncated.any() or first.reward.any())
    assert places(first) == [0.0, 0.0], "the actions before the reset are forgotten"
    assert ages(first) == [2 * TICKS - 1] * 2, "two steps have passed in the game"
    batch = step(session, -0.5, 0.5)
    assert places(batch) == [-0.5, 0.5]
    assert batch.reward.tolist() == [-0.5, 0.5]
    assert ages(batch) == [3 * TICKS - 1] * 2


def test_ends_before_the_first_action_are_forgotten(opened: Opened) -> None:
    session = opened()
    begin(session)
    step(session, 2.0, 0.0)
    begin(session)
    for _ in range(2):
        begin(session)
    assert not step(session, 0.0, 0.0).terminated.any()


def test_own_time_limit_truncates_each_agent(opened: Opened) -> None:
    session = opened(max_episode_steps=3, game_arguments={"reset_after": 10_000})
    begin(session)
    ends = [step(session, 0.25, 0.0) for _ in range(2)]
    assert not any(batch.truncated.any() for batch in ends)
    batch = step(session, 0.25, 0.0)
    assert batch.truncated.all()
    assert batch.final_observation["obs"][:, 0].tolist() == places(batch) == [0.75, 0.0]
    assert places(step(session, 0.25, 0.0)) == [1.0, 0.0], "nothing in the game was reset"


@pytest.mark.parametrize("reset_after", [37, 38, 39, 40, 41])
def test_known_time_limit_is_truncated_before_the_jump(opened: Opened, reset_after: int) -> None:
    """No transition that is learned from spans the jump; at most four a jump are lost."""
    session = opened(reset_after=reset_after, game_arguments={"reset_after": reset_after})
    batch = begin(session)["walker"]
    num_truncated = num_active = 0
    for _ in range(60):
        was_active, before = batch.active.copy(), ages(batch)
        batch = step(session, 0.0, 0.0)
        last = dict(
            zip(batch.final_index.tolist(), batch.final_observation.get("obs", []), strict=True)
        )
        for row in range(2):
            if was_active[row]:
                after = last[row][1] if row in last else ages(batch)[row]
                assert after == before[row] + TICKS
                num_active += 1
            assert batch.active[row] or ages(batch)[row] == 0.0
        assert not batch.terminated.any()
        num_truncated += int(batch.truncated.sum())
        batch = copy.deepcopy(batch)
    assert num_truncated >= 2 * 5
    assert num_active >= 120 - 4 * num_truncated


def test_unknown_time_limit_is_a_jump(opened: Opened) -> None:
    session = opened(game_arguments={"reset_after": 15})
    begin(session)
    seen = [step(session, 0.0, 0.0) for _ in range(8)]
    assert not any(batch.terminated.any() or batch.truncated.any() for batch in seen)


def test_call_reaches_all_controllers(opened: Opened) -> None:
    session = opened()
    begin(session)
    returned = session.call({"world": 0}, "call", ["get_name_and_policy"])
    assert returned == ["First of walker", "Watcher of watcher", "Second of walker"]
    step(session, 0.0, 0.0)


def test_game_gets_its_arguments(opened: Opened) -> None:
    session = opened(number=3, env_seed=10, speedup=2, game_arguments={"level": 5})
    (arguments, *_) = session.call({"world": 0}, "call", ["get_arguments"])
    given = {"--env_seed=13", "--speedup=2", "--level=5", f"--action_repeat={TICKS}"}
    assert given <= set(arguments)


@pytest.mark.parametrize("speedup", [1, 8])
def test_a_step_is_as_many_ticks_at_any_speed(opened: Opened, speedup: int) -> None:
    session = opened(speedup=speedup, game_arguments={"reset_after": 10_000})
    first = ages(begin(session)["walker"])
    seen = [ages(step(session, 0.0, 0.0)) for _ in range(5)]
    assert seen == [[age + TICKS * n for age in first] for n in range(1, 6)]


def test_two_games_step_as_one_pool(walkers: Path, nothing_left: None) -> None:
    config = ludus.PoolConfig(num_engines=2, bridge={"action_repeat": TICKS})
    with ludus.open_pool(f"gdrl:{walkers}", config) as pool:
        batches = pool.reset(seed=1)
        assert {name: batch.num_agents for name, batch in batches.items()} == {
            "walker": 4,
            "watcher": 2,
        }


def test_what_no_seed_reaches_is_no_mistake_of_the_game(walkers: Path, nothing_left: None) -> None:
    game = {"action_repeat": TICKS, "game_arguments": {"is_lost": 1}}
    target = f"gdrl:{walkers}"
    report = run_checks(CheckConfig(target=target, bridge=game, num_worlds=1, num_steps=40))
    unknown = {f.title for _, f in report.findings if "no seed reaches this game" in f.detail}
    assert unknown == {
        "equal seeds give equal episodes",
        "an episode does not depend on the one before it",
    }
    assert not any("--num-worlds" in finding.hint for _, finding in report.findings)
    assert report.is_ok


@pytest.mark.screen
def test_window_is_filmed(
    walkers: Path, nothing_left: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "film.mp4"
    target = [f"gdrl:{walkers}", "--action-repeat", str(TICKS), "--max-episode-steps", "5"]
    assert main(["record", *target, "--random", "--seconds", "0.5", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"{out}: 15 frames, 0.50 s, 30 frames/s, walker: ")
    assert said.endswith(", watcher: 1 episodes\n")


def test_commands_take_the_game(
    walkers: Path, nothing_left: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    target = [f"gdrl:{walkers}", "--action-repeat", "4"]
    assert main(["check", *target]) == 0, capsys.readouterr().out
    limits = ["--reset-after", "40"]
    assert main(["train", *target, *limits, "--total-steps", "600", "--device", "cpu"]) == 0
    (run,) = (tmp_path / "runs").iterdir()
    assert main(["evaluate", str(run), "--episodes", "2"]) == 0
    assert "walker" in capsys.readouterr().out
