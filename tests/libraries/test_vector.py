"""``ludus.make_vec`` against known answers; real Godot."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import psutil
import pytest
from gymnasium.vector import AutoresetMode

import ludus
from ludus.errors import SequenceError, UsageError

pytestmark = pytest.mark.engine

NUM = 4
LENGTHS = [2, 3, 5, 0]
PARAMETERS = [{"length": length} for length in LENGTHS]


@pytest.fixture(scope="module")
def shared(oracle: Path) -> Iterator[ludus.LudusVectorEnv]:
    envs = ludus.make_vec(oracle, num_worlds=2, num_engines=2)
    yield envs
    envs.close()


@pytest.fixture
def envs(shared: ludus.LudusVectorEnv) -> ludus.LudusVectorEnv:
    shared.reset(seed=11, options={"parameters": PARAMETERS})
    return shared


def act(envs: ludus.LudusVectorEnv, action: int = 0) -> Any:
    return envs.step(np.full(NUM, action))


def test_autoreset_is_in_the_same_step(envs: ludus.LudusVectorEnv) -> None:
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    steps, episodes = np.zeros(NUM, int), np.ones(NUM, int)
    for number in range(1, 13):
        observation, reward, terminated, truncated, infos = act(envs, number % 5)
        steps += 1
        has_ended = steps == LENGTHS
        np.testing.assert_array_equal(terminated, has_ended)
        np.testing.assert_allclose(reward, steps * 0.1, rtol=1e-6)
        assert not truncated.any()
        assert ("final_obs" in infos) == has_ended.any()
        if has_ended.any():
            np.testing.assert_array_equal(infos["_final_obs"], has_ended)
        for i in range(NUM):
            if has_ended[i]:
                final = infos["final_obs"][i]
                assert final[[0, 1, 2, 4]].tolist() == [
                    episodes[i],
                    steps[i],
                    number % 5,
                    2 * steps[i],
                ]
                episodes[i] += 1
                steps[i] = 0
            elif has_ended.any():
                assert infos["final_obs"][i] is None
            last = number % 5 if steps[i] else -1
            assert observation[i, [0, 1, 2, 4]].tolist() == [
                episodes[i],
                steps[i],
                last,
                2 * steps[i],
            ]


def test_one_seed_is_seed_plus_i_over_all_engines(envs: ludus.LudusVectorEnv) -> None:
    one, _ = envs.reset(seed=20)
    listed, _ = envs.reset(seed=[20, 21, 22, 23])
    array, _ = envs.reset(seed=np.array([20, 21, 22, 23]))
    np.testing.assert_array_equal(one, array)
    turned, _ = envs.reset(seed=[23, 22, 21, 20])
    np.testing.assert_array_equal(one, listed)
    np.testing.assert_array_equal(one[::-1], turned)
    assert len(set(one[:, 3].tolist())) == NUM


def test_a_seed_of_none_goes_on_with_the_stream(envs: ludus.LudusVectorEnv) -> None:
    first, _ = envs.reset(seed=20)
    second, _ = envs.reset(seed=[20, None, 22, None])
    np.testing.assert_array_equal(first[[0, 2]], second[[0, 2]])
    assert second[[1, 3], 0].tolist() == [2, 2]
    assert (second[[1, 3], 3] != first[[1, 3], 3]).all()


def test_reset_mask_leaves_the_other_worlds_alone(envs: ludus.LudusVectorEnv) -> None:
    before = act(envs, 3)[0]
    mask = np.array([True, False, False, True])
    after, _ = envs.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(after[~mask], before[~mask])
    assert after[mask][:, [0, 1, 2, 4]].tolist() == [[2, 0, -1, 0]] * 2


def test_parameters_stay_until_they_are_set_again(envs: ludus.LudusVectorEnv) -> None:
    envs.reset(seed=0)
    act(envs)
    assert act(envs)[2].tolist() == [True, False, False, False]
    envs.reset(seed=0, options={"parameters": {"length": 1}})
    assert act(envs)[2].all()


def test_truncation_is_not_termination(envs: ludus.LudusVectorEnv) -> None:
    parameters = [{"length": 1}, {"length": 0, "truncate_after": 1}, {"length": 3}, {}]
    envs.reset(seed=0, options={"parameters": parameters})
    _, _, terminated, truncated, infos = act(envs)
    assert terminated.tolist() == [True, False, False, False]
    assert truncated.tolist() == [False, True, False, False]
    assert [final is not None for final in infos["final_obs"]] == [True, True, False, False]
    assert infos["_final_obs"].tolist() == [True, True, False, False]
    assert infos["final_obs"][1][:2].tolist() == [1, 1]


def test_forms_are_those_of_the_spaces(envs: ludus.LudusVectorEnv) -> None:
    assert envs.num_envs == NUM
    spaces: Any = envs
    observation, reward, terminated, truncated, _ = envs.step(spaces.action_space.sample())
    assert observation in spaces.observation_space
    assert (reward.dtype, reward.shape) == (np.float32, (NUM,))
    assert (terminated.dtype, truncated.dtype) == (np.bool_, np.bool_)


def test_returned_arrays_are_not_reused(envs: ludus.LudusVectorEnv) -> None:
    kept = act(envs, 1)
    copies = [array.copy() for array in kept[:4]]
    act(envs, 2)
    for array, copy in zip(kept[:4], copies, strict=True):
        np.testing.assert_array_equal(array, copy)


WRONG_RESETS: list[dict[str, Any]] = [
    {"options": {"gravity": 1}},
    {"seed": [1, 2]},
    {"seed": -1},
    {"seed": 1.7},
    {"seed": 2**63},
    {"seed": np.array([0.0, 1.0, 2.0, 3.0])},
    {"options": {"reset_mask": np.ones(2, np.bool_)}},
    {"options": {"reset_mask": np.ones(NUM, np.int64)}},
    {"options": {"parameters": [{}]}},
    {"options": {"parameters": {"length": float("nan")}}},
    {"options": {"parameters": {"length": object()}}},
]


@pytest.mark.parametrize(
    "arguments",
    WRONG_RESETS,
    ids=[
        "option",
        "too few seeds",
        "-1",
        "1.7",
        "2**63",
        "floats",
        "mask shape",
        "mask dtype",
        "too few",
        "NaN",
        "no JSON",
    ],
)
def test_wrong_resets_are_refused_and_nothing_breaks(
    envs: ludus.LudusVectorEnv, arguments: dict[str, Any]
) -> None:
    with pytest.raises(UsageError):
        envs.reset(**arguments)
    assert envs.reset(seed=0)[0].shape == (NUM, 5)


def test_a_step_before_the_first_reset_is_refused(oracle: Path) -> None:
    envs = ludus.make_vec(oracle)
    try:
        with pytest.raises(SequenceError, match="before the first reset"):
            envs.step(np.zeros(1, np.int64))
        envs.reset(seed=0)
        assert envs.step(np.zeros(1, np.int64))[0][0, 1] == 1
    finally:
        envs.close()


def test_one_of_several_policies_must_be_chosen(tasks: Path) -> None:
    with pytest.raises(UsageError, match="several policies"):
        ludus.make_vec(tasks / "oracle_world.tscn")


def test_other_policies_act_at_random_or_as_given() -> None:
    def stand(observed: Any) -> Any:
        return np.zeros((len(observed), 2))

    seen: list[Any] = []
    for others in ({}, {}, {"runner": stand}):
        envs: Any = ludus.make_vec("tag", num_worlds=3, policy="chaser", others=others)
        try:
            envs.reset(seed=4)
            action = np.zeros_like(envs.action_space.sample())
            seen.append([envs.step(action)[0] for _ in range(20)][-1])
        finally:
            envs.close()
    np.testing.assert_equal(seen[0], seen[1])
    with pytest.raises(AssertionError):
        np.testing.assert_equal(seen[0], seen[2])
    with pytest.raises(UsageError, match="the other policies are"):
        ludus.make_vec("tag", policy="chaser", others={"hero": "x.ludus.json"})


def test_gymnasium_makes_the_registered_examples() -> None:
    with pytest.raises(UsageError, match=r"(?s)num_envs is 4.*16 or 32 would do"):
        gymnasium.make_vec("ludus/BallChase-v0", num_envs=4)
    envs: Any = gymnasium.make_vec("ludus/BallChase-v0", num_envs=32)
    try:
        seeds = [5] * 16 + [6] * 16
        everywhere = np.ones(32, np.bool_)
        one, _ = envs.reset(seed=5)
        listed, _ = envs.reset(seed=seeds)
        masked, _ = envs.reset(seed=5, options={"reset_mask": everywhere})
        np.testing.assert_array_equal(one, listed)
        np.testing.assert_array_equal(one, masked)
        assert envs.num_envs == 2 * 16
        observation, _ = envs.reset(seed=0)
        assert observation in envs.observation_space
        assert envs.step(envs.action_space.sample())[1].shape == (32,)
    finally:
        envs.close()


def test_a_game_that_was_killed_is_started_again(oracle: Path) -> None:
    others = set(psutil.Process().children(recursive=True))
    envs = ludus.make_vec(oracle, num_worlds=2)
    envs.reset(seed=3)
    (game,) = set(psutil.Process().children(recursive=True)) - others
    game.kill()
    _, reward, terminated, truncated, infos = envs.step(np.zeros(2, np.int64))
    assert truncated.all() and not terminated.any() and not reward.any()
    assert infos["_final_obs"].all()
    (second,) = set(psutil.Process().children(recursive=True)) - {*others, game}
    assert second.is_running()
    observation, *_ = envs.step(np.zeros(2, np.int64))
    assert observation[:, 1].tolist() == [1.0, 1.0]
    envs.close()
