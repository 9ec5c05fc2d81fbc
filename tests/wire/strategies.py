"""Hypothesis strategies for specs and what belongs to them."""

from __future__ import annotations

from typing import Any

import hypothesis.strategies as st
import numpy as np
from hypothesis.extra.numpy import arrays

from ludus.spec import (
    ActionComponent,
    AgentSpec,
    ContinuousAction,
    DiscreteAction,
    ObservationEntry,
    PolicySpec,
    Spec,
)
from ludus.spec.batch import ActionBatch
from tests.wire import reference

finite = st.floats(-1e6, 1e6, width=32)
json_values: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | finite | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=6,
)
json_objects = st.dictionaries(st.text(max_size=6), json_values, max_size=3)
printable = st.characters(exclude_categories=["C", "Z"])
names = st.text(printable, min_size=1, max_size=128).map(
    lambda text: text.translate({ord(letter): "_" for letter in "/\\@"})
)


@st.composite
def bounds(draw: st.DrawFn, size: int) -> tuple[Any, Any]:
    if draw(st.booleans()):
        low = draw(finite)
        return low, low + 1.0
    low = draw(st.lists(finite, min_size=size, max_size=size))
    return tuple(low), tuple(value + 1.0 for value in low)


@st.composite
def entries(draw: st.DrawFn, name: str) -> ObservationEntry:
    shape = tuple(draw(st.lists(st.integers(1, 3), min_size=1, max_size=4)))
    entry = ObservationEntry(name, draw(st.sampled_from(["float32", "uint8", "int64"])), shape)
    if draw(st.booleans()):
        return entry
    low, high = draw(bounds(entry.size))
    return ObservationEntry(name, entry.dtype, shape, low, high)


@st.composite
def components(draw: st.DrawFn, name: str) -> ActionComponent:
    if draw(st.booleans()):
        return DiscreteAction(name, draw(st.integers(1, 5)))
    size = draw(st.integers(1, 4))
    low, high = draw(bounds(size))
    return ContinuousAction(name, size, low, high)


def unique_names(maximum: int) -> st.SearchStrategy[list[str]]:
    return st.lists(names, min_size=1, max_size=maximum, unique=True)


@st.composite
def policies(draw: st.DrawFn, name: str, num_worlds: int) -> PolicySpec:
    per_world = draw(st.integers(1, 3))
    paths = st.none() | st.text(printable, max_size=10)
    action = tuple(draw(components(part)) for part in draw(unique_names(3)))
    has_choice = any(isinstance(part, DiscreteAction) for part in action)
    return PolicySpec(
        name=name,
        observation=tuple(draw(entries(entry)) for entry in draw(unique_names(3))),
        action=action,
        agents=tuple(AgentSpec(i // per_world, draw(paths)) for i in range(num_worlds * per_world)),
        agents_per_world=per_world,
        has_action_mask=has_choice and draw(st.booleans()),
        episode=draw(st.sampled_from(["agent", "world"])),
        max_episode_steps=draw(st.none() | st.integers(1, 10_000)),
        settings=draw(json_objects),
    )


@st.composite
def specs(draw: st.DrawFn) -> Spec:
    num_worlds = draw(st.integers(1, 3))
    return Spec(
        num_worlds=num_worlds,
        layout=draw(st.sampled_from(["isolated", "grid"])),
        ticks_per_step=draw(st.integers(1, 20)),
        tick_rate=draw(st.floats(1.0, 1000.0)),
        policies=tuple(draw(policies(name, num_worlds)) for name in draw(unique_names(3))),
        scene=draw(st.text(printable, max_size=10)),
    )


@st.composite
def actions(draw: st.DrawFn, spec: Spec) -> dict[str, ActionBatch]:
    def batch(policy: PolicySpec) -> ActionBatch:
        num = policy.num_agents
        return ActionBatch(
            draw(arrays(np.int64, (num, policy.num_discrete))),
            draw(arrays(np.float32, (num, policy.continuous_size), elements=finite)),
        )

    return {policy.name: batch(policy) for policy in spec.policies}


@st.composite
def batch_contents(draw: st.DrawFn, spec: Spec) -> dict[str, Any]:
    """Contents of a ``BATCH``, as ``protocol/golden`` describes them."""
    content = reference.quiet_batch(spec.to_json(), is_reset=draw(st.booleans()))
    content["has_requests"] = draw(st.booleans())
    content["tick"] = draw(st.integers(0, 2**64 - 1))
    for name in ("engine_us", "bridge_us", "wait_us"):
        content[name] = draw(st.integers(0, 2**32 - 1))
    for policy in spec.policies:
        content["policies"][policy.name] = draw(_policy_content(policy))
    return content


@st.composite
def _policy_content(draw: st.DrawFn, policy: PolicySpec) -> dict[str, Any]:
    num = policy.num_agents

    def observation(rows: int) -> dict[str, Any]:
        return {
            entry.name: draw(arrays(entry.numpy_dtype, (rows, *entry.shape))).tolist()
            for entry in policy.observation
        }

    def flags(*shape: int) -> Any:
        return draw(arrays(np.uint8, shape, elements=st.integers(0, 1))).tolist()

    slots = sorted(draw(st.sets(st.integers(0, num - 1), max_size=num)))
    content: dict[str, Any] = {
        "observation": observation(num),
        "reward": draw(arrays(np.float32, num)).tolist(),
        "terminated": flags(num),
        "truncated": flags(num),
        "active": flags(num),
        "final": {"slots": slots, "observation": observation(len(slots))},
    }
    if policy.has_action_mask:
        content["action_mask"] = flags(num, policy.mask_size)
    return content
