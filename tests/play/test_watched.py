"""What a game that shows an agent is told: the same by a run, by a policy file, and by PPO."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
import pytest
import torch

from ludus.algorithms.learner import LearnerSettings
from ludus.algorithms.ppo import PPO
from ludus.export.convert import to_model
from ludus.model import ModelRunner
from ludus.networks.policy import Player
from ludus.networks.tensors import as_tensors
from ludus.play.players import FilePlayer
from ludus.play.watched import WatchedPlayer
from ludus.pool import EnginePool
from ludus.runs.run_folder import RunFolder
from ludus.runs.saved import load_policies
from ludus.spec import AgentSpec, PolicySpec
from ludus.spec.batch import ActionBatch, Batch
from tests.export.trained_runs import MIXED, SIMPLE, SMALL, make_policy, make_run

SLOTS = 3


def two_steps(spec: PolicySpec) -> list[Batch]:
    rng = np.random.default_rng(5)
    return [_step(spec, rng) for _ in range(2)]


def _step(spec: PolicySpec, rng: np.random.Generator) -> Batch:
    batch = Batch.allocate(spec, SLOTS)
    for entry in spec.observation:
        low = -1 if entry.dtype == "float32" else 0
        batch.observation[entry.name][...] = rng.uniform(low, 6, (SLOTS, *entry.shape))
    if spec.has_action_mask and batch.action_mask is not None:
        batch.action_mask[1, 2] = False
    batch.active[...] = True
    return batch


CONFIGS = {
    "choice": (SIMPLE, SMALL),
    "mixed": (MIXED, SMALL),
    "memory": (MIXED, dataclasses.replace(SMALL, memory_size=6)),
    "frames": (MIXED, dataclasses.replace(SMALL, frame_stack=3)),
    "own deviation": (MIXED, dataclasses.replace(SMALL, state_dependent_std=True)),
    "squashed": (MIXED, dataclasses.replace(SMALL, squash=True)),
}


@pytest.mark.parametrize("case", CONFIGS)
def test_a_policy_file_tells_what_its_run_tells(case: str) -> None:
    spec, config = CONFIGS[case]
    policy = make_policy(spec, config)
    player = Player(policy, SLOTS)
    file = FilePlayer(ModelRunner(to_model(policy, spec)), SLOTS)
    first, second = two_steps(spec)
    for one in (player, file):
        one.act(first)
    actions = player.act(second)
    file.act(second)
    for slot in range(SLOTS):
        told, expected = file.describe(slot), player.describe(slot)
        assert told.keys() == expected.keys()
        for name in ("probabilities", "means", "deviations"):
            np.testing.assert_allclose(told[name], expected[name], rtol=1e-4, atol=1e-5)
        start = 0
        for i, n in enumerate(spec.nvec):
            part = expected["probabilities"][start : start + n]
            assert sum(part) == pytest.approx(1.0, abs=1e-5)
            assert int(np.argmax(part)) == actions.discrete[slot, i]
            start += n
        np.testing.assert_allclose(expected["means"], actions.continuous[slot], atol=1e-5)
        assert all(deviation > 0 for deviation in expected["deviations"])
    if spec.has_action_mask:
        assert file.describe(1)["probabilities"][2] == 0


def test_a_run_tells_what_its_critic_expects(tmp_path: Any) -> None:
    spec = dataclasses.replace(SIMPLE, agents=tuple(AgentSpec(i, "x") for i in range(SLOTS)))
    config = dataclasses.replace(SMALL, rollout_steps=4, minibatch_size=4)
    policy = make_policy(spec, config)
    ppo = PPO(policy, config, LearnerSettings([slice(0, SLOTS)], seed=1))
    critic = cast(torch.nn.Module, ppo.__dict__["_critic"])
    with torch.no_grad():
        for parameter in critic.parameters():
            parameter.add_(torch.randn_like(parameter))
    ppo.__dict__["_scaler"].statistics.variance.fill_(9.0)
    run = make_run(tmp_path / "run", {"hero": policy}, config=config)
    assert load_policies(run, {"hero": spec})["hero"].critic is None
    store = RunFolder(run).checkpoints(keep=100)
    _, checkpoint = store.newest()
    store.write(dataclasses.replace(checkpoint, agent_steps=200, learners={"hero": ppo.state()}))
    policy = load_policies(run, {"hero": spec})["hero"]
    assert policy.critic is not None
    (batch, _) = two_steps(spec)
    player = Player(policy, SLOTS)
    player.act(batch)
    inputs = policy.encoder(as_tensors(batch.observation, policy.device))
    with torch.no_grad():
        values = ppo.value(policy.features(inputs))
    for slot in range(SLOTS):
        assert player.describe(slot)["value"] == pytest.approx(3.0 * float(values[slot]), rel=1e-5)


class _Game:
    """A pool that asks to be told, and notes what it is told."""

    def __init__(self, *requests: Mapping[str, Any]) -> None:
        self.requests: Sequence[Mapping[str, Any]] = requests
        self.told: list[Any] = []
        self.policies = {"hero": SIMPLE}

    def num_agents(self, _policy: str) -> int:
        return SLOTS

    def take_requests(self) -> Sequence[Mapping[str, Any]]:
        taken, self.requests = self.requests, []
        return taken

    def call(self, _target: Any, method: str, arguments: list[Any]) -> None:
        assert method == "show_decision"
        self.told += arguments


def test_only_the_agent_that_is_shown_is_told_of() -> None:
    batch = two_steps(SIMPLE)[0]
    file = FilePlayer(ModelRunner(to_model(make_policy(SIMPLE), SIMPLE)), SLOTS)

    class Act:
        def __call__(self, batches: Mapping[str, Batch]) -> Mapping[str, ActionBatch]:
            return {"hero": file.act(batches["hero"])}

        def describe(self, policy: str, slot: int) -> dict[str, Any]:
            assert policy == "hero"
            return file.describe(slot)

    game = _Game({"kind": "save"})
    player = WatchedPlayer(cast(EnginePool, game), Act())
    player({"hero": batch})
    assert game.told == []
    game.requests = [{"kind": "watch", "policy": "hero", "slot": 2.0}]
    player({"hero": batch})
    player({"hero": batch})
    assert [told["slot"] for told in game.told] == [2, 2]
    assert game.told[0] == {"policy": "hero", "slot": 2, **file.describe(2)}
    for nobody in ("", "stranger", None):
        game.requests = [{"kind": "watch", "policy": nobody, "slot": 0}]
        player({"hero": batch})
    game.requests = [{"kind": "watch", "policy": "hero", "slot": SLOTS}]
    player({"hero": batch})
    assert len(game.told) == 2
