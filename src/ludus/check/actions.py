"""Actions: legal ones are taken, masks leave a choice, and what is done matters."""

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
    """Try every alternative and both ends of every range; look for masks and for an effect."""
    recording = context.recording
    findings = [_random_play(recording)]
    for policy in recording.spec.policies:
        if policy.has_action_mask:
            findings.append(_mask(recording, policy))
    with context.main_pool() as pool:
        if not any(policy.has_action_mask for policy in recording.spec.policies):
            findings.append(_extremes(pool, context.config.seed))
        findings.append(_effect(context, pool))
    return findings


def _random_play(recording: Recording) -> Finding:
    kinds = "; ".join(f"{p.name}: {describe_action(p)}" for p in recording.spec.policies)
    return ok("random legal actions are taken", f"{kinds}; {recording.num_steps} steps")


def describe_action(policy: PolicySpec) -> str:
    """Say in a few words what an agent decides."""
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
                    f"step {step}, slot {slot}: the mask of choice {part} allows nothing",
                    "get_action_mask() must allow at least one alternative of every choice",
                )
            start += n
    if not num_forbidden:
        hint = "switch has_action_mask off if nothing is ever forbidden"
        return warn(title, f"nothing was forbidden in {recording.num_steps} steps", hint)
    return ok(title, f"{num_forbidden} alternatives were forbidden")


def _extremes(pool: EnginePool, seed: int) -> Finding:
    """Every alternative, and the lowest and highest of every range."""
    pool.reset(seed)
    spec = pool.spec
    most = max((n for policy in spec.policies for n in policy.nvec), default=2)
    num_steps = max(2, min(most, MAX_ALTERNATIVES))
    for step in range(num_steps):
        pool.step({policy.name: _extreme(policy, step) for policy in spec.policies})
    return ok("every alternative and both ends of every range are taken")


def _extreme(policy: PolicySpec, step: int) -> ActionBatch:
    actions = ActionBatch.zeros(policy, policy.num_agents)
    if policy.nvec:
        actions.discrete[:] = np.minimum(step, np.asarray(policy.nvec) - 1)
    actions.continuous[:] = policy.continuous_bounds()[step % 2]
    return actions


def _effect(context: CheckContext, pool: EnginePool) -> Finding:
    """Whether other actions lead anywhere else."""
    title = "actions have an effect"
    num_steps = min(context.recording.num_steps, MAX_EFFECT_STEPS)
    seed = context.config.seed
    other = record(pool, seed, num_steps, action_seed=seed + OTHER_ACTIONS)
    found = first_difference(context.recording, other)
    if found is not None:
        return ok(title, f"seen in {found.policy}.{found.what} at step {found.step}")
    return warn(
        title,
        f"{num_steps} steps with other actions were the same to the bit",
        "apply_action() may be ignored, or the observation does not show what it does",
    )
