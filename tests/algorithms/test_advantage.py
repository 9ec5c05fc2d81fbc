from __future__ import annotations

import numpy as np
import torch

from ludus.algorithms.losses import generalised_advantage


def reference(
    reward: np.ndarray,
    value: np.ndarray,
    next_value: np.ndarray,
    done: np.ndarray,
    g: float,
    lam: float,
) -> np.ndarray:
    """Sum the deltas forwards, equation 16, instead of recursively."""
    steps, agents = reward.shape
    result = np.zeros_like(reward)
    for agent in range(agents):
        for start in range(steps):
            weight = 1.0
            for t in range(start, steps):
                delta = reward[t, agent] + g * next_value[t, agent] - value[t, agent]
                result[start, agent] += weight * delta
                if done[t, agent]:
                    break
                weight *= g * lam
    return result


def test_equals_the_forward_sum() -> None:
    random = np.random.default_rng(0)
    reward, value, next_value = random.normal(size=(3, 12, 5))
    done = random.random((12, 5)) < 0.2
    arrays = [torch.as_tensor(array) for array in (reward, value, next_value)]
    rewards, values, next_values = arrays
    discounts = (0.9, 0.8)
    result = generalised_advantage(rewards, values, next_values, torch.as_tensor(done), discounts)
    expected = reference(reward, value, next_value, done, 0.9, 0.8)
    np.testing.assert_allclose(result.numpy(), expected, rtol=1e-12)


def test_advantages_equal_those_computed_by_hand() -> None:
    reward = torch.tensor([[1.0], [2.0]])
    value = torch.tensor([[0.5], [1.0]])
    next_value = torch.tensor([[1.0], [4.0]])
    done = torch.tensor([[False], [False]])
    # delta_1 = 2 + 0.5 * 4 - 1 = 3; delta_0 = 1 + 0.5 * 1 - 0.5 = 1; A_0 = 1 + 0.5 * 0.5 * 3
    result = generalised_advantage(reward, value, next_value, done, (0.5, 0.5))
    assert torch.equal(result.flatten(), torch.tensor([1.75, 3.0]))


def test_advantages_do_not_cross_the_end_of_an_episode() -> None:
    reward = torch.tensor([[0.0], [100.0]])
    zeros = torch.zeros(2, 1)
    result = generalised_advantage(
        reward, zeros, zeros, torch.tensor([[True], [False]]), (0.99, 0.95)
    )
    assert result[0, 0] == 0.0
