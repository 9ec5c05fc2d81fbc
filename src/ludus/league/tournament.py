"""A tournament: every player of one team against every player of another, and who won.

A team is a policy; where there is only one policy, each agent of a world is a team. All worlds of
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
from ludus.league.matches import MatchTracker, Teams, score
from ludus.league.players import LeaguePlayer, LeaguePlayers
from ludus.league.seats import act_for
from ludus.networks.policy import Player, Policy
from ludus.networks.tensors import load_tensors
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
        columns: The same for the other team.
        wins: ``int64[rows, columns]``, games that the row's player won; of the higher return.
        draws: The same for games that nobody won.
        losses: The same for games that the column's player won.
    """

    rows: tuple[LeaguePlayer, ...]
    columns: tuple[LeaguePlayer, ...]
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
    """One game: player of each team by index, and which two teams it decides between."""

    lineup: tuple[int, ...]
    first: int
    second: int


def play_tournament(
    league_players: LeaguePlayers,
    pool: Pool,
    config: TournamentConfig = TournamentConfig(),
    on_games: OnGames | None = None,
) -> list[MatchTable]:
    """Let every two players of different teams play; one table for every two policies.

    Where a game has more than two teams, the others are played by their newest policy.

    Args:
        league_players: Players of each policy of the pool.
        pool: Reset before; in the middle of episodes afterwards.
        config: How many games, and how they are played.
        on_games: Is told after each step in which games ended.

    Raises:
        ConfigError: The game has only one team, or no episodes of whole worlds.
        CheckpointError: A network does not fit its settings.
        RunError: Games do not end.
    """
    teams = teams_of(pool)
    games = list(_schedule(teams, league_players, config.episodes))
    tournament = _Tournament(teams, league_players, pool, config)
    results = tournament.play(games, on_games or (lambda _, __: None))
    return _tables(teams, league_players, results)


def teams_of(pool: Pool) -> Teams:
    """Return the teams of all worlds of all engines."""
    one = Teams.of(pool.policies)
    worlds: dict[str, NDArray[np.int64]] = {}
    team: dict[str, NDArray[np.int64]] = {}
    for name in pool.policies:
        worlds[name] = np.zeros(pool.num_agents(name), np.int64)
        team[name] = np.zeros(pool.num_agents(name), np.int64)
        for engine in range(pool.num_engines):
            rows = pool.rows(name, engine)
            worlds[name][rows] = one.worlds[name] + engine * one.num_worlds
            team[name][rows] = one.team[name]
    return Teams(one.policies, worlds, team, one.num_worlds * pool.num_engines)


# --- who plays whom -----------------------------------------------------------------------------


def _schedule(teams: Teams, league_players: LeaguePlayers, episodes: int) -> Iterable[_Game]:
    """Return all games; those of one player in a row, so that few networks run at once."""
    names = teams.policies
    newest = [len(league_players[name]) - 1 for name in names]
    if len(set(names)) == 1:
        yield from _mirror_schedule(newest, episodes)
        return
    for first, second in itertools.combinations(range(len(names)), 2):
        for row in range(newest[first] + 1):
            for column in range(newest[second] + 1):
                lineup = _lineup(newest, (first, row), (second, column))
                yield from itertools.repeat(_Game(lineup, first, second), episodes)


def _mirror_schedule(newest: Sequence[int], episodes: int) -> Iterable[_Game]:
    """Return the games of one policy against itself, where players change teams."""
    places = list(itertools.permutations(range(len(newest)), 2))
    for row, column in itertools.combinations(range(newest[0] + 1), 2):
        for first, second in itertools.islice(itertools.cycle(places), episodes):
            yield _Game(_lineup(newest, (first, row), (second, column)), first, second)


def _lineup(newest: Sequence[int], *changed: tuple[int, int]) -> tuple[int, ...]:
    lineup = list(newest)
    for team, player in changed:
        lineup[team] = player
    return tuple(lineup)


# --- playing ------------------------------------------------------------------------------------


