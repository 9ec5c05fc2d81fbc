from __future__ import annotations

import numpy as np
import torch

from ludus.networks.normalise import RewardScaler, RunningNormaliser


def test_statistics_equal_those_of_all_vectors_at_once() -> None:
    random = np.random.default_rng(0)
    parts = [random.normal(3.0, 5.0, (n, 2)).astype(np.float32) for n in (1, 7, 300)]
    normaliser = RunningNormaliser(2)
    for part in parts:
        normaliser.update(torch.as_tensor(part))
    everything = np.concatenate(parts).astype(np.float64)
    np.testing.assert_allclose(normaliser.mean.numpy(), everything.mean(0), rtol=1e-10)
    np.testing.assert_allclose(normaliser.variance.numpy(), everything.var(0), rtol=1e-10)
    normal = normaliser(torch.as_tensor(everything.astype(np.float32)))
    np.testing.assert_allclose(normal.mean(0).numpy(), 0.0, atol=1e-5)
    np.testing.assert_allclose(normal.std(0, correction=0).numpy(), 1.0, atol=1e-4)


def test_before_any_vector_nothing_changes_and_constants_stay_finite() -> None:
    normaliser = RunningNormaliser(1)
    assert normaliser(torch.tensor([[3.0]])).item() == 3.0
    normaliser.update(torch.full((10, 1), 4.0))
    assert normaliser(torch.tensor([[4.0]])).item() == 0.0
    assert normaliser(torch.tensor([[5.0]])).item() == 10.0  # cut off


def test_statistics_are_saved() -> None:
    normaliser, other = RunningNormaliser(2), RunningNormaliser(2)
    normaliser.update(torch.randn(50, 2))
    other.load_state_dict(normaliser.state_dict())
    vectors = torch.randn(5, 2)
    assert torch.equal(normaliser(vectors), other(vectors))


def test_rewards_are_divided_by_the_deviation_of_the_return() -> None:
    scaler = RewardScaler(num_agents=1, discount=0.5)
    reward = torch.tensor([[1.0], [1.0], [4.0]])
    is_done = torch.tensor([[False], [True], [False]])
    scaled = scaler.scale(reward, torch.ones(3, 1, dtype=torch.bool), is_done)
    deviation = np.std([1.0, 1.5, 4.0])
    np.testing.assert_allclose(scaled.numpy(), reward.numpy() / deviation, rtol=1e-6)
