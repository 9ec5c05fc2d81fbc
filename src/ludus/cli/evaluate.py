"""``ludus evaluate``: play episodes and report the returns."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ludus.cli.action_flags import ActionFlags
from ludus.cli.game_flags import GameFlags

if TYPE_CHECKING:
    from ludus.settings.train_config import TrainConfig

__all__ = ["COMMAND", "EvaluateCommand", "run"]


@dataclass(frozen=True, kw_only=True)
class EvaluateCommand(ActionFlags, GameFlags):
    """Play complete episodes with the agents of a run, or at random, and report their returns.

    Attributes:
        run: Run folder, whose newest checkpoint is used, or one of its checkpoints; with --random,
            a game works as well.
        episodes: Episodes of each policy.
        random: Take random actions.
        stochastic: Sample actions as in training; with names, only these policies do.
        goal_return: Also report the share of episodes whose return reaches this.
        seed: Seed of worlds and samples.
        num_engines: Game processes side by side.
        json: Print one JSON object on stdout.
    """

    run: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="RUN")]
    episodes: int = 20
    random: bool = False
    stochastic: tuple[str, ...] | None = field(  # pyright: ignore[reportIncompatibleVariableOverride]
        default=None, kw_only=True
    )
    goal_return: float | None = None
    seed: int = 0
    num_engines: int = 1
    json: bool = False


COMMAND = EvaluateCommand


def run(command: EvaluateCommand) -> int:
    """Evaluate and print; return 0."""
    import torch
    from rich.console import Console

    from ludus.cli.live import evaluation_table
    from ludus.errors import ConfigError
    from ludus.play.evaluation import evaluate
    from ludus.play.players import load_player, random_player
    from ludus.training.loop import open_training_pool

    if command.episodes < 1:
        raise ConfigError(f"episodes must be at least 1, not {command.episodes}")
    stochastic = command.choose()
    config = _config(command)
    torch.set_num_threads(config.torch_threads)
    pool = open_training_pool(config)
    try:
        if command.random:
            act = random_player(pool, command.seed)
        else:
            act = load_player([Path(command.run)], pool, command.seed, stochastic)
        results = evaluate(act, pool, command.episodes, seed=command.seed)
    finally:
        pool.close()
    if command.json:
        values = {name: asdict(result) for name, result in results.items()}
        if command.goal_return is not None:
            for name, result in results.items():
                values[name]["share_reaching"] = result.share_reaching(command.goal_return)
        sys.stdout.write(json.dumps({"run": command.run, "policies": values}) + "\n")
    else:
        Console().print(evaluation_table(results, command.run, command.goal_return))
    return 0


def _config(command: EvaluateCommand) -> TrainConfig:
    """Return what to play in: what the run was trained in, or a game to play at random."""
    from ludus.runs.saved import trained_config
    from ludus.settings.train_config import TrainConfig
    from ludus.target import find_run

    if command.random and find_run(Path(command.run)) is None:
        return replace(TrainConfig(command.run), **command.given())
    return trained_config(Path(command.run), **command.given())
