"""Workers on the machines of a Ray cluster: one actor for each, and one call for each rollout."""

from __future__ import annotations

import contextlib
import logging
import os
import platform
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ray import exceptions as ray_errors
from ray import util as ray_util
from ray.util.scheduling_strategies import PlacementGroupSchedulingStrategy

from ludus.errors import ConfigError, MachineLost, RunError, SetupError
from ludus.settings.train_config import TrainConfig
from ludus.workers.nodes import LOOK_S, Node, RayCluster, kill_process, ray, require_equal
from ludus.workers.parcel import find_parcel
from ludus.workers.worker import Worker, outcome_of

__all__ = ["RayMachine", "open_ray_machines"]

groups: Any = ray_util
"""Its own types say little."""

START_S, SILENCE_S = 120.0, 30.0
"""Seconds until a worker process runs, and without any sign of life until a worker is lost."""

ARRIVE_S = 50.0
"""Seconds that an answer has to arrive; without a head, Ray ends this process after a minute."""

END_S, LEAVE_S = 15.0, 1.0
"""Seconds a worker has to end its games, and itself."""

MORE_ROOM = (
    "ray memory and df show what is full; fewer worlds need less, and ray start "
    "--object-store-memory or --object-spilling-directory (on another disk) make room"
)
RESUME = "ludus train --resume goes on from the last checkpoint"

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
        kind, value = outcome_of(partial(self._do, method, arguments))
        logged, self._log.records = self._log.records, []
        return kind, value, logged

    def _do(self, method: str, arguments: tuple[Any, ...]) -> Any:
        if method == "begin":
            folder, parcel, config, *rest = arguments
            with contextlib.suppress(OSError):  # it is there where machines share a home
                os.chdir(folder)
            if parcel is not None:
                config = replace(config, **parcel.settings())
            self._worker = Worker(config, *rest)
            return self._worker.spec
        if self._worker is None:
            return None  # it is closed before its games could start
        return getattr(self._worker, method)(*arguments)

    @ray.method(concurrency_group="play")
    def place(self) -> tuple[str, int]:
        """Return host and process."""
        return platform.node(), os.getpid()

    @ray.method(concurrency_group="life")
    def live(self) -> None:
        """Give a sign of life, beside a call that goes on."""

    @ray.method(concurrency_group="life")
    def leave(self) -> None:
        """End this process, whatever it does, even where no head could tell it to."""
        os._exit(0)


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
        places: Where it gets one.
        index: Number of the machine, from 0.
    """

    def __init__(self, places: _Places, index: int) -> None:
        self.name = f"machine {index}"
        self._places = places
        self._index = index
        self._actor = places.start(index)
        self._pid = 0
        self._answer: Any = None
        self._is_closed = False

    def greet(self) -> None:
        """Wait until the actor runs.

        Raises:
            MachineLost: It does not, or its node is gone.
        """
        answer, limit_s = self._actor.place.remote(), time.monotonic() + START_S
        while not ray.wait([answer], timeout=1.0)[0]:
            if time.monotonic() > limit_s or self._places.node(self._index) is None:
                self.kill()
                raise MachineLost(f"{self.name} did not start", "ray status lists the nodes")
        host, self._pid = self._get(answer, SILENCE_S)
        self.name += f" ({host}, process {self._pid})"

    def send(self, method: str, *arguments: Any) -> None:
        """Call a method of the worker and return at once."""
        self._places.cluster.require_head(is_due=False)
        try:
            self._answer = self._actor.call.remote(method, arguments)
        except ray_errors.RayError as error:
            raise self._as_error(error) from None

    def receive(self) -> Any:
        """Return what the method that was called last returned, or raise what it raised."""
        # Wait for it to be there, not here: only ray.get says why it cannot arrive.
        while not ray.wait([self._answer], timeout=LOOK_S, fetch_local=False)[0]:
            self._places.cluster.require_head()
            self._get(self._actor.live.remote(), SILENCE_S)
        kind, value, logged = self._fetch()
        for name, level, text in logged:
            logging.getLogger(name).log(level, "%s: %s", self.name, text)
        if kind == "error":
            value.message = f"{self.name}: {value.message}"
            raise value
        return value

    def _fetch(self) -> tuple[str, Any, list[Any]]:
        try:
            return ray.get(self._answer, timeout=ARRIVE_S)
        except ray_errors.GetTimeoutError:
            self._places.cluster.require_head()
            raise RunError(
                f"what {self.name} sends has not arrived after {ARRIVE_S:.0f} s",
                f"the line is slow, or this machine has no room for it: {MORE_ROOM}",
            ) from None
        except ray_errors.RayError as error:
            raise self._as_error(error) from None

    def _get(self, answer: Any, timeout_s: float) -> Any:
        try:
            return ray.get(answer, timeout=timeout_s)
        except ray_errors.GetTimeoutError:
            self._places.cluster.require_head()
            self.kill()
            raise MachineLost(
                f"{self.name} has given no sign of life for {timeout_s:.0f} s", RESUME
            ) from None
        except ray_errors.RayError as error:
            raise self._as_error(error) from None

    def _as_error(self, error: Exception) -> RunError:
        if isinstance(error, ray_errors.ObjectStoreFullError | ray_errors.OutOfDiskError):
            return RunError(
                f"the data from {self.name} does not fit: the object store of its node or of "
                "this one is full, and so is the disk behind it",
                MORE_ROOM,
            )
        self._places.cluster.require_head()
        # What went wrong in the actor has a traceback around it; why it did not start ends one.
        said = str(getattr(error, "cause", error)).strip().splitlines()
        why = said[-1 if "creation task" in said[0] else 0]
        return MachineLost(f"{self.name} is lost: {why}", RESUME)

    def kill(self) -> None:
        """End the worker's process without a word; its games end by themselves."""
        self._is_closed = True
        if not self._places.cluster.has_head():
            return
        ray.kill(self._actor)
        node = self._places.node(self._index)
        if self._pid and node is not None:  # a process that is stopped does not hear Ray
            self._places.cluster.ask(kill_process, [node], self._pid)

    def close(self) -> None:
        """End the worker and its games; may be called twice."""
        if not self._is_closed:
            self._is_closed = True
            ray.wait([self._actor.call.remote("close", ())], timeout=END_S)
            if self._places.cluster.has_head():
                ray.kill(self._actor)
            else:
                ray.wait([self._actor.leave.remote()], timeout=LEAVE_S)
        self._places.leave(self._index)


