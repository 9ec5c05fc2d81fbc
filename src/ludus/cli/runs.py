"""``ludus runs``: list training runs and how they went."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from ludus.training.figures import CURVE_WIDTH, clock, sparkline

if TYPE_CHECKING:
    from rich.text import Text

    from ludus.runs.run_list import PolicySummary, RunState, RunSummary

__all__ = ["COMMAND", "RunsCommand", "run"]

HINT = "start one: ludus train cartpole"
MAX_GAME_METRICS = 6
"""Metrics of the game in the listing, where it has up to 64."""
STYLES: dict[RunState, str] = {
    "running": "bold cyan",
    "finished": "green",
    "stopped": "yellow",
    "interrupted": "yellow",
    "diverged": "red",
    "failed": "red",
    "crashed": "red",
}


@dataclass(frozen=True)
class RunsCommand:
    """List the runs in a folder, newest first, with the last figures of their policies and games.

    Attributes:
        folder: Folder that holds the run folders, or a single run folder.
        json: Print one JSON object on stdout.
    """

    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="[FOLDER]")] = Path("runs")
    json: bool = False


COMMAND = RunsCommand


def run(command: RunsCommand) -> int:
    """List the runs; return 0, also if there are none."""
    from rich.console import Console

    from ludus.errors import UsageError
    from ludus.runs.run_list import list_runs

    try:
        found = list_runs(command.folder)
    except FileNotFoundError:
        found = []
    except OSError as error:
        raise UsageError(f"cannot list {command.folder}: {error.strerror}", HINT) from None
    if command.json:
        sys.stdout.write(json.dumps({"runs": [to_plain(run) for run in found]}) + "\n")
    elif not found:
        sys.stdout.write(f"there are no runs in {command.folder} yet\nhint: {HINT}\n")
    else:
        console = Console()
        for line in listing(found):
            console.print(line, highlight=False, soft_wrap=True)
    return 0


def to_plain(run: RunSummary) -> dict[str, Any]:
    """Return a run as JSON values."""
    return {**asdict(run), "path": str(run.path), "name": run.path.resolve().name}


def listing(runs: Sequence[RunSummary]) -> list[Text]:
    """Return a line for each run, one for each of its policies, and one for the game's metrics."""
    from rich.text import Text

    name_width = max(len(run.path.resolve().name) for run in runs)
    target_width = max(len(run.target) for run in runs)
    policy_width = max((len(name) for run in runs for name in run.policies), default=0)
    lines: list[Text] = []
    for run in runs:
        line = Text(f"{run.path.resolve().name:<{name_width}}  ", style="bold")
        line.append(f"{run.state:<11}  ", style=STYLES[run.state])
        line.append(f"{run.target:<{target_width}}  {_amount(run)}", style="not bold")
        lines.append(line)
        for name, policy in run.policies.items():
            lines.append(Text(f"  {name:<{policy_width}}  ").append_text(_figures(policy)))
        if run.game:
            lines.append(Text(f"  game: {_game_metrics(run.game)}"))
    return lines


def _game_metrics(means: Mapping[str, float]) -> str:
    shown = [f"{name} {mean:.4g}" for name, mean in means.items()][:MAX_GAME_METRICS]
    num_more = len(means) - len(shown)
    return ", ".join(shown) + (f" and {num_more} more" if num_more else "")


def _amount(run: RunSummary) -> str:
    started = time.strftime("%Y-%m-%d %H:%M", time.localtime(run.started_at))
    return f"{started}  {run.agent_steps:,} steps in {clock(run.wall_s)}"


def _figures(policy: PolicySummary) -> Text:
    from rich.text import Text

    if policy.mean_return is None:
        return Text("no episode has ended yet", style="dim")
    text = Text(f"{sparkline(policy.curve):<{CURVE_WIDTH}}", style="cyan")
    text.append(f"  mean return {policy.mean_return:<8.4g}", style="default")
    if policy.elo is not None:
        text.append(f"  elo {policy.elo:.0f}", style="default")
    if policy.evaluation is not None:
        text.append(f"  evaluation {policy.evaluation:.4g}", style="default")
    text.rstrip()
    return text
