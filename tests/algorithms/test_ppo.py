from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from ludus.algorithms.learner import LearnerSettings
from ludus.algorithms.losses import (
    approximate_kl,
    clipped_surrogate,
    generalised_advantage,
    value_loss,
)
from ludus.algorithms.ppo import PPO
from ludus.algorithms.recurrence import run_memory
from ludus.networks.policy import Policy
from ludus.settings.train_config import PPOConfig
from ludus.spec import AgentSpec, ContinuousAction, DiscreteAction, ObservationEntry, PolicySpec
from ludus.spec.batch import Batch


def test_clipped_surrogate_by_hand() -> None:
    ratio = torch.tensor([1.5, 1.5, 0.5, 0.5, 1.1])
    advantage = torch.tensor([1.0, -1.0, 1.0, -1.0, 2.0])
    result = clipped_surrogate(ratio.log(), advantage, 0.2)
    torch.testing.assert_close(result, torch.tensor([1.2, -1.5, 0.5, -0.8, 2.2]))


def test_value_loss_by_hand() -> None:
    value, target, old = torch.tensor([2.0]), torch.tensor([3.0]), torch.tensor([1.0])
    assert value_loss(value, target, old, None).item() == 0.5
    # Held at 1.2: (3 - 1.2)^2 is worse than (3 - 2)^2, and the worse one counts.
    assert value_loss(value, target, old, 0.2).item() == pytest.approx(0.5 * 1.8**2)


def test_approximate_kl_is_near_the_exact_one() -> None:
    p, q = torch.tensor([0.5, 0.3, 0.2]), torch.tensor([0.4, 0.4, 0.2])
    drawn = torch.multinomial(
        p, 200_000, replacement=True, generator=torch.Generator().manual_seed(0)
    )
    exact = float((p * (p / q).log()).sum())
    assert approximate_kl((q / p).log()[drawn]).item() == pytest.approx(exact, rel=0.05)


SPEC = PolicySpec(
    "hero",
    (ObservationEntry("o", "float32", (2,)),),
    (DiscreteAction("a", 3), ContinuousAction("c", 1, -4.0, 4.0)),
    (AgentSpec(0, "x"), AgentSpec(1, "x")),
)
CONFIG = PPOConfig(hidden_sizes=(8,), rollout_steps=4, minibatch_size=4, scale_reward=False)


def learner(config: PPOConfig = CONFIG) -> PPO:
    with torch.random.fork_rng(devices=[]):  # pyright: ignore[reportUnknownMemberType]
        torch.manual_seed(0)  # pyright: ignore[reportUnknownMemberType]
        ppo = PPO(Policy(SPEC, config), config, LearnerSettings([slice(0, 2)], seed=1))
        # A new critic says 0 everywhere, which would hide where a value is missing.
        torch.nn.init.normal_(ppo._critic[-1].weight)  # pyright: ignore[reportPrivateUsage, reportArgumentType]
    return ppo


def batch(random: np.random.Generator, **changes: Any) -> Batch:
    result = Batch.allocate(SPEC, 2)
    result.observation["o"][:] = random.normal(size=(2, 2))
    result.reward[:] = random.normal(size=2)
    result.active[:] = True
    return replace(result, **changes)


def learn_once(ppo: PPO, seed: int, progress: float) -> None:
    """Learn from one random rollout."""
    random = np.random.default_rng(seed)
    ppo.begin(0, batch(random))
    for _ in range(4):
        ppo.act(0)
        ppo.record(0, batch(random))
    ppo.update(progress)


def test_act_and_record_fill_a_rollout_that_the_update_learns_from() -> None:
    ppo, random = learner(), np.random.default_rng(0)
    before = [parameter.clone() for parameter in ppo.policy.parameters()]
    ppo.begin(0, batch(random))
    for left in (4, 3, 2, 1):
        assert ppo.num_steps_left == left
        actions = ppo.act(0)
        assert actions.discrete.shape == (2, 1)
        assert (np.abs(actions.continuous) <= 4.0).all()
        ppo.record(0, batch(random))
    metrics = ppo.update(0.0)
    assert ppo.num_steps_left == 4
    assert metrics["num_transitions"] == 8
    changed = [not torch.equal(a, b) for a, b in zip(before, ppo.policy.parameters(), strict=True)]
    assert all(changed)


