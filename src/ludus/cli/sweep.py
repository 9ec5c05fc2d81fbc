"""``ludus sweep``: look for better settings by many runs."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from ludus.cli.train import TrainCommand, parse_settings

if TYPE_CHECKING:
    from rich.table import Table

    from ludus.tuning.sweeping import Sweep, Trial

__all__ = ["COMMAND", "SweepCommand", "parse", "run"]

PROGRAM = "ludus sweep"


@dataclass(frozen=True)
class SweepCommand(TrainCommand):
    """Train many times with settings proposed by Optuna, and show which are best.

    All flags of ludus train hold for every trial. The first trial uses the settings as they are.
    A trial ends early if it is worse than half of the others at the same share of its steps. A
    sweep writes best.toml for ludus train --config, and a picture; --resume continues one that was
    stopped or killed.

    Attributes:
        set: A setting to vary: --set ppo.learning_rate=log:1e-5:1e-2, --set ppo.epochs=1:8 or
            --set ppo.activation=tanh,relu; may be given several times. Without it, learning rate,
            discount and a few more of the algorithm's settings vary.
        trials: Total number of trials.
        seeds: Runs of each trial, with different seeds; their median is its score. With one run per
            trial, the best is often only lucky.
        objective: "return" looks for the highest mean return at the end, "steps" for the fewest
            agent steps until target_return; if not given, steps with a target_return, else return.
        resume: Folder of a sweep to continue.
        json: Print the sweep as one JSON object on stdout.
    """

    varied: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]],
        tyro.conf.arg(name="set", metavar="NAME=VALUES"),
    ] = ()
    trials: int = 30
    seeds: int = 1
    objective: Literal["return", "steps"] | None = None
    explain: tyro.conf.Suppress[bool] = False


COMMAND = SweepCommand


def parse(arguments: Sequence[str]) -> SweepCommand:
    """Return what was typed, and all layers of settings below it."""
    from ludus.runs.run_folder import stack_layers

    command, typed = parse_settings(arguments, SweepCommand, PROGRAM)
    return replace(command, layers=stack_layers(typed, config=command.config))


def run(command: SweepCommand) -> int:
    """Run the trials and show them; return 0, or 128 plus the signal that stopped it."""
    from rich.console import Console

    from ludus.tuning.sweeping import SweepConfig, run_sweep

    space = dict(_split(text) for text in command.varied)
    config = None
    if command.resume is None:
        config = SweepConfig(space, command.layers, command.objective, command.seeds)
    sweep = run_sweep(config, command.trials, resume=command.resume, on_trial=_tell)
    if command.json:
        trials = [{**vars(trial), "path": str(trial.path)} for trial in sweep.trials]
        values = {"sweep": str(sweep.path), "objective": sweep.objective, "trials": trials}
        sys.stdout.write(json.dumps(values) + "\n")
    else:
        Console().print(_table(sweep))
        sys.stdout.write(f"sweep: {sweep.path}\n")
    if sweep.signum is None:
        return 0
    again = f"{PROGRAM} --resume {shlex.quote(str(sweep.path))} --trials {command.trials}"
    sys.stderr.write(f"stopped; go on with: {again}\n")
    return 128 + sweep.signum


def _split(text: str) -> tuple[str, str]:
    from ludus.errors import ConfigError
    from ludus.tuning.space import FORMS

    name, equals, values = text.partition("=")
    if not equals or not name:
        raise ConfigError(f"--set {text} cannot be read", f"write {FORMS}")
    return name.replace("-", "_"), values


def _tell(trial: Trial) -> None:
    values = ", ".join(f"{name} {_figure(value)}" for name, value in trial.values.items())
    score = "failed" if trial.score is None else _figure(trial.score)
    sys.stderr.write(f"trial {trial.number}: {score} ({trial.state}), {values}\n")
    sys.stderr.flush()


def _table(sweep: Sweep) -> Table:
    """Return a table of all trials, the best first."""
    from rich.table import Table

    heading = {"return": "mean return", "steps": "agent steps"}[sweep.objective]
    best = sweep.best
    names = list(dict.fromkeys(name for trial in sweep.trials for name in trial.values))
    title = f"{len(sweep.trials)} trials; trial 0 has the settings as they are"
    table = Table(title=title, title_justify="left")
    for column in ("trial", heading):
        table.add_column(column, justify="right", no_wrap=True)
    for name in names:
        table.add_column(name, overflow="fold")
    down = sweep.objective == "return"
    ranked = sorted(sweep.trials, key=lambda trial: _rank(trial, down=down))
    for trial in ranked:
        cells = [_figure(trial.values.get(name, "as is")) for name in names]
        score = _figure(trial.score)
        if trial.state != "complete" or trial.reached is False:
            score = "not reached" if trial.state == "complete" else trial.state
        style = "bold" if best is not None and trial.number == best.number else None
        table.add_row(str(trial.number), score, *cells, style=style)
    return table


def _rank(trial: Trial, *, down: bool) -> tuple[bool, float]:
    score = trial.score
    return score is None, 0.0 if score is None else -score if down else score


def _figure(value: Any) -> str:
    is_large = isinstance(value, float) and value >= 1e4  # agent steps
    return (
        f"{value:,.0f}" if is_large else f"{value:.3g}" if isinstance(value, float) else str(value)
    )
