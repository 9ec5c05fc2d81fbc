"""Matches between teams: which team each slot belongs to, and which matches have ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ludus.errors import ConfigError
from ludus.spec import PolicySpec
from ludus.spec.batch import Batches

__all__ = ["FinishedMatches", "MatchTracker", "Teams", "expected_score", "score"]

ELO_SCALE = 400.0
"""Difference of ratings at which the better team is expected to score ten times as much."""


@dataclass(frozen=True)
class Teams:
    """The teams of every world: its policies, or the agents of its only policy.

    Attributes:
        policies: Policy of each team.
        worlds: Per policy ``int64[slots]``, world of each slot of one engine.
        team: Per policy ``int64[slots]``, team of each slot.
        num_worlds: Worlds of one engine.
    """

    policies: tuple[str, ...]
    worlds: Mapping[str, NDArray[np.int64]]
    team: Mapping[str, NDArray[np.int64]]
    num_worlds: int

    @classmethod
    def of(cls, policies: Mapping[str, PolicySpec]) -> Teams:
        """Return the teams of a game.

        Raises:
            ConfigError: There is only one team, or agents of a world end their episodes each by
                itself.
        """
        if len(policies) == 1 and max(of.agents_per_world for of in policies.values()) < 2:
            raise ConfigError(
                f"self-play needs two teams, and {next(iter(policies))} is the only agent of a "
                "world",
                "add a second agent or a second policy; without one, train with league.share 0",
            )
        wrong = [name for name, spec in policies.items() if spec.episode != "world"]
        if wrong:
            raise ConfigError(
                f"self-play needs episodes that end for a whole world; those of policy {wrong[0]} "
                "do not",
                "set episode_mode of the LudusWorld to WORLD",
            )
        worlds = {
            name: np.asarray([agent.world for agent in spec.agents])
            for name, spec in policies.items()
        }
        num_worlds = max(int(of.max()) for of in worlds.values()) + 1
        if len(policies) > 1:
            team = {name: np.full(len(worlds[name]), i) for i, name in enumerate(policies)}
            return cls(tuple(policies), worlds, team, num_worlds)
        ((name, spec),) = policies.items()
        agents = np.arange(spec.num_agents) % spec.agents_per_world
        return cls((name,) * spec.agents_per_world, worlds, {name: agents}, num_worlds)

    def slots(self, policy: str, world_teams: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return what ``[worlds, teams]`` says of each slot of ``policy``."""
        return world_teams[self.worlds[policy], self.team[policy]]


@dataclass(frozen=True)
class FinishedMatches:
    """Games that ended in one step.

    Attributes:
        worlds: ``int64[m]``.
        returns: ``float64[m, teams]``, sums of the rewards of each team's agents.
    """

    worlds: NDArray[np.int64]
    returns: NDArray[np.float64]


class MatchTracker:
    """Follows the games in the worlds of one engine."""

    def __init__(self, teams: Teams) -> None:
        self._teams = teams
        self._shape = (teams.num_worlds, len(teams.policies))
        self._returns = np.zeros(self._shape)
        self._index = {
            name: worlds * len(teams.policies) + teams.team[name]
            for name, worlds in teams.worlds.items()
        }
        self._was_active = {name: np.zeros(len(of), np.bool_) for name, of in teams.worlds.items()}

    def begin(self, batches: Batches) -> None:
        """Take the first batches after a reset."""
        self._returns[...] = 0.0
        for name, was_active in self._was_active.items():
            was_active[...] = batches[name].active

    def record(self, batches: Batches) -> FinishedMatches:
        """Take the outcome of a step; return the games it ended.

        A game ends with the last of its agents; those that end before wait (PROTOCOL.md §4).
        """
        has_ended, goes_on = np.zeros((2, self._shape[0]), np.bool_)
        for name, was_active in self._was_active.items():
            batch = batches[name]
            counted = np.bincount(
                self._index[name], batch.reward * was_active, minlength=self._returns.size
            )
            self._returns += counted.reshape(self._shape)
            is_over = (batch.terminated | batch.truncated) & was_active
            has_ended[self._teams.worlds[name][is_over]] = True
            goes_on[self._teams.worlds[name][was_active & batch.active & ~is_over]] = True
            was_active[...] = batch.active
        worlds = (has_ended & ~goes_on).nonzero()[0]
        finished = FinishedMatches(worlds, self._returns[worlds])
        self._returns[worlds] = 0.0
        return finished


def score(returns: Sequence[float], first: int, second: int) -> float:
    """Return 1 if the first of two teams won, 0 if the second did, 0.5 for a draw.

    The team with the higher return wins.
    """
    difference = returns[first] - returns[second]
    if abs(difference) < 1e-6:
        return 0.5
    return float(difference > 0)


def expected_score(rating: float, other: float) -> float:
    """Return what a team is expected to score (Elo 1978): ``1 / (1 + 10^((b - a) / 400))``."""
    return 1.0 / (1.0 + 10.0 ** ((other - rating) / ELO_SCALE))
