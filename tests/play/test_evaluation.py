from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from ludus.errors import RunError
from ludus.networks.policy import Policy
from ludus.play.evaluation import evaluate, play_round
from ludus.play.players import Act, random_player, trained_player
from ludus.pool import EnginePool, Pool, PoolConfig, open_pool
from ludus.settings.train_config import PPOConfig
from ludus.spec import AgentSpec, DiscreteAction, ObservationEntry, PolicySpec
from ludus.spec.batch import ActionBatch, Batch, Batches


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


class LateZombies:
    """A game of one hero, whose episodes have 5 steps, and of zombies that come after the reset.

    Args:
        lengths: Steps of each zombie's episodes, by slot; 0: it never comes.
    """

    def __init__(self, *lengths: int) -> None:
        self.num_steps = 0
        self._lengths = {"hero": np.array([5]), "zombie": np.array(lengths)}
        entry, action = ObservationEntry("x", "float32", (1,)), DiscreteAction("x", 2)
        self._policies = {
            name: PolicySpec(name, (entry,), (action,), (AgentSpec(0, name),) * len(lengths))
            for name, lengths in self._lengths.items()
        }

    def reset(self, seed: int) -> Batches:
        """Begin with the hero alone."""
        del seed
        batches = {name: self._batch(name) for name in self._policies}
        batches["hero"].active[:] = True
        return batches

    def step(self, actions: dict[str, ActionBatch]) -> Batches:
        """Fill the slots of the zombies; end what is due."""
        del actions
        self.num_steps += 1
        batches = {name: self._batch(name) for name in self._policies}
        for name, batch in batches.items():
            lengths = self._lengths[name]
            batch.active[:] = lengths > 0
            batch.terminated[:] = batch.active & (self.num_steps % np.maximum(lengths, 1) == 0)
        return batches

    def act(self, batches: Batches) -> dict[str, ActionBatch]:
        """Take action 0."""
        return {
            name: ActionBatch.zeros(self._policies[name], batch.num_agents)
            for name, batch in batches.items()
        }

    def _batch(self, policy: str) -> Batch:
        return Batch.allocate(self._policies[policy], len(self._lengths[policy]))


def test_episodes_of_agents_that_come_later_count_in_any_slot() -> None:
    game = LateZombies(4, 0, 6)
    results = evaluate(game.act, cast(Pool, game), 4)
    assert results["hero"].lengths == (5, 5, 5, 5)
    assert results["zombie"].lengths == (3, 5, 4, 4)  # at 4, 6, 8, and 12 in the first of two slots
    assert game.num_steps == 20


def test_agents_that_never_come_are_waited_for() -> None:
    game = LateZombies(0)
    with pytest.raises(RunError, match="policy zombie: 0 of 2 episodes ended within 50 steps"):
        evaluate(game.act, cast(Pool, game), 2, max_steps=50)
    assert game.num_steps == 50


def test_a_round_leaves_out_agents_that_come_later() -> None:
    game = LateZombies(4)
    played = play_round(game.act, cast(Pool, game), 0, lambda: False)
    assert played is not None
    assert set(played) == {"hero"}
    assert game.num_steps == 5
