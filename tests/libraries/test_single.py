"""``ludus.make`` against known answers and Gymnasium's own checker; real Godot."""

from __future__ import annotations

import pickle
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import ludus
from ludus.engine.bundled import example_names
from ludus.errors import ActionError, SequenceError, SetupError, UsageError
from ludus.libraries.registration import ENVIRONMENT_IDS

pytestmark = pytest.mark.engine

TICKS_PER_STEP = 2


@pytest.fixture(scope="module")
def env(oracle: Path) -> Iterator[ludus.LudusEnv]:
    env = ludus.make(oracle)
    yield env
    env.close()


def test_every_step_of_two_episodes_is_as_predicted(env: ludus.LudusEnv) -> None:
    observation, info = env.reset(seed=7, options={"parameters": {"length": 5}})
    for episode in (1, 2):
        random = observation[3]
        np.testing.assert_array_equal(observation, [episode, 0, -1, random, 0])
        for step in range(1, 6):
            action = (step + episode) % 5
            observation, reward, terminated, truncated, info = env.step(action)
            expected = [episode, step, action, random, step * TICKS_PER_STEP]
            np.testing.assert_array_equal(observation, np.array(expected, np.float32))
            assert reward == pytest.approx(0.1 * step)
            assert (terminated, truncated) == (step == 5, False)
        observation, info = env.reset()
    assert info == {}


def test_equal_seeds_give_equal_episodes_and_others_do_not(env: ludus.LudusEnv) -> None:
    first = [env.reset(seed=3)[0][3], env.reset()[0][3]]
    again = [env.reset(seed=3)[0][3], env.reset()[0][3]]
    other = [env.reset(seed=4)[0][3], env.reset()[0][3]]
    assert first == again
    assert len({*first, *other}) == 4


def test_truncation_is_not_termination(env: ludus.LudusEnv) -> None:
    env.reset(seed=0, options={"parameters": {"length": 0, "truncate_after": 3}})
    answers = [env.step(0) for _ in range(3)]
    assert [answer[2:4] for answer in answers] == [(False, False), (False, False), (False, True)]
    assert answers[-1][0][:2].tolist() == [1, 3]
    with pytest.raises(SequenceError, match="outside an episode"):
        env.step(0)
    assert env.reset()[0][:2].tolist() == [2, 0]


def test_a_step_outside_an_episode_is_refused(env: ludus.LudusEnv) -> None:
    env.reset(seed=0, options={"parameters": {"length": 1}})
    assert env.step(0)[2] is True
    with pytest.raises(SequenceError, match="outside an episode"):
        env.step(0)


def test_misfits_are_refused_and_the_episode_goes_on(env: ludus.LudusEnv) -> None:
    env.reset(seed=0, options={"parameters": {"length": 5}})
    with pytest.raises(ActionError, match="out of range 0 to 4"):
        env.step(5)
    with pytest.raises(UsageError, match="unknown reset option gravity"):
        env.reset(options={"gravity": 1})
    assert env.step(np.int64(4))[0][1] == 1


def test_forms_are_those_of_the_spaces(env: ludus.LudusEnv) -> None:
    observation, _ = env.reset(seed=0)
    assert observation in env.observation_space
    observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
    assert observation in env.observation_space
    assert (type(reward), type(terminated), type(truncated)) == (float, bool, bool)


@pytest.mark.parametrize("environment", ["ludus/CartPole-v0", "ludus/Pendulum-v0"])
def test_registered_examples_pass_gymnasiums_checker(environment: str) -> None:
    with warnings.catch_warnings():
        # Unbounded observations are allowed, and a window needs a screen.
        warnings.filterwarnings("ignore", "(?s).*infinity.*")
        env = gymnasium.make(environment)
        try:
            check_env(env.unwrapped, skip_render_check=True, skip_close_check=True)
        finally:
            env.close()


def test_mixed_actions_and_masks(tasks: Path) -> None:
    env = ludus.make(tasks / "identity_mixed.tscn")
    try:
        observation, info = env.reset(seed=0)
        assert observation in env.observation_space
        assert info["action_mask"].dtype == np.bool_
        kept = info["action_mask"].copy()
        action = env.action_space.sample()
        for name, n in zip(*_choices(env), strict=True):
            action[name] = np.int64(info["action_mask"][:n].argmax())
        following, *_, next_info = env.step(action)
        assert following in env.observation_space
        assert not np.shares_memory(info["action_mask"], next_info["action_mask"])
        np.testing.assert_array_equal(info["action_mask"], kept)
        while not (outcome := env.step(action))[2]:
            pass
        assert not np.shares_memory(outcome[4]["action_mask"], env.reset()[1]["action_mask"])
    finally:
        env.close()


