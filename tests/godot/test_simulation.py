"""Games in code without nodes (LudusSimulation) are worlds like any other; real Godot."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ludus.check import CheckConfig, Status, run_checks
from ludus.check.difference import first_difference
from ludus.check.recording import Recording, record
from ludus.errors import EngineError, LudusError
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.session import EngineSession, open_session
from ludus.settings.train_config import PPOConfig, TrainConfig
from ludus.spec.batch import ActionBatch, Batches
from ludus.training.loop import train
from ludus.wire.handshake import EngineConfig
from ludus.wire.reset import ResetAction, ResetRequest
from tests.godot.simulation_games import write_project
from tests.targets import find_game

pytestmark = pytest.mark.engine
TICKS, SUM, DRAW, EPISODES, CREATED = 1, 2, 3, 4, 5
RUNNER_0_ENDS, RUNNER_1_ENDS, ROUND_ENDS = 2, 3, 5
# Pixels per second², in the default settings of a project.
GRAVITY_2D = 980.0


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulations")
    write_project(folder)
    return folder


@pytest.fixture(scope="module")
def rounds(project: Path) -> Iterator[EnginePool]:
    with open_pool(project / "rounds.tscn", PoolConfig(num_worlds=2)) as pool:
        yield pool


def moves(pool: EnginePool, move: int) -> dict[str, ActionBatch]:
    actions = {name: ActionBatch.zeros(own, own.num_agents) for name, own in pool.policies.items()}
    for action in actions.values():
        assert action.discrete is not None
        action.discrete[:] = move
    return actions


def play_round(pool: EnginePool) -> list[Batches]:
    """One frame for the reset, one for each step of the round, in which all move 1, 2, 0, 1, 2."""
    frames = [pool.reset(1)]
    return frames + [pool.step(moves(pool, step % 3)) for step in range(1, ROUND_ENDS + 1)]


def test_the_spec_is_what_the_simulation_declares(rounds: EnginePool) -> None:
    runner, watcher = rounds.spec.policies
    assert [policy.name for policy in rounds.spec.policies] == ["runner", "watcher"]
    assert [agent.path for agent in runner.agents] == ["runner0", "runner1"] * 2
    assert [agent.path for agent in watcher.agents] == ["watcher0"] * 2
    assert (runner.episode, runner.max_episode_steps) == ("world", ROUND_ENDS)
    assert (runner.has_action_mask, watcher.has_action_mask) == (False, True)
    assert runner.settings == {} and watcher.settings["learning_rate"] == 0.01
    assert rounds.spec.ticks_per_step == 2


def test_rewards_and_observations_frame_by_frame(rounds: EnginePool) -> None:
    for step, frame in enumerate(play_round(rounds)[:ROUND_ENDS]):
        watched = frame["watcher"].observation["observation"]
        move_sum = 2 * sum(k % 3 for k in range(1, step + 1))
        assert watched[:, [0, TICKS, SUM]].tolist() == [[2, 2 * step, move_sum]] * 2
        expected = 2 + step % 3 if step else 0
        assert frame["watcher"].reward.tolist() == [expected] * 2
        mask = frame["watcher"].action_mask
        assert mask is not None and mask.tolist() == [[1, int(step % 2 == 0), 1]] * 2


def test_agents_end_early_and_wait_for_the_round(rounds: EnginePool) -> None:
    frames = play_round(rounds)
    active = [frame["runner"].active[:2].astype(int).tolist() for frame in frames]
    assert active == [[1, 1], [1, 1], [0, 1], [0, 0], [0, 0], [1, 1]]
    for step, frame in enumerate(frames):
        runner, watcher = frame["runner"], frame["watcher"]
        ends = [step == RUNNER_0_ENDS, step == RUNNER_1_ENDS] * 2
        assert runner.terminated.tolist() == ends
        assert not runner.truncated.any() and not watcher.terminated.any()
        assert watcher.truncated.tolist() == [step == ROUND_ENDS] * 2
        assert not runner.observation["observation"][~runner.active].any()
    final = frames[RUNNER_0_ENDS]["runner"].final_observation["observation"]
    assert final[:, [0, TICKS, SUM]].tolist() == [[0, 4, 6]] * 2
    assert frames[RUNNER_1_ENDS]["runner"].reward[1] == 1
    final = frames[ROUND_ENDS]["watcher"].final_observation["observation"]
    first = frames[ROUND_ENDS]["watcher"].observation["observation"]
    assert (final[0, TICKS], first[0, TICKS]) == (10, 0)
    assert (final[0, EPISODES], first[0, EPISODES]) == (1, 2)


def test_the_random_stream_depends_on_seed_and_episode_only(rounds: EnginePool) -> None:
    """A simulation that is made anew draws in create(), one that goes on does not."""
    first = rounds.reset(1)["watcher"].observation["observation"].copy()
    assert first[:, CREATED].tolist() == [1, 1]
    rounds.step(moves(rounds, 0))
    seeds = ResetRequest.all_worlds(2, 1)
    seeds.actions[1] = ResetAction.LEAVE
    again = rounds.reset_worlds(seeds)["watcher"].observation["observation"]
    assert again[0, [DRAW, EPISODES, CREATED]].tolist() == [first[0, DRAW], 2, 1]
    assert again[1, [TICKS, DRAW]].tolist() == [2, first[1, DRAW]]
    anew = rounds.reset(1)["watcher"].observation["observation"]
    assert anew[:, EPISODES].tolist() == [1, 1], "all worlds with a seed: made anew"


def test_random_play_inside_the_engine(project: Path) -> None:
    """The ceiling of ``ludus bench`` plays rounds too, also where nothing was reset before."""
    session = open_simulation(project, "rounds", 2)
    result = session.call({"bridge": True}, "run_ceiling", [12, 1])
    assert result["num_steps"] == 12 and result["elapsed_us"] > 0
    episodes = [session.call({"world": i}, "count_episodes", [1]) for i in range(2)]
    assert episodes == [3, 3], "rounds of 5 steps"
    session.close()


def test_calls_reach_the_simulation(project: Path) -> None:
    session = open_simulation(project, "rounds")
    session.reset(ResetRequest.all_worlds(1, 3))
    assert session.call({"world": 0}, "count_episodes", [7]) == 7
    with pytest.raises(LudusError, match=r"rounds\.gd has no method nothing"):
        session.call({"world": 0}, "nothing")
    with pytest.raises(LudusError, match=r"does not let trainers call advance: .*ludus_"):
        session.call({"world": 0}, "advance")
    session.close()


def test_mixed_actions_and_episodes_of_single_agents(project: Path) -> None:
    with open_pool(project / "mixed.tscn", PoolConfig(num_worlds=2)) as pool:
        assert [policy.episode for policy in pool.spec.policies] == ["agent", "agent"]
        pool.reset(1)
        for step in range(1, 8):
            actions: dict[str, ActionBatch] = {}
            for name, policy in pool.policies.items():
                action = ActionBatch.zeros(policy, 2)
                assert action.discrete is not None and action.continuous is not None
                action.discrete[:] = step % 4
                action.continuous[:] = [step, -step]
                actions[name] = action
            frame = pool.step(actions)
            for name, length in (("one", 2), ("other", 3)):
                batch = frame[name]
                counts = [step % length, 1 + step // length, step % 4]
                assert batch.observation["counts"].tolist() == [counts] * 2
                assert batch.observation["aim"].tolist() == [[step, -step]] * 2
                ended = [step % length == 0] * 2
                assert (batch.terminated if name == "one" else batch.truncated).tolist() == ended
                assert not (batch.truncated if name == "one" else batch.terminated).any()
                if ended[0]:
                    final = batch.final_observation["counts"].tolist()
                    assert final == [[length, step // length, step % 4]] * 2
                assert batch.active.all()


def recordings(project: Path, name: str, **config: Any) -> Recording:
    with open_pool(project / f"{name}.tscn", PoolConfig(**config)) as pool:
        return record(pool, config.pop("seed", 5), 45)


def assert_equal(one: Recording, two: Recording) -> None:
    found = first_difference(one, two)
    assert found is None, found.describe()


@pytest.mark.parametrize("name", ["rounds", "mixed", "choice", "fall"])
def test_isolated_worlds_equal_single_ones(project: Path, name: str) -> None:
    isolated = recordings(project, name, num_worlds=3, layout="isolated")
    with open_pool(project / f"{name}.tscn", PoolConfig(layout="isolated")) as pool:
        for index in range(3):
            assert_equal(isolated.world(index), record(pool, 5 + index, 45))


@pytest.mark.parametrize("name", ["rounds", "mixed", "choice"])
def test_the_grid_equals_isolated(project: Path, name: str) -> None:
    isolated = recordings(project, name, num_worlds=3, layout="isolated")
    grid = recordings(project, name, num_worlds=3, layout="grid")
    assert isolated.digest() == grid.digest()


def test_equal_seeds_give_equal_bits_in_spaces_made_anew(project: Path) -> None:
    for layout in ("isolated", "grid"):
        with open_pool(project / "fall.tscn", PoolConfig(num_worlds=3, layout=layout)) as pool:
            first = record(pool, 5, 45)
            assert first.digest() != record(pool, 6, 45).digest()
            assert first.digest() == record(pool, 5, 45).digest()


def test_physics_of_own_spaces(project: Path) -> None:
    """Gravity is the project's, and creation takes the three ticks that it awaits."""
    recording = recordings(project, "fall", num_worlds=2, layout="isolated")
    assert recording.frames[0].tick == 3
    ticks = np.diff([frame.tick for frame in recording.frames])
    assert (ticks == 2).all(), "later episodes await nothing"
    with open_pool(project / "fall.tscn", PoolConfig()) as pool:
        pool.reset(1)
        batch = pool.step({"ball": ActionBatch.zeros(pool.policies["ball"], 1)})["ball"]
        x, y, x_speed, y_speed, height, awaited, found = batch.observation["observation"][0]
        speeds = np.cumsum([GRAVITY_2D / 60 * (1 - 0.1 / 60)] * 2)
        assert x_speed == 0 and y_speed == pytest.approx(speeds[1], rel=2e-3)
        assert y == pytest.approx(speeds.sum() / 60, rel=2e-3) and abs(x) < 50
        assert height == pytest.approx(-9.8 / 60**2 * 3, rel=5e-3)
        assert (awaited, found) == (3, 1)


