"""The nodes of a Ray cluster: join it, ask nodes what they have, notice that the head is gone."""

from __future__ import annotations

import contextlib
import logging
import socket
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import ray as ray_package
from ray import cloudpickle
from ray import exceptions as ray_errors
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from ludus.errors import ConfigError, MachineLost, RunError, SetupError
from ludus.workers.parcel import Parcel, has_parcel, unpack_parcel

__all__ = ["SAME_VERSIONS", "Facts", "Node", "RayCluster", "find_difference", "kill_process",
           "node_facts", "require_equal"]  # fmt: skip

ray: Any = ray_package
"""Its own types say little."""

LOOK_S, HEAD_S = 5.0, 5.0
"""Seconds between two looks whether the head lives, and until it has to answer."""

ASK_S, SEND_S = 60.0, 600.0
"""Seconds that a node has to answer, and to receive a game."""

SAME_VERSIONS = "install the same versions on all machines"

Facts = Mapping[str, Any]
"""What a node has: ``ludus``, ``python``, ``ray`` (versions), ``cores``, ``engines`` (texts)."""

# What nodes are asked is sent to them as code: the Ludus of a node may be another one, or missing.
cast(Any, cloudpickle).register_pickle_by_value(sys.modules[__name__])


@dataclass(frozen=True)
class Node:
    """A machine of the cluster that has CPUs to give.

    Attributes:
        id: What Ray calls it.
        name: Host and address, for people.
        cpus: CPUs that Ray gives away there.
    """

    id: str
    name: str
    cpus: float


class RayCluster:
    """A Ray cluster that this process has joined.

    Args:
        address: ``auto`` or ``HOST:PORT``.

    Raises:
        ConfigError: It cannot be reached.
    """

    def __init__(self, address: str) -> None:
        if not ray.is_initialized():
            _join(address)
        self.head = str(ray.get_runtime_context().gcs_address)
        self._looked_at_s = time.monotonic()

    def nodes(self) -> list[Node]:
        """Return the nodes that live and have CPUs to give, those with the most first."""
        found = [
            Node(
                of["NodeID"],
                f"{of['NodeManagerHostname']} ({of['NodeManagerAddress']})",
                of["Resources"]["CPU"],
            )
            for of in ray.nodes()
            if of["Alive"] and of["Resources"].get("CPU")
        ]
        return sorted(found, key=lambda node: (-node.cpus, node.name, node.id))

    def ask(
        self,
        function: Callable[..., Any],
        nodes: list[Node],
        *arguments: Any,
        timeout_s: float = ASK_S,
    ) -> dict[Node, Any]:
        """Call a function on nodes, all at once; return what it returned, or the error, by node.

        Args:
            function: Of a module that nodes have, or of this one.
            nodes: Which.
            arguments: Of the function.
            timeout_s: Until a node counts as one that does not answer.

        Raises:
            RunError: The head is gone, without which nobody answers.
        """
        task = ray.remote(num_cpus=0, max_retries=0)(function)
        answers: dict[Node, Any] = {}
        for node in nodes:
            place = NodeAffinitySchedulingStrategy(node.id, soft=False)
            answers[node] = task.options(scheduling_strategy=place).remote(*arguments)
        refs, limit_s = list(answers.values()), time.monotonic() + timeout_s
        while refs and time.monotonic() < limit_s:
            refs = ray.wait(refs, num_returns=len(refs), timeout=min(LOOK_S, timeout_s))[1]
            if refs:
                self.require_head()
        return {node: _answer(ref) for node, ref in answers.items()}

    def deliver(self, parcel: Parcel, nodes: list[Node]) -> None:
        """Send a game to the nodes that have not kept it.

        Raises:
            SetupError: A node cannot keep it.
        """
        found = self.ask(has_parcel, nodes, parcel.digest)
        lacking = [node for node in nodes if found[node] is not True]
        if not lacking:
            return
        files = ray.put(parcel.read())
        answers = self.ask(unpack_parcel, lacking, parcel.digest, files, timeout_s=SEND_S)
        for node, answer in answers.items():
            if isinstance(answer, Exception):
                said = str(answer).strip().splitlines()[-1]
                raise SetupError(f"node {node.name} cannot keep the game: {said}")

    def require_head(self, *, is_due: bool = True) -> None:
        """Make sure that the head answers: without it, Ray ends this process after a minute.

        Args:
            is_due: Look in any case; otherwise only if the last look was a while ago.

        Raises:
            RunError: It does not.
        """
        now = time.monotonic()
        if not is_due and now - self._looked_at_s < LOOK_S:
            return
        self._looked_at_s = now
        if not self.has_head():
            raise RunError(
                f"the head of the Ray cluster, {self.head}, is gone",
                "when the cluster is up again, ludus train --resume goes on from the last "
                "checkpoint",
            )

    def has_head(self) -> bool:
        """Return whether the head answers."""
        host, _, port = self.head.rpartition(":")
        try:
            with socket.create_connection((host.strip("[]"), int(port)), timeout=HEAD_S):
                return True
        except OSError:
            return False


def _join(address: str) -> None:
    installed = Path(ray_package.__file__).parents[1]
    try:
        # Ray's workers import from the folder that is the current one now: from a downloaded
        # repository they would run its dill.py and pynvml.py.
        with contextlib.chdir(installed):
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise ConfigError(
            f"there is no Ray cluster at {address}: {str(error).splitlines()[0]}",
            "ray start --head starts one on this machine, and --cluster local:2 needs none; one "
            "with tokens takes RAY_AUTH_MODE=token, and a copy of its head's ~/.ray/auth_token",
        ) from None


def _answer(ref: Any) -> Any:
    try:
        return ray.get(ref, timeout=0)
    except ray_errors.RayError as error:
        return error


def kill_process(pid: int) -> None:
    """Kill a process of this node, if there still is one."""
    import contextlib
    import os
    import signal

    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def node_facts(with_engines: bool = False) -> Facts:
    """Return what this node has; any version of Ludus, or none."""
    import os
    import platform

    import ray

    facts: dict[str, Any] = {
        "ludus": "none",
        "python": platform.python_version(),
        "ray": ray.__version__,
        "cores": os.cpu_count(),
        "engines": [],
    }
    try:
        from ludus.version import __version__

        facts["ludus"] = __version__
        if with_engines:
            from ludus.engine import list_engines

            engines = {f"{engine.kind} {engine.version_text}" for engine in list_engines()}
            facts["engines"] = sorted(engines)
    except ImportError:
        pass
    return facts


def require_equal(cluster: RayCluster, nodes: list[Node]) -> None:
    """Make sure that nodes have what this machine has.

    Raises:
        ConfigError: One has another version of Ludus or Python.
        MachineLost: One does not answer.
    """
    facts = cluster.ask(node_facts, nodes)
    for node, of in facts.items():
        if isinstance(of, Exception):
            raise MachineLost(find_difference(node.name, of), "ray status lists the nodes")
    differences = [find_difference(node.name, of) for node, of in facts.items()]
    if any(differences):
        raise ConfigError("; ".join(filter(None, differences)), SAME_VERSIONS)


def find_difference(name: str, facts: Facts | Exception) -> str:
    """Return in what a node differs from this machine; empty if it does not.

    Args:
        name: Of the node.
        facts: What it has, or why it does not say.
    """
    if isinstance(facts, Exception):
        return f"node {name} does not answer: {str(facts).strip().splitlines()[-1]}"
    return ", and ".join(
        f"node {name} has {title} {facts[key]}, and this machine {own}"
        for key, title in (("ludus", "Ludus"), ("python", "Python"))
        if facts[key] != (own := node_facts()[key])
    )
