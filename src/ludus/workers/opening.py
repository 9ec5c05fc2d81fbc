"""Open the machines that a run asks for."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from ludus.errors import ConfigError
from ludus.extras import require_package
from ludus.settings.train_config import LOCAL, TrainConfig
from ludus.target import Play, parse_target, split_addresses
from ludus.workers.interface import Machine
from ludus.workers.process import ProcessMachine
from ludus.workers.remote_pool import RemotePool

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
    config = _checked(config)
    with contextlib.ExitStack() as stack:
        machines, start_again = _start(config, log_dir, stack)
        specs = [machine.receive() for machine in machines]
        pool = RemotePool(machines, specs, start_again, config)
        stack.pop_all()  # the pool closes them from now on
    return pool


def _start(
    config: TrainConfig, log_dir: Path | None, stack: contextlib.ExitStack
) -> tuple[Sequence[Machine], Callable[[int], Machine | None]]:
    """Start all workers at once; the first answer of each is the spec of its games.

    Args:
        config: Settings of the run.
        log_dir: Where engines on this machine leave their output.
        stack: Closes the machines.

    Returns:
        The machines, and what starts the worker of one of them again, or returns None.
    """
    found = re.fullmatch(LOCAL, config.cluster or "")
    if found is None:
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        require_package("ray")
        from ludus.workers.ray_machines import open_ray_machines

        machines, start_again = open_ray_machines(config, log_dir)
        for machine in machines:
            stack.callback(machine.close)
        return machines, start_again

    def start(index: int) -> Machine:
        return ProcessMachine(config, index, log_dir)

    indices = range(int(found[1]))
    return [stack.enter_context(contextlib.closing(start(index))) for index in indices], start


def _checked(config: TrainConfig) -> TrainConfig:
    """Return the settings, with the number of machines where the target says it."""
    games = split_addresses(config.target)
    if games:
        found = re.fullmatch(LOCAL, config.cluster or "")
        num_machines = int(found[1]) if found else config.num_machines or len(games)
        if num_machines != len(games):
            raise ConfigError(
                f"{config.target} names {len(games)} running games, and there are {num_machines} "
                "workers: each plays one",
                "name as many as there are workers, HOST:PORT,HOST:PORT, or a game that workers "
                "start themselves",
            )
        return config if found else replace(config, num_machines=num_machines)
    target = parse_target(config.target, scene=config.scene, godot=config.godot)
    if isinstance(target, Play):
        raise ConfigError(
            f"{config.target} waits for one game, and a cluster has many",
            "leave out --cluster, or name the game itself: its project, or what was exported",
        )
    return config
