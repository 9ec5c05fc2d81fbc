"""Open the machines that a run asks for."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from ludus.errors import ConfigError
from ludus.extras import require_package
from ludus.settings.train_config import LOCAL, TrainConfig
from ludus.target import Address, Play, parse_target
from ludus.workers.interface import Machine
from ludus.workers.process import ProcessMachine
from ludus.workers.remote import RemotePool

__all__ = ["open_machines"]


def open_machines(config: TrainConfig, log_dir: Path | None = None) -> RemotePool:
    """Start a worker with its engines on each machine that ``config.cluster`` names.

    Args:
        config: Settings of the run.
        log_dir: Where engines on this machine leave their output.

    Raises:
        ConfigError: A setting does not go with a cluster.
        TargetError: There is no such target, or it cannot be trained.
        EngineError: An engine did not start.
        MachineLost: A worker died at its start.
        MissingExtra: Ray is not installed, and ``config.cluster`` names a cluster of it.
    """
    _check(config)
    machines: list[Machine] = []
    try:
        started, start_again = _start(config, log_dir)
        machines += started
        specs = [machine.receive() for machine in machines]
        return RemotePool(machines, specs, start_again, config)
    except BaseException:
        _close(machines)
        raise


def _start(
    config: TrainConfig, log_dir: Path | None
) -> tuple[Sequence[Machine], Callable[[int], Machine]]:
    """Start all workers at once; the first answer of each is the spec of its games.

    Returns:
        The machines, and what starts the worker of one of them again.
    """
    found = re.fullmatch(LOCAL, config.cluster or "")
    if found is None:
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        require_package("ray")
        from ludus.workers.ray_machines import open_ray_machines

        return open_ray_machines(config, log_dir)

    def start(index: int) -> Machine:
        return ProcessMachine(config, index, log_dir)

    return [start(index) for index in range(int(found[1]))], start


def _check(config: TrainConfig) -> None:
    if config.league.share:
        raise ConfigError(
            "self-play against past selves needs all engines on one machine",
            "leave out --cluster, or set league.share to 0",
        )

    target = parse_target(config.target, scene=config.scene, godot=config.godot)
    if isinstance(target, Address | Play):
        raise ConfigError(
            f"{config.target} is one game that is running already, and a cluster starts its own",
            "leave out --cluster, or name the game itself: its project, or what was exported",
        )


def _close(machines: Sequence[Machine]) -> None:
    with contextlib.ExitStack() as stack:
        for machine in machines:
            stack.callback(machine.close)
