"""Policy files that act for the other agents remember one episode at a time; real Godot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit
from numpy.typing import NDArray

import ludus
from ludus.export.convert import to_model
from ludus.model import ModelRunner, write_model
from ludus.settings.train_config import PPOConfig
from tests.export.trained_runs import make_policy

pytestmark = pytest.mark.engine

EARLY_LENGTH = 2  # of one runner in each world, which then waits for the others
LENGTHS = [4, 6]
NUM_FRAMES = 3


@pytest.fixture(scope="module")
def scene(tasks: Path) -> Path:
    """One watcher in each world, and runners, of which one ends after two steps and waits."""
    return tasks / "oracle_world.tscn"


@pytest.fixture(scope="module")
def runner(scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy file of runners with a memory that see three frames."""
    with ludus.open_pool(scene) as pool:
        spec = pool.policies["runner"]
    config = PPOConfig(hidden_sizes=(4,), memory_size=4, frame_stack=NUM_FRAMES)
    path = tmp_path_factory.mktemp("policies") / "runner.ludus.json"
    write_model(path, to_model(make_policy(spec, config), spec))
    return path


class Witness:
    """Notes what policy files look at.

    Attributes:
        frames: ``float32[num_slots, NUM_FRAMES, 5]`` of each step: episode, step and so on.
        memories: ``float32[num_slots, 4]`` of each step.
    """

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.frames: list[NDArray[Any]] = []
        self.memories: list[NDArray[Any]] = []
        act = ModelRunner.act

        def note(this: ModelRunner, observation: Any, mask: Any, memory: Any, *rest: Any) -> Any:
            self.frames.append(observation["observation"].copy())
            self.memories.append(memory.copy())
            return act(this, observation, mask, memory, *rest)

        patch.setattr(ModelRunner, "act", note)

    def assert_episodes_are_apart(self, last_steps: Sequence[int] = ()) -> None:
        """Hold that all of an episode was seen and remembered, and nothing of another one.

        Args:
            last_steps: Steps whose observations may stand alone: nobody acts on them.
        """
        frames, memories = np.concatenate(self.frames), np.concatenate(self.memories)
        is_agent = frames[:, -1, 0] > 0  # episodes count from 1, and empty slots observe zeros
        frames, remembers = frames[is_agent], memories[is_agent].max(1) != 0
        np.testing.assert_array_equal(frames[:, :, 0], frames[:, -1:, 0].repeat(NUM_FRAMES, 1))
        steps, now = frames[:, :, 1], frames[:, -1, 1]
        assert remembers.any()
        assert not remembers[now == 0].any()
        assert np.isin(now[~remembers], (0, *last_steps)).all()
        expected = np.maximum(now[:, None] + np.arange(1 - NUM_FRAMES, 1), 0)
        np.testing.assert_array_equal(steps[remembers], expected[remembers])


@pytest.fixture
def witness(monkeypatch: pytest.MonkeyPatch) -> Witness:
    return Witness(monkeypatch)


def make_vec(scene: Path, runner: Path, mode: str) -> ludus.LudusVectorEnv:
    envs = ludus.make_vec(
        scene, policy="watcher", num_worlds=2, autoreset_mode=mode, others={"runner": runner}
    )
    envs.reset(seed=1, options={"parameters": [{"length": length} for length in LENGTHS]})
    return envs


@pytest.mark.parametrize("mode", ["same_step", "next_step", "disabled"])
def test_an_end_is_forgotten_in_every_mode(
    scene: Path, runner: Path, mode: str, witness: Witness
) -> None:
    envs = make_vec(scene, runner, mode)
    num_ends = 0
    try:
        for _ in range(20):
            _, _, terminated, *_ = envs.step(np.zeros(2, np.int64))
            num_ends += terminated.sum()
            if mode == "disabled" and terminated.any():
                envs.reset(options={"reset_mask": terminated})
        assert num_ends >= 5
        last_steps = (EARLY_LENGTH, *LENGTHS) if mode == "next_step" else ()
        witness.assert_episodes_are_apart(last_steps)
    finally:
        envs.close()


@pytest.mark.parametrize("mode", ["same_step", "next_step", "disabled"])
def test_a_reset_of_one_world_is_forgotten_there_only(
    scene: Path, runner: Path, mode: str, witness: Witness
) -> None:
    envs = make_vec(scene, runner, mode)
    try:
        for _ in range(2):
            envs.step(np.zeros(2, np.int64))
        envs.reset(options={"reset_mask": np.array([True, False])})
        for _ in range(3):
            envs.step(np.zeros(2, np.int64))
        witness.assert_episodes_are_apart()
        steps = [frames[:, -1, 1].max() for frames in np.split(witness.frames[-1], 2)]
        assert steps == [2, 4]
        assert [memory.any() for memory in np.split(witness.memories[-1], 2)] == [True, True]
    finally:
        envs.close()


def test_an_end_just_before_a_reset_of_another_world_is_forgotten(
    scene: Path, runner: Path, witness: Witness
) -> None:
    envs = make_vec(scene, runner, "same_step")
    try:
        ended = [envs.step(np.zeros(2, np.int64))[2] for _ in range(LENGTHS[0])]
        assert ended[-1].tolist() == [True, False]
        envs.reset(options={"reset_mask": ~ended[-1]})
        for _ in range(2):
            envs.step(np.zeros(2, np.int64))
        witness.assert_episodes_are_apart()
    finally:
        envs.close()


def test_a_single_environment_forgets_at_ends_and_at_a_time_limit(
    scene: Path, runner: Path, witness: Witness
) -> None:
    game = ludus.make(scene, policy="watcher", others={"runner": runner})
    env: gymnasium.Env[Any, Any] = TimeLimit(game, max_episode_steps=4)
    try:
        for length in (3, 0, 3, 3, 0, 0):
            env.reset(options={"parameters": {"length": length}})
            ends = [env.step(0)[2:4] for _ in range(length or 4)]
            assert ends[-1] == (length == 3, length == 0)
            env.reset()
            env.step(0)
        witness.assert_episodes_are_apart()
    finally:
        env.close()
