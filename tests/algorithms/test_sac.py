from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.distributions import Normal, TanhTransform, TransformedDistribution
from torch.nn import functional

from ludus.algorithms.learner import LearnerSettings
from ludus.algorithms.losses import discrete_soft_value, squashed_log_prob
from ludus.algorithms.sac import SAC, Minibatch
from ludus.errors import ConfigError, DivergenceError
from ludus.networks.networks import Inputs
from ludus.networks.policy import Policy
from ludus.settings.train_config import SACConfig
from ludus.spec import AgentSpec, ContinuousAction, DiscreteAction, ObservationEntry, PolicySpec
from ludus.spec.batch import Batch

NUM_SLOTS = 6


def spec(*action: Any, **changes: Any) -> PolicySpec:
    agents = tuple(AgentSpec(world, "x") for world in range(NUM_SLOTS))
    return PolicySpec("hero", (ObservationEntry("o", "float32", (3,)),), action, agents, **changes)


CONTINUOUS = spec(ContinuousAction("c", 2, -4.0, 8.0))
DISCRETE = spec(DiscreteAction("a", 4))
MASKED = spec(DiscreteAction("a", 4), has_action_mask=True)
CONFIG = SACConfig(
    hidden_sizes=(32, 16), batch_size=8, replay_capacity=500, learning_starts=24,
    learning_rate=1e-3, report_steps=10, target_rate=0.1, discount=0.9,
)  # fmt: skip


def learner(policy: PolicySpec, config: SACConfig = CONFIG, **settings: Any) -> SAC:
    with torch.random.fork_rng(devices=[]):  # pyright: ignore[reportUnknownMemberType]
        torch.manual_seed(0)  # pyright: ignore[reportUnknownMemberType]
        actor = Policy(policy, config)
        half = NUM_SLOTS // 2
        rows = [slice(0, half), slice(half, NUM_SLOTS)]
        return SAC(actor, config, LearnerSettings(rows, seed=1, **settings))


