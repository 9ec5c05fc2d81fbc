"""A tournament: every player of one side against every player of another, and who won.

A side is a policy; where there is only one policy, each agent of a world is a side. All worlds of
all engines play at once, and each begins the next game of the programme when its last one ends. The
programme is fixed beforehand, so that short games do not count more often than long ones.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from ludus.algorithms.learners import policy_seed
from ludus.errors import RunError
from ludus.league.league import act_for
from ludus.league.matches import MatchTracker, Sides, score
from ludus.league.players import Entrant, Entrants
from ludus.networks.load_tensors import load_tensors
from ludus.networks.policy import Player, Policy
from ludus.pool.interface import Pool
from ludus.spec.batch import ActionBatch, Batches

__all__ = ["MatchTable", "OnGames", "TournamentConfig", "play_tournament"]

MAX_STEPS = 100_000
"""Steps without the end of any game after which a tournament gives up."""

OnGames = Callable[[int, int], None]
"""Is told how many games are played, and how many there are."""


@dataclass(frozen=True)
class TournamentConfig:
    """How a tournament is played.

    Attributes:
        episodes: Games of every two players.
        is_stochastic: Draw actions, as in training; otherwise take the most probable ones.
        seed: Of worlds and actions.
    """

    episodes: int = 20
    is_stochastic: bool = True
    seed: int = 0


@dataclass(frozen=True)
class MatchTable:
    """Who beat whom: players of one policy in the rows, of another or the same in the columns.

    Attributes:
        rows: Players, oldest first.
        columns: The same for the other side.
        wins: ``int64[rows, columns]``, games that the row's player won; of the higher return.
        draws: The same for games that nobody won.
        losses: The same for games that the column's player won.
    """

    rows: tuple[Entrant, ...]
    columns: tuple[Entrant, ...]
    wins: NDArray[np.int64]
    draws: NDArray[np.int64]
    losses: NDArray[np.int64]

    @property
    def shares(self) -> NDArray[np.float64]:
        """``float64[rows, columns]``, share of wins, draws as halves; NaN without a game."""
        games = self.wins + self.draws + self.losses
        points = self.wins + 0.5 * self.draws
        return np.divide(points, games, out=np.full(games.shape, np.nan), where=games > 0)


@dataclass(frozen=True)
class _Game:
    """One game: player of each side by index, and which two sides it decides between."""

    lineup: tuple[int, ...]
    first: int
    second: int


def play_tournament(
    entrants: Entrants,
    pool: Pool,
    config: TournamentConfig = TournamentConfig(),
    on_games: OnGames | None = None,
) -> list[MatchTable]:
    """Let every two players of different sides play; one table for every two policies.

    Where a game has more than two sides, the others are played by their newest policy.

    Args:
        entrants: Players of each policy of the pool.
        pool: Reset before; in the middle of episodes afterwards.
        config: How many games, and how they are played.
        on_games: Is told after each step in which games ended.

    Raises:
        ConfigError: The game has only one side, or no episodes of whole worlds.
        CheckpointError: A network does not fit its settings.
        RunError: Games do not end.
    """
    sides = sides_of(pool)
    games = list(_programme(sides, entrants, config.episodes))
    hall = _Hall(sides, entrants, pool, config)
    results = hall.play(games, on_games or (lambda _, __: None))
    return _tables(sides, entrants, results)


def sides_of(pool: Pool) -> Sides:
    """Return the sides of all worlds of all engines."""
    one = Sides.of(pool.policies)
    worlds: dict[str, NDArray[np.int64]] = {}
    side: dict[str, NDArray[np.int64]] = {}
    for name in pool.policies:
        worlds[name] = np.zeros(pool.num_agents(name), np.int64)
        side[name] = np.zeros(pool.num_agents(name), np.int64)
        for engine in range(pool.num_engines):
            rows = pool.rows(name, engine)
            worlds[name][rows] = one.worlds[name] + engine * one.num_worlds
            side[name][rows] = one.side[name]
    return Sides(one.policies, worlds, side, one.num_worlds * pool.num_engines)


# --- who plays whom -----------------------------------------------------------------------------


def _programme(sides: Sides, entrants: Entrants, episodes: int) -> Iterable[_Game]:
    """Return all games; those of one player stand together, so that few networks run at once."""
    names = sides.policies
    newest = [len(entrants[name]) - 1 for name in names]
    if len(set(names)) == 1:
        yield from _mirror_programme(newest, episodes)
        return
    for first, second in itertools.combinations(range(len(names)), 2):
        for row in range(newest[first] + 1):
            for column in range(newest[second] + 1):
                lineup = _lineup(newest, (first, row), (second, column))
                yield from itertools.repeat(_Game(lineup, first, second), episodes)


def _mirror_programme(newest: Sequence[int], episodes: int) -> Iterable[_Game]:
    """Return the games of one policy against itself, where players change sides."""
    places = list(itertools.permutations(range(len(newest)), 2))
    for row, column in itertools.combinations(range(newest[0] + 1), 2):
        for first, second in itertools.islice(itertools.cycle(places), episodes):
            yield _Game(_lineup(newest, (first, row), (second, column)), first, second)


def _lineup(newest: Sequence[int], *changed: tuple[int, int]) -> tuple[int, ...]:
    lineup = list(newest)
    for side, player in changed:
        lineup[side] = player
    return tuple(lineup)


# --- playing ------------------------------------------------------------------------------------


class _Hall:
    """The worlds of a pool, each with a game of its own."""

    def __init__(
        self, sides: Sides, entrants: Entrants, pool: Pool, config: TournamentConfig
    ) -> None:
        self._sides = sides
        self._pool = pool
        self._seed = config.seed
        self._tracker = MatchTracker(sides)
        self._players = {
            name: [_player(entrant, pool, config) for entrant in entrants[name]]
            for name in pool.policies
        }
        self._newest = [len(entrants[name]) - 1 for name in sides.policies]
        self._lineups = np.tile(np.asarray(self._newest, np.int64), (sides.num_worlds, 1))
        self._games: list[_Game | None] = [None] * sides.num_worlds

    def play(self, games: Sequence[_Game], on_games: OnGames) -> list[tuple[_Game, float]]:
        """Return the points of the first side of every game: 1, 0.5 or 0."""
        waiting = deque(games)
        results: list[tuple[_Game, float]] = []
        batches = self._pool.reset(self._seed)
        self._tracker.begin(batches)
        self._deal(np.arange(self._sides.num_worlds), waiting)
        steps_left = MAX_STEPS
        while len(results) < len(games):
            num_restarts = self._pool.num_restarts
            batches = self._pool.step(self._act(batches))
            ended = self._tracker.record(batches)
            steps_left -= 1
            if len(ended.worlds):
                if self._pool.num_restarts == num_restarts:
                    results += self._results(ended.worlds, ended.returns)
                else:  # games of an engine that died were cut short; play them again
                    waiting.extend(game for game in self._played(ended.worlds) if game is not None)
                self._deal(ended.worlds, waiting)
                on_games(len(results), len(games))
                steps_left = MAX_STEPS
            elif steps_left == 0:
                raise RunError(f"no game ended within {MAX_STEPS} steps", "set max_episode_steps")
        return results

    def _act(self, batches: Batches) -> dict[str, ActionBatch]:
        actions: dict[str, ActionBatch] = {}
        for name, players in self._players.items():
            slots = self._sides.slots(name, self._lineups)
            present = {int(index): players[int(index)] for index in np.unique(slots)}
            none = ActionBatch.zeros(self._pool.policies[name], len(slots))
            actions[name] = act_for(slots, present, batches[name], none)
        return actions

    def _deal(self, worlds: NDArray[np.int64], waiting: deque[_Game]) -> None:
        """Let the next games begin in some worlds; when none is left, games that do not count."""
        for world in worlds:
            game = waiting.popleft() if waiting else None
            self._games[world] = game
            self._lineups[world] = self._newest if game is None else game.lineup
        for name, players in self._players.items():
            rows = np.isin(self._sides.worlds[name], worlds).nonzero()[0]
            for player in players:
                player.forget(rows)  # one that paused may remember another game

    def _results(
        self, worlds: NDArray[np.int64], returns: NDArray[np.float64]
    ) -> list[tuple[_Game, float]]:
        return [
            (game, score(of_sides.tolist(), game.first, game.second))
            for game, of_sides in zip(self._played(worlds), returns, strict=True)
            if game is not None
        ]

    def _played(self, worlds: NDArray[np.int64]) -> list[_Game | None]:
        return [self._games[int(world)] for world in worlds]


def _player(entrant: Entrant, pool: Pool, config: TournamentConfig) -> Player:
    policy = Policy(pool.policies[entrant.policy], entrant.settings)
    load_tensors(policy, entrant.tensors, "")
    generator = None
    if config.is_stochastic:
        stream = f"{entrant.policy} {entrant.updates} {entrant.is_newest}"
        generator = torch.Generator().manual_seed(policy_seed(config.seed, stream))
    return Player(policy.eval(), pool.num_agents(entrant.policy), generator)


# --- counting -----------------------------------------------------------------------------------


def _tables(
    sides: Sides, entrants: Entrants, results: Iterable[tuple[_Game, float]]
) -> list[MatchTable]:
    names = sides.policies
    tables: dict[tuple[str, str], MatchTable] = {}
    for game, points in results:
        key = (names[game.first], names[game.second])
        if key not in tables:
            tables[key] = _empty_table(*(entrants[name] for name in key))
        row, column = game.lineup[game.first], game.lineup[game.second]
        _count(tables[key], row, column, points)
        if key[0] == key[1]:
            _count(tables[key], column, row, 1.0 - points)
    return [tables[key] for key in sorted(tables, key=lambda key: [names.index(n) for n in key])]


def _count(table: MatchTable, row: int, column: int, points: float) -> None:
    counts = {1.0: table.wins, 0.5: table.draws, 0.0: table.losses}[points]
    counts[row, column] += 1


def _empty_table(rows: tuple[Entrant, ...], columns: tuple[Entrant, ...]) -> MatchTable:
    def zeros() -> NDArray[np.int64]:
        return np.zeros((len(rows), len(columns)), np.int64)

    return MatchTable(rows, columns, zeros(), zeros(), zeros())
