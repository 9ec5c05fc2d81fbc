"""``ludus league``: who beats whom among the agents of a run and their past selves."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from ludus.cli.action_flags import ActionFlags
from ludus.cli.game_flags import GameFlags
from ludus.errors import ConfigError

if TYPE_CHECKING:
    from rich.table import Table

    from ludus.league.players import LeaguePlayer, LeaguePlayers
    from ludus.league.tournament import MatchTable, TournamentConfig
    from ludus.runs.checkpoint import Checkpoint

__all__ = ["COMMAND", "LeagueCommand", "run"]

CLEAR_WIN = 0.6
"""Shares of points from here on are green, those of the opponent's as high are red."""


@dataclass(frozen=True, kw_only=True)
class LeagueCommand(ActionFlags, GameFlags):
    """Let the agents of a run and their past selves play each other, and print who beats whom.

    Past selves come from self-play; without it, older checkpoints of the run play instead. A cell
    is the share of games that the row's player won, with draws counted as half. Players are named
    by the number of updates that the run had made; "now" is the newest.

    Attributes:
        run: Run folder, whose newest checkpoint is used, or one of its checkpoints.
        episodes: Games between any two players.
        max_players: Most players of each policy; of more, evenly spaced ones are chosen.
        recorded: Play nothing; print the ratings from training.
        seed: Seed of worlds and actions.
        stochastic: Draw each action from the policy's probabilities, as in training and as agents
            do here without either flag.
        deterministic: Always take the most probable action instead.
        json: Print one JSON object on stdout.
    """

    run: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN")]
    episodes: int = 20
    max_players: int = 8
    recorded: bool = False
    seed: int = 0
    json: bool = False


COMMAND = LeagueCommand


def run(command: LeagueCommand) -> int:
    """Play and print; return 0.

    Raises:
        ConfigError: The game has no two teams, or a setting is out of range.
        CheckpointError: There is no such run, or it cannot be loaded.
        TargetError: The game is gone.
    """
    from ludus.league.players import load_players, subsample
    from ludus.league.tournament import TournamentConfig

    settings = TournamentConfig(
        episodes=command.episodes,
        is_stochastic=bool(command.choose(default=True)),
        seed=command.seed,
    )
    if command.episodes < 1:
        raise ConfigError(f"episodes must be at least 1, not {command.episodes}")
    if command.max_players < 2:
        raise ConfigError(f"max_players must be at least 2, not {command.max_players}")
    path, checkpoint, league_players = load_players(command.run)
    if command.recorded:
        _show_recorded(command, league_players)
        return 0
    few = {
        name: subsample(players, command.max_players) for name, players in league_players.items()
    }
    tables = _play(command, settings, path, checkpoint, few)
    if command.json:
        values = {"run": str(command.run), "tables": [table_to_plain(table) for table in tables]}
        sys.stdout.write(json.dumps(values) + "\n")
    else:
        _print({match_title(table, command.episodes): match_table(table) for table in tables})
        if not tables:
            sys.stdout.write("there are no past selves yet for the newest policy to play against\n")
    return 0


def _play(
    command: LeagueCommand,
    settings: TournamentConfig,
    path: Path,
    checkpoint: Checkpoint,
    league_players: LeaguePlayers,
) -> list[MatchTable]:
    import torch
    from rich.console import Console

    from ludus.league.tournament import play_tournament
    from ludus.runs.checkpoint import check_spec
    from ludus.runs.saved import trained_config
    from ludus.training.loop import open_training_pool

    config = trained_config(command.run, **command.given())
    torch.set_num_threads(config.torch_threads)
    with Console(stderr=True).status("opening the game") as status:
        pool = open_training_pool(config)
        try:
            check_spec(checkpoint, pool.policies, path)
            return play_tournament(
                league_players,
                pool,
                settings,
                lambda played, games: status.update(f"{played} of {games} games"),
            )
        finally:
            pool.close()