def _choices(env: ludus.LudusEnv) -> tuple[list[str], list[int]]:
    parts = [part for part in env.policy.action if hasattr(part, "n")]
    return [part.name for part in parts], list(env.policy.nvec)


@pytest.mark.parametrize(
    ("environment", "problem"),
    [
        ("ludus/BallChase-v0", "has 16 agents, not one"),
        ("ludus:ludus/Tag-v0", r"has several policies \(chaser, runner\)"),
    ],
)
def test_worlds_with_several_agents_are_refused(environment: str, problem: str) -> None:
    with pytest.raises(UsageError, match=rf"(?s){problem}.*gymnasium\.make_vec.*pettingzoo"):
        gymnasium.make(environment)


def test_every_example_has_an_id() -> None:
    of_tests = {"identity"}
    of_godot4 = {name for name in example_names() if ":" not in name}
    assert set(ENVIRONMENT_IDS.values()) == of_godot4 - of_tests
    assert ENVIRONMENT_IDS.keys() <= gymnasium.registry.keys()


@pytest.mark.parametrize("seed", [-1, 1.7, 2**63, True, "1", [1]])
def test_seeds_out_of_range_are_refused(env: ludus.LudusEnv, seed: Any) -> None:
    with pytest.raises(UsageError, match="seed must be an integer from 0 to"):
        env.reset(seed=seed)
    highest: Any = np.int64(2**63 - 1)
    assert env.reset(seed=highest)[0].shape == (5,)


def test_an_environment_is_made_once_more_from_its_pickle_and_its_spec(env: ludus.LudusEnv) -> None:
    first, spec = env.reset(seed=5)[0], env.spec
    assert spec is not None
    for make in (lambda: pickle.loads(pickle.dumps(env)), lambda: gymnasium.make(spec)):
        other = make()
        try:
            np.testing.assert_array_equal(other.reset(seed=5)[0], first)
        finally:
            other.close()


def test_a_spec_needs_no_import_of_ludus(env: ludus.LudusEnv) -> None:
    assert env.spec is not None
    text = "import gymnasium, sys; from gymnasium.envs.registration import EnvSpec; "
    text += "env = gymnasium.make(EnvSpec.from_json(sys.argv[1])); "
    text += "print(*env.reset(seed=5)[0]); env.close()"
    command = [sys.executable, "-c", text, env.spec.to_json()]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    np.testing.assert_allclose([float(word) for word in printed.split()], env.reset(seed=5)[0])


def test_whoever_only_looks_for_gymnasium_leaves_the_ids_to_its_import() -> None:
    text = "import ludus, sys; from importlib.util import find_spec; "
    text += "assert find_spec('gymnasium') and 'gymnasium' not in sys.modules; "
    text += "import gymnasium; print('ludus/CartPole-v0' in gymnasium.registry)"
    command = [sys.executable, "-c", text]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "True\n"


def test_unknown_settings_are_refused(oracle: Path) -> None:
    with pytest.raises(UsageError, match="unexpected keyword argument 'num_world'") as unknown:
        ludus.make(oracle, num_world=1)
    assert unknown.value.hint == "did you mean num_worlds?"
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'"):
        gymnasium.make("ludus/CartPole-v0", frameskip=4)
    with pytest.raises(UsageError, match="one world, but num_worlds is 3"):
        ludus.make(oracle, num_worlds=3)
    with pytest.raises(UsageError, match="render_mode"):
        ludus.make(oracle, render_mode="ansi")
    with pytest.raises(UsageError, match="no policy 'hero'"):
        ludus.make(oracle, policy="hero")


@pytest.mark.parametrize("make", [ludus.make, ludus.make_vec])
def test_where_nothing_can_draw_a_game_plays_and_render_says_why(
    make: Any, oracle: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("ludus.engine.screen.find_xvfb", lambda: None)
    env = make(oracle, render_mode="rgb_array")
    try:
        env.reset(seed=1)
        with pytest.raises(SetupError, match=r"cannot draw .*neither one nor Xvfb\nhint: .*Xvfb"):
            env.render()
        env.step(env.action_space.sample())
    finally:
        env.close()
