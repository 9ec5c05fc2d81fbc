"""``ludus.load_policy``: runs and files act on one observation and on batches."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ludus
from ludus.errors import ArgumentError, CheckpointError, ConfigError, PolicyFileError, UsageError

KINDS = ("run", ".ludus.json", ".onnx")


def trained(tmp_path: Path, target: str, **ppo: Any) -> ludus.Run:
    return ludus.train(
        target, runs=tmp_path, name="run", num_worlds=2, num_engines=1, seed=3, total_steps=64,
        evaluation_episodes=0, ppo={"rollout_steps": 8, "hidden_sizes": [16], **ppo},
    )  # fmt: skip


def loaded(run: ludus.Run, kind: str) -> ludus.LoadedPolicy:
    if kind == "run":
        return ludus.load_policy(run.path)
    (file,) = run.export(run.path / f"policy{kind}", parity=False).values()
    return ludus.load_policy(file)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("form", ["discrete", "multi_discrete", "continuous"])
def test_one_observation_and_a_batch_get_the_same_actions(
    tmp_path: Path, form: str, kind: str
) -> None:
    policy = loaded(trained(tmp_path, f"gym:Identity-{form}-v0"), kind)
    observations = np.stack([policy.observation_space.sample() for _ in range(6)])
    batch = policy.act(observations)
    for observation, of_batch in zip(observations, batch, strict=True):
        action = policy.act(observation)
        assert policy.action_space.contains(action)
        assert np.allclose(action, of_batch, atol=1e-6)


def test_files_and_runs_agree(tmp_path: Path) -> None:
    run = trained(tmp_path, "gym:Identity-continuous-v0")
    policies = [loaded(run, kind) for kind in KINDS]
    observations = np.stack([policies[0].observation_space.sample() for _ in range(20)])
    first, *others = (policy.act(observations) for policy in policies)
    for other in others:
        assert np.allclose(first, other, atol=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_a_memory_goes_on_until_it_is_cleared(tmp_path: Path, kind: str) -> None:
    run = trained(tmp_path, "gym:Identity-continuous-v0", memory_size=8, sequence_length=8)
    policy = loaded(run, kind)
    observations = np.stack([policy.observation_space.sample() for _ in range(3)])
    first = policy.act(observations).copy()
    second = policy.act(observations).copy()
    assert not np.allclose(first, second)
    policy.forget(np.array([True, False, False]))
    third = policy.act(observations).copy()
    assert np.allclose(third[0], first[0])
    assert not np.allclose(third[1:], first[1:])
    with pytest.raises(UsageError, match="remembers 3 agents, but 1 act now"):
        policy.act(observations[0])
    policy.forget()
    assert np.allclose(policy.act(observations[0]), first[0], atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_kept_until_an_episode_ends(tmp_path: Path, kind: str) -> None:
    run = trained(tmp_path, "gym:Identity-continuous-v0", frame_stack=3)
    policy = loaded(run, kind)
    low, high = -np.ones((2, 2), np.float32), np.ones((2, 2), np.float32)
    alone = policy.act(high).copy()
    policy.forget()
    policy.act(low)
    assert not np.allclose(policy.act(high), alone)
    policy.forget(np.array([True, False]))
    third = policy.act(high)
    assert np.allclose(third[0], alone[0])
    assert not np.allclose(third[1], alone[1])
    with pytest.raises(UsageError, match="remembers 2 agents, but 1 act now"):
        policy.act(low[0])
    policy.forget()
    assert np.allclose(policy.act(high[0]), alone[0], atol=1e-6)


@pytest.mark.parametrize("kind", ["run", ".ludus.json"])
def test_drawn_actions_differ_and_masks_hold(tmp_path: Path, kind: str) -> None:
    policy = loaded(trained(tmp_path, "gym:Masked-v0"), kind)
    observations = np.stack([policy.observation_space.sample() for _ in range(50)])
    mask = np.tile([True, False, True, False], (50, 1))
    drawn = policy.act(observations, action_mask=mask, stochastic=True)
    assert set(drawn.tolist()) == {0, 2}
    assert policy.act(observations[0], action_mask=mask[0]) in (0, 2)


def test_entries_are_named_in_a_dictionary(tmp_path: Path) -> None:
    policy = ludus.load_policy(trained(tmp_path, "gym:Pictures-v0").path)
    sample = policy.observation_space.sample()
    assert policy.act(sample) in (0, 1)
    with pytest.raises(UsageError, match='the observation lacks "number"'):
        policy.act({"image": sample["image"]})
    with pytest.raises(
        UsageError, match=r'"image" has shape \[3, 12, 12\], expected \[12, 12, 1\]'
    ):
        policy.act({**sample, "image": np.zeros((3, 12, 12), np.uint8)})
    with pytest.raises(ArgumentError, match="observes a dictionary with image, number"):
        policy.act(np.zeros(3))


@pytest.mark.parametrize("observation", [{"a": 1}, "left", [[1.0], [2.0, 3.0]], [None, "x"]])
def test_what_is_no_array_of_numbers_is_refused(tmp_path: Path, observation: object) -> None:
    policy = ludus.load_policy(trained(tmp_path, "gym:Identity-continuous-v0").path)
    kind = type(observation).__name__
    expected = rf'"observation" is a {kind} that is not an array of numbers, expected .* \[\d\]'
    with pytest.raises(ArgumentError, match=expected):
        policy.act(observation)


def test_what_is_no_policy_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "a.ludus.json").write_text("{}")
    (tmp_path / "a.onnx").write_bytes(b"nothing")
    (tmp_path / "folder").mkdir()
    with pytest.raises(PolicyFileError):
        ludus.load_policy(tmp_path / "a.ludus.json")
    with pytest.raises(PolicyFileError, match="is not a policy that Ludus has exported"):
        ludus.load_policy(tmp_path / "a.onnx")
    with pytest.raises(PolicyFileError):
        ludus.load_policy(tmp_path / "none.ludus.json")
    with pytest.raises(CheckpointError, match="is not a run"):
        ludus.load_policy(tmp_path / "folder")
    run = trained(tmp_path, "gym:Identity-discrete-v0")
    with pytest.raises(ConfigError, match="has no policy hero"):
        ludus.load_policy(run.path, "hero")
    with pytest.raises(UsageError, match="takes the most probable actions only"):
        loaded(run, ".onnx").act(np.zeros(4), stochastic=True)
