from __future__ import annotations

import pytest

from ludus.errors import RunError
from ludus.networks.policy import Policy
from ludus.play.evaluation import evaluate
from ludus.pool.gymnasium_pool import GymnasiumPool
from ludus.settings.train_config import PPOConfig


def policy(pool: GymnasiumPool) -> dict[str, Policy]:
    return {"agent": Policy(pool.policies["agent"], PPOConfig(hidden_sizes=()))}


def test_short_episodes_are_not_favoured() -> None:
    pool = GymnasiumPool("Lottery-v0", num_worlds=50)
    result = evaluate(policy(pool), pool, episodes=200)["agent"]
    # Whichever 200 end first would have a mean near 2.5; the unbiased one is 5 ± 0.28.
    assert result.num_episodes == 200
    assert result.mean_return == pytest.approx(5.0, abs=1.0)
    assert (result.min_return, result.max_return) == (1.0, 9.0)
    assert result.mean_length == result.mean_return


@pytest.mark.parametrize(("worlds", "episodes"), [(7, 3), (3, 7), (4, 4)])
def test_plays_exactly_as_many_as_asked(worlds: int, episodes: int) -> None:
    pool = GymnasiumPool("Lottery-v0", num_worlds=worlds)
    result = evaluate(policy(pool), pool, episodes)["agent"]
    assert len(result.returns) == len(result.lengths) == result.num_episodes == episodes


def test_sampling_differs_by_seed_and_repeats() -> None:
    pool = GymnasiumPool("Identity-discrete-v0", num_worlds=4)
    own = policy(pool)

    def returns(seed: int) -> tuple[float, ...]:
        return evaluate(own, pool, 4, sampled=["agent"], seed=seed)["agent"].returns

    assert returns(1) == returns(1)
    assert returns(1) != returns(2)


def test_endless_episodes_give_an_error() -> None:
    pool = GymnasiumPool("Endless-v0", num_worlds=1)
    with pytest.raises(RunError, match="0 of 2 episodes ended within 50 steps"):
        evaluate(policy(pool), pool, 2, max_steps=50)