@pytest.mark.parametrize("name", ["slow", "slow_alone"])
def test_a_world_that_begins_slowly_ticks_alone(project: Path, name: str) -> None:
    """World 1 ends after one step, and its next episodes take 4 and 5 ticks to begin."""
    with open_pool(project / f"{name}.tscn", PoolConfig(num_worlds=2, layout="isolated")) as pool:
        actions = {"ball": ActionBatch.zeros(pool.policies["ball"], 2)}
        pool.reset(1)
        assert pool.times(0).tick == 3 + 3, "create() awaits 3, begin_episode() 1 and 3"
        ticks, slow, steady = [pool.times(0).tick], [], [0.0]
        for _ in range(4):
            slow = pool.step(actions)["ball"].observation["observation"][0].tolist()
            ticks.append(pool.times(0).tick)
        assert np.diff(ticks).tolist() == [2 + 4, 2 + 5, 2, 2]
    with open_pool(project / "fall.tscn", PoolConfig(layout="isolated")) as pool:
        pool.reset(1)
        actions = {"ball": ActionBatch.zeros(pool.policies["ball"], 1)}
        for _ in range(4):
            steady = pool.step(actions)["ball"].observation["observation"][0].tolist()
        assert slow == steady, "world 0 ticked while world 1 began"


def open_simulation(project: Path, name: str, num: int = 1, layout: str = "scene") -> EngineSession:
    target = find_game(project, scene=f"res://{name}.tscn")
    return open_session(target, EngineConfig(num_worlds=num, layout=layout))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("blind", r'agent runner0: res://blind\.gd: observation_entries\("runner"\) is empty'),
        ("idle", r'agent runner0: res://idle\.gd: action_components\("runner"\) is empty'),
        ("lonely", r"res://lonely\.gd: policy_names\(\) is empty"),
        ("no_simulation", r"res://no_simulation\.gd does not extend LudusSimulation"),
        ("broken", r"res://broken\.gd cannot be loaded"),
        ("no_script", "simulation_script of Game is empty"),
    ],
)
def test_scenes_that_cannot_be_trained(project: Path, name: str, words: str) -> None:
    with pytest.raises(LudusError, match=words):
        open_simulation(project, name).close()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("wrong_size", r"world 0, agent watcher0, step 3: observation.*expected 6 numbers, got"),
        ("wrong_mask", r"world 0, agent watcher0, step 0: get_action_mask\(\): expected 3 bytes"),
    ],
)
def test_mistakes_in_play_name_world_agent_and_step(project: Path, name: str, words: str) -> None:
    with (
        pytest.raises(EngineError, match=words),
        open_pool(project / f"{name}.tscn", PoolConfig(num_worlds=2)) as pool,
    ):
        play_round(pool)


