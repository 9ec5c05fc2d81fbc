from __future__ import annotations

import pytest

from ludus.errors import RunError
from ludus.networks.policy import Policy
from ludus.play.evaluation import evaluate, play_round
from ludus.play.players import Act, random_player, trained_player
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.settings.train_config import PPOConfig


def untrained(pool: EnginePool, seed: int = 0, *, stochastic: bool = False) -> Act:
    policies = {"agent": Policy(pool.policies["agent"], PPOConfig(hidden_sizes=()))}
    return trained_player(policies, pool, seed, stochastic)


def test_short_episodes_are_not_favoured() -> None:
    pool = open_pool("gym:Lottery-v0", PoolConfig(num_worlds=50))
    result = evaluate(untrained(pool), pool, episodes=200)["agent"]
    # Whichever 200 end first would have a mean near 2.5; the unbiased one is 5 ± 0.28.
    assert result.num_episodes == 200
    assert result.mean_return == pytest.approx(5.0, abs=1.0)
    assert (result.min_return, result.max_return) == (1.0, 9.0)
    assert result.mean_length == result.mean_return


@pytest.mark.parametrize(("worlds", "episodes"), [(7, 3), (3, 7), (4, 4)])
def test_plays_exactly_as_many_as_asked(worlds: int, episodes: int) -> None:
    pool = open_pool("gym:Lottery-v0", PoolConfig(num_worlds=worlds))
    result = evaluate(untrained(pool), pool, episodes)["agent"]
    assert len(result.returns) == len(result.lengths) == result.num_episodes == episodes


def test_drawn_actions_differ_by_seed_and_repeat() -> None:
    pool = open_pool("gym:Identity-discrete-v0", PoolConfig(num_worlds=4))
    policies = {"agent": Policy(pool.policies["agent"], PPOConfig(hidden_sizes=()))}

    def returns(seed: int, stochastic: bool | tuple[str, ...] = True) -> tuple[float, ...]:
        act = trained_player(policies, pool, seed, stochastic)
        return evaluate(act, pool, 4, seed=3)["agent"].returns

    assert returns(1) == returns(1, ("agent",))
    assert returns(1) != returns(2)
    assert returns(1, False) == returns(2, ()) != returns(1)


def test_random_play_differs_in_the_worlds_of_every_engine() -> None:
    pool = open_pool("gym:Identity-discrete-v0", PoolConfig(num_worlds=2, num_engines=3))
    act = random_player(pool, 5)
    batches = pool.reset(5)
    rows = [act(batches)["agent"].discrete[:, 0].tolist() for _ in range(100)]
    assert len({tuple(column) for column in zip(*rows, strict=True)}) == 6
    result = evaluate(random_player(pool, 5), pool, 12, seed=5)["agent"]
    assert result == evaluate(random_player(pool, 5), pool, 12, seed=5)["agent"]
    assert result != evaluate(random_player(pool, 6), pool, 12, seed=5)["agent"]


def test_a_round_is_the_first_episode_of_every_slot() -> None:
    pool = open_pool("gym:Lottery-v0", PoolConfig(num_worlds=50))
    played = play_round(untrained(pool), pool, 0, lambda: False)
    assert played is not None
    assert played["agent"].num_episodes == 50
    assert set(played["agent"].returns) == {1.0, 9.0}


def test_a_round_that_is_stopped_has_no_result() -> None:
    pool = open_pool("gym:Endless-v0", PoolConfig(num_worlds=1))
    answers = iter([False] * 5 + [True])
    assert play_round(untrained(pool), pool, 0, lambda: next(answers)) is None


def test_endless_episodes_give_an_error() -> None:
    pool = open_pool("gym:Endless-v0", PoolConfig(num_worlds=1))
    with pytest.raises(RunError, match="0 of 2 episodes ended within 50 steps"):
        evaluate(untrained(pool), pool, 2, max_steps=50)
