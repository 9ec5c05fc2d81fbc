"""Draws and lessons in a real engine: learned by, resumed, and seen by ``make_vec``."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus import LudusVectorEnv, TrainConfig, make_vec
from ludus.cli.main import main
from ludus.runs.metrics import read_metrics
from ludus.settings.policy_config import PPOConfig
from ludus.settings.world_parameters import Lesson, Sampler
from ludus.training.loop import train
from tests.curriculum.signposts import LESSONS, write_signposts
from tests.training.test_on_engine import Stopping
from tests.workers.machines import assert_equal, newest, use_in_process

pytestmark = [pytest.mark.engine, pytest.mark.timeout(300, func_only=True)]


@pytest.fixture(scope="module")
def signposts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_signposts(tmp_path_factory.mktemp("signposts"))


BUDGET = 40_000


def run(signposts: Path, runs: Path, *more: str) -> tuple[Path, float]:
    """Train for the budget; return the run's folder, and the mean return of the evaluation."""
    arguments = [
        "train", str(signposts), "--total-steps", str(BUDGET), "--seed", "1",
        "--runs", str(runs), "--name", "run", "--num-worlds", "16", "--num-engines", "1", *more,
    ]  # fmt: skip
    assert main(arguments) == 0
    folder = runs / "run"
    evaluation = json.loads((folder / "evaluation.json").read_text())
    (policy,) = evaluation.values()
    return folder, policy["mean_return"]


@pytest.mark.slow
@pytest.mark.training
def test_lessons_solve_what_ppo_alone_does_not(signposts: Path, tmp_path: Path) -> None:
    settings = tmp_path / "lessons.toml"
    settings.write_text(LESSONS)
    _, alone = run(signposts, tmp_path / "alone")
    assert alone < 0.1, "chance"
    folder, taught = run(signposts, tmp_path / "taught", "--config", str(settings))
    assert taught == 1.0, "of the whole way"
    lines = read_metrics(folder / "metrics.jsonl")
    lessons = [line["lesson"] for line in lines]
    assert lessons == sorted(lessons)
    assert set(lessons) == {1, 2, 3}
    lengths = [line["parameters"]["length"] for line in lines if line["lesson"] == 2]
    assert all(2 <= length <= 8 for length in lengths)


def test_draws_and_lessons_resume_to_the_bit(signposts: Path, tmp_path: Path) -> None:
    lessons = (Lesson(parameters={"length": 3}, until_steps=6 * 128), Lesson())
    whole = TrainConfig(
        target=str(signposts), num_worlds=4, num_engines=2, seed=5, total_steps=10**9,
        runs=tmp_path, name="whole", evaluation_episodes=0,
        exact_resume=True, checkpoint_every_s=None,
        checkpoint_every_updates=2, curriculum=lessons,
        randomise={"length": 5, "wind": Sampler(normal=(0.0, 1.0))},
        ppo=PPOConfig(rollout_steps=16, hidden_sizes=(16,), learning_rate_schedule="constant"),
    )  # fmt: skip
    train(whole, reporter=Stopping(12))
    half = train(replace(whole, name="half"), reporter=Stopping(8))
    train(replace(whole, name="half"), resume=half.path, reporter=Stopping(4))
    assert_equal(newest(whole.runs / "whole"), newest(half.path))
    names = ("agent_steps", "lesson", "parameters")
    told = [
        [{name: line.get(name) for name in names} for line in read_metrics(path / "metrics.jsonl")]
        for path in (whole.runs / "whole", half.path)
    ]
    assert told[0] == told[1]
    assert [line["lesson"] for line in told[0]] == [1] * 6 + [2] * 6


