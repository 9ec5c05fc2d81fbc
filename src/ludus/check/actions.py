"""Actions: legal ones are accepted, masks leave a choice, and actions have an effect."""

from __future__ import annotations

import numpy as np

from ludus.check.context import CheckContext
from ludus.check.difference import first_difference
from ludus.check.finding import Finding, fail, ok, warn
from ludus.check.recording import Recording, record
from ludus.pool import EnginePool
from ludus.spec import DiscreteAction, PolicySpec
from ludus.spec.batch import ActionBatch

__all__ = ["check_actions"]

MAX_ALTERNATIVES = 64
MAX_EFFECT_STEPS = 50
OTHER_ACTIONS = 1_000_003


def check_actions(context: CheckContext) -> list[Finding]:
    """Try every alternative and both ends of every range; check masks and the effect."""
    recording = context.recording
    policies = recording.spec.policies
    kinds = "; ".join(f"{policy.name}: {_describe_action(policy)}" for policy in policies)
    findings = [
        ok("random legal actions are accepted", f"{kinds}; {recording.num_steps} steps"),
        *(_mask(recording, policy) for policy in policies if policy.has_action_mask),
    ]
    with context.main_pool() as pool:
        if not any(policy.has_action_mask for policy in policies):
            findings.append(_extremes(pool, context.config.seed))
        findings.append(_effect(context, pool))
    return findings


def _describe_action(policy: PolicySpec) -> str:
    parts = [
        f"{part.name} of {part.n}"
        if isinstance(part, DiscreteAction)
        else f"{part.name} {part.size} × [{np.min(part.low):.4g}, {np.max(part.high):.4g}]"
        for part in policy.action
    ]
    return ", ".join(parts) + (" (masked)" if policy.has_action_mask else "")


def _mask(recording: Recording, policy: PolicySpec) -> Finding:
    title = f"{policy.name}: action masks leave a choice"
    num_forbidden = 0
    for step, frame in enumerate(recording.frames):
        batch = frame.batches[policy.name]
        assert batch.action_mask is not None
        mask = batch.action_mask[batch.active]
        num_forbidden += int((~mask).sum())
        start = 0
        for part, n in enumerate(policy.nvec):
            is_empty = ~mask[:, start : start + n].any(axis=1)
            if is_empty.any():
                slot = int(np.flatnonzero(batch.active)[is_empty.argmax()])
                return fail(
                    title,
                    f"step {step}, slot {slot}: the mask of choice {part} allows no alternative",
                    "get_action_mask() must allow at least one alternative of every choice",
                )
            start += n
    if not num_forbidden:
        hint = "switch has_action_mask off if the game never forbids anything"
        return warn(title, f"nothing was forbidden in {recording.num_steps} steps", hint)
    return ok(title, f"{num_forbidden} alternatives were forbidden")


def _extremes(pool: EnginePool, seed: int) -> Finding:
    pool.reset(seed)
    policies = pool.spec.policies
    most = max((n for policy in policies for n in policy.nvec), default=2)
    for step in range(max(2, min(most, MAX_ALTERNATIVES))):
        actions = {p.name: ActionBatch.zeros(p, p.num_agents) for p in policies}
        for policy in policies:
            actions[policy.name].discrete[:] = np.minimum(step, np.array(policy.nvec, int) - 1)
            actions[policy.name].continuous[:] = policy.continuous_bounds()[step % 2]
        pool.step(actions)
    return ok("every alternative and both ends of every range are accepted")


def _effect(context: CheckContext, pool: EnginePool) -> Finding:
    title = "actions have an effect"
    num_steps = min(context.recording.num_steps, MAX_EFFECT_STEPS)
    seed = context.config.seed
    other = record(pool, seed, num_steps, action_seed=seed + OTHER_ACTIONS)
    found = first_difference(context.recording, other)
    if found is not None:
        return ok(title, f"seen in {found.policy}.{found.what} at step {found.step}")
    return warn(
        title,
        f"{num_steps} steps with different actions were equal to the bit",
        "apply_action() may do nothing, or the observation does not show what it does",
    )