def _show_recorded(command: LeagueCommand, league_players: LeaguePlayers) -> None:
    if all(player.rating is None for players in league_players.values() for player in players):
        raise ConfigError(
            f"{command.run} was trained without self-play and has no ratings",
            "leave out --recorded to play now, or train with --league.share 0.5",
        )
    if command.json:
        policies = {name: [_to_plain(one) for one in of] for name, of in league_players.items()}
        sys.stdout.write(json.dumps({"run": str(command.run), "policies": policies}) + "\n")
    else:
        _print({"ratings from training": rating_table(league_players)})


def _print(tables: Mapping[str, Table]) -> None:
    """Print tables, each below its title, which may be wider than the table."""
    from rich.console import Console

    console = Console()
    for title, table in tables.items():
        console.print(title, style="italic", markup=False, highlight=False, soft_wrap=True)
        console.print(table)


def match_title(table: MatchTable, episodes: int) -> str:
    """Return what a table of games shows."""
    first, second = table.rows[0].policy, table.columns[0].policy
    return f"{first} (rows) against {second} (columns): percent won of {episodes} games"


def match_table(table: MatchTable) -> Table:
    """Return who beats whom, in percent, with ratings where training noted some."""
    from rich import box
    from rich.table import Table

    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    shown.add_column("updates", justify="right")
    for column in table.columns:
        shown.add_column(label(column), justify="right")
    shown.add_column("all", justify="right", style="bold")
    has_ratings = any(player.rating is not None for player in (*table.rows, *table.columns))
    if has_ratings:
        shown.add_column("elo", justify="right")
    for row, shares in zip(table.rows, table.shares.tolist(), strict=True):
        cells = [percent(share) for share in [*shares, mean(shares)]]
        shown.add_row(label(row), *cells, *[_rating(row)] * has_ratings, style=_style(row))
    shown.add_section()
    columns = [mean(column) for column in table.shares.T.tolist()]
    shown.add_row("all", *map(percent, columns), style="bold")
    if has_ratings:
        shown.add_row("elo", *map(_rating, table.columns))
    return shown


def rating_table(league_players: LeaguePlayers) -> Table:
    """Return the ratings that training noted, one row for each player."""
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    shown = Table(box=box.SIMPLE_HEAD)
    for heading in ("policy", "updates", "elo"):
        shown.add_column(heading, justify="left" if heading == "policy" else "right")
    for name, players in league_players.items():
        for player in players:
            shown.add_row(escape(name), label(player), _rating(player), style=_style(player))
        shown.add_section()
    return shown


def table_to_plain(table: MatchTable) -> dict[str, Any]:
    """Return a table as JSON values."""
    return {
        "rows": [_to_plain(player) for player in table.rows],
        "columns": [_to_plain(player) for player in table.columns],
        "wins": table.wins.tolist(),
        "draws": table.draws.tolist(),
        "losses": table.losses.tolist(),
    }


def label(player: LeaguePlayer) -> str:
    """Return the name of a player: the updates it had seen, or that it is the newest."""
    return "now" if player.is_newest else str(player.updates)


def percent(share: float) -> str:
    """Return a share of points in percent, coloured if it is clearly more or less than half."""
    if math.isnan(share):
        return "–"
    style = "green" if share >= CLEAR_WIN else "red" if share <= 1.0 - CLEAR_WIN else "default"
    return f"[{style}]{100 * share:.0f}[/]"


def mean(shares: Sequence[float]) -> float:
    """Return the mean of the shares that there are; NaN if there is none."""
    known = [share for share in shares if not math.isnan(share)]
    return sum(known) / len(known) if known else math.nan


def _rating(player: LeaguePlayer) -> str:
    return "" if player.rating is None else f"{player.rating:.0f}"


def _style(player: LeaguePlayer) -> str:
    return "bold" if player.is_newest else ""


def _to_plain(player: LeaguePlayer) -> Mapping[str, Any]:
    return {
        "policy": player.policy,
        "updates": player.updates,
        "is_newest": player.is_newest,
        "elo": player.rating,
    }
