"""``ludus record``: a film of a game, played by trained agents or as it is."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from ludus.cli.action_flags import ActionFlags
from ludus.cli.bridge_flags import BridgeFlags
from ludus.record import RecordConfig, record
from ludus.settings.checks import ABOVE_0, AT_LEAST_1, optional, setting

__all__ = ["COMMAND", "RecordCommand", "run"]


@dataclass(frozen=True, kw_only=True)
class RecordCommand(BridgeFlags, ActionFlags, RecordConfig):
    """Play a game in its own window and write a film of it, or a Minari dataset of its steps.

    Every frame of the game is filmed once, however slowly it is drawn. On a machine without a
    screen, Ludus uses Xvfb. With a run folder, the agents trained there play.

    A game of a legacy bridge takes the settings of the bridge as flags, too, such as
    --action-space "Discrete(2)"; the page "Targets" of the docs lists them.

    Attributes:
        policy: Run folder or checkpoint of trained agents; or policy files (.ludus.json), each with
            its own --policy; if not given, the game plays as it does for a player.
    """

    target: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="TARGET")]
    policy: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    is_random: Annotated[bool, tyro.conf.arg(name="random")] = False
    is_stochastic: tyro.conf.Suppress[bool] = False
    num_episodes: Annotated[int | None, tyro.conf.arg(name="episodes")] = setting(
        None, optional(AT_LEAST_1)
    )
    frames_per_second: Annotated[float | None, tyro.conf.arg(name="fps")] = setting(
        None, optional(ABOVE_0)
    )
    has_overlay: Annotated[bool, tyro.conf.arg(name="overlay")] = False
    scene: str | None = None


COMMAND = RecordCommand


def run(command: RecordCommand) -> int:
    """Film or write a dataset, say what was written, and return 0."""
    config = replace(command, is_stochastic=bool(command.choose()))
    if config.dataset is not None:
        return _record_dataset(config)
    recorded = record(config)
    words = [
        f"{recorded.num_frames} frames",
        f"{recorded.seconds:.2f} s",
        f"{float(recorded.frames_per_second):g} frames/s",
        *(f"{name}: {count} episodes" for name, count in recorded.num_episodes.items()),
    ]
    sys.stdout.write(f"{recorded.path}: {', '.join(words)}\n")
    return 0


def _record_dataset(config: RecordConfig) -> int:
    from ludus.errors import ConfigError
    from ludus.record.dataset import record_dataset

    if config.out is not None:
        raise ConfigError("--out and --dataset exclude each other", "one is a film, one a dataset")
    for one in record_dataset(config):
        counts = f"{one.num_episodes} episodes, {one.num_steps} steps"
        sys.stdout.write(f"{one.name}: {counts} of policy {one.policy}\n")
    return 0
