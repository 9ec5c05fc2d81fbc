"""Does a reset forget? The next episode must not depend on how the last one went."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ludus.check.context import CheckContext
from ludus.check.finding import Finding, fail, info, ok, warn
from ludus.check.numbers import differences, element_names, scales
from ludus.check.recording import Frame, Recording
from ludus.play.players import random_player
from ludus.pool import EnginePool

__all__ = ["check_resets"]

MAX_PLAYED_STEPS = 20
NUM_STEPS_AFTER = 5
FIRST_TOLERANCE = 1e-5
LATER_TOLERANCE = 1e-2
HINT = (
    "reset() must put back everything that an episode changes: places, velocities, timers, counts"
)


@dataclass(frozen=True)
class _Largest:
    """The largest difference between two episodes that should be one, in units of its scale."""

    size: float
    step: int
    where: str


def check_resets(context: CheckContext) -> list[Finding]:
    """Compare second episodes: after a played first one, and after none."""
    with context.main_pool() as pool:
        fresh = _second_episode(pool, context.config.seed, 0)
        findings = _after_reset(context, pool, fresh)
    return [*findings, *_after_end(context, fresh)]


def _second_episode(pool: EnginePool, seed: int, num_played: int) -> Recording:
    """Return the start of the second episode, after ``num_played`` steps of the first one."""
    batches = pool.reset(seed)
    act = random_player(pool, seed)
    for _ in range(num_played):
        batches = pool.step(act(batches))
    batches = pool.reset(None)
    frames = [Frame(pool.times(0).tick, batches)]
    act = random_player(pool, seed + 1)
    for _ in range(NUM_STEPS_AFTER):
        batches = pool.step(act(batches))
        frames.append(Frame(pool.times(0).tick, batches))
    return Recording(pool.spec, seed, tuple(frames))


def _after_reset(context: CheckContext, pool: EnginePool, fresh: Recording) -> list[Finding]:
    title = "reset() forgets the episode before"
    first_ends = context.recording.first_ends()
    num_played = int(min(MAX_PLAYED_STEPS, first_ends.max() - 1))
    if num_played < 1:
        return [info(title, "every episode ended after one step: nothing to forget")]
    played = _second_episode(pool, context.config.seed, num_played)
    worlds = np.flatnonzero(first_ends > num_played)
    scale = scales(context.recording)
    largest = [_compare(scale, fresh, played, step, worlds) for step in range(len(fresh.frames))]
    seen = f"the same episode, after {num_played} steps of another and after none"
    if largest[0].size > FIRST_TOLERANCE:
        detail = f"{seen}: the first observations differ: {largest[0].where}"
        return [fail(title, detail, HINT, scaled_difference=largest[0].size)]
    worst = max(largest, key=lambda found: found.size)
    if worst.size > LATER_TOLERANCE:
        detail = f"{seen}: step {worst.step} differs, though not the first: {worst.where}"
        return [warn(title, detail, HINT, scaled_difference=worst.size)]
    return [ok(title, f"largest later difference {worst.size:.1g} of the usual size")]


def _after_end(context: CheckContext, fresh: Recording) -> list[Finding]:
    """Check that the observation that comes with an end is the first of the next episode."""
    title = "the observation after an end is the first of the next episode"
    recording = context.recording
    if not _worlds_begin_as_one(recording):
        return []
    scale = scales(recording)
    first_ends = _first_ends_of_worlds(recording)
    worlds = np.flatnonzero(first_ends <= recording.num_steps)
    if not len(worlds):
        return [info(title, f"no episode ended within {recording.num_steps} steps")]
    for world in worlds:
        step = int(first_ends[world])
        expected, seen = fresh.world(int(world)), recording.world(int(world))
        for policy in expected.spec.policies:
            size = differences(policy, expected.frames[0].batches, seen.frames[step].batches, scale)
            if size.max(initial=0.0) > FIRST_TOLERANCE:
                _, column = np.unravel_index(size.argmax(), size.shape)
                entry, element = element_names(policy)[int(column)]
                detail = (
                    f'world {world}, step {step}: {policy.name}.observation["{entry}"][{element}] '
                    f"is not what a reset to the same episode shows"
                )
                return [fail(title, detail, HINT)]
    return [ok(title, f"in {len(worlds)} worlds")]


def _worlds_begin_as_one(recording: Recording) -> bool:
    """Whether all agents of a world begin together, so that a reset shows the same."""
    policies = recording.spec.policies
    alone = sum(policy.agents_per_world for policy in policies) == 1
    return alone or all(policy.episode == "world" for policy in policies)


def _first_ends_of_worlds(recording: Recording) -> NDArray[np.int64]:
    """Return the step in which each world as a whole began anew, else ``num_steps + 1``."""
    spec = recording.spec
    first = np.full(spec.num_worlds, recording.num_steps + 1, np.int64)
    has_ended = {p.name: np.zeros(p.num_agents, np.bool_) for p in spec.policies}
    for step, frame in enumerate(recording.frames):
        whole = np.ones(spec.num_worlds, np.bool_)
        for policy in spec.policies:
            has_ended[policy.name][frame.batches[policy.name].final_index] = True
            by_world = has_ended[policy.name].reshape(spec.num_worlds, -1)
            idle = ~recording.frames[0].batches[policy.name].active.reshape(spec.num_worlds, -1)
            whole &= (by_world | idle).all(axis=1)
        first = np.where(whole & (first > recording.num_steps), step, first)
    return first


def _compare(
    scale: Mapping[str, NDArray[np.float64]],
    one: Recording,
    two: Recording,
    step: int,
    worlds: NDArray[np.int64],
) -> _Largest:
    largest = _Largest(0.0, step, "")
    for world in worlds:
        first, second = one.world(int(world)), two.world(int(world))
        for policy in first.spec.policies:
            before, after = first.frames[step].batches, second.frames[step].batches
            size = differences(policy, before, after, scale)
            if size.max(initial=0.0) <= largest.size:
                continue
            slot, column = (int(i) for i in np.unravel_index(size.argmax(), size.shape))
            entry, element = element_names(policy)[column]
            a = before[policy.name].observation[entry].reshape(policy.num_agents, -1)
            b = after[policy.name].observation[entry].reshape(policy.num_agents, -1)
            where = (
                f'world {world}: {policy.name}.observation["{entry}"][{element}] is '
                f"{b[slot, element]:.6g} after play, {a[slot, element]:.6g} without"
            )
            largest = _Largest(float(size.max()), step, where)
    return largest
