"""The determinism certificate: two processes, same seed and actions, same bits."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from ludus.check.context import CheckContext
from ludus.check.difference import first_difference
from ludus.check.finding import Finding, fail, ok
from ludus.check.recording import Recording, record

__all__ = ["certificate", "check_determinism"]

FORMAT = 1
"""Counted up when recordings or random actions change."""


def check_determinism(context: CheckContext) -> list[Finding]:
    """Play the same in a second process and compare every frame."""
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
                "no randf(), no Time, no Timer of the real clock, no _process(), no order of a "
                "Dictionary of nodes: LudusWorld.rng and _physics_process() only",
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
    """Return the hash of all frames of the recording, with what it depends on."""
    recording = context.recording
    return {
        "hash": recording.digest(),
        "format": FORMAT,
        "spec": spec_fingerprint(recording),
        "engine": context.engine_version,
        "layout": recording.spec.layout,
        "num_worlds": recording.spec.num_worlds,
        "num_steps": recording.num_steps,
        "ticks": recording.frames[-1].tick - recording.frames[0].tick,
        "seed": recording.seed,
    }


def spec_fingerprint(recording: Recording) -> str:
    """Return a hash of all policies' entries and actions, and of the time step."""
    spec = recording.spec
    content = {
        "ticks_per_step": spec.ticks_per_step,
        "tick_rate": spec.tick_rate,
        "policies": {policy.name: policy.fingerprint() for policy in spec.policies},
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
