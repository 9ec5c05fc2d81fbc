"""Workers on the machines of a Ray cluster: one actor for each, and one call for each rollout."""

from __future__ import annotations

import logging
import os
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ray as ray_package
from ray import exceptions as ray_errors
from ray.util.placement_group import placement_group, remove_placement_group
from ray.util.scheduling_strategies import PlacementGroupSchedulingStrategy

from ludus.errors import ConfigError, LudusError, MachineLost, RunError
from ludus.settings.train_config import TrainConfig
from ludus.version import __version__
from ludus.workers.worker import Worker

__all__ = ["RayMachine", "open_ray_machines"]

START_S, SILENCE_S = 120.0, 30.0
"""Seconds until a worker process runs, and without any sign of life until a worker is lost."""

LOOK_S = 5.0
"""Seconds between two looks whether a worker that is busy lives."""

ray: Any = ray_package
"""Its own types say little."""

log = logging.getLogger(__name__)


class _Actor:
    """What Ray runs on a machine: a worker, and what it logs."""

    def __init__(self) -> None:
        self._worker: Worker | None = None
        self._log = _Log()
        logging.getLogger("ludus").addHandler(self._log)

    @ray.method(concurrency_group="play")
    def call(self, method: str, arguments: tuple[Any, ...]) -> tuple[str, Any, list[Any]]:
        """Return ``("result", value, logged)`` or ``("error", error, logged)``."""
        try:
            kind, value = "result", self._do(method, arguments)
        except LudusError as error:
            kind, value = "error", error
        except Exception as error:
            log.exception("a defect in a worker")
            said = f"{type(error).__name__}: {error}"
            kind = "error"
            value = RunError(f"a worker failed: {said}", "train.log has the traceback")
        logged, self._log.records = self._log.records, []
        return kind, value, logged

    def _do(self, method: str, arguments: tuple[Any, ...]) -> Any:
        if method == "begin":
            self._worker = Worker(*arguments)
            return self._worker.spec
        if self._worker is None:
            return None  # it is closed before its games could start
        return getattr(self._worker, method)(*arguments)

    @ray.method(concurrency_group="play")
    def about(self) -> dict[str, Any]:
        """Return what must be equal on all machines, and where this one is."""
        versions = {"ludus": __version__, "python": platform.python_version()}
        return {"host": platform.node(), "pid": os.getpid(), "versions": versions}

    @ray.method(concurrency_group="life")
    def live(self) -> None:
        """Give a sign of life, beside a call that goes on."""


class _Log(logging.Handler):
    """Keeps what is logged until it is told with the next answer."""

    def __init__(self) -> None:
        super().__init__()
        self.records: list[tuple[str, int, str]] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.records.append((record.name, record.levelno, self.format(record)))


class RayMachine:
    """An actor; a :class:`~ludus.workers.interface.Machine`.

    Args:
        actor: The handle.
        index: Number of the machine, from 0.
        group: Places that are given back when it is closed; None keeps them.
    """

    def __init__(self, actor: Any, index: int, group: Any = None) -> None:
        self.name = f"machine {index}"
        self._actor = actor
        self._group = group
        self._answer: Any = None
        self._is_closed = False

    def greet(self) -> dict[str, str]:
        """Wait until the actor runs; return the versions it runs with."""
        about = self._get(self._actor.about.remote(), START_S)
        self.name += f" ({about['host']}, process {about['pid']})"
        return about["versions"]

    def send(self, method: str, *arguments: Any) -> None:
        """Call a method of the worker and return at once."""
        self._answer = self._actor.call.remote(method, arguments)

    def receive(self) -> Any:
        """Return what the method that was called last returned, or raise what it raised."""
        while not ray.wait([self._answer], timeout=LOOK_S)[0]:
            self._get(self._actor.live.remote(), SILENCE_S)
        kind, value, logged = self._get(self._answer, SILENCE_S)
        for name, level, text in logged:
            logging.getLogger(name).log(level, "%s: %s", self.name, text)
        if kind == "error":
            raise value
        return value

    def _get(self, answer: Any, timeout_s: float) -> Any:
        try:
            return ray.get(answer, timeout=timeout_s)
        except ray_errors.GetTimeoutError:
            self.kill()
            said = f"has given no sign of life for {timeout_s:.0f} s"
        except ray_errors.RayError as error:
            said = f"is lost: {str(error).strip().splitlines()[0]}"
        raise MachineLost(f"{self.name} {said}", "--resume goes on from the last checkpoint")

    def kill(self) -> None:
        """End the worker's process without a word; its games end by themselves."""
        self._is_closed = True
        ray.kill(self._actor)

    def close(self) -> None:
        """End the worker and its games; may be called twice."""
        if not self._is_closed:
            try:
                self.send("close")
                self.receive()
            except LudusError as error:
                log.warning("%s did not end cleanly: %s", self.name, error.message)
            self.kill()
        if self._group is not None:
            remove_placement_group(self._group)
            self._group = None


