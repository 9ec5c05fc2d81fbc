"""``ludus evaluate``: play episodes and report the returns."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from ludus.cli.action_flags import ActionFlags
from ludus.cli.game_flags import GameFlags

__all__ = ["COMMAND", "EvaluateCommand", "run"]


@dataclass(frozen=True, kw_only=True)
class EvaluateCommand(ActionFlags, GameFlags):
    """Play complete episodes with trained agents, or at random, and report their returns.

    A game of a legacy bridge takes the settings of the bridge as flags, too, such as
    --action-space "Discrete(2)"; the page "Targets" of the docs lists them.

    Attributes:
        run: Run folder, whose newest checkpoint is used, or one of its checkpoints; with --policy
            or --random, a game works as well.
        policy: Run folder or checkpoint of trained agents; or policy files (.ludus.json), each with
            its own --policy; if not given, the agents of the run.
        episodes: Episodes of each policy.
        random: Take random actions.
        stochastic: Draw each action from the policy's probabilities, as in training, instead of
            always taking the most probable one. With names, only these policies draw.
        goal_return: Also report the share of episodes whose return reaches this.
        seed: Seed of worlds and samples.
        num_engines: Game processes side by side.
        json: Print one JSON object on stdout.
    """

    run: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="RUN")]
    policy: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    episodes: int = 20
    random: bool = False
    stochastic: Annotated[  # pyright: ignore[reportIncompatibleVariableOverride]
        tuple[str, ...] | None,
        tyro.conf.arg(metavar="[NAME ...]", help_behavior_hint="(default: no policy)"),
    ] = field(default=None, kw_only=True)
    goal_return: float | None = None
    seed: int = 0
    num_engines: int = 1
    json: bool = False


COMMAND = EvaluateCommand


def run(command: EvaluateCommand) -> int:
    """Evaluate and print; return 0."""
    from rich.console import Console

    from ludus.api.evaluating import RANDOM, evaluate
    from ludus.errors import ConfigError
    from ludus.training.live import evaluation_table

    if command.random and command.policy:
        raise ConfigError("--policy and --random exclude each other")
    results = evaluate(
        command.run,
        RANDOM if command.random else command.policy or None,
        episodes=command.episodes,
        seed=command.seed,
        stochastic=command.choose(),
        **command.given(),
    )
    if command.json:
        values = {name: asdict(result) for name, result in results.items()}
        if command.goal_return is not None:
            for name, result in results.items():
                values[name]["share_reaching"] = result.share_reaching(command.goal_return)
        sys.stdout.write(json.dumps({"run": command.run, "policies": values}) + "\n")
    else:
        played_by = ["random actions"] if command.random else map(str, command.policy)
        title = ", ".join((command.run, *played_by))
        Console().print(evaluation_table(results, title, command.goal_return))
    return 0
