"""Self-play: past selves of every policy, their ratings, and who meets whom."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ludus.league.matches import MatchTracker, Teams, expected_score, score
from ludus.networks.policy import Player, Policy
from ludus.networks.tensors import with_prefix
from ludus.settings.train_config import LeagueConfig
from ludus.spec import PolicySpec
from ludus.spec.batch import ActionBatch, Batch, Batches

__all__ = ["League", "PastSelf", "act_for", "past_selves"]

LIVE = -1
"""Number of the policy as it is now; past selves have the number of their updates."""

FIRST_RATING = 1000.0


@dataclass
class PastSelf:
    """A policy as it once was.

    Attributes:
        number: Updates it had seen, and its name in the league.
        rating: Elo rating.
        tensors: State of the policy.
    """

    number: int
    rating: float
    tensors: dict[str, Tensor]


class League:
    """Past selves of all policies, and which worlds they play in.

    Per engine the order is :meth:`begin` after a reset, then :meth:`replace_actions` and
    :meth:`record` in turn. Call :meth:`advance` between two steps, after every update.

    Attributes:
        ratings: Elo rating of each policy as it is now.
        pools: Past selves of each policy, oldest first.
    """

    def __init__(
        self,
        config: LeagueConfig,
        specs: Mapping[str, PolicySpec],
        policies: Mapping[str, Policy],
        num_engines: int,
        seed: int,
    ) -> None:
        self.ratings = dict.fromkeys(policies, FIRST_RATING)
        self.pools: dict[str, list[PastSelf]] = {name: [] for name in policies}
        self._config = config
        self._policies = policies
        self._teams = Teams.of(specs)
        self._random = np.random.default_rng(seed)
        self._generators = {
            name: torch.Generator(policy.device).manual_seed(seed + index)
            for index, (name, policy) in enumerate(policies.items())
        }
        self._trackers = [MatchTracker(self._teams) for _ in range(num_engines)]
        shape = (self._teams.num_worlds, len(self._teams.policies))
        self._lineups = [np.full(shape, LIVE) for _ in range(num_engines)]
        self._slots: list[dict[str, NDArray[np.int64]]] = [{} for _ in range(num_engines)]
        self._opponents: dict[str, list[int]] = {name: [] for name in policies}
        self._players: list[dict[tuple[str, int], Player]] = [{} for _ in range(num_engines)]
        self.learning: frozenset[str] = frozenset(policies)

    # --- playing --------------------------------------------------------------------------------

    def begin(self, engine: int, batches: Batches) -> None:
        """Take the first batches of an engine that was reset, and draw who plays."""
        self._trackers[engine].begin(batches)
        self._players[engine].clear()
        self._draw(engine, np.arange(self._teams.num_worlds))

    def is_live(self, engine: int, policy: str) -> NDArray[np.bool_]:
        """Return ``bool[slots]``, where the policy plays as it is now."""
        return self._slots[engine][policy] == LIVE

    def replace_actions(
        self, engine: int, policy: str, batch: Batch, actions: ActionBatch
    ) -> ActionBatch:
        """Return ``actions`` with those of past selves in their slots."""
        slots = self._slots[engine][policy]
        numbers = np.unique(slots[slots != LIVE])
        players = {int(number): self._player(engine, policy, int(number)) for number in numbers}
        return act_for(slots, players, batch, actions)

    def record(self, engine: int, batches: Batches) -> None:
        """Take the outcome of a step: rate the games that ended, and draw who plays next there."""
        finished = self._trackers[engine].record(batches)
        if not len(finished.worlds):
            return
        for world, returns in zip(finished.worlds, finished.returns, strict=True):
            self._rate(self._lineups[engine][world], returns)
        # A player that paused may remember another game, if its agent died before the world ended.
        for (name, _), player in self._players[engine].items():
            player.forget(np.isin(self._teams.worlds[name], finished.worlds).nonzero()[0])
        self._draw(engine, finished.worlds)

    def advance(self, updates: int) -> None:
        """Save past selves and choose opponents, if it is time to after ``updates``."""
        if updates % self._config.snapshot_every_updates:
            return
        for name, policy in self._policies.items():
            pool = self.pools[name]
            if not pool or pool[-1].number != updates:
                tensors = {key: value.clone() for key, value in policy.state_dict().items()}
                pool.append(PastSelf(updates, self.ratings[name], tensors))
            self._retire(name)
            self._opponents[name] = self._choose(name)

    def _retire(self, policy: str) -> None:
        """Drop the oldest past selves, but not those that are playing."""
        size = self._config.pool_size
        older, newest = self.pools[policy][:-size], self.pools[policy][-size:]
        playing = {int(number) for slots in self._slots if slots for number in slots[policy]}
        self.pools[policy] = [past for past in older if past.number in playing] + newest
        for players in self._players:
            for key in [key for key in players if key[0] == policy and key[1] not in playing]:
                del players[key]

    def _player(self, engine: int, policy: str, number: int) -> Player:
        key = (policy, number)
        if key not in self._players[engine]:
            past = copy.deepcopy(self._policies[policy])
            past.load_state_dict(self._past_self(policy, number).tensors)
            num_slots = len(self._teams.worlds[policy])
            self._players[engine][key] = Player(past, num_slots, self._generators[policy])
        return self._players[engine][key]

    def _past_self(self, policy: str, number: int) -> PastSelf:
        return next(past for past in self.pools[policy] if past.number == number)

    # --- drawing --------------------------------------------------------------------------------

    def _draw(self, engine: int, worlds: NDArray[np.int64]) -> None:
        """Draw who plays in some worlds."""
        lineup, teams = self._lineups[engine], self._teams.policies
        learning = [team for team, name in enumerate(teams) if name in self.learning]
        lineup[worlds] = LIVE
        is_drawn = self._random.random(len(worlds)) < self._config.share
        for world in worlds[is_drawn] if learning else ():
            learner = learning[self._random.integers(len(learning))]
            for team, name in enumerate(teams):
                if team != learner and self._opponents[name]:
                    lineup[world, team] = self._random.choice(self._opponents[name])
        self._slots[engine] = {name: self._teams.slots(name, lineup) for name in self.ratings}

    def _choose(self, name: str) -> list[int]:
        """Choose opponents from a pool, by the weights that the settings ask for."""
        pool = self.pools[name]
        weights = np.asarray(self._weights(name))
        count = min(self._config.max_opponents, len(pool))
        chosen = self._random.choice(len(pool), count, replace=False, p=weights / weights.sum())
        return [pool[int(index)].number for index in sorted(chosen)]

    def _weights(self, name: str) -> list[float]:
        pool = self.pools[name]
        if self._config.sampling == "recent":
            return [2.0 ** (-4.0 * age / len(pool)) for age in range(len(pool) - 1, -1, -1)]
        if self._config.sampling == "rating":
            others = [rating for other, rating in self.ratings.items() if other != name]
            rating = float(np.mean(others or [self.ratings[name]]))
            chances = [expected_score(rating, past.rating) for past in pool]
            return [max(chance * (1.0 - chance), 1e-3) for chance in chances]
        return [1.0] * len(pool)

    # --- rating ---------------------------------------------------------------------------------

    def _rate(self, lineup: NDArray[np.int64], returns: NDArray[np.float64]) -> None:
        """Move the ratings of every two teams of a game (Elo 1978)."""
        teams = self._teams.policies
        for first in range(len(teams)):
            for second in range(first + 1, len(teams)):
                one, two = (teams[first], int(lineup[first])), (teams[second], int(lineup[second]))
                if one == two:
                    continue  # against itself
                expected = expected_score(self._rating(*one), self._rating(*two))
                change = score(returns.tolist(), first, second) - expected
                self._move(*one, self._config.elo_factor * change)
                self._move(*two, -self._config.elo_factor * change)

    def _rating(self, policy: str, number: int) -> float:
        if number == LIVE:
            return self.ratings[policy]
        return self._past_self(policy, number).rating

    def _move(self, policy: str, number: int, change: float) -> None:
        if number == LIVE:
            self.ratings[policy] += change
        else:
            self._past_self(policy, number).rating += change

    # --- saving ---------------------------------------------------------------------------------

    def state(self) -> tuple[dict[str, Tensor], dict[str, Any]]:
        """Return tensors by ``<policy>/<number>/<name>``, and the rest as JSON values."""
        tensors = {
            f"{policy}/{past.number}/{name}": tensor.detach().cpu().clone()
            for policy, pool in self.pools.items()
            for past in pool
            for name, tensor in past.tensors.items()
        }
        for policy, generator in self._generators.items():
            tensors[f"{policy}/generator"] = generator.get_state()
        values: dict[str, Any] = {
            "ratings": self.ratings,
            "past": {
                policy: [[past.number, past.rating] for past in pool]
                for policy, pool in self.pools.items()
            },
            "opponents": self._opponents,
            "random": cast(Any, self._random.bit_generator).state,
        }
        return tensors, copy.deepcopy(values)

    def load_state(self, tensors: Mapping[str, Tensor], values: Mapping[str, Any]) -> None:
        """Go on from :meth:`state`; call :meth:`begin` next."""
        self.pools = past_selves(tensors, values)
        self.ratings = {name: float(rating) for name, rating in values["ratings"].items()}
        self._opponents = {name: list(of) for name, of in values["opponents"].items()}
        cast(Any, self._random.bit_generator).state = values["random"]
        for policy, generator in self._generators.items():
            generator.set_state(tensors[f"{policy}/generator"])


def past_selves(
    tensors: Mapping[str, Tensor], values: Mapping[str, Any]
) -> dict[str, list[PastSelf]]:
    """Return the past selves of each policy in what :meth:`League.state` returned."""
    return {
        policy: [
            PastSelf(number, rating, with_prefix(tensors, f"{policy}/{number}/"))
            for number, rating in pool
        ]
        for policy, pool in values["past"].items()
    }


def act_for(
    slots: NDArray[np.int64], players: Mapping[int, Player], batch: Batch, actions: ActionBatch
) -> ActionBatch:
    """Return ``actions`` with those of ``players`` in the slots that have their number.

    Args:
        slots: ``int64[n]``, number of the player of each slot.
        players: By number; slots with other numbers keep their action.
        batch: Of all ``n`` slots.
        actions: Of all ``n`` slots; stays as it is.
    """
    if not players:
        return actions
    result = ActionBatch(actions.discrete.copy(), actions.continuous.copy())
    for number, player in players.items():
        rows = (slots == number).nonzero()[0]
        own = player.act(batch, rows)
        result.discrete[rows] = own.discrete
        result.continuous[rows] = own.continuous
    return result