def open_ray_machines(
    config: TrainConfig, log_dir: Path | None
) -> tuple[list[RayMachine], Callable[[int], RayMachine]]:
    """Start a worker on each of the machines that ``config`` asks for.

    Returns:
        The machines, whose first answer is the spec of their games, and what starts one again.

    Raises:
        ConfigError: The cluster cannot be reached, has fewer machines, or other versions.
        MachineLost: A worker did not start.
    """
    _join(config)
    nodes = [node for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU")]
    num_machines = config.num_machines or len(nodes)
    if num_machines > len(nodes):
        raise ConfigError(
            f"num_machines is {num_machines}, and the cluster has {len(nodes)} machines",
            "ray status lists them; ray start --address=HEAD:6379 adds one",
        )
    group, make = _place(num_machines, config.num_engines, nodes)

    def open_machine(index: int) -> RayMachine:
        # The last one that is closed gives the places back to other runs.
        return RayMachine(make(index), index, group if index == num_machines - 1 else None)

    machines = [open_machine(index) for index in range(num_machines)]

    def start(machine: RayMachine, index: int) -> RayMachine:
        versions = machine.greet()
        if versions["ludus"] != __version__:
            raise ConfigError(
                f"{machine.name} has Ludus {versions['ludus']}, and this one {__version__}",
                "install the same version on all machines",
            )
        machine.send("begin", config, index, log_dir)
        return machine

    try:
        for index, machine in enumerate(machines):
            start(machine, index)
    except BaseException:
        for machine in machines:
            machine.kill()
        remove_placement_group(group)
        raise
    return machines, lambda index: start(open_machine(index), index)


def _join(config: TrainConfig) -> None:
    if ray.is_initialized():
        return
    try:
        ray.init(address=config.cluster, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise ConfigError(
            f"there is no Ray cluster at {config.cluster}: {str(error).splitlines()[0]}",
            "ray start --head starts one on this machine; --cluster local:2 needs none",
        ) from None


def _place(
    num_machines: int, num_engines: int, nodes: list[Any]
) -> tuple[Any, Callable[[int], Any]]:
    """Return places on ``num_machines`` machines, and what starts an actor on one of them."""
    cpus = sorted((node["Resources"]["CPU"] for node in nodes), reverse=True)
    each = min(num_engines + 1, cpus[num_machines - 1])
    group: Any = placement_group([{"CPU": each}] * num_machines, strategy="STRICT_SPREAD")
    if not group.wait(timeout_seconds=START_S):
        remove_placement_group(group)
        raise ConfigError(
            f"the cluster has no {num_machines} machines with {each:g} free CPUs each",
            "another run may have them: ray status; a smaller --num-engines needs less",
        )
    make = ray.remote(num_cpus=each, max_restarts=0, max_task_retries=0,
                      concurrency_groups={"play": 1, "life": 1})(_Actor)  # fmt: skip

    def start(index: int) -> Any:
        place = PlacementGroupSchedulingStrategy(group, index)
        return make.options(scheduling_strategy=place).remote()

    return group, start
