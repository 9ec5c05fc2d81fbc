"""Self-play, as the engines of one process see it: which past self plays in which world.

Who may be drawn is the league's business, which may be on another machine. Each engine draws from
streams of its own, so that equal seeds give equal games however engines are spread over machines.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ludus.algorithms.learners import policy_seed
from ludus.algorithms.recorder import stream_seed
from ludus.league.matches import MatchTracker, Teams
from ludus.networks.policy import Player, Policy
from ludus.spec import PolicySpec
from ludus.spec.batch import ActionBatch, Batch, Batches

__all__ = ["LIVE", "Book", "Match", "Seats", "act_for", "league_seed"]

LIVE = -1
"""Number of the policy as it is now; past selves have the number of their updates."""


class Book(Protocol):
    """What seats need of a league.

    Attributes:
        learning: Policies that learn.
        opponents: Numbers of the past selves of each policy that may be drawn.
    """

    learning: frozenset[str]
    opponents: Mapping[str, Sequence[int]]

    def tensors(self, policy: str, number: int) -> Mapping[str, Tensor]:
        """Return the state of a past self that plays or may be drawn."""
        ...


class Match(NamedTuple):
    """A game that has ended.

    Attributes:
        lineup: Number of the player of each team.
        returns: Of each team.
    """

    lineup: list[int]
    returns: list[float]


class Seats:
    """Who plays in the worlds of some engines.

    Per engine the order is :meth:`begin` after a reset, then :meth:`replace_actions` and
    :meth:`record` in turn. Call :meth:`advance` between two steps, after every update.

    Args:
        book: The league.
        policies: As they are now.
        specs: Of the policies, in wire order.
        share: Share of the worlds that past selves play in.
        num_engines: Of this process.
        seed: Of the league.
        first_engine: Number of the first engine among those of all machines.

    Raises:
        ConfigError: The game has no two teams.
    """

    def __init__(
        self,
        book: Book,
        policies: Mapping[str, Policy],
        specs: Mapping[str, PolicySpec],
        *,
        share: float,
        num_engines: int,
        seed: int,
        first_engine: int = 0,
    ) -> None:
        self._book = book
        self._share = share
        self._policies = policies
        self._seed = seed
        self._engines = range(first_engine, first_engine + num_engines)
        self._teams = Teams.of(specs)
        self._trackers = [MatchTracker(self._teams) for _ in self._engines]
        shape = (self._teams.num_worlds, len(self._teams.policies))
        self._lineups = [np.full(shape, LIVE) for _ in self._engines]
        self._slots: list[dict[str, NDArray[np.int64]]] = [{} for _ in self._engines]
        self._players: list[dict[tuple[str, int], Player]] = [{} for _ in self._engines]
        self._noise = [
            {name: torch.Generator(policy.device) for name, policy in policies.items()}
            for _ in self._engines
        ]
        self.advance(0)

    def playing(self, policy: str) -> set[int]:
        """Return the numbers of the past selves of ``policy`` that play somewhere."""
        return {int(number) for slots in self._slots if slots for number in slots[policy]} - {LIVE}

    def advance(self, updates: int) -> None:
        """Draw from streams that nothing but ``updates`` decides; forget who plays no more."""
        self._random: list[np.random.Generator] = []
        for own, engine in enumerate(self._engines):
            self._random.append(np.random.default_rng((self._seed, updates, engine)))
            for index, generator in enumerate(self._noise[own].values()):
                generator.manual_seed(stream_seed(self._seed + index, updates, engine))
        for name in self._policies:
            kept = self.playing(name) | set(self._book.opponents.get(name, ()))
            for players in self._players:
                for key in [key for key in players if key[0] == name and key[1] not in kept]:
                    del players[key]

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

    def record(self, engine: int, batches: Batches) -> list[Match]:
        """Take the outcome of a step, draw who plays next where games ended, and return those."""
        finished = self._trackers[engine].record(batches)
        if not len(finished.worlds):
            return []
        lineup = self._lineups[engine]
        matches = [
            Match(lineup[world].tolist(), returns.tolist())
            for world, returns in zip(finished.worlds, finished.returns, strict=True)
        ]
        # A player that paused may remember another game, if its agent died before the world ended.
        for (name, _), player in self._players[engine].items():
            player.forget(np.isin(self._teams.worlds[name], finished.worlds).nonzero()[0])
        self._draw(engine, finished.worlds)
        return matches

    def _player(self, engine: int, policy: str, number: int) -> Player:
        key = (policy, number)
        if key not in self._players[engine]:
            past = copy.deepcopy(self._policies[policy])
            past.load_state_dict(self._book.tensors(policy, number))
            num_slots = len(self._teams.worlds[policy])
            self._players[engine][key] = Player(past, num_slots, self._noise[engine][policy])
        return self._players[engine][key]

    def _draw(self, engine: int, worlds: NDArray[np.int64]) -> None:
        """Draw who plays in some worlds."""
        lineup, teams, random = self._lineups[engine], self._teams.policies, self._random[engine]
        learning = [team for team, name in enumerate(teams) if name in self._book.learning]
        lineup[worlds] = LIVE
        is_drawn = random.random(len(worlds)) < self._share
        for world in worlds[is_drawn] if learning else ():
            learner = learning[random.integers(len(learning))]
            for team, name in enumerate(teams):
                if team != learner and self._book.opponents[name]:
                    lineup[world, team] = random.choice(self._book.opponents[name])
        self._slots[engine] = {name: self._teams.slots(name, lineup) for name in self._policies}


def league_seed(seed: int | None) -> int:
    """Return the seed of the league of a run."""
    return policy_seed(seed or 0, "league")


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
