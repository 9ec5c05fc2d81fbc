from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from ludus.algorithms.adam import Adam


def network() -> Any:
    return nn.Sequential(nn.Linear(3, 5), nn.Tanh(), nn.Linear(5, 2))


def test_equals_algorithm_1() -> None:
    """Every element by itself, in double precision, as the paper writes it."""
    own = network()
    adam, epsilon, limit = Adam(own.parameters(), 1e-5), 1e-5, 0.5
    values, mean, square = _joined(own, "data"), 0.0, 0.0
    for t in range(1, 21):
        rate = 0.01 / t
        adam.zero_gradients()
        own(torch.randn(4, 3)).square().sum().backward()
        gradient = _joined(own, "grad")
        length = np.linalg.norm(gradient)
        assert adam.clip_grad_norm(limit).item() == pytest.approx(length, rel=1e-5)
        gradient *= min(1.0, limit / length)
        mean = 0.9 * mean + 0.1 * gradient
        square = 0.999 * square + 0.001 * gradient**2
        unbiased = mean / (1 - 0.9**t), square / (1 - 0.999**t)
        values -= rate * unbiased[0] / (np.sqrt(unbiased[1]) + epsilon)
        adam.step(rate)
        np.testing.assert_allclose(_joined(own, "data"), values, rtol=1e-4, atol=1e-6)


def _joined(model: Any, attribute: str) -> Any:
    parts = [getattr(parameter, attribute).flatten() for parameter in model.parameters()]
    return torch.cat(parts).double().numpy().copy()


def test_gradients_below_the_limit_are_not_clipped() -> None:
    own = network()
    adam = Adam(own.parameters(), 1e-5)
    own(torch.zeros(1, 3)).sum().backward()
    before = [parameter.grad.clone() for parameter in own.parameters()]
    adam.clip_grad_norm(1e6)
    assert all(torch.equal(a, p.grad) for a, p in zip(before, own.parameters(), strict=True))


def test_loaded_weights_and_state_reach_the_vectors() -> None:
    first, second = network(), network()
    one, two = Adam(first.parameters(), 1e-5), Adam(second.parameters(), 1e-5)
    inputs = torch.randn(4, 3)

    def step(model: Any, adam: Adam) -> None:
        adam.zero_gradients()
        model(inputs).sum().backward()
        adam.step(0.1)

    step(first, one)
    second.load_state_dict(first.state_dict())
    two.load_state(one.state())
    step(first, one)
    step(second, two)
    pairs = zip(first.parameters(), second.parameters(), strict=True)
    assert all(torch.equal(mine, theirs) for mine, theirs in pairs)