def test_worker_processes_draw_the_same(
    signposts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use_in_process(monkeypatch)
    lessons = (Lesson(parameters={"length": 3}, until_steps=128), Lesson())
    config = TrainConfig(
        target=str(signposts), num_worlds=2, seed=5, total_steps=256, runs=tmp_path,
        evaluation_episodes=4, checkpoint_every_s=None, checkpoint_every_updates=1,
        exact_resume=True, curriculum=lessons, randomise={"wind": Sampler(normal=(0.0, 1.0))},
        ppo=PPOConfig(rollout_steps=16, hidden_sizes=(16,)),
    )  # fmt: skip
    alone = train(replace(config, name="alone", num_engines=2))
    spread = train(replace(config, name="spread", num_engines=1, cluster="local:2"))
    assert_equal(newest(alone.path), newest(spread.path))
    assert alone.evaluation == spread.evaluation
    alone_lines, spread_lines = (
        read_metrics(result.path / "metrics.jsonl") for result in (alone, spread)
    )
    assert [line["lesson"] for line in spread_lines] == [1, 1, 2, 2]
    for one, other in zip(alone_lines, spread_lines, strict=True):
        assert one["parameters"] == pytest.approx(other["parameters"])


def test_a_run_resumes_in_its_lesson(signposts: Path, tmp_path: Path) -> None:
    lessons = (Lesson(parameters={"length": 3}, until_steps=128), Lesson())
    config = TrainConfig(
        target=str(signposts), num_worlds=8, num_engines=1, total_steps=512, seed=1,
        runs=tmp_path, name="run", evaluation_episodes=0, curriculum=lessons,
        ppo=PPOConfig(rollout_steps=16, hidden_sizes=(8,)),
    )  # fmt: skip
    train(config)
    train(replace(config, total_steps=640), resume=tmp_path / "run")
    lessons_told = [line["lesson"] for line in read_metrics(tmp_path / "run" / "metrics.jsonl")]
    assert lessons_told == [1, 2, 2, 2, 2]


DRAWS = {"length": {"choice": [4, 5]}, "wind": {"uniform": [2, 3]}}


def draws(env: LudusVectorEnv, seed: int, num_steps: int = 40) -> list[NDArray[Any]]:
    """Return length and wind of all worlds in each step of random play."""
    rng = np.random.default_rng(3)
    seen = [env.reset(seed=seed)[0][:, :2]]
    actions = rng.integers(2, size=(num_steps, 4))
    seen += [env.step(actions[step, : env.num_envs])[0][:, :2] for step in range(num_steps)]
    return seen


def test_make_vec_draws_for_each_episode(signposts: Path) -> None:
    with closing(make_vec(signposts, num_worlds=4, randomise=DRAWS)) as env:
        first, again, other = draws(env, 7), draws(env, 7), draws(env, 8)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first[0], other[0])
    seen = np.stack(first)
    assert set(np.unique(seen[:, :, 0])) == {4.0, 5.0}
    assert ((seen[:, :, 1] >= 2) & (seen[:, :, 1] <= 3)).all()
    assert len(np.unique(seen[:, :, 1])) > 8, "each of the four worlds has drawn several times"


def test_draws_of_a_world_depend_on_its_seed_only(signposts: Path) -> None:
    with closing(make_vec(signposts, num_worlds=4, randomise=DRAWS)) as env:
        many = draws(env, 7)
    with closing(make_vec(signposts, num_worlds=1, randomise=DRAWS)) as env:
        one = draws(env, 7)
    np.testing.assert_array_equal(np.stack(many)[:, :1], one)


def test_parameters_of_a_reset_win_over_draws(signposts: Path) -> None:
    with closing(make_vec(signposts, num_worlds=2, randomise=DRAWS)) as env:
        seen, _ = env.reset(seed=1, options={"parameters": {"length": 9}})
    assert seen[:, 0].tolist() == [9.0, 9.0]
    assert (seen[:, 1] >= 2).all()


@pytest.mark.parametrize("mode", ["next_step", "disabled"])
def test_draws_come_in_all_modes(signposts: Path, mode: str) -> None:
    with closing(make_vec(signposts, num_worlds=2, randomise=DRAWS, autoreset_mode=mode)) as env:
        seen = [env.reset(seed=1)[0]]
        for _ in range(30):
            observation, _, terminated, truncated, _ = env.step(np.ones(2, np.int64))
            if mode == "disabled" and (mask := terminated | truncated).any():
                observation, _ = env.reset(options={"reset_mask": mask})
            seen.append(observation)
    assert len(np.unique(np.stack(seen)[:, :, 1])) > 2