def test_beginnings_that_never_end_or_cannot_wait(project: Path) -> None:
    for name, layout, words in (
        ("endless", "isolated", r"world 0: res://endless\.gd: create\(\).*not over after 7 ticks"),
        ("slow", "grid", r"world 1: res://slow\.gd awaits ticks to begin: in the grid no world"),
    ):
        session = open_simulation(project, name, 2, layout)
        with pytest.raises(LudusError, match=words):
            session.reset(ResetRequest.all_worlds(2, 1))
        session.close()


@pytest.mark.games
@pytest.mark.parametrize("name", ["choice", "fall"])
def test_ludus_check_passes(project: Path, name: str) -> None:
    report = run_checks(
        CheckConfig(
            target=project / f"{name}.tscn",
            num_worlds=3,
            num_steps=60,
            num_layout_worlds=8,
            timing_s=0.05,
        )
    )
    wrong = [(check, f.title, f.detail) for check, f in report.findings if f.status is Status.FAIL]
    assert wrong == []


@pytest.mark.training
def test_ppo_learns_it(project: Path, tmp_path: Path) -> None:
    """Chance is right in a third of 10 moves."""
    config = TrainConfig(
        target=str(project / "choice.tscn"),
        num_worlds=16,
        seed=1,
        total_steps=16_000,
        target_return=9.5,
        runs=tmp_path,
        evaluation_episodes=20,
        ppo=PPOConfig(
            hidden_sizes=(32,), rollout_steps=32, minibatch_size=256, epochs=4, learning_rate=0.01
        ),
    )
    result = train(config)
    returns = json.loads((result.path / "evaluation.json").read_bytes())["chooser"]["returns"]
    assert len(returns) == 20 and np.mean(returns) > 9.5
