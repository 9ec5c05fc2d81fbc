from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from torch.distributions import Categorical, Normal, TanhTransform, TransformedDistribution

from ludus.networks.distributions import ActionHead, GaussianShape, tanh_log_det
from ludus.spec import ActionComponent, AgentSpec, ContinuousAction, DiscreteAction, PolicySpec

SAME = GaussianShape(-0.3)


def head(
    *action: ActionComponent, has_mask: bool = False, shape: GaussianShape = SAME
) -> ActionHead:
    spec = PolicySpec("p", (), tuple(action), (AgentSpec(0, "a"),), has_action_mask=has_mask)
    return ActionHead(spec, shape)


MIXED = (
    DiscreteAction("a", 3),
    ContinuousAction("b", 2, (-2.0, 0.0), (2.0, 10.0)),
    DiscreteAction("c", 2),
)


def test_mixed_action_equals_torch_distributions() -> None:
    part = head(*MIXED)
    random = torch.Generator().manual_seed(0)
    outputs = torch.randn(6, 7, generator=random)
    discrete = torch.tensor([[0, 1], [2, 0], [1, 1]] * 2)
    continuous = torch.randn(6, 2, generator=random)
    log_prob, entropy = part.evaluate(outputs, discrete, continuous, None)
    first: Any = Categorical(logits=outputs[:, :3])
    second: Any = Categorical(logits=outputs[:, 3:5])
    normal: Any = Normal(outputs[:, 5:], math.exp(-0.3))
    expected = first.log_prob(discrete[:, 0]) + second.log_prob(discrete[:, 1])
    torch.testing.assert_close(log_prob, expected + normal.log_prob(continuous).sum(-1))
    total = first.entropy() + second.entropy() + normal.entropy().sum(-1)
    torch.testing.assert_close(entropy, total)


def test_masked_actions_have_no_probability_and_finite_gradients() -> None:
    part = head(DiscreteAction("a", 4), has_mask=True)
    outputs = torch.randn(5, 4, requires_grad=True)
    mask = torch.tensor([[True, False, True, False]] * 5)
    log_prob, entropy = part.evaluate(outputs, torch.zeros(5, 1).long(), torch.zeros(5, 0), mask)
    allowed = Categorical(logits=outputs[:, [0, 2]])
    torch.testing.assert_close(log_prob, allowed.log_prob(torch.zeros(5)))
    torch.testing.assert_close(entropy, allowed.entropy())
    (gradient,) = torch.autograd.grad(log_prob.sum() + entropy.sum(), outputs)
    assert torch.isfinite(gradient).all()
    assert (gradient[:, [1, 3]] == 0).all()


def test_samples_follow_the_distribution() -> None:
    part = head(*MIXED)
    generator, count = torch.Generator().manual_seed(1), 40_000
    outputs = torch.tensor([[0.0, 1.0, -1.0, 0.5, -0.5, 0.2, -0.4]]).expand(count, -1)
    noise = torch.empty(count, 7)
    part.fill_noise(noise, generator)
    discrete, continuous = part.sample(outputs, noise)
    for component, logits in ((0, outputs[0, :3]), (1, outputs[0, 3:5])):
        share = torch.bincount(discrete[:, component]) / count
        torch.testing.assert_close(share, logits.softmax(-1), atol=0.01, rtol=0)
    torch.testing.assert_close(continuous.mean(0), outputs[0, 5:], atol=0.02, rtol=0)
    torch.testing.assert_close(
        continuous.std(0), torch.full((2,), -0.3).exp().detach(), atol=0.02, rtol=0
    )


def test_samples_respect_masks() -> None:
    part = head(DiscreteAction("a", 4), has_mask=True)
    noise = torch.empty(1000, 4)
    part.fill_noise(noise, torch.Generator().manual_seed(0))
    mask = torch.tensor([[False, True, False, True]]).expand(1000, -1)
    discrete, _ = part.sample(torch.tensor([[9.0, 0.0, 9.0, 0.0]]).expand(1000, -1), noise, mask)
    assert torch.isin(discrete, torch.tensor([1, 3])).all()


def test_without_noise_the_most_probable_action() -> None:
    outputs = torch.tensor([[0.0, 3.0, 1.0, 2.0, 1.0, 0.3, -0.6]])
    discrete, continuous = head(*MIXED).sample(outputs)
    assert torch.equal(discrete, torch.tensor([[1, 0]]))
    np.testing.assert_allclose(continuous.numpy(), [[0.3, -0.6]], rtol=1e-6)


@pytest.mark.parametrize(
    ("raw", "expected"),
    [([0.0, 0.0], [0.0, 5.0]), ([-9.0, 9.0], [-2.0, 10.0]), ([0.5, -0.5], [1.0, 2.5])],
)
def test_continuous_actions_reach_their_bounds(raw: list[float], expected: list[float]) -> None:
    bounded = head(*MIXED).to_bounds(torch.tensor([raw]))
    assert torch.equal(bounded, torch.tensor([expected]))


def test_squashed_action_equals_torch_distributions() -> None:
    part = head(ContinuousAction("b", 2, -3.0, 5.0), shape=GaussianShape(0.0, True, True))
    generator = torch.Generator().manual_seed(2)
    outputs, noise = torch.randn(9, 4, generator=generator), torch.randn(9, 2, generator=generator)
    discrete, sampled = part.sample(outputs, noise)
    normal: Any = Normal(outputs[:, :2], outputs[:, 2:].clamp(-20, 2).exp())
    squashed: Any = TransformedDistribution(normal, [TanhTransform()])
    log_prob, _ = part.evaluate(outputs, discrete, sampled, None)
    torch.testing.assert_close(log_prob, squashed.log_prob(sampled.tanh()).sum(-1))
    torch.testing.assert_close(part.to_bounds(sampled), 1.0 + 4.0 * sampled.tanh())


def test_squashing_far_out_stays_finite() -> None:
    far = torch.tensor([[50.0, -50.0]])
    expected = 2 * (2 * (math.log(2.0) - 50.0))  # log(4 e^-2u) for each element
    assert tanh_log_det(far).item() == pytest.approx(expected)


def test_the_estimated_entropy_of_a_squashed_gaussian_is_right_on_average() -> None:
    part = head(ContinuousAction("b", 1), shape=GaussianShape(0.0, False, True))
    count = 100_000
    outputs = torch.full((count, 1), 0.3)
    noise = torch.randn(count, 1, generator=torch.Generator().manual_seed(3))
    discrete, sampled = part.sample(outputs, noise)
    log_prob, entropy = part.evaluate(outputs, discrete, sampled, None)
    assert entropy.mean().item() == pytest.approx(-log_prob.mean().item(), abs=0.01)


def test_a_network_that_puts_out_deviations_begins_with_the_initial_one() -> None:
    part = head(ContinuousAction("b", 2), shape=GaussianShape(-1.5, True))
    last = torch.nn.Linear(3, part.num_outputs)
    part.initialise(last)
    _, log_std = part.gaussian(last(torch.zeros(1, 3)))
    torch.testing.assert_close(log_std, torch.full((1, 2), -1.5))