class _Tournament:
    """The worlds of a pool, each with its own game."""

    def __init__(
        self, teams: Teams, league_players: LeaguePlayers, pool: Pool, config: TournamentConfig
    ) -> None:
        self._teams = teams
        self._pool = pool
        self._seed = config.seed
        self._tracker = MatchTracker(teams)
        self._players = {
            name: [_player(league_player, pool, config) for league_player in league_players[name]]
            for name in pool.policies
        }
        self._newest = [len(league_players[name]) - 1 for name in teams.policies]
        self._lineups = np.tile(np.asarray(self._newest, np.int64), (teams.num_worlds, 1))
        self._games: list[_Game | None] = [None] * teams.num_worlds

    def play(self, games: Sequence[_Game], on_games: OnGames) -> list[tuple[_Game, float]]:
        """Return the points of the first team of every game: 1, 0.5 or 0."""
        waiting = deque(games)
        results: list[tuple[_Game, float]] = []
        batches = self._pool.reset(self._seed)
        self._tracker.begin(batches)
        self._start_matches(np.arange(self._teams.num_worlds), waiting)
        steps_left = MAX_STEPS
        while len(results) < len(games):
            num_restarts = self._pool.num_restarts
            batches = self._pool.step(self._act(batches))
            finished = self._tracker.record(batches)
            steps_left -= 1
            if len(finished.worlds):
                if self._pool.num_restarts == num_restarts:
                    results += [
                        (game, score(returns.tolist(), game.first, game.second))
                        for game, returns in zip(
                            self._played(finished.worlds), finished.returns, strict=True
                        )
                        if game is not None
                    ]
                else:  # games of an engine that died were cut short; play them again
                    waiting.extend(
                        game for game in self._played(finished.worlds) if game is not None
                    )
                self._start_matches(finished.worlds, waiting)
                on_games(len(results), len(games))
                steps_left = MAX_STEPS
            elif steps_left == 0:
                raise RunError(f"no game ended within {MAX_STEPS} steps", "set max_episode_steps")
        return results

    def _act(self, batches: Batches) -> dict[str, ActionBatch]:
        actions: dict[str, ActionBatch] = {}
        for name, players in self._players.items():
            slots = self._teams.slots(name, self._lineups)
            present = {int(index): players[int(index)] for index in np.unique(slots)}
            none = ActionBatch.zeros(self._pool.policies[name], len(slots))
            actions[name] = act_for(slots, present, batches[name], none)
        return actions

    def _start_matches(self, worlds: NDArray[np.int64], waiting: deque[_Game]) -> None:
        """Let the next games begin in some worlds; when none is left, games that do not count."""
        for world in worlds:
            game = waiting.popleft() if waiting else None
            self._games[world] = game
            self._lineups[world] = self._newest if game is None else game.lineup
        for name, players in self._players.items():
            rows = np.isin(self._teams.worlds[name], worlds).nonzero()[0]
            for player in players:
                player.forget(rows)  # one that paused may remember another game

    def _played(self, worlds: NDArray[np.int64]) -> list[_Game | None]:
        return [self._games[int(world)] for world in worlds]


def _player(league_player: LeaguePlayer, pool: Pool, config: TournamentConfig) -> Player:
    policy = Policy(pool.policies[league_player.policy], league_player.settings)
    load_tensors(policy, league_player.tensors, "")
    generator = None
    if config.is_stochastic:
        stream = f"{league_player.policy} {league_player.updates} {league_player.is_newest}"
        generator = torch.Generator().manual_seed(policy_seed(config.seed, stream))
    return Player(policy.eval(), pool.num_agents(league_player.policy), generator)


# --- counting -----------------------------------------------------------------------------------


def _tables(
    teams: Teams, league_players: LeaguePlayers, results: Iterable[tuple[_Game, float]]
) -> list[MatchTable]:
    names = teams.policies
    tables: dict[tuple[str, str], MatchTable] = {}
    for game, points in results:
        key = (names[game.first], names[game.second])
        if key not in tables:
            rows, columns = (league_players[name] for name in key)
            counts = np.zeros((3, len(rows), len(columns)), np.int64)
            tables[key] = MatchTable(rows, columns, *counts)
        row, column = game.lineup[game.first], game.lineup[game.second]
        _count(tables[key], row, column, points)
        if key[0] == key[1]:
            _count(tables[key], column, row, 1.0 - points)
    return [tables[key] for key in sorted(tables, key=lambda key: [names.index(n) for n in key])]


def _count(table: MatchTable, row: int, column: int, points: float) -> None:
    counts = {1.0: table.wins, 0.5: table.draws, 0.0: table.losses}[points]
    counts[row, column] += 1
