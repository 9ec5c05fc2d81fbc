"""Self-play on handmade batches: who plays where, what is rated, and what is remembered."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from ludus.errors import ConfigError
from ludus.league.league import League
from ludus.league.matches import MatchTracker, Teams, expected_score, score
from ludus.league.seats import LIVE, Seats
from ludus.networks.policy import Policy
from ludus.settings.train_config import LeagueConfig, PPOConfig
from ludus.spec import AgentSpec, DiscreteAction, ObservationEntry, PolicySpec
from ludus.spec.batch import ActionBatch, Batch, Batches

WORLDS = 6
CONFIG = PPOConfig(hidden_sizes=(8,))


def spec(name: str, agents_per_world: int = 1, **changes: Any) -> PolicySpec:
    agents = tuple(AgentSpec(world, f"{name}{i}")
                   for world in range(WORLDS) for i in range(agents_per_world))  # fmt: skip
    settings: dict[str, Any] = {"episode": "world", "agents_per_world": agents_per_world}
    entry = ObservationEntry("o", "float32", (3,))
    return PolicySpec(name, (entry,), (DiscreteAction("a", 4),), agents, **{**settings, **changes})


DUEL = {"hero": spec("hero"), "foe": spec("foe")}
MIRROR = {"twin": spec("twin", 2)}
SQUADS = {"red": spec("red", 2), "blue": spec("blue", 2)}


def batches(specs: dict[str, PolicySpec], **columns: dict[str, Any]) -> Batches:
    """Return active batches; ``columns`` hold arrays by policy."""
    result: dict[str, Batch] = {}
    for name, of in specs.items():
        result[name] = Batch.allocate(of, of.num_agents)
        result[name].active[:] = True
        result[name].observation["o"][:] = 1.0
        for column, by_policy in columns.items():
            if name in by_policy:
                getattr(result[name], column)[:] = by_policy[name]
    return result


class Duel:
    """A league and the seats of one engine, as a run on one machine has them."""

    def __init__(self, league: League, seats: Seats, policies: dict[str, Policy]) -> None:
        self.league = league
        self.seats = seats
        self.policies = policies

    def advance(self, updates: int) -> None:
        self.league.advance(updates, {name: self.seats.playing(name) for name in self.policies})
        self.seats.advance(updates)

    def record(self, batches: Batches) -> None:
        self.league.rate(self.seats.record(0, batches))

    def slots(self, name: str) -> Any:
        return self.seats._slots[0][name]  # pyright: ignore[reportPrivateUsage]


def league(specs: dict[str, PolicySpec], **settings: Any) -> Duel:
    with torch.random.fork_rng(devices=[]):  # pyright: ignore[reportUnknownMemberType]
        torch.manual_seed(0)  # pyright: ignore[reportUnknownMemberType]
        policies = {name: Policy(of, CONFIG) for name, of in specs.items()}
    config: dict[str, Any] = {"share": 1.0, **settings}
    made = LeagueConfig(**config)
    one = League(made, specs, policies, seed=5)
    seats = Seats(one, policies, specs, share=made.share, num_engines=1, seed=5)
    return Duel(one, seats, policies)


def test_expected_scores() -> None:
    assert expected_score(1000, 1000) == 0.5
    assert expected_score(1400, 1000) == pytest.approx(10 / 11)
    assert expected_score(1000, 1400) == pytest.approx(1 / 11)


def test_the_higher_return_wins() -> None:
    assert [score(returns, 0, 1) for returns in ([1, 0], [0, 1], [2, 2])] == [1.0, 0.0, 0.5]


def test_returns_of_a_team_are_summed_until_the_game_ends() -> None:
    tracker = MatchTracker(Teams.of(MIRROR))
    tracker.begin(batches(MIRROR))
    reward = np.arange(12, dtype=np.float32)
    assert len(tracker.record(batches(MIRROR, reward={"twin": reward})).worlds) == 0
    over = np.zeros(12, np.bool_)
    over[[4, 5]] = True  # both agents of world 2
    finished = tracker.record(batches(MIRROR, reward={"twin": reward}, terminated={"twin": over}))
    assert finished.worlds.tolist() == [2]
    assert finished.returns.tolist() == [[8.0, 10.0]]
    finished = tracker.record(batches(MIRROR, reward={"twin": reward}, truncated={"twin": over}))
    assert finished.returns.tolist() == [[4.0, 5.0]]  # a new game


def test_rewards_of_inactive_agents_do_not_count() -> None:
    tracker = MatchTracker(Teams.of(DUEL))
    active = np.asarray([True] + [False] * 5)
    tracker.begin(batches(DUEL, active={"hero": active}))
    ends = {"terminated": {"hero": np.ones(6, np.bool_), "foe": active}}
    finished = tracker.record(batches(DUEL, reward={"hero": 3.0, "foe": 1.0}, **ends))
    assert finished.worlds.tolist() == [0]
    assert finished.returns.tolist() == [[3.0, 1.0]]


def only(policy: PolicySpec, *slots: int) -> NDArray[np.bool_]:
    return np.isin(np.arange(policy.num_agents), slots)


def test_a_game_of_squads_ends_with_its_last_agent() -> None:
    """In world 0 one red agent dies, then the other, then both blue ones; each death costs 1."""
    tracker = MatchTracker(Teams.of(SQUADS))
    tracker.begin(batches(SQUADS))
    red, blue = SQUADS.values()
    first, second, both = only(red, 0), only(red, 1), only(blue, 0, 1)
    for dead, waiting in ((first, first), (second, first | second)):
        step = {"terminated": {"red": dead}, "reward": {"red": -1.0 * dead}}
        finished = tracker.record(batches(SQUADS, active={"red": ~waiting}, **step))
        assert finished.worlds.tolist() == []
    step = {"terminated": {"blue": both}, "reward": {"blue": -1.0 * both}}
    finished = tracker.record(batches(SQUADS, **step))
    assert finished.worlds.tolist() == [0]
    assert finished.returns.tolist() == [[-2.0, -2.0]]
    assert tracker.record(batches(SQUADS)).worlds.tolist() == []


def test_a_game_of_one_policy_ends_with_its_last_agent() -> None:
    one = league(MIRROR)
    one.advance(0)
    one.seats.begin(0, batches(MIRROR))
    lineup = one.slots("twin")[:2].tolist()
    first, second = (only(MIRROR["twin"], slot) for slot in (0, 1))
    dies: dict[str, Any] = {"truncated": {"twin": first}, "active": {"twin": ~first}}
    assert one.seats.record(0, batches(MIRROR, **dies)) == []
    wins: dict[str, Any] = {"terminated": {"twin": second}, "reward": {"twin": 1.0}}
    assert one.seats.record(0, batches(MIRROR, **wins)) == [(lineup, [0.0, 1.0])]


@pytest.mark.parametrize(
    ("specs", "text"),
    [
        ({"solo": spec("solo")}, "solo is the only agent of a world"),
        ({"a": spec("a"), "b": spec("b", episode="agent")}, "those of policy b do not"),
    ],
)
def test_games_without_two_teams_are_refused(specs: dict[str, PolicySpec], text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        Teams.of(specs)


def test_one_team_of_every_world_learns_and_the_other_is_of_the_past() -> None:
    one = league(DUEL)
    one.advance(0)
    one.seats.begin(0, batches(DUEL))
    hero, foe = one.slots("hero"), one.slots("foe")
    assert ((hero == LIVE) != (foe == LIVE)).all()
    assert {LIVE, 0} == set(hero.tolist()) == set(foe.tolist())


def test_agents_of_one_policy_play_against_their_past() -> None:
    one = league(MIRROR)
    one.advance(0)
    one.seats.begin(0, batches(MIRROR))
    pairs = one.slots("twin").reshape(WORLDS, 2)
    assert (np.sort(pairs, axis=1) == [LIVE, 0]).all()


def test_only_a_team_that_learns_meets_the_past() -> None:
    one = league(DUEL)
    one.advance(0)
    one.league.learning = frozenset({"foe"})
    one.seats.begin(0, batches(DUEL))
    assert (one.slots("hero") == 0).all()
    assert (one.slots("foe") == LIVE).all()
    one.league.learning = frozenset()
    one.seats.begin(0, batches(DUEL))
    assert (one.slots("hero") == LIVE).all()


def test_a_share_of_zero_and_a_half() -> None:
    for share, expected in ((0.0, 0), (0.5, 300)):
        one = league(DUEL, share=share)
        one.advance(0)
        count = 0
        for _ in range(100):
            one.seats.begin(0, batches(DUEL))
            count += sum(int((one.slots(name) != LIVE).sum()) for name in DUEL)
        assert count == pytest.approx(expected, abs=60)


def test_past_selves_act_as_they_did() -> None:
    one = league(DUEL)
    one.advance(0)
    one.league.learning = frozenset({"foe"})
    live = one.policies["hero"]
    with torch.no_grad():  # the hero of the past always does 2, today's always 3
        live.actor[-1].weight.zero_()  # pyright: ignore
        live.actor[-1].bias.copy_(torch.tensor([0.0, 0.0, 100.0, 0.0]))  # pyright: ignore
    one.advance(20)
    with torch.no_grad():
        live.actor[-1].bias.copy_(torch.tensor([0.0, 0.0, 0.0, 100.0]))  # pyright: ignore
    one.league.pools["hero"] = one.league.pools["hero"][1:]
    one.league.opponents = {**one.league.opponents, "hero": [20]}
    first = batches(DUEL)
    one.seats.begin(0, first)
    given = ActionBatch.zeros(DUEL["hero"], WORLDS)
    result = one.seats.replace_actions(0, "hero", first["hero"], given)
    assert (result.discrete == 2).all()
    assert (given.discrete == 0).all()
    assert one.seats.replace_actions(0, "foe", first["foe"], given) is given


def test_winning_moves_ratings_and_draws_anew() -> None:
    one = league(DUEL, elo_factor=10.0)
    one.advance(0)
    one.league.learning = frozenset({"hero"})
    one.seats.begin(0, batches(DUEL))
    over = np.zeros(WORLDS, np.bool_)
    over[3] = True
    ends = {"terminated": dict.fromkeys(DUEL, over)}
    one.record(batches(DUEL, reward={"hero": 1.0, "foe": -1.0}, **ends))
    assert one.league.ratings == {"hero": 1005.0, "foe": 1000.0}
    assert one.league.pools["foe"][0].rating == 995.0
    one.record(batches(DUEL, **ends))  # a draw moves the better one down a little
    assert one.league.ratings["hero"] < 1005.0
    assert one.league.ratings["hero"] + one.league.pools["foe"][0].rating == pytest.approx(2000.0)


def test_the_pool_keeps_the_newest_and_those_that_play() -> None:
    one = league(DUEL, pool_size=2, max_opponents=1, snapshot_every_updates=10)
    one.league.learning = frozenset({"hero"})
    one.advance(0)
    one.seats.begin(0, batches(DUEL))
    assert set(one.slots("foe").tolist()) == {0}
    for updates in (5, 10, 15, 20, 30):
        one.advance(updates)
    assert [past.number for past in one.league.pools["hero"]] == [20, 30]
    assert [past.number for past in one.league.pools["foe"]] == [0, 20, 30]
    given = ActionBatch.zeros(DUEL["foe"], WORLDS)
    one.seats.replace_actions(0, "foe", batches(DUEL)["foe"], given)
    one.league.opponents = {**one.league.opponents, "foe": [30]}
    one.seats.begin(0, batches(DUEL))
    one.advance(40)
    assert 0 not in [past.number for past in one.league.pools["foe"]]


@pytest.mark.parametrize(("sampling", "best"), [("recent", 90), ("rating", 30), ("uniform", None)])
def test_opponents_are_sampled_as_configured(sampling: Any, best: int | None) -> None:
    one = league(DUEL, sampling=sampling, max_opponents=1, snapshot_every_updates=10)
    for updates in range(0, 100, 10):
        one.advance(updates)
    for past in one.league.pools["foe"]:
        past.rating = 1000.0 + 20.0 * (past.number - 30)
    counts = dict.fromkeys(range(0, 100, 10), 0)
    for _ in range(600):
        (number,) = one.league._choose("foe")  # pyright: ignore[reportPrivateUsage]
        counts[number] += 1
    if best is None:
        assert min(counts.values()) > 30
    else:
        assert max(counts, key=lambda number: counts[number]) == best
        assert counts[0 if best == 90 else 90] < counts[best] / 3


def test_a_restored_league_continues_to_the_bit() -> None:
    first, second = league(DUEL, max_opponents=2), league(DUEL, max_opponents=2)
    over = {"terminated": dict.fromkeys(DUEL, np.ones(WORLDS, np.bool_))}
    for updates in (0, 20, 40):
        first.advance(updates)
        first.seats.begin(0, batches(DUEL))
        first.record(batches(DUEL, reward={"hero": 1.0}, **over))
    tensors, values = first.league.state()
    second.league.load_state(tensors, values)
    for one in (first, second):
        one.seats.advance(40)  # as a run does before it resets the worlds
        one.seats.begin(0, batches(DUEL))
        one.record(batches(DUEL, **over))
        one.advance(60)
        one.seats.begin(0, batches(DUEL))
    assert first.league.ratings == second.league.ratings
    for name in DUEL:
        assert first.slots(name).tolist() == second.slots(name).tolist()
    one, two = first.league.state()[0], second.league.state()[0]
    assert one.keys() == two.keys()
    assert all(torch.equal(one[name], two[name]) for name in one)
