"""``ludus cluster check``: does every node of a Ray cluster have what a run needs, and how fast?"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ludus.errors import LudusError
from ludus.play.players import random_player
from ludus.pool import PoolConfig, open_pool
from ludus.settings.checks import ABOVE_0, setting
from ludus.settings.pool_config import GameConfig
from ludus.spec import Spec, spec_difference
from ludus.target import check_accepted, parse_target
from ludus.workers.nodes import SAME_VERSIONS, Facts, Node, RayCluster, find_difference, node_facts
from ludus.workers.parcel import Parcel, find_parcel

__all__ = ["NodeCheckConfig", "NodeReport", "check_nodes"]

START_S = 120.0
"""Seconds that a game has to start."""

PACK_BYTES = 32 << 20
"""What is sent to measure the line."""


@dataclass(frozen=True, kw_only=True)
class NodeCheckConfig(GameConfig):
    """What nodes are to play.

    Attributes:
        target: The game.
        cluster: Address of the cluster: auto or HOST:PORT.
        seconds: How long each node plays.
    """

    target: str
    cluster: str = "auto"
    seconds: float = setting(5.0, ABOVE_0)


@dataclass(frozen=True)
class NodeReport:
    """What one node has.

    Attributes:
        node: Host and address.
        cpus: CPUs that Ray gives away there.
        facts: Versions, cores and engines; empty if the node does not answer.
        megabytes_per_s: What it sends to this machine; None if that was not measured.
        agent_steps_per_s: Of random actions, all nodes at once; None if it did not play.
        error: Why no run can play there, with the node's name; empty if it can.
        hint: What to do about it.
    """

    node: str
    cpus: float
    facts: Facts
    megabytes_per_s: float | None = None
    agent_steps_per_s: float | None = None
    error: str = ""
    hint: str = ""


@dataclass(frozen=True)
class _Play:
    """What came of a few seconds of play; sent by the node."""

    spec: Spec | None = None
    agent_steps_per_s: float | None = None
    error: LudusError | None = None


def check_nodes(config: NodeCheckConfig) -> list[NodeReport]:
    """Look at every node that has CPUs to give, and let it play.

    Raises:
        ConfigError: The cluster cannot be reached.
        TargetError: There is no such target here, or it cannot be trained.
    """
    check_accepted("train", parse_target(config.target, scene=config.scene, godot=config.godot))
    cluster = RayCluster(config.cluster)
    nodes = cluster.nodes()
    facts = cluster.ask(node_facts, nodes, True)
    differences = {node: find_difference(node.name, of) for node, of in facts.items()}
    equal = [node for node in nodes if not differences[node]]
    parcel = find_parcel(config.target, config.scene, config.godot)
    if parcel is not None:
        cluster.deliver(parcel, equal)
    plays = cluster.ask(_play, equal, config, parcel, timeout_s=config.seconds + START_S)
    first = next((of.spec for of in plays.values() if isinstance(of, _Play) and of.spec), None)
    reports: list[NodeReport] = []
    for node in nodes:
        of, play = facts[node], plays.get(node)
        known: Facts = {} if isinstance(of, Exception) else of
        speed, error, hint = None, differences[node], SAME_VERSIONS
        if play is not None:
            speed, error, hint = _judge(node, play, first)
        line = _megabytes_per_s(cluster, node) if known else None
        reports.append(NodeReport(node.name, node.cpus, known, line, speed, error, hint))
    return reports


def _judge(
    node: Node, play: _Play | Exception, first: Spec | None
) -> tuple[float | None, str, str]:
    """Return the speed of a node, and what is wrong with its game and what to do about it."""
    if isinstance(play, Exception):
        return None, f"node {node.name} did not play: {str(play).strip().splitlines()[-1]}", ""
    if play.error is not None:
        return None, f"node {node.name}: {play.error.message}", play.error.hint
    if first is not None and play.spec is not None and play.spec != first:
        difference = spec_difference(first, play.spec)
        hint = "copy the same game to all machines"
        return play.agent_steps_per_s, f"node {node.name} has another game: {difference}", hint
    return play.agent_steps_per_s, "", ""


def _play(config: NodeCheckConfig, parcel: Parcel | None) -> _Play:
    """Play with random actions on this node."""
    if parcel is not None:
        config = replace(config, **parcel.settings())
    try:
        with open_pool(config.target, PoolConfig.of(config)) as pool:
            act, batches, steps = random_player(pool, 0), pool.reset(0), 0
            start = time.perf_counter()
            while (passed_s := time.perf_counter() - start) < config.seconds:
                steps += sum(int(batch.active.sum()) for batch in batches.values())
                batches = pool.step(act(batches))
            return _Play(pool.spec, steps / passed_s)
    except LudusError as error:
        return _Play(error=error)


def _megabytes_per_s(cluster: RayCluster, node: Node) -> float | None:
    """Return how fast a node sends; a first parcel makes sure that its process runs."""
    parcel: Any = None
    for size in (1 << 20, PACK_BYTES):
        start = time.perf_counter()
        parcel = cluster.ask(_pack, [node], size)[node]
        passed_s = time.perf_counter() - start
    return None if isinstance(parcel, Exception) else len(parcel) / passed_s / 1e6


def _pack(num_bytes: int) -> Any:
    return np.ones(num_bytes, np.uint8)