def test_advantages_respect_ends_and_silent_slots() -> None:
    """Slot 0 is truncated at step 1; slot 1 dies at step 0, is silent, and comes back at step 3."""
    ppo, random = learner(), np.random.default_rng(0)
    final = random.normal(size=(1, 2)).astype(np.float32)
    outcomes: list[dict[str, Any]] = [
        {"terminated": np.array([False, True]), "active": np.array([True, False]),
         "final_index": np.array([1]), "final_observation": {"o": np.ones((1, 2), np.float32)}},
        {"truncated": np.array([True, False]), "active": np.array([True, False]),
         "final_index": np.array([0]), "final_observation": {"o": final}},
        {}, {},
    ]  # fmt: skip
    ppo.begin(0, batch(random))
    for outcome in outcomes:
        ppo.act(0)
        ppo.record(0, batch(random, **outcome))
    transitions = ppo._transitions()  # pyright: ignore[reportPrivateUsage]
    rollout = ppo._rollout  # pyright: ignore[reportPrivateUsage]

    def value(observation: Any) -> torch.Tensor:
        with torch.no_grad():
            inputs = ppo.policy.encoder({"o": torch.as_tensor(observation)})
            return ppo.value(ppo.policy.features(inputs))

    states = torch.stack([value(row) for row in rollout.observation["o"]])
    next_value = states[1:].clone()
    next_value[0, 1] = 0.0  # terminated
    next_value[1, 0] = value(final)[0]  # truncated
    is_done = torch.zeros(4, 2, dtype=torch.bool)
    is_done[0, 1] = is_done[1, 0] = True
    is_done[1, 1] = True  # silent afterwards
    rewards = torch.as_tensor(rollout.reward)
    expected = generalised_advantage(rewards, states[:-1], next_value, is_done, (0.99, 0.95))
    is_valid = torch.tensor([[True, True], [True, False], [True, False], [True, True]])
    assert len(transitions) == 6
    torch.testing.assert_close(transitions.advantage, expected[is_valid])
    torch.testing.assert_close(transitions.target, (expected + states[:-1])[is_valid])


def test_first_gradient_is_that_of_the_policy_gradient() -> None:
    """At ratio 1 the clipped objective has the gradient of ``A * log pi``, equation 1."""
    config = replace(
        CONFIG, value_coefficient=0.0, entropy_coefficient=0.0, normalise_advantage=False,
        max_grad_norm=1e9,
    )  # fmt: skip
    ppo, random = learner(config), np.random.default_rng(0)
    ppo.begin(0, batch(random))
    for _ in range(4):
        ppo.act(0)
        ppo.record(0, batch(random))
    transitions = ppo._transitions()  # pyright: ignore[reportPrivateUsage]
    outputs = ppo.policy.actor(ppo.policy.features(transitions.inputs))
    log_prob, _ = ppo.policy.head.evaluate(
        outputs, transitions.discrete, transitions.continuous, None
    )
    objective: Any = -(log_prob * transitions.advantage).mean()
    actor = list(ppo.policy.actor.parameters())
    expected = torch.autograd.grad(objective, actor)
    ppo._gradient_step(transitions)  # pyright: ignore[reportPrivateUsage]
    for parameter, gradient in zip(actor, expected, strict=True):
        torch.testing.assert_close(parameter.grad, gradient)


def test_minibatches_hold_every_transition_once() -> None:
    ppo, random = learner(replace(CONFIG, minibatch_size=3)), np.random.default_rng(0)
    ppo.begin(0, batch(random))
    for _ in range(4):
        ppo.act(0)
        ppo.record(0, batch(random))
    transitions = ppo._transitions()  # pyright: ignore[reportPrivateUsage]
    parts = list(ppo._minibatches(transitions))  # pyright: ignore[reportPrivateUsage]
    assert [len(part) for part in parts] == [2, 3, 3]
    seen = torch.cat([part.advantage for part in parts]).sort().values
    torch.testing.assert_close(seen, transitions.advantage.sort().values)


def test_target_kl_stops_the_epochs() -> None:
    ppo, random = learner(replace(CONFIG, target_kl=1e-9, epochs=9)), np.random.default_rng(0)
    ppo.begin(0, batch(random))
    for _ in range(4):
        ppo.act(0)
        ppo.record(0, batch(random))
    assert ppo.update(0.0)["num_epochs"] == 1