class _Places:
    """The places of a run's workers, one on each of its machines.

    Args:
        cluster: Where.
        num_machines: How many; None: one on every node.
        num_engines: Of each.

    Raises:
        ConfigError: There are not as many machines, or they are taken.
        RunError: The head is gone.
    """

    def __init__(self, cluster: RayCluster, num_machines: int | None, num_engines: int) -> None:
        self.cluster = cluster
        nodes = cluster.nodes()
        self.num_machines = num_machines or len(nodes)
        if self.num_machines > len(nodes) or not nodes:
            raise ConfigError(
                f"num_machines is {self.num_machines}, and the cluster has {len(nodes)} machines",
                "ray status lists them; ray start --address=HEAD:6379 adds one",
            )
        cpus = min(num_engines + 1, nodes[self.num_machines - 1].cpus)
        self._group: Any = groups.placement_group(
            [{"CPU": cpus}] * self.num_machines, strategy="STRICT_SPREAD"
        )
        self._left: set[int] = set()
        limit_s = time.monotonic() + START_S
        while not self._group.wait(timeout_seconds=LOOK_S):
            cluster.require_head()
            if time.monotonic() > limit_s:
                groups.remove_placement_group(self._group)
                raise ConfigError(
                    f"the cluster has no {self.num_machines} machines with {cpus:g} free CPUs each",
                    "another run may have them: ray status; a smaller --num-engines needs less",
                )
        self._make = ray.remote(num_cpus=cpus, max_restarts=0, max_task_retries=0,
                                concurrency_groups={"play": 1, "life": 1})(_Actor)  # fmt: skip

    def start(self, index: int) -> Any:
        """Return a new actor in one of the places."""
        strategy = PlacementGroupSchedulingStrategy(self._group, index)
        return self._make.options(scheduling_strategy=strategy).remote()

    def node(self, index: int) -> Node | None:
        """Return the node that a place is on; None while it is on none that lives.

        Raises:
            RunError: The head, which knows, is gone.
        """
        self.cluster.require_head()
        table = groups.placement_group_table(self._group)
        found = table["bundles_to_node_id"].get(index)
        return next((node for node in self.cluster.nodes() if node.id == found), None)

    def leave(self, index: int) -> None:
        """Give the places back to other runs once all have been left."""
        self._left.add(index)
        if len(self._left) == self.num_machines and self.cluster.has_head():
            groups.remove_placement_group(self._group)


def open_ray_machines(
    config: TrainConfig, log_dir: Path | None
) -> tuple[list[RayMachine], Callable[[int], RayMachine | None]]:
    """Start a worker on each of the machines that ``config`` asks for.

    Returns:
        The machines, whose first answer is the spec of their games; and what starts one again, or
        returns None while no node has room for it.

    Raises:
        ConfigError: The cluster cannot be reached, has fewer machines, or other versions.
        MachineLost: A worker did not start.
    """
    cluster = RayCluster(config.cluster or "auto")
    places = _Places(cluster, config.num_machines, config.num_engines)
    machines: list[RayMachine] = []
    parcel = find_parcel(config.target, config.scene, config.godot)

    def start(machine: RayMachine, index: int) -> RayMachine:
        machine.greet()
        machine.send("begin", Path.cwd(), parcel, config, index, log_dir)
        return machine

    def prepare(indices: range) -> None:
        """See that the nodes of some places have what it takes."""
        nodes = [node for index in indices if (node := places.node(index)) is not None]
        require_equal(cluster, nodes)
        if parcel is not None:
            cluster.deliver(parcel, nodes)

    def start_again(index: int) -> RayMachine | None:
        node = places.node(index)
        if node is None:
            return None
        try:
            prepare(range(index, index + 1))
            return start(RayMachine(places, index), index)
        except (MachineLost, SetupError):
            # The head takes a while to notice that a node is gone.
            limit_s = time.monotonic() + SILENCE_S
            while places.node(index) == node:
                if time.monotonic() > limit_s:
                    raise
                time.sleep(1.0)
            return None

    every = range(places.num_machines)
    try:
        prepare(every)
        machines += [RayMachine(places, index) for index in every]
        for index, machine in enumerate(machines):
            start(machine, index)
    except BaseException:
        for index in every:
            with contextlib.suppress(IndexError):
                machines[index].kill()
            places.leave(index)
        raise
    return machines, start_again
