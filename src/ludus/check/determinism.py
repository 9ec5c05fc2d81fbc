"""The determinism certificate: the same seed and actions in two processes give the same bits."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from ludus.check.causes import name_causes
from ludus.check.context import CheckContext
from ludus.check.difference import first_difference
from ludus.check.finding import Finding, fail, ok
from ludus.check.recording import record

__all__ = ["certificate", "check_determinism"]

FORMAT = 1
"""Raised by one whenever recordings or random actions change."""
HINT = (
    "use LudusWorld.rng and _physics_process() only: no randf(), no Time, no Timer on the real "
    "clock, no _process(), no order of a Dictionary with nodes as keys"
)


def check_determinism(context: CheckContext) -> list[Finding]:
    """Play the same episodes in a second process and compare every frame."""
    title = "two processes give the same bits"
    first = context.recording
    with context.other_pool() as pool:
        second = record(pool, context.config.seed, first.num_steps)
    found = first_difference(first, second)
    if found is not None:
        return [
            fail(
                title,
                f"first difference: {found.describe('first process', 'second process')}",
                name_causes(context.scripts, HINT),
                **found.to_json(),
            )
        ]
    values = certificate(context)
    detail = (
        f"certificate {values['hash']} ({values['engine']}, {values['layout']}, "
        f"{values['num_worlds']} worlds, {values['num_steps']} steps, seed {values['seed']}, "
        f"spec {values['spec'][:12]})"
    )
    return [ok(title, detail, **values)]


def certificate(context: CheckContext) -> dict[str, Any]:
    """Return the hash of all frames of the recording, and what it depends on."""
    recording = context.recording
    spec = {
        "ticks_per_step": recording.spec.ticks_per_step,
        "tick_rate": recording.spec.tick_rate,
        "policies": {policy.name: policy.fingerprint() for policy in recording.spec.policies},
    }
    return {
        "hash": recording.digest(),
        "format": FORMAT,
        "spec": hashlib.sha256(json.dumps(spec, sort_keys=True).encode()).hexdigest(),
        "engine": context.engine_version,
        "layout": recording.spec.layout,
        "num_worlds": recording.spec.num_worlds,
        "num_steps": recording.num_steps,
        "ticks": recording.frames[-1].tick - recording.frames[0].tick,
        "seed": recording.seed,
    }