def test_learning_rate_falls_to_zero() -> None:
    ppo, random = learner(), np.random.default_rng(0)
    ppo.begin(0, batch(random))
    for progress, rate in ((0.0, 1e-3), (0.75, 2.5e-4), (1.0, 0.0)):
        for _ in range(4):
            ppo.act(0)
            ppo.record(0, batch(random))
        assert ppo.update(progress)["learning_rate"] == pytest.approx(rate)


@pytest.mark.parametrize("memory_size", [0, 5])
def test_a_rollout_without_active_slots_changes_nothing(memory_size: int) -> None:
    ppo = learner(replace(CONFIG, memory_size=memory_size, sequence_length=2))
    random = np.random.default_rng(0)
    silent = {"active": np.array([False, False])}
    ppo.begin(0, batch(random, **silent))
    for _ in range(4):
        ppo.act(0)
        ppo.record(0, batch(random, **silent))
    before = [parameter.clone() for parameter in ppo.policy.parameters()]
    assert ppo.update(0.0)["num_transitions"] == 0
    assert all(torch.equal(a, b) for a, b in zip(before, ppo.policy.parameters(), strict=True))


@pytest.mark.parametrize(
    "change",
    [
        {"clip_range": 0.01}, {"value_clip_range": 0.01}, {"value_coefficient": 2.0},
        {"epochs": 1}, {"minibatch_size": 2}, {"gae_lambda": 0.5}, {"entropy_coefficient": 0.1},
    ],
    ids=str,
)  # fmt: skip
@pytest.mark.parametrize("curiosity", [0.0, 0.5])
def test_settings_may_change_between_updates(change: dict[str, Any], curiosity: float) -> None:
    config = replace(CONFIG, curiosity=curiosity, clip_range=0.02)
    changed, made_so = learner(config), learner(replace(config, **change))
    changed.config = made_so.config
    for ppo in (changed, made_so):
        learn_once(ppo, 0, 0.0)
    one, other = changed.state().tensors, made_so.state().tensors
    assert all(torch.equal(one[name], other[name]) for name in one)


def play(ppo: PPO, reward: float, *, restart: bool = True) -> dict[str, float]:
    """Learn from one rollout in which both slots get the same reward in each step."""
    random = np.random.default_rng(0)
    same = {"reward": np.full(2, reward, np.float32)}
    if restart:
        ppo.begin(0, batch(random, **same))
    for _ in range(4):
        ppo.act(0)
        ppo.record(0, batch(random, **same))
    return ppo.update(0.0)


def actor_of(ppo: PPO) -> torch.Tensor:
    assert ppo.policy.head.log_std is not None
    parameters = [*ppo.policy.actor.parameters(), ppo.policy.head.log_std]
    return torch.nn.utils.parameters_to_vector(parameters).detach().clone()


@pytest.mark.parametrize("is_overlapping", [False, True])
def test_the_policy_waits_for_the_first_reward(is_overlapping: bool) -> None:
    """Its critic has random values, which are all that advantages consist of until then."""
    ppo = learner(replace(CONFIG, overlap=is_overlapping))
    first = actor_of(ppo)
    metrics = [play(ppo, 0.0, restart=number == 0) for number in range(3)][-1]
    assert metrics["policy_loss"] == 0.0
    assert metrics["value_loss"] > 0.0
    assert torch.equal(actor_of(ppo), first)
    play(ppo, 1.0, restart=False)
    ppo.state()  # with overlap, takes the gradient steps that are left
    learnt = actor_of(ppo)
    assert not torch.equal(learnt, first)
    play(ppo, 0.0, restart=False)
    ppo.state()
    assert not torch.equal(actor_of(ppo), learnt)


def test_a_restored_learner_remembers_whether_it_saw_a_reward() -> None:
    for reward in (0.0, 1.0):
        ppo, second = learner(), learner()
        play(ppo, reward)
        second.load_state(ppo.state())
        before = actor_of(second)
        play(second, 0.0)
        assert torch.equal(actor_of(second), before) == (reward == 0.0)


