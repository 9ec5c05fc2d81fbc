"""Measure a game; bridged play and the ceiling alternate, so that both see the same machine."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ludus.bench.echo import measure_echo
from ludus.bench.report import BenchReport, Breakdown
from ludus.engine import CorePlan, pinned_to, reserve_cores
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.session import EngineSession
from ludus.settings.checks import ABOVE_0, AT_LEAST_0, AT_LEAST_1, setting
from ludus.settings.pool_config import GameConfig
from ludus.spec import PolicySpec
from ludus.spec.batch import ActionBatch
from ludus.target import Scene, Target, check_accepted, parse_target, prepare
from ludus.wire.frames import HEADER_BYTES
from ludus.wire.step import BatchDecoder, StepEncoder

__all__ = ["BenchConfig", "bench"]

_NUM_ACTION_SETS = 64
_NUM_WARM_UP_STEPS = 50
_NUM_ROUND_TRIPS = 3000


@dataclass(frozen=True, kw_only=True)
class BenchConfig(GameConfig):
    """What to measure.

    Attributes:
        target: A bundled example, a project folder, a scene, or an exported game.
        seconds: Length of each part of a round.
        rounds: How often bridged play and ceiling alternate.
        seed: Seed of worlds and random actions.
    """

    target: str
    num_worlds: int = setting(64, AT_LEAST_1)
    seconds: float = setting(2.0, ABOVE_0)
    rounds: int = setting(5, AT_LEAST_1)
    seed: int = setting(0, AT_LEAST_0)


@dataclass(frozen=True)
class _SingleWorld:
    """Round trip, memory and sizes of request and answer of one engine with one world."""

    round_trip_us: float
    resident_bytes: int | None
    frame_bytes: tuple[int, int]


Actions = list[dict[str, ActionBatch]]


def bench(
    config: BenchConfig, report_progress: Callable[[str], None] = lambda _: None
) -> BenchReport:
    """Measure a target with random actions.

    Args:
        config: What to measure.
        report_progress: Called with a sentence at every stage.

    Raises:
        TargetError: The target cannot be run.
        EngineError: An engine failed.
    """
    target = parse_target(config.target, scene=config.scene, godot=config.godot)
    check_accepted("bench", target)
    target = prepare(target)  # an example is built once, not for each engine
    report_progress("one world: round trips")
    single = _measure_single(target, config)
    report_progress("bare socket echo")
    echo_us = _measure_echo(target, config, single.frame_bytes)
    with open_pool(target, PoolConfig.of(config)) as pool:
        return _measure_pool(config, pool, single, echo_us, report_progress)


def _measure_pool(
    config: BenchConfig,
    pool: EnginePool,
    single: _SingleWorld,
    echo_us: float | None,
    report_progress: Callable[[str], None],
) -> BenchReport:
    actions = [_random_actions(pool.policies, config.seed + k) for k in range(pool.num_engines)]
    num_agents = sum(pool.num_agents(name) for name in pool.policies)
    pool.reset(config.seed)
    memory = _memory_per_world(pool, single.resident_bytes)
    rounds: list[tuple[float, float]] = []
    breakdowns: list[Breakdown] = []
    for number in range(config.rounds):
        report_progress(f"round {number + 1} of {config.rounds}")
        with pinned_to(pool.learner_cores):
            num_steps, elapsed_s, breakdown = _play(pool, actions, config)
        steps_per_s = num_steps * num_agents / elapsed_s
        ceiling = _ceiling(pool, max(num_steps, 10), config.seed + number) * num_agents
        rounds.append((steps_per_s, ceiling))
        breakdowns.append(breakdown)
    return BenchReport(
        target=config.target,
        engine=_session(pool).hello.engine,
        layout=pool.spec.layout,
        num_worlds=pool.spec.num_worlds,
        num_engines=pool.num_engines,
        num_agents=num_agents,
        ticks_per_step=pool.spec.ticks_per_step,
        agent_steps_per_s=statistics.median(played for played, _ in rounds),
        ceiling_agent_steps_per_s=statistics.median(ceiling for _, ceiling in rounds),
        efficiency=statistics.median(played / ceiling for played, ceiling in rounds),
        round_trip_us=single.round_trip_us,
        socket_echo_us=echo_us,
        breakdown=Breakdown(*map(statistics.median, zip(*map(astuple, breakdowns), strict=True))),
        memory_per_world_bytes=memory,
        rounds=tuple(rounds),
    )


def _play(
    pool: EnginePool, actions: list[Actions], config: BenchConfig
) -> tuple[int, float, Breakdown]:
    """Step all engines in turn, always one step ahead; returns steps per engine and seconds."""
    pool.reset(config.seed)
    engines = range(pool.num_engines)
    for step in range(_NUM_WARM_UP_STEPS):
        for engine in engines:
            pool.send(engine, actions[engine][step % _NUM_ACTION_SETS])
        for engine in engines:
            pool.receive(engine)
    for engine in engines:
        pool.send(engine, actions[engine][0])
    waited_s = engine_us = bridge_us = 0.0
    num_steps = 0
    began = time.perf_counter()
    while (now := time.perf_counter()) - began < config.seconds:
        num_steps += 1
        for engine in engines:
            asked = time.perf_counter()
            pool.receive(engine)
            waited_s += time.perf_counter() - asked
            times = pool.times(engine)
            engine_us += times.engine_us
            bridge_us += times.bridge_us
            pool.send(engine, actions[engine][num_steps % _NUM_ACTION_SETS])
    elapsed_s = now - began
    for engine in engines:
        pool.receive(engine)
    total = num_steps * pool.num_engines
    python_us = (elapsed_s - waited_s) * 1e6 / total
    engine_us, bridge_us = engine_us / total, bridge_us / total
    wall_us = elapsed_s * 1e6 / num_steps
    transport_us = max(0.0, wall_us - engine_us - bridge_us - python_us)
    return num_steps, elapsed_s, Breakdown(engine_us, bridge_us, transport_us, python_us)


def _ceiling(pool: EnginePool, num_steps: int, seed: int) -> float:
    """Return the mean steps per second of engines that play by themselves, all at once."""
    pool.reset(seed)

    def run(engine: int) -> float:
        session = pool.sessions[engine]
        value = session.call({"bridge": True}, "run_ceiling", [num_steps, seed + engine])
        return num_steps / (cast(dict[str, Any], value)["elapsed_us"] * 1e-6)

    with ThreadPoolExecutor(pool.num_engines) as executor:
        rates = list(executor.map(run, range(pool.num_engines)))
    return statistics.mean(rates)


def _measure_single(target: Target, config: BenchConfig) -> _SingleWorld:
    single = PoolConfig.of(replace(config, num_worlds=1, num_engines=1))
    with open_pool(target, single) as pool:
        actions = _random_actions(pool.policies, config.seed)
        pool.reset(config.seed)
        resident_bytes = _resident_bytes(pool)
        trips: list[float] = []
        with pinned_to(pool.learner_cores):
            for step in range(_NUM_ROUND_TRIPS):
                began = time.perf_counter()
                pool.send(0, actions[step % _NUM_ACTION_SETS])
                pool.receive(0)
                elapsed_us = (time.perf_counter() - began) * 1e6
                trips.append(elapsed_us - pool.times(0).engine_us)
        spec = pool.spec
        sizes = (
            len(StepEncoder(spec).encode(actions[0])),
            len(BatchDecoder(spec).buffer) - HEADER_BYTES,
        )
        return _SingleWorld(statistics.median(trips), resident_bytes, sizes)


def _measure_echo(target: Target, config: BenchConfig, sizes: tuple[int, int]) -> float | None:
    if not isinstance(target, Scene):
        return None
    engine = target.find_engine()
    if not config.is_pinned:
        return measure_echo(engine, sizes, _NUM_ROUND_TRIPS, CorePlan((None,), None))
    with reserve_cores(1) as cores:
        return measure_echo(engine, sizes, _NUM_ROUND_TRIPS, cores.plan)


def _random_actions(policies: Mapping[str, PolicySpec], seed: int) -> Actions:
    rng = np.random.default_rng(seed)

    def draw(policy: PolicySpec) -> ActionBatch:
        num = policy.num_agents
        discrete: NDArray[np.int64] = rng.integers(0, policy.nvec or 1, (num, policy.num_discrete))
        low, high = policy.continuous_bounds()
        continuous = rng.uniform(low, high, (num, policy.continuous_size)).astype(np.float32)
        return ActionBatch(discrete, continuous)

    return [
        {name: draw(policy) for name, policy in policies.items()} for _ in range(_NUM_ACTION_SETS)
    ]


def _memory_per_world(pool: EnginePool, single_rss: int | None) -> float | None:
    rss = _resident_bytes(pool)
    if rss is None or single_rss is None or pool.spec.num_worlds == 1:
        return None
    return (rss - single_rss) / (pool.spec.num_worlds - 1)


def _resident_bytes(pool: EnginePool) -> int | None:
    import psutil

    pid = _session(pool).pid
    return None if pid is None else int(psutil.Process(pid).memory_info().rss)


def _session(pool: EnginePool) -> EngineSession:
    session = pool.sessions[0]
    assert isinstance(session, EngineSession)
    return session
