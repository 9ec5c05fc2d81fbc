"""``ludus evaluate``: play episodes and report the returns."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from ludus.cli.action_flags import ActionFlags

if TYPE_CHECKING:
    from ludus.settings.train_config import TrainConfig

__all__ = ["COMMAND", "EvaluateCommand", "run"]


@dataclass(frozen=True)
class EvaluateCommand(ActionFlags):
    """Play complete episodes with the agents of a run, or at random, and report their returns.

    Attributes:
        run: Run folder, whose newest checkpoint is taken, or one of its checkpoints; with --random
            a game will do, too.
        episodes: Episodes of each policy.
        random: Take random actions.
        stochastic: Draw actions as in training; with names, only those policies do.
        goal_return: Tell the share of episodes whose return reaches this.
        seed: Seed of worlds and samples.
        target: Play in this target; none is the one the run was trained in.
        num_worlds: Worlds in each engine; none is as many as in training.
        num_engines: Game processes side by side.
        json: Print one JSON object on stdout.
    """

    run: tyro.conf.Positional[str]
    episodes: int = 20
    random: bool = False
    stochastic: tuple[str, ...] | None = field(  # pyright: ignore[reportIncompatibleVariableOverride]
        default=None, kw_only=True
    )
    goal_return: float | None = None
    seed: int = 0
    target: str | None = None
    num_worlds: int | None = None
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
        return TrainConfig(
            target=command.target or command.run,
            num_worlds=command.num_worlds or TrainConfig().num_worlds,
            num_engines=command.num_engines,
        )
    return trained_config(
        Path(command.run),
        target=command.target,
        num_worlds=command.num_worlds,
        num_engines=command.num_engines,
    )
