"""Demonstrations: what is cloned acts as it was shown, and the term in PPO's loss fades."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from ludus.algorithms.imitation import Imitation
from ludus.algorithms.learner import LearnerSettings
from ludus.algorithms.ppo import PPO
from ludus.datasets import Demonstrations
from ludus.networks.policy import Player, Policy
from ludus.settings.train_config import ImitationConfig, PPOConfig
from ludus.spec import AgentSpec, ContinuousAction, DiscreteAction, ObservationEntry, PolicySpec
from ludus.spec.batch import ActionBatch, Batch

LENGTH, EPISODES = 7, 12
VECTOR = ObservationEntry("vector", "float32", (3,))
IMAGE = ObservationEntry("image", "uint8", (8, 8, 1))
CHOICES = (DiscreteAction("a", 3), DiscreteAction("b", 2))
TURN = ContinuousAction("turn", 1, -2.0, 6.0)


def spec_of(*parts: Any, observation: tuple[ObservationEntry, ...] = (VECTOR,)) -> PolicySpec:
    return PolicySpec("hero", observation, parts, (AgentSpec(0, "x"),))


def shown(spec: PolicySpec, answers: NDArray[np.int64]) -> Demonstrations:
    """Return episodes of ``LENGTH`` steps whose actions follow from the answer that is seen."""
    image = np.zeros((len(answers), 8, 8, 1), np.uint8)
    image[np.arange(len(answers)), 2 * answers] = 200  # a bright row
    observation = {"vector": np.eye(3, dtype=np.float32)[answers], "image": image}
    discrete = np.stack([answers % n for n in spec.nvec] or [answers], 1)[:, : spec.num_discrete]
    continuous = (2.0 * answers - 1.0).astype(np.float32).reshape(-1, 1)[:, : spec.continuous_size]
    entries = {entry.name: observation[entry.name] for entry in spec.observation}
    lengths = [LENGTH] * (len(answers) // LENGTH)
    return Demonstrations("x-v0", entries, ActionBatch(discrete, continuous), None, lengths)


ANSWERS = np.random.default_rng(0).integers(0, 3, LENGTH * EPISODES)
PLAIN = PPOConfig(hidden_sizes=(32,), sequence_length=4, rollout_steps=4)
CASES = [
    (spec_of(*CHOICES), PLAIN),
    (spec_of(*CHOICES, TURN), PLAIN),
    (spec_of(TURN), PPOConfig(hidden_sizes=(32,), squash=True, state_dependent_std=True)),
    (spec_of(CHOICES[0], observation=(VECTOR, IMAGE)), PLAIN),
    (spec_of(CHOICES[0], observation=(IMAGE,)), PLAIN),
]


@pytest.mark.parametrize(("spec", "config"), CASES, ids=["choices", "mixed", "turn", "both", "eye"])
def test_a_clone_acts_as_it_was_shown(spec: PolicySpec, config: PPOConfig) -> None:
    policy, given = Policy(spec, config), shown(spec, ANSWERS)
    before = None if policy.head.log_std is None else policy.head.log_std.clone()
    imitation = Imitation(policy, given, ImitationConfig(epochs=60, learning_rate=1e-2), 4)
    imitation.clone(policy, 0, lambda _: None)
    batch = Batch.allocate(spec, len(ANSWERS))
    batch.observation.update(given.observation)
    actions = Player(policy, len(ANSWERS)).act(batch)
    assert np.array_equal(actions.discrete, given.actions.discrete)
    assert np.abs(actions.continuous - given.actions.continuous).max(initial=0.0) < 0.3
    if before is not None:  # what explores is left alone
        assert policy.head.log_std is not None
        assert torch.equal(policy.head.log_std, before)


@pytest.mark.parametrize("settings", [{"memory_size": 16}, {"frame_stack": 7}], ids=str)
def test_a_memory_or_frames_carry_what_was_seen_before(settings: dict[str, Any]) -> None:
    """Only the first of seven steps shows the answer; gradients go back four steps at most."""
    spec = spec_of(CHOICES[0])
    first = np.repeat(np.arange(EPISODES) % 3, LENGTH)
    given = shown(spec, first)
    given.observation["vector"][np.arange(len(first)) % LENGTH != 0] = 0.0
    policy = Policy(spec, PPOConfig(hidden_sizes=(16,), **settings))
    imitation = Imitation(policy, given, ImitationConfig(epochs=60, learning_rate=1e-2), 4)
    imitation.clone(policy, 0, lambda _: None)
    player, batch = Player(policy, EPISODES), Batch.allocate(spec, EPISODES)
    batch.active[:] = True
    for step in range(LENGTH):
        batch.observation["vector"][:] = given.observation["vector"][step::LENGTH]
        assert player.act(batch).discrete[:, 0].tolist() == (np.arange(EPISODES) % 3).tolist()


def test_masked_actions_get_no_probability_from_a_clone() -> None:
    spec = PolicySpec("hero", (VECTOR,), CHOICES[:1], (AgentSpec(0, "x"),), has_action_mask=True)
    mask = np.eye(3, dtype=np.bool_)[ANSWERS]
    given = shown(spec, ANSWERS)
    masked = Demonstrations("x-v0", given.observation, given.actions, mask, given.lengths)
    policy = Policy(spec, PLAIN)
    imitation = Imitation(policy, masked, ImitationConfig(weight=1.0), 4)
    imitation.begin_update(policy)
    loss = imitation.penalty(policy, torch.Generator())
    assert loss.item() == 0.0  # the only action allowed is certain already


def make_learner(weight: float, decay: float = 0.5) -> PPO:
    spec = spec_of(CHOICES[0])
    policy = Policy(spec, PLAIN)
    config = ImitationConfig(epochs=0, weight=weight, decay=decay)
    imitation = Imitation(policy, shown(spec, ANSWERS), config, 4)
    return PPO(policy, PLAIN, LearnerSettings([slice(0, 2)], seed=1, imitation=imitation))


def learn(learner: PPO, num_updates: int) -> dict[str, float]:
    """Learn from rollouts without a reward, which alone would teach nothing."""
    batch = Batch.allocate(learner.policy.spec, 2)
    batch.active[:] = True
    learner.begin(0, batch)
    losses: dict[str, float] = {}
    for _ in range(num_updates):
        for _ in range(PLAIN.rollout_steps):
            learner.act(0)
            learner.record(0, batch)
        losses = learner.update(0.0)
    return losses


def test_demonstrations_are_learned_beside_the_rewards() -> None:
    learner = make_learner(weight=1.0, decay=1.0)
    first = learn(learner, 1)["imitation_loss"]
    assert learn(learner, 20)["imitation_loss"] < 0.5 * first


def test_the_weight_falls_until_demonstrations_are_left_out() -> None:
    learner = make_learner(weight=2.0)
    assert learn(learner, 1)["imitation_weight"] == 2.0
    assert learn(learner, 1)["imitation_weight"] == 1.0
    losses = learn(learner, 9)
    assert losses["imitation_weight"] == 0.0
    assert "imitation_loss" not in losses


def test_a_state_has_the_place_in_the_schedule_and_nothing_of_the_demonstrations() -> None:
    learner, without = make_learner(weight=2.0), make_learner(weight=2.0)
    learn(learner, 3)
    state = learner.state()
    assert state.values["imitated_updates"] == 3
    other = make_learner(weight=2.0)
    other.load_state(state)
    assert learn(other, 1)["imitation_weight"] == 0.25
    assert state.tensors.keys() == without.state().tensors.keys() | {"samples.vector"}