def batch(policy: PolicySpec, random: np.random.Generator, **changes: Any) -> Batch:
    result = Batch.allocate(policy, NUM_SLOTS // 2)
    result.observation["o"][:] = random.normal(2.0, 3.0, size=(NUM_SLOTS // 2, 3))
    result.reward[:] = random.normal(size=NUM_SLOTS // 2)
    result.active[:] = True
    if result.action_mask is not None:
        result.action_mask[:] = random.random((NUM_SLOTS // 2, 4)) < 0.5
        result.action_mask[:, 1] = True
    return replace(result, **changes)


def play(sac: SAC, steps: int, seed: int = 0, *, learns: bool = True) -> list[Any]:
    """Step both engines and return all actions."""
    random, actions = np.random.default_rng(seed), list[Any]()
    for engine in range(2):
        sac.begin(engine, batch(sac.policy.spec, random))
    for _ in range(steps):
        for engine in range(2):
            taken = sac.act(engine)
            actions.append((taken.discrete.copy(), taken.continuous.copy()))
            if learns:
                sac.learn_while_stepping()
            sac.record(engine, batch(sac.policy.spec, random))
    return actions


# --- one gradient step against plain implementations ---------------------------------------------


def minibatch(policy: PolicySpec, n: int = 128) -> Minibatch:
    generator = torch.Generator().manual_seed(5)
    mask = next_mask = None
    if policy.has_action_mask:
        mask, next_mask = torch.rand(2, n, 4, generator=generator) < 0.5
        mask[:, 1] = next_mask[:, 2] = True
    return Minibatch(
        inputs=Inputs(torch.randn(n, 3, generator=generator)),
        next_inputs=Inputs(torch.randn(n, 3, generator=generator)),
        discrete=torch.ones(n, 1, dtype=torch.int64),
        continuous=torch.rand(n, 2, generator=generator) * 2 - 1,
        reward=torch.randn(n, generator=generator),
        discount=torch.where(torch.arange(n) % 3 == 0, 0.0, 0.9),
        mask=mask,
        next_mask=next_mask,
        noise=torch.randn(2, n, 2 if policy.continuous_size else 0, generator=generator),
    )


class Reference:
    """SAC as the papers write it, with nothing but ``torch.distributions`` and autograd."""

    def __init__(self, sac: SAC) -> None:
        state = sac.state().tensors
        self.actor = copies(state, "policy.actor.")
        self.critics = [copies(state, f"critic.{name}.") for name in ("first", "second")]
        self.targets = [copies(state, f"target.{name}.") for name in ("first", "second")]
        self.log_alpha = state["log_temperature"].clone().requires_grad_()
        self.optimisers = [
            torch.optim.Adam(parameters, lr=1e-3, eps=1e-8)
            for parameters in (both(self.critics), self.actor, [self.log_alpha])
        ]

    def step(self, batch: Minibatch) -> list[float]:
        alpha = self.log_alpha.exp().detach()
        with torch.no_grad():
            after, noise = batch.next_inputs.vector, batch.noise[1]
            value, _ = self.value(self.targets, after, noise, batch.next_mask, alpha)
            target = batch.reward + batch.discount * value
        losses = [(self.taken(critic, batch) - target).square().mean() / 2
                  for critic in self.critics]  # fmt: skip
        self.descend(0, losses[0] + losses[1])
        value, entropy = self.value(
            self.critics, batch.inputs.vector, batch.noise[0], batch.mask, alpha
        )
        policy_loss = -value.mean()
        self.descend(1, policy_loss)
        aim = torch.tensor(-2.0)
        if not batch.noise.shape[-1]:
            allowed = torch.full((len(value),), 4) if batch.mask is None else batch.mask.sum(1)
            aim = 0.7 * allowed.log()
        temperature_loss = (self.log_alpha * (entropy.detach() - aim)).mean()
        self.descend(2, temperature_loss)
        with torch.no_grad():
            pairs = zip(both(self.targets), both(self.critics), strict=True)
            for slow, fast in pairs:
                slow.copy_(0.9 * slow + 0.1 * fast)
        parts = [losses[0] + losses[1], policy_loss, temperature_loss, entropy.mean()]
        return [part.item() for part in parts]

    def parameters(self) -> list[Tensor]:
        return [self.log_alpha, *self.actor, *both(self.critics), *both(self.targets)]

    def descend(self, index: int, loss: Tensor) -> None:
        for optimiser in self.optimisers:
            optimiser.zero_grad()
        cast(Any, loss).backward()
        cast(Any, self.optimisers[index]).step()

    def taken(self, critic: list[Tensor], batch: Minibatch) -> Tensor:
        if not batch.noise.shape[-1]:
            return forward(critic, batch.inputs.vector)[:, 1]
        return forward(critic, torch.cat([batch.inputs.vector, batch.continuous], 1))[:, 0]

    def value(
        self, critics: list[list[Tensor]], x: Tensor, noise: Tensor, mask: Any, alpha: Tensor
    ) -> tuple[Tensor, Tensor]:
        outputs = forward(self.actor, x)
        if not noise.shape[-1]:
            weights = outputs.exp() if mask is None else outputs.exp() * mask
            probability = weights / weights.sum(1, keepdim=True)
            log = probability.clamp(min=1e-30).log()
            q = torch.stack([forward(critic, x) for critic in critics]).min(0).values
            return (probability * (q - alpha * log)).sum(1), -(probability * log).sum(1)
        mean, log_std = outputs[:, :2], outputs[:, 2:]
        action = torch.tanh(mean + log_std.exp() * noise)
        squashed: Any = TransformedDistribution(Normal(mean, log_std.exp()), [TanhTransform()])
        log_prob = squashed.log_prob(action).sum(1)
        together = torch.cat([x, action], 1)
        q = torch.stack([forward(critic, together)[:, 0] for critic in critics]).min(0).values
        return q - alpha * log_prob, -log_prob


def both(pair: list[list[Tensor]]) -> list[Tensor]:
    return [*pair[0], *pair[1]]


def copies(state: dict[str, Tensor], prefix: str) -> list[Tensor]:
    names = sorted(name for name in state if name.startswith(prefix))
    pairs = [name.rpartition(".")[0] for name in names if name.endswith("weight")]
    return [
        state[f"{name}.{part}"].clone().requires_grad_("target" not in prefix)
        for name in pairs
        for part in ("weight", "bias")
    ]


def forward(parameters: list[Tensor], x: Tensor) -> Tensor:
    for index in range(0, len(parameters) - 2, 2):
        x = functional.relu(functional.linear(x, parameters[index], parameters[index + 1]))
    return functional.linear(x, parameters[-2], parameters[-1])


@pytest.mark.parametrize("hidden_sizes", [(32, 16), (128, 160)], ids=["small", "large"])
@pytest.mark.parametrize("policy", [CONTINUOUS, DISCRETE, MASKED], ids=["tanh", "one", "masked"])
def test_equals_a_plain_implementation(policy: PolicySpec, hidden_sizes: Any) -> None:
    """The large networks are those that ``dense`` makes faster."""
    sac = learner(policy, replace(CONFIG, hidden_sizes=hidden_sizes))
    reference = Reference(sac)
    for _ in range(3):
        q_loss, policy_loss, loss, _, entropy, _ = sac._gradient_step(  # pyright: ignore[reportPrivateUsage]
            minibatch(policy)
        )
        wanted = reference.step(minibatch(policy))
        got = [part.item() for part in (q_loss, policy_loss, loss, entropy)]
        assert got == pytest.approx(wanted, rel=1e-4, abs=1e-5)
    now = Reference(sac)
    for one, two in zip(now.parameters(), reference.parameters(), strict=True):
        torch.testing.assert_close(one, two, rtol=1e-4, atol=2e-5)


def test_squashed_density_integrates_to_one() -> None:
    raw = torch.linspace(-9.0, 9.0, 20_001).unsqueeze(1)
    mean, log_std = torch.tensor([0.4]), torch.tensor([-0.3])
    log_prob = squashed_log_prob(raw, (raw - mean) * torch.exp(-log_std), log_std)
    action = raw.squeeze(1).tanh()
    assert torch.trapezoid(log_prob.exp(), action).item() == pytest.approx(1.0, abs=1e-3)


def test_discrete_value_by_hand() -> None:
    probability = torch.tensor([[0.25, 0.75]])
    value, entropy = discrete_soft_value(
        torch.tensor([[2.0, -1.0]]), probability.log(), torch.tensor(0.5)
    )
    expected = -0.25 * math.log(0.25) - 0.75 * math.log(0.75)
    assert entropy.item() == pytest.approx(expected)
    assert value.item() == pytest.approx(0.25 * 2.0 - 0.75 + 0.5 * expected)


def test_losses_in_bfloat16_are_near_those_in_float32() -> None:
    exact, mixed = learner(CONTINUOUS), learner(CONTINUOUS, is_mixed=True)
    one = exact._gradient_step(minibatch(CONTINUOUS))  # pyright: ignore[reportPrivateUsage]
    two = mixed._gradient_step(minibatch(CONTINUOUS))  # pyright: ignore[reportPrivateUsage]
    torch.testing.assert_close(one, two, rtol=0.05, atol=0.02)
    assert not torch.equal(one, two)


# --- collecting ----------------------------------------------------------------------------------


def test_acts_at_random_until_learning_starts() -> None:
    config = replace(CONFIG, learning_starts=3000, replay_capacity=5000)
    actions = np.concatenate([part[1] for part in play(learner(CONTINUOUS, config), 400)])
    assert actions.min() >= -4.0
    assert actions.max() <= 8.0
    counts, _ = np.histogram(actions, 8, (-4.0, 8.0))
    assert (np.abs(counts / actions.size - 1 / 8) < 0.02).all()


def test_masks_are_never_violated() -> None:
    """At random, and with a policy that would like nothing better."""
    sac, random = learner(MASKED), np.random.default_rng(0)
    last = sac.policy.actor[-1]
    assert isinstance(last, torch.nn.Linear)
    with torch.no_grad():
        last.bias.copy_(torch.tensor([50.0, -50.0, 0.0, 50.0]))
    now, taken = [batch(MASKED, random) for _ in range(2)], np.zeros(4)
    for engine in range(2):
        sac.begin(engine, now[engine])
    for step in range(40):
        for engine in range(2):
            action = sac.act(engine).discrete[:, 0]
            mask = now[engine].action_mask
            assert mask is not None
            assert mask[np.arange(3), action].all()
            taken += np.bincount(action, minlength=4) if step < 4 else 0
            now[engine] = batch(MASKED, random)
            sac.record(engine, now[engine])
    assert (taken > 0).all()


def test_takes_the_gradient_steps_it_owes() -> None:
    """24 transitions of 6 slots are there after 4 steps; then half a gradient step for each."""
    sac = learner(DISCRETE, replace(CONFIG, updates_per_step=0.5))
    play(sac, 10)
    assert sac.num_steps_left == 0
    metrics = sac.update(0.0)
    assert metrics["replay_size"] == 60
    assert metrics["gradient_steps"] == math.floor(0.5 * 6.5)  # the second engine filled it up
    assert sac.num_steps_left == 10


@pytest.mark.slow
def test_gradient_steps_drawn_together_equal_single_ones() -> None:
    sac = learner(CONTINUOUS, replace(CONFIG, updates_per_step=40.0))
    play(sac, 10, learns=False)
    assert sac.update(0.0)["gradient_steps"] == 20 * 13


def test_a_state_that_has_diverged_is_told_before_it_is_saved() -> None:
    sac = learner(CONTINUOUS)
    play(sac, 10)
    with torch.no_grad():
        next(sac.policy.actor.parameters()).fill_(float("nan"))
    sac._learn_owed()  # pyright: ignore[reportPrivateUsage]
    with pytest.raises(DivergenceError, match=r": .* is nan"):
        sac.state()
    sac.state()  # to be inspected


def test_no_losses_before_learning_starts() -> None:
    sac = learner(DISCRETE, replace(CONFIG, learning_starts=1000, replay_capacity=1000))
    play(sac, 10)
    assert sac.update(0.0).keys() == {
        "learning_rate", "gradient_steps", "replay_size"
    }  # fmt: skip


def test_a_fixed_temperature_stays() -> None:
    sac = learner(CONTINUOUS, replace(CONFIG, temperature=0.2))
    play(sac, 10)
    assert sac.update(0.0)["temperature"] == pytest.approx(0.2)
    sac = learner(CONTINUOUS, replace(CONFIG, initial_temperature=0.2))
    play(sac, 10)
    assert sac.update(0.0)["temperature"] != pytest.approx(0.2, abs=1e-4)


def test_observations_are_normalised_with_all_that_were_recorded() -> None:
    sac = learner(CONTINUOUS)
    for seed in range(3):
        play(sac, 10, seed)
        sac.update(0.0)
    normaliser = sac.policy.encoder.normaliser
    seen = sac.state().replay["observation.o"].numpy().astype(np.float64)
    assert normaliser is not None
    assert normaliser.count.item() == len(seen) == 180
    np.testing.assert_allclose(normaliser.mean.numpy(), seen.mean(0), rtol=1e-6)
    np.testing.assert_allclose(normaliser.variance.numpy(), seen.var(0), rtol=1e-6)


@pytest.mark.parametrize(
    "action",
    [(DiscreteAction("a", 3), ContinuousAction("c", 1, -1.0, 1.0)),
     (DiscreteAction("a", 3), DiscreteAction("b", 2))],
    ids=["mixed", "multi-discrete"],
)  # fmt: skip
def test_other_actions_are_refused(action: Any) -> None:
    with pytest.raises(ConfigError, match="policy hero: sac needs continuous actions or one") as e:
        learner(spec(*action))
    assert "ppo" in e.value.hint


# --- saving --------------------------------------------------------------------------------------


@pytest.mark.parametrize("policy", [CONTINUOUS, MASKED], ids=["continuous", "masked"])
def test_a_restored_learner_continues_to_the_bit(policy: PolicySpec) -> None:
    config = replace(CONFIG, updates_per_step=0.7)
    one, two = learner(policy, config), learner(policy, config)
    play(one, 10)
    one.update(0.3)
    two.load_state(one.state())
    two.update(0.3)  # sets the learning rate; there is nothing to learn
    for sac in (one, two):
        play(sac, 10, seed=9)
        sac.update(0.6)
    first, second = one.state(), two.state()
    assert first.values == second.values
    assert {f"samples.{name}" for name in ("o",)} <= first.tensors.keys()
    for before, after in ((first.tensors, second.tensors), (first.replay, second.replay)):
        assert before.keys() == after.keys()
        assert all(torch.equal(before[name], after[name]) for name in before)


def test_without_a_replay_it_acts_at_once_and_learns_later() -> None:
    config = replace(CONFIG, save_replay=False, learning_starts=90)
    one, two = learner(DISCRETE, config), learner(DISCRETE, config)
    for seed in range(2):
        play(one, 10, seed)
        one.update(0.0)
    state = one.state()
    assert not state.replay
    two.load_state(state)
    play(two, 10)
    metrics = two.update(0.0)
    assert metrics["gradient_steps"] == state.values["gradient_steps"]
    assert "q_loss" not in metrics
    play(two, 10)
    assert two.update(0.0)["gradient_steps"] > state.values["gradient_steps"]
