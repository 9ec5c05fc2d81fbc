"""Episode timing: ticks per step, the answer to a reset, truncation."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ludus.check.causes import name_causes
from ludus.check.context import CheckContext
from ludus.check.difference import standing_difference
from ludus.check.finding import Finding, fail, info, ok
from ludus.check.recording import Recording, play, record
from ludus.check.seeds import SHARED_HINT
from ludus.pool import EnginePool
from ludus.wire.reset import ResetAction, ResetRequest

__all__ = ["check_timing"]

WAIT_S = 0.05
SHORT_EPISODE_STEPS = 5
UNCHANGED_HINT = "get_observation() must change nothing, and nothing may depend on the real clock"


def check_timing(context: CheckContext) -> Iterator[Finding]:
    """Check ticks, resets and truncation."""
    recording = context.recording
    yield _reset_answers(recording)
    yield _ticks(recording)
    with context.main_pool() as pool:
        unchanged = _unchanged_until_action(pool, context)
        others = _others_unchanged(pool, context)
    yield unchanged
    yield others
    yield _limit(recording, "")
    with context.other_pool(max_episode_steps=SHORT_EPISODE_STEPS) as pool:
        short = record(pool, context.config.seed, 2 * SHORT_EPISODE_STEPS + 2)
    yield _limit(short, " (set by the trainer)")


def _reset_answers(recording: Recording) -> Finding:
    title = "a reset returns observations only"
    for name, batch in recording.frames[0].batches.items():
        has_outcome = batch.terminated | batch.truncated | (batch.reward != 0)
        if has_outcome.any() or len(batch.final_index):
            detail = (
                f"policy {name}: the answer to a reset carries a reward or the end of an episode"
            )
            return fail(title, detail, "this is a defect of the engine's add-on")
        if not batch.active.any():
            return fail(title, f"policy {name}: no agent is active after a reset")
    return ok(title, "reward 0, no episode ended, agents active")


def _ticks(recording: Recording) -> Finding:
    expected = recording.spec.ticks_per_step
    title = f"a step takes {expected} ticks"
    ticks = np.diff([frame.tick for frame in recording.frames])
    # After an end, worlds may settle for some ticks before their first observation.
    may_settle = np.array(
        [
            any(len(batch.final_index) for batch in frame.batches.values())
            for frame in recording.frames[1:]
        ]
    )
    wrong = np.flatnonzero(np.where(may_settle, ticks < expected, ticks != expected))
    if len(wrong):
        step = int(wrong[0]) + 1
        detail = f"step {step} took {int(ticks[step - 1])} ticks, expected {expected}"
        return fail(title, detail, "do not change the pause or the time scale of the tree")
    settle = int((ticks[may_settle] - expected).max(initial=0))
    note = f", and up to {settle} more to settle after an end" if settle else ""
    return ok(title, f"in all {len(ticks)} steps{note}", settle_ticks=settle)


def _unchanged_until_action(pool: EnginePool, context: CheckContext) -> Finding:
    """Check that nothing changes between a reset and the first action, however late that is."""
    title = "the first action acts on what reset returned"
    first = pool.reset(context.config.seed)
    tick = pool.times(0).tick
    time.sleep(WAIT_S)
    again = pool.reset_worlds(_leave_all(pool.spec.num_worlds))
    if pool.times(0).tick != tick:
        return fail(title, f"{pool.times(0).tick - tick} ticks passed between reset and action")
    found = standing_difference(pool.spec, first, again)
    if found is not None:
        return fail(
            title,
            f"the game changed without a tick: {found.describe('at reset', 'a moment later')}",
            name_causes(context.scripts, UNCHANGED_HINT),
            **found.to_json(),
        )
    return ok(title, "no tick and no change in between")


def _others_unchanged(pool: EnginePool, context: CheckContext) -> Finding:
    title = "a reset of one world leaves the others unchanged"
    seed, num = context.config.seed, pool.spec.num_worlds
    if num < 2:
        if context.is_legacy:
            return info(title, "does not apply: this game is one world")
        return info(title, "not checked: it needs two worlds", "run with --num-worlds 2")
    before = play(pool, pool.reset(seed), 3, seed)[-1].batches
    request = _leave_all(num)
    request.actions[0] = ResetAction.NEXT_EPISODE
    after = pool.reset_worlds(request)
    found = standing_difference(pool.spec, before, after, first_world=1)
    if found is not None:
        return fail(
            title,
            f"a reset of world 0 changed another: {found.describe('before', 'after')}",
            name_causes(context.scripts, SHARED_HINT),
            **found.to_json(),
        )
    return ok(title, f"worlds 1 to {num - 1} are equal to the bit")


def _limit(recording: Recording, origin: str) -> Finding:
    """Check that an episode that reaches its limit ends there."""
    limits = {policy.name: policy.max_episode_steps for policy in recording.spec.policies}
    if all(limit is None for limit in limits.values()):
        return info(
            "no step limit is declared",
            hint="LudusAgent.max_episode_steps sets one, or --max-episode-steps",
        )
    shown = ", ".join(f"{limit or 'none'}" for limit in limits.values())
    title = f"episodes are truncated after {shown} steps{origin}"
    num_cut = 0
    for policy in recording.spec.policies:
        lengths = np.zeros(policy.num_agents, np.int64)
        limit = policy.max_episode_steps or len(recording.frames) + 1
        for step, (last, frame) in enumerate(pairwise(recording.frames), 1):
            before, batch = last.batches[policy.name], frame.batches[policy.name]
            lengths += before.active
            has_ended = batch.terminated | batch.truncated
            late = np.flatnonzero(before.active & (lengths >= limit) & ~has_ended)
            if len(late):
                detail = (
                    f"policy {policy.name}, slot {int(late[0])}: after step {step} the episode is "
                    f"{int(lengths[late[0]])} steps long and has not ended"
                )
                return fail(title, detail)
            num_cut += int((batch.truncated & (lengths == limit)).sum())
            lengths[has_ended] = 0
    if not num_cut:
        return info(
            title,
            "not checked: no episode lasted that long",
            "play more steps, --steps, unless random play ends every episode earlier",
        )
    return ok(title, f"episodes that reached the limit: {num_cut}", num_truncated=num_cut)


def _leave_all(num_worlds: int) -> ResetRequest:
    """Return a request that resets no world."""
    return ResetRequest(np.zeros(num_worlds, np.uint64), np.zeros(num_worlds, np.uint8))
