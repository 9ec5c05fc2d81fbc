"""What a LudusAgent of Godot 3 can be told: spaces, ticks, masks, policies; and worlds apart."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

import ludus
from ludus.errors import TargetError
from ludus.pool import PoolConfig, open_pool
from ludus.session import EngineSession
from ludus.spec import ContinuousAction, DiscreteAction
from ludus.spec.batch import ActionBatch
from ludus.wire.reset import ResetRequest
from tests.godot.conftest import Game, reset, step

pytestmark = pytest.mark.engine

POOL_REAL_ARRAY = 22


def sample(envs: ludus.LudusVectorEnv) -> Any:
    return cast(Any, envs).action_space.sample()


@pytest.mark.parametrize(("scene", "applied_per_step"), [("every", 3), ("once", 1)])
def test_actions_and_ticks_of_a_step(project: Path, scene: str, applied_per_step: int) -> None:
    envs = ludus.make_vec(project / f"{scene}.tscn", num_worlds=2)
    assert envs.policy.agents_per_world == 1, "the agent that is not enabled takes part"
    assert envs.policy.action == (DiscreteAction("move", 3), ContinuousAction("aim", 2))
    observation, _ = envs.reset(seed=0)
    assert np.array_equal(observation["counts"], [[0, 0, 1]] * 2)
    for number in (1, 2, 3):
        observation, _, terminated, truncated, _ = envs.step(sample(envs))
        assert np.array_equal(
            observation["counts"], [[applied_per_step * number, 3 * number, 1]] * 2
        )
        assert not terminated.any() and not truncated.any()
    observation, _, terminated, truncated, infos = envs.step(sample(envs))
    assert truncated.all() and not terminated.any()
    assert np.array_equal(infos["final_obs"][1]["counts"], [applied_per_step * 4, 12, 1])
    assert np.array_equal(observation["counts"], [[0, 0, 2]] * 2)
    envs.close()


def test_random_play_inside_the_engine_may_come_first(project: Path) -> None:
    """What ``ludus bench`` calls the ceiling, with several ticks a step; the game goes on after."""
    with open_pool(project / "every.tscn", PoolConfig(num_worlds=2)) as pool:
        result = pool.call({"bridge": True}, "run_ceiling", [20, 0])
        assert result[0]["num_steps"] == 20 and result[0]["elapsed_us"] > 0
        counts = pool.reset(0)["agent"].observation["counts"]
    assert np.array_equal(counts, [[0, 0, 1]] * 2)


def test_the_trainer_may_choose_ticks_and_limit(project: Path) -> None:
    envs = ludus.make_vec(project / "every.tscn", ticks_per_step=2, max_episode_steps=2)
    envs.reset(seed=0)
    observation, *_ = envs.step(sample(envs))
    assert np.array_equal(observation["counts"], [[2, 2, 1]])
    assert envs.step(sample(envs))[3].all()
    envs.close()


def test_every_agent_gets_its_own_action(game: Game) -> None:
    session = game.open("every", num_worlds=3)
    reset(session)
    discrete = np.array([[2], [0], [1]])
    continuous = np.array([[0.5, -1.0], [0.25, 0.0], [-0.125, 1.0]], np.float32)
    session.send({"agent": ActionBatch(discrete, continuous)})
    session.receive()
    for world in range(3):
        assert session.call({"world": world, "agent": "Agent"}, "get_last") == {
            "move": discrete[world, 0],
            "aim": continuous[world].tolist(),
            "type": POOL_REAL_ARRAY,
        }


def test_masks(game: Game) -> None:
    session = game.open("masked", num_worlds=2)
    assert session.policies["agent"].has_action_mask
    mask = reset(session)["agent"].action_mask
    assert mask is not None and mask.tolist() == [[1, 0, 1]] * 2
    mask = step(session, 4)["agent"].action_mask  # the next episode has begun
    assert mask is not None and mask.tolist() == [[1, 0, 0]] * 2


def test_several_policies(game: Game) -> None:
    session = game.open("several", num_worlds=2)
    assert {name: spec.num_agents for name, spec in session.policies.items()} == {
        "hero": 4,
        "target": 2,
    }
    paths = [(agent.world, agent.path) for agent in session.policies["hero"].agents]
    assert paths == [(0, "A"), (0, "C"), (1, "A"), (1, "C")]
    reset(session)
    batches = step(session, 2)
    assert batches["hero"].observation["counts"].tolist() == [[6, 6, 1]] * 4
    assert batches["target"].observation["counts"].tolist() == [[6, 6, 1]] * 2


def play(session: EngineSession, num_steps: int, first_world: int = 0) -> NDArray[np.float32]:
    """Push the balls of each world at random, world *i* always in the same way.

    Returns:
        What was observed, ``float32[num_steps, num_worlds, 3]``.
    """
    num_worlds = session.spec.num_worlds
    session.reset(ResetRequest.all_worlds(num_worlds, 5 + first_world))
    streams = [np.random.default_rng(first_world + world) for world in range(num_worlds)]
    frames: list[NDArray[np.float32]] = []
    for _ in range(num_steps):
        push = np.array([[stream.uniform(-1, 1)] for stream in streams], np.float32)
        session.send({"agent": ActionBatch(np.zeros((num_worlds, 0), np.int64), push)})
        frames.append(session.receive()["agent"].observation["observation"].copy())
    return np.stack(frames)


@pytest.mark.parametrize("scene", ["balls", "settling"])
def test_worlds_are_isolated_and_equal_to_worlds_alone(game: Game, scene: str) -> None:
    together = play(game.open(scene, num_worlds=3), 60)
    assert len(np.unique(together[-1, :, 0])) == 3, "all worlds do the same"
    for world in range(3):
        alone = play(game.open(scene), 60, world)
        assert np.array_equal(together[:, world], alone[:, 0])


def test_equal_seeds_are_equal_bits_whatever_was_before(game: Game) -> None:
    session = game.open("balls", num_worlds=2)
    first = play(session, 60)
    again = play(session, 60)
    assert np.array_equal(first, again)
    other = play(session, 60, 9)
    assert not np.array_equal(first, other)


def test_settling_lets_the_ball_fall_first(game: Game) -> None:
    fallen = reset(game.open("settling"))["agent"].observation["observation"][0, 1]
    hanging = reset(game.open("balls"))["agent"].observation["observation"][0, 1]
    assert hanging == 2.0
    assert fallen < 1.0 + 1.0 + 1e-3 and fallen != hanging


def test_more_worlds_than_bullet_can_keep_are_refused(game: Game) -> None:
    with pytest.raises(TargetError, match="Bullet can keep 126"):
        game.open("balls", num_worlds=127)
