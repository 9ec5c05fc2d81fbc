"""Self-play: past selves of every policy, their ratings, and which of them are opponents."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from torch import Tensor

from ludus.league.matches import Teams, expected_score, score
from ludus.league.seats import LIVE, Match
from ludus.networks.policy import Policy
from ludus.networks.tensors import with_prefix
from ludus.settings.train_config import LeagueConfig
from ludus.spec import PolicySpec

__all__ = ["League", "PastSelf", "past_selves"]

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
    """Past selves of all policies; a :class:`~ludus.league.seats.Book`.

    :class:`~ludus.league.seats.Seats` let them play. Call :meth:`rate` for the games that end, and
    :meth:`advance` between two steps, after every update.

    Attributes:
        ratings: Elo rating of each policy as it is now.
        pools: Past selves of each policy, oldest first.
        opponents: Numbers of the past selves of each policy that are drawn at present.
        learning: Policies that learn.

    Raises:
        ConfigError: The game has no two teams.
    """

    def __init__(
        self,
        config: LeagueConfig,
        specs: Mapping[str, PolicySpec],
        policies: Mapping[str, Policy],
        seed: int,
    ) -> None:
        self.ratings = dict.fromkeys(policies, FIRST_RATING)
        self.pools: dict[str, list[PastSelf]] = {name: [] for name in policies}
        self._config = config
        self._policies = policies
        self._teams = Teams.of(specs)
        self._random = np.random.default_rng(seed)
        self.opponents: Mapping[str, Sequence[int]] = {name: [] for name in policies}
        self.learning: frozenset[str] = frozenset(policies)

    def tensors(self, policy: str, number: int) -> Mapping[str, Tensor]:
        """Return the state of a past self."""
        return self._past_self(policy, number).tensors

    def advance(self, updates: int, playing: Mapping[str, Set[int]]) -> None:
        """Save past selves and choose opponents, if it is time to after ``updates``.

        Args:
            updates: Of the run.
            playing: Numbers of past selves that play, by policy, which are kept.
        """
        if updates % self._config.snapshot_every_updates:
            return
        for name, policy in self._policies.items():
            pool = self.pools[name]
            if not pool or pool[-1].number != updates:
                tensors = {key: value.clone() for key, value in policy.state_dict().items()}
                pool.append(PastSelf(updates, self.ratings[name], tensors))
            size = self._config.pool_size
            older, newest = pool[:-size], pool[-size:]
            self.pools[name] = [past for past in older if past.number in playing[name]] + newest
        self.opponents = {name: self._choose(name) for name in self._policies}

    def _past_self(self, policy: str, number: int) -> PastSelf:
        return next(past for past in self.pools[policy] if past.number == number)

    # --- choosing -------------------------------------------------------------------------------

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

    def rate(self, matches: Iterable[Match]) -> None:
        """Move the ratings of those who played, game after game."""
        for match in matches:
            self._rate(match.lineup, match.returns)

    def _rate(self, lineup: Sequence[int], returns: Sequence[float]) -> None:
        """Move the ratings of every two teams of a game (Elo 1978)."""
        teams = self._teams.policies
        for first in range(len(teams)):
            for second in range(first + 1, len(teams)):
                one, two = (teams[first], lineup[first]), (teams[second], lineup[second])
                if one == two:
                    continue  # against itself
                expected = expected_score(self._rating(*one), self._rating(*two))
                change = score(returns, first, second) - expected
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
        values: dict[str, Any] = {
            "ratings": self.ratings,
            "past": {
                policy: [[past.number, past.rating] for past in pool]
                for policy, pool in self.pools.items()
            },
            "opponents": self.opponents,
            "random": cast(Any, self._random.bit_generator).state,
        }
        return tensors, copy.deepcopy(values)

    def load_state(self, tensors: Mapping[str, Tensor], values: Mapping[str, Any]) -> None:
        """Go on from :meth:`state`; reset the worlds next."""
        self.pools = past_selves(tensors, values)
        self.ratings = {name: float(rating) for name, rating in values["ratings"].items()}
        self.opponents = {name: list(of) for name, of in values["opponents"].items()}
        cast(Any, self._random.bit_generator).state = values["random"]


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
