"""Does a reset restore everything? An episode must not depend on the one before it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ludus.check.causes import name_causes
from ludus.check.context import CheckContext
from ludus.check.finding import Finding, fail, info, ok, warn
from ludus.check.numbers import Largest, largest_difference, scales
from ludus.check.recording import Recording, play
from ludus.pool import EnginePool

__all__ = ["check_resets"]

MAX_PLAYED_STEPS = 20
NUM_STEPS_AFTER = 5
FIRST_TOLERANCE = 1e-5
LATER_TOLERANCE = 1e-2
HINT = (
    "reset() must restore everything that an episode changes: positions, velocities, timers, counts"
)


def check_resets(context: CheckContext) -> list[Finding]:
    """Compare second episodes, after a first one that was played and one that was not."""
    with context.main_pool() as pool:
        fresh = _second_episode(pool, context.config.seed, 0)
        findings = _after_reset(context, pool, fresh)
    return [context.excuse(finding) for finding in [*findings, *_after_end(context, fresh)]]


def _second_episode(pool: EnginePool, seed: int, num_played: int) -> Recording:
    """Record the start of the second episode, after ``num_played`` steps of the first."""
    play(pool, pool.reset(seed), num_played, seed)
    frames = play(pool, pool.reset(None), NUM_STEPS_AFTER, seed + 1)
    return Recording(pool.spec, seed, frames)


def _after_reset(context: CheckContext, pool: EnginePool, fresh: Recording) -> list[Finding]:
    title = "an episode does not depend on the one before it"
    first_ends = context.recording.first_ends()
    num_played = int(min(MAX_PLAYED_STEPS, first_ends.max() - 1))
    if num_played < 1:
        return [info(title, "does not apply: every episode ended after one step")]
    played = _second_episode(pool, context.config.seed, num_played)
    worlds = np.flatnonzero(first_ends > num_played)
    scale = scales(context.recording)
    worst: tuple[Largest, int, int] | None = None
    for step, (one, two) in enumerate(zip(fresh.frames, played.frames, strict=True)):
        for world in map(int, worlds):
            found = largest_difference(fresh.spec, one.batches, two.batches, scale, world)
            if found is not None and (worst is None or found.size > worst[0].size):
                worst = found, world, step
        if step == 0 and worst is not None and worst[0].size > FIRST_TOLERANCE:
            break
    if worst is None:
        return [ok(title, f"{NUM_STEPS_AFTER} steps after it are equal to the bit")]
    found, world, step = worst
    unplayed, after = found.values
    detail = (
        f"world {world}, step {step} of an episode: {found.name} is {after:.6g} if the episode "
        f"before it was played for {num_played} steps, {unplayed:.6g} if it was not played"
    )
    if step == 0 and found.size > FIRST_TOLERANCE:
        return [fail(title, detail, _hint(context), scaled_difference=found.size)]
    if found.size > LATER_TOLERANCE:
        hint = name_causes(context.scripts, HINT)
        return [warn(title, detail, hint, scaled_difference=found.size)]
    return [ok(title, f"the largest later difference is {found.size:.1g} of the usual size")]


def _after_end(context: CheckContext, fresh: Recording) -> list[Finding]:
    """Check that the observation that comes with an end is the next episode's first."""
    title = "the observation after an end is the first of the next episode"
    recording = context.recording
    policies = recording.spec.policies
    is_single_agent = sum(policy.agents_per_world for policy in policies) == 1
    # Where agents end one by one, no reset shows what the world looks like then.
    if not is_single_agent and any(policy.episode != "world" for policy in policies):
        return []
    scale = scales(recording)
    first_ends = _first_ends_of_worlds(recording)
    worlds = np.flatnonzero(first_ends <= recording.num_steps)
    if not len(worlds):
        return [info(title, f"no episode ended within {recording.num_steps} steps")]
    for world in map(int, worlds):
        step = int(first_ends[world])
        seen = recording.frames[step].batches
        found = largest_difference(fresh.spec, fresh.frames[0].batches, seen, scale, world)
        if found is not None and found.size > FIRST_TOLERANCE:
            expected, got = found.values
            detail = (
                f"world {world}, step {step}: {found.name} is {got:.6g}; a reset to the same "
                f"episode gives {expected:.6g}"
            )
            return [fail(title, detail, _hint(context))]
    return [ok(title, f"in {len(worlds)} worlds")]


def _hint(context: CheckContext) -> str:
    return name_causes(context.scripts, HINT, has_casts=True)


def _first_ends_of_worlds(recording: Recording) -> NDArray[np.int64]:
    """Return the step by which all agents of each world have ended, else ``num_steps + 1``."""
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
