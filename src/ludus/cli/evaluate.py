"""``ludus evaluate``: play episodes with trained agents and report the returns."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import tyro

__all__ = ["COMMAND", "EvaluateCommand", "run"]


@dataclass(frozen=True)
class EvaluateCommand:
    """Play complete episodes with the agents of a run and report their returns.

    Attributes:
        run: Run folder, whose newest checkpoint is taken, or one of its checkpoints.
        episodes: Episodes of each policy.
        stochastic: Policies that draw their actions, as in training; without names, all of
            them. The others take their most probable ones.
        goal_return: Tell the share of episodes whose return reaches this.
        seed: Seed of worlds and samples.
        target: Play in this target; none is the one the run was trained in.
        num_worlds: Worlds in each engine; none is as many as in training.
        num_engines: Game processes side by side.
        json: Print one JSON object on stdout.
    """

    run: tyro.conf.Positional[Path]
    episodes: int = 20
    stochastic: tuple[str, ...] | None = None
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
    from ludus.runs.run_folder import RunFolder
    from ludus.runs.saved import load_policies
    from ludus.training.source import open_source

    if command.episodes < 1:
        raise ConfigError(f"episodes must be at least 1, not {command.episodes}")
    config = RunFolder.find(command.run).read_config()
    config = replace(
        config,
        target=command.target or config.target,
        num_worlds=command.num_worlds or config.num_worlds,
        num_engines=command.num_engines,
    )
    torch.set_num_threads(config.torch_threads)
    pool = open_source(config)
    try:
        policies = load_policies(command.run, pool.policies)
        sampled = _sampled(command.stochastic, list(policies))
        results = evaluate(policies, pool, command.episodes, sampled=sampled, seed=command.seed)
    finally:
        pool.close()
    if command.json:
        values = {name: asdict(result) for name, result in results.items()}
        if command.goal_return is not None:
            for name, result in results.items():
                values[name]["share_reaching"] = result.share_reaching(command.goal_return)
        sys.stdout.write(json.dumps({"run": str(command.run), "policies": values}) + "\n")
    else:
        table = evaluation_table(results, str(command.run), command.goal_return)
        Console().print(table)
    return 0


def _sampled(names: tuple[str, ...] | None, policies: list[str]) -> list[str]:
    """Return the policies that draw their actions, from what the command line says."""
    from ludus.errors import ConfigError

    if names is None:
        return []
    for name in names:
        if name not in policies:
            raise ConfigError(
                f"--stochastic: there is no policy {name!r}",
                f"the policies are {', '.join(policies)}",
            )
    return list(names) or policies
