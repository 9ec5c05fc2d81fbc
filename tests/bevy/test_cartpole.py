"""The Bevy CartPole behaves as the protocol says, and can be balanced."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import ludus
from ludus.check import CheckConfig, run_checks
from ludus.cli.main import main
from ludus.pool import PoolConfig, open_pool
from ludus.session import EngineSession
from ludus.spec.batch import ActionBatch, Batch
from ludus.wire.reset import ResetRequest
from tests.bevy.conftest import TARGET, Open

pytestmark = [pytest.mark.engine, pytest.mark.bevy, pytest.mark.timeout(180, func_only=True)]


def reset(session: EngineSession, seed: int = 0, **parameters: float) -> Batch:
    request = ResetRequest.all_worlds(session.spec.num_worlds, seed, parameters)
    return session.reset(request)["cart"]


def step(session: EngineSession, choices: NDArray[np.int64]) -> Batch:
    session.send({"cart": ActionBatch(choices[:, None], np.zeros((len(choices), 0), np.float32))})
    return session.receive()["cart"]


def test_handshake(open_game: Open) -> None:
    session = open_game(num_worlds=3)
    assert session.hello.engine == "bevy 0.19.1"
    assert session.hello.capabilities == {
        "call", "ceiling", "metrics", "rebuild", "requests", "reset_worlds",
    }  # fmt: skip
    spec = session.spec
    assert (spec.num_worlds, spec.layout, spec.ticks_per_step) == (3, "grid", 2)
    assert (spec.tick_rate, spec.scene) == (60.0, "cartpole")
    (policy,) = spec.policies
    assert (policy.name, policy.num_agents, policy.max_episode_steps) == ("cart", 3, 250)
    assert [(entry.name, entry.shape) for entry in policy.observation] == [("observation", (4,))]
    assert policy.nvec == (2,)
    assert [agent.path for agent in policy.agents] == ["cart"] * 3


@pytest.mark.parametrize("layout", ["grid", "isolated"])
def test_episodes_begin_and_end_as_in_godot(open_game: Open, layout: str) -> None:
    session = open_game(num_worlds=8, layout=layout)
    batch = reset(session, seed=3)
    seen = batch.observation["observation"].copy()
    assert (np.abs(seen[:, 0]) <= 1.0 / 40.0).all()
    assert (np.abs(seen[:, 2]) <= 0.05 / (math.pi / 8.0)).all()
    assert (seen[:, [1, 3]] == 0.0).all()
    assert len(np.unique(seen[:, 0])) == 8
    for number in range(1, 20):
        batch = step(session, np.zeros(8, np.int64))
        assert session.times.tick == 2 * number
        assert batch.reward.tolist() == [1.0] * 8
        fallen = np.abs(batch.final_observation["observation"])
        assert ((fallen[:, 2] > 1.0) | (fallen[:, 0] > 1.0)).all()
        if len(batch.final_index):
            return
    pytest.fail("pushing to one side for ever must throw the pole")


def test_gravity_is_a_parameter(open_game: Open) -> None:
    session = open_game(num_worlds=2)
    request = ResetRequest.all_worlds(2, 5, [{"gravity": 0.0}, {"gravity": 50.0}])
    request.seeds[:] = 5
    session.reset(request)
    batch = step(session, np.zeros(2, np.int64))
    light, heavy = batch.observation["observation"]
    assert light[0] == pytest.approx(heavy[0], abs=1e-3)
    assert abs(light[3] - heavy[3]) > 1e-3


def balance(seen: NDArray[np.float32]) -> NDArray[np.int64]:
    """Push under the pole, and a little back to the middle."""
    position, velocity, angle, turning = seen.T
    lean = angle * math.pi / 8.0 + 0.5 * turning * 2.0
    drift = 0.002 * position * 40.0 + 0.01 * velocity * 20.0
    return (lean + drift > 0.0).astype(np.int64)


def test_a_controller_balances_the_pole(open_game: Open) -> None:
    session = open_game(num_worlds=16)
    batch = reset(session, seed=1)
    for _ in range(249):
        batch = step(session, balance(batch.observation["observation"]))
        assert len(batch.final_index) == 0
    batch = step(session, balance(batch.observation["observation"]))
    assert batch.truncated.all()
    assert not batch.terminated.any()
    assert batch.active.all()


def hashes(num_engines: int) -> list[bytes]:
    """Play the same steps in new processes; return the bits that were seen, by step."""
    seen: list[bytes] = []
    rng = np.random.default_rng(0)
    with open_pool(TARGET, PoolConfig(num_worlds=4, num_engines=num_engines)) as pool:
        pool.reset(11)
        for _ in range(60):
            choices = rng.integers(0, 2, (4 * num_engines, 1))
            for engine in range(num_engines):
                own = choices[engine * 4 : engine * 4 + 4]
                pool.send(engine, {"cart": ActionBatch(own, np.zeros((4, 0), np.float32))})
            received = [pool.receive(engine)["cart"] for engine in range(num_engines)]
            seen.append(b"".join(batch.observation["observation"].tobytes() for batch in received))
    return seen


def test_equal_seeds_give_equal_bits_in_other_processes(executable: Path) -> None:
    first = hashes(2)
    assert len(set(first)) == 60
    assert hashes(2) == first


def test_ludus_check_passes(executable: Path) -> None:
    config = CheckConfig(target=TARGET, num_steps=120, num_layout_worlds=8, timing_s=0.05)
    report = run_checks(config)
    wrong = [(name, found.title) for name, found in report.findings if str(found.status) == "fail"]
    assert wrong == []
    (verdict, *_) = (found for name, found in report.findings if name == "layouts")
    assert verdict.data["verdict"] == "equal to the bit"


def test_ludus_bench(executable: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--worlds", "64", "--rounds", "1", "--seconds", "0.2", "--json"]
    assert main(["bench", TARGET, *arguments]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["engine"] == "bevy 0.19.1"
    assert (report["num_agents"], report["ticks_per_step"]) == (64, 2)
    assert report["agent_steps_per_s"] > 0.0
    assert report["ceiling_agent_steps_per_s"] > 0.0


def test_ludus_train_writes_a_run(executable: Path, tmp_path: Path) -> None:
    arguments = [
        "train", TARGET, "--total-steps", "512", "--num-worlds", "8", "--num-engines", "1",
        "--seed", "1", "--runs", str(tmp_path), "--name", "short", "--ppo.rollout-steps", "16",
    ]  # fmt: skip
    assert main(arguments) == 0
    assert (tmp_path / "short" / "config.json").is_file()


def test_next_step_autoreset_pauses_for_a_step(executable: Path) -> None:
    """The first episodes are those of same-step autoreset, to the bit."""
    modes = ("next_step", "same_step")
    own, other = (ludus.make_vec(executable, num_worlds=8, autoreset_mode=mode) for mode in modes)
    rng = np.random.default_rng(1)
    num_pauses = 0
    is_first, is_pause = np.ones(8, np.bool_), np.zeros(8, np.bool_)
    try:
        np.testing.assert_array_equal(own.reset(seed=3)[0], other.reset(seed=3)[0])
        for _ in range(80):
            actions = rng.integers(0, 2, 8)
            seen, reward, terminated, truncated, infos = own.step(actions)
            expected, same_reward, same_terminated, _, same_infos = other.step(actions)
            for row in (is_first & same_terminated).nonzero()[0]:
                expected[row] = same_infos["final_obs"][row]
            np.testing.assert_array_equal(seen[is_first], expected[is_first])
            np.testing.assert_array_equal(reward[is_first], same_reward[is_first])
            np.testing.assert_array_equal(terminated[is_first], same_terminated[is_first])
            assert not infos
            assert (seen[is_pause][:, [1, 3]] == 0.0).all(), "it begins at rest"
            assert not reward[is_pause].any()
            assert not (terminated | truncated)[is_pause].any()
            num_pauses += int(is_pause.sum())
            is_pause = terminated | truncated
            is_first &= ~is_pause
        assert num_pauses > 8
    finally:
        own.close()
        other.close()
