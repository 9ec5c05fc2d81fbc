"""Seeds: equal seeds give equal bits, different seeds give different episodes."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import partial

import numpy as np

from ludus.check.causes import name_causes
from ludus.check.context import NO_SEEDS, CheckContext, OneEngineOnly
from ludus.check.difference import first_difference
from ludus.check.finding import Finding, fail, info, ok, warn
from ludus.check.numbers import differences, scales
from ludus.check.recording import Recording, record
from ludus.errors import TargetError

__all__ = ["check_seeds"]

RNG_HINT = "draw all random numbers from LudusWorld.of(self).rng, and do not read the clock"
SHARED_HINT = "the copies share something: a static variable, an autoload, a group, get_tree().root"
SAME_START_HINT = (
    "fine if the game draws from LudusWorld.rng only later in the episode; if it uses no "
    "randomness, or draws it elsewhere, all worlds play the same episodes"
)
ROUNDING = 1e-3
"""In units of an element's usual size."""
OTHER_SEED = 1_000_003


def check_seeds(context: CheckContext) -> Iterator[Finding]:
    """Check that an episode depends on its seed and on nothing else."""
    if context.is_legacy:
        yield info("equal seeds give equal episodes", f"does not apply: {NO_SEEDS}")
    else:
        yield _same_seed(context)
        yield _other_seed(context)
    yield _alone_and_together(context)


def _same_seed(context: CheckContext) -> Finding:
    title = "the same seed twice in one process gives the same bits"
    with context.main_pool() as pool:
        again = record(pool, context.config.seed, context.recording.num_steps)
    found = first_difference(context.recording, again)
    if found is None:
        return ok(title, f"{again.num_steps} steps of {again.spec.num_worlds} worlds")
    if _is_rounding(context, again) and _are_processes_equal(context):
        return warn(
            title,
            f"the game's physics remembers the episode before: "
            f"{found.describe('first time', 'second time')}; the first observations are equal, and "
            "so are two processes",
            "such differences are as small as rounding errors; whoever needs equal bits begins "
            "each episode in fresh bodies, or in a new process",
            **found.to_json(),
        )
    hint = name_causes(context.scripts, RNG_HINT)
    return fail(title, found.describe("first time", "second time"), hint, **found.to_json())


def _is_rounding(context: CheckContext, again: Recording) -> bool:
    """Return whether first observations are equal and the first difference is a tiny one."""
    first, scale = context.recording, scales(context.recording)
    for step, (one, two) in enumerate(zip(first.frames, again.frames, strict=False)):
        sizes = [
            float(differences(policy, one.batches, two.batches, scale).max(initial=0.0))
            for policy in first.spec.policies
        ]
        if max(sizes) > 0.0:
            return step > 0 and max(sizes) <= ROUNDING
    return False


def _are_processes_equal(context: CheckContext) -> bool:
    """Return whether another process plays the same bits, which randomness would not."""
    with contextlib.suppress(OneEngineOnly), context.other_pool() as pool:
        other = record(pool, context.config.seed, context.recording.num_steps)
        return first_difference(context.recording, other) is None
    return False


def _other_seed(context: CheckContext) -> Finding:
    title = "different seeds give different first observations"
    with context.main_pool() as pool:
        other = pool.reset(context.config.seed + OTHER_SEED)
    first = context.recording.frames[0].batches
    for name, batch in first.items():
        for entry, values in batch.observation.items():
            if not np.array_equal(values, other[name].observation[entry]):
                return ok(title)
    return warn(
        title,
        "every first observation was the same with another seed",
        name_causes(context.scripts, SAME_START_HINT),
    )


def _alone_and_together(context: CheckContext) -> Finding:
    """Compare world *i* of N with a single world of seed + i, isolated if the game can be."""
    num_worlds, steps = context.spec.num_worlds, context.recording.num_steps
    title = f"world i of {num_worlds} equals a world alone with seed + i"
    layout, together, lone_pool = context.spec.layout, context.recording, context.lone_pool
    if layout != "isolated":
        with contextlib.suppress(TargetError), context.other_pool(layout="isolated") as pool:
            layout, together = "isolated", record(pool, context.config.seed, steps)
            lone_pool = partial(context.other_pool, num_worlds=1, layout=layout)
    with lone_pool() as pool:
        for world in sorted({0, num_worlds - 1}):
            alone = record(pool, context.config.seed + world, steps)
            found = first_difference(together.world(world), alone)
            if found is not None:
                text = found.describe(f"world {world} of {num_worlds}", "alone")
                return fail(
                    title, text, name_causes(context.scripts, SHARED_HINT), **found.to_json()
                )
    return ok(title, f"layout {layout}, {steps} steps, to the bit")
