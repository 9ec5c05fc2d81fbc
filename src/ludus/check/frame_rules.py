"""Rules that every frame keeps, whatever the game does (PROTOCOL.md §7, "Meaning")."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ludus.check.context import CheckContext
from ludus.check.finding import Finding, fail, ok
from ludus.check.recording import Recording
from ludus.spec.batch import Batch

__all__ = ["RULES", "apply_rule", "check_frame_rules"]

Rule = Callable[[Batch, Batch], NDArray[np.bool_]]


def check_frame_rules(context: CheckContext) -> list[Finding]:
    """Check flags, final observations and inactive slots in every frame of random play."""
    recording = context.recording
    return [apply_rule(recording, title, rule, hint) for title, (rule, hint) in RULES.items()]


def _never_both(_: Batch, batch: Batch) -> NDArray[np.bool_]:
    return batch.terminated & batch.truncated


def _finals_where_ended(_: Batch, batch: Batch) -> NDArray[np.bool_]:
    has_final = np.zeros(batch.num_agents, np.bool_)
    has_final[batch.final_index] = True
    return has_final != (batch.terminated | batch.truncated)


def _only_where_active(before: Batch, batch: Batch) -> NDArray[np.bool_]:
    return ~before.active & (batch.terminated | batch.truncated | (batch.reward != 0))


def _zeros_where_inactive(_: Batch, batch: Batch) -> NDArray[np.bool_]:
    seen = np.zeros(batch.num_agents, np.bool_)
    for values in batch.observation.values():
        seen |= values.reshape(batch.num_agents, -1).any(axis=1)
    return ~batch.active & seen


def _active_until_end(before: Batch, batch: Batch) -> NDArray[np.bool_]:
    return before.active & ~batch.active & ~batch.terminated & ~batch.truncated


RULES: dict[str, tuple[Rule, str]] = {
    "terminated and truncated are never both true": (_never_both, "is_done() takes precedence"),
    "final observations exactly where an episode ended": (_finals_where_ended, ""),
    "outcomes only for agents that acted": (_only_where_active, ""),
    "inactive agents observe zeros": (_zeros_where_inactive, ""),
    "agents become inactive only at the end of an episode": (
        _active_until_end,
        "an agent that leaves the scene is reported as terminated",
    ),
}
"""Rule and hint by title; a rule marks the slots that break it, given two frames in a row."""


def apply_rule(recording: Recording, title: str, rule: Rule, hint: str) -> Finding:
    """Apply one rule to every frame; the finding names the first place where it is broken."""
    for step, (last, frame) in enumerate(pairwise(recording.frames), 1):
        for policy in recording.spec.policies:
            broken = np.flatnonzero(rule(last.batches[policy.name], frame.batches[policy.name]))
            if len(broken):
                slot = int(broken[0])
                agent = policy.agents[slot]
                detail = f"broken at step {step} by policy {policy.name}, {agent}"
                return fail(title, detail, hint, step=step, policy=policy.name, slot=slot)
    return ok(title, f"in all {recording.num_steps} steps")