def test_rewards_of_inactive_slots_do_not_count() -> None:
    ppo, random = learner(), np.random.default_rng(0)
    reward, first = np.array([0.0, 1.0], np.float32), actor_of(ppo)
    half = {"reward": reward, "active": np.array([True, False])}
    ppo.begin(0, batch(random, **half))
    for _ in range(4):
        ppo.act(0)
        ppo.record(0, batch(random, **half))
    ppo.update(0.0)
    assert torch.equal(actor_of(ppo), first)


def test_a_restored_learner_continues_to_the_bit() -> None:
    first, second = learner(), learner()
    for ppo in (first, first, second):
        random = np.random.default_rng(3)
        if ppo is second:
            ppo.load_state(first.state())
            break
        ppo.begin(0, batch(random))
        for _ in range(4):
            ppo.act(0)
            ppo.record(0, batch(random))
        ppo.update(0.1)
    for ppo in (first, second):
        learn_once(ppo, 4, 0.2)
    pairs = zip(first.state().tensors.items(), second.state().tensors.items(), strict=True)
    assert all(a == b and torch.equal(x, y) for (a, x), (b, y) in pairs)


def test_sequences_repeat_what_the_memory_did_while_acting() -> None:
    """Ratios are 1 before the first gradient step, across ends, silences and comings back."""
    changes: list[dict[str, Any]] = [
        {},
        {"terminated": np.array([False, True]), "active": np.array([True, False])},
        {"truncated": np.array([True, False]), "active": np.array([True, False]),
         "final_index": np.array([0]), "final_observation": {"o": np.ones((1, 2), np.float32)}},
        {},
    ]  # fmt: skip
    config = replace(CONFIG, memory_size=5, sequence_length=2, learning_rate=1e-9)
    ppo, random = learner(config), np.random.default_rng(0)
    ppo.begin(0, batch(random))
    metrics: dict[str, float] = {}
    for _ in range(3):
        for change in changes:
            ppo.act(0)
            ppo.record(0, batch(random, **change))
        metrics = ppo.update(0.0)
        assert metrics["approximate_kl"] == pytest.approx(0.0, abs=1e-9)
    assert metrics["num_transitions"] == 6


def test_truncated_backpropagation_reaches_the_start_of_a_sequence_only() -> None:
    ppo, random = (
        learner(replace(CONFIG, memory_size=5, sequence_length=2)),
        np.random.default_rng(0),
    )
    ppo.begin(0, batch(random))
    for _ in range(4):
        ppo.act(0)
        ppo.record(0, batch(random))
    transitions = ppo._transitions()  # pyright: ignore[reportPrivateUsage]
    sequences = transitions.sequences
    assert sequences is not None
    assert sequences.start.shape == (4, 5)
    assert torch.equal(sequences.rows, torch.tensor([0, 1, 4, 5, 2, 3, 6, 7]))
    features = ppo.policy.features(transitions.inputs).detach().requires_grad_()
    chosen = features[sequences.rows]
    _, flat = run_memory(ppo.policy, chosen, sequences.start, sequences.keep)
    (gradient,) = torch.autograd.grad(flat[4:].sum(), features)  # the second steps
    assert (gradient.abs().sum(1) > 0).all()
    (gradient,) = torch.autograd.grad(
        run_memory(ppo.policy, features[sequences.rows], sequences.start, sequences.keep)[1][
            6:
        ].sum(),
        features,
    )
    is_reached = gradient.abs().sum(1) > 0
    assert torch.equal(is_reached, torch.tensor([False] * 4 + [True] * 4))


def test_overlapped_gradient_steps_are_spread_over_the_next_rollout() -> None:
    ppo, random = (
        learner(replace(CONFIG, overlap=True, epochs=4, minibatch_size=4)),
        np.random.default_rng(0),
    )
    ppo.begin(0, batch(random))
    moved: list[bool] = []
    metrics: dict[str, float] = {}
    for _ in range(2):
        for _ in range(4):
            before = [parameter.clone() for parameter in ppo.policy.parameters()]
            ppo.act(0)
            ppo.learn_while_stepping()
            ppo.record(0, batch(random))
            pairs = zip(before, ppo.policy.parameters(), strict=True)
            moved.append(any(not torch.equal(a, b) for a, b in pairs))
        metrics = ppo.update(0.0)
    assert moved == [False] * 4 + [True] * 4
    assert metrics["num_epochs"] == 4
