"""Read a spec from the JSON of a `SPEC` frame (PROTOCOL.md §4); errors name the place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from ludus.errors import ProtocolError
from ludus.printing import printable
from ludus.spec import (
    DTYPES,
    ActionComponent,
    AgentSpec,
    Bound,
    ContinuousAction,
    DiscreteAction,
    EpisodeMode,
    ObservationEntry,
    PolicySpec,
    Spec,
)
from ludus.wire.frames import MAX_BINARY_BYTES, MAX_WORLDS
from ludus.wire.json_object import JsonObject
from ludus.wire.step import max_batch_bytes

__all__ = ["read_spec"]

MAX_AGENTS = 65_536
MAX_POLICIES = 64
MAX_ENTRIES = 64
MAX_WARNINGS = 256
MAX_DIMENSIONS = 8
MAX_NAME_LENGTH = 128
MAX_ENTRY_ELEMENTS = 1 << 26
_HINT = "the add-on and ludus may differ in version; run `ludus addon install PROJECT`"


def read_spec(value: Any) -> Spec:
    """Build a spec from the JSON of a ``SPEC`` frame.

    Raises:
        ProtocolError: A key is missing, of the wrong type or over a limit.
    """
    reader = JsonObject(value, "spec", _HINT)
    num_worlds = reader.integer("num_worlds", 1, MAX_WORLDS)
    policies = tuple(
        _policy(item, num_worlds) for item in reader.children("policies", 1, MAX_POLICIES)
    )
    _check_names(reader, "policies", [policy.name for policy in policies])
    tick_rate = reader.number("tick_rate", reader.get("tick_rate"))
    if tick_rate <= 0.0:
        raise reader.unexpected("tick_rate", "a positive number", tick_rate)
    spec = Spec(
        num_worlds=num_worlds,
        layout=reader.choice("layout", ("isolated", "grid")),
        ticks_per_step=reader.integer("ticks_per_step", 1, 100_000),
        tick_rate=tick_rate,
        policies=policies,
        scene=printable(reader.text("scene", default="")),
        warnings=_warnings(reader),
    )
    num_bytes = max_batch_bytes(spec)
    if num_bytes > MAX_BINARY_BYTES:
        raise ProtocolError(
            f"spec: a BATCH may need {num_bytes} bytes, the limit is {MAX_BINARY_BYTES}",
            hint="use fewer worlds or agents, or smaller observations",
        )
    return spec


def _warnings(reader: JsonObject) -> tuple[str, ...]:
    texts = reader.items("warnings") if "warnings" in reader.names() else []
    if len(texts) > MAX_WARNINGS or not all(isinstance(text, str) for text in texts):
        raise reader.unexpected("warnings", f"up to {MAX_WARNINGS} texts", texts)
    return tuple(printable(text) for text in texts)


def _policy(reader: JsonObject, num_worlds: int) -> PolicySpec:
    agents = tuple(_agent(item, num_worlds) for item in reader.children("agents", 1, MAX_AGENTS))
    if reader.integer("num_agents", 1, MAX_AGENTS) != len(agents):
        raise reader.error("num_agents", f"the list of agents has {len(agents)}")
    per_world = reader.integer("agents_per_world", 1, MAX_AGENTS)
    if len(agents) != per_world * num_worlds:
        count = f"{len(agents)} agents in {num_worlds} worlds"
        raise reader.error("agents_per_world", f"{per_world} does not match {count}")
    for slot, agent in enumerate(agents):
        if agent.world != slot // per_world:
            what = f"expected {slot // per_world} (slots are ordered by world), got {agent.world}"
            raise reader.error(f"agents[{slot}].world", what)
    action = tuple(_component(item) for item in reader.children("action", 1, MAX_ENTRIES))
    observation = tuple(_entry(item) for item in reader.children("observation", 1, MAX_ENTRIES))
    _check_names(reader, "observation", [entry.name for entry in observation])
    _check_names(reader, "action", [part.name for part in action])
    settings, limit = reader.get("settings"), reader.get("max_episode_steps")
    if not isinstance(settings, dict):
        raise reader.unexpected("settings", "an object", settings)
    name = reader.name("name", MAX_NAME_LENGTH)
    if "/" in name or "\\" in name or name.startswith("@"):
        raise reader.unexpected(
            "name", "a policy's name without / and \\, not beginning with @", name
        )
    policy = PolicySpec(
        name=name,
        observation=observation,
        action=action,
        agents=agents,
        agents_per_world=per_world,
        has_action_mask=reader.flag("has_action_mask"),
        episode=cast(EpisodeMode, reader.choice("episode", ("agent", "world"))),
        max_episode_steps=None
        if limit is None
        else reader.integer("max_episode_steps", 1, 1 << 31),
        settings=cast(dict[str, Any], settings),
    )
    if policy.has_action_mask and not policy.nvec:
        raise reader.error("has_action_mask", "there is no discrete action to mask")
    return policy


def _check_names(reader: JsonObject, key: str, names: Sequence[str]) -> None:
    if len(set(names)) != len(names):
        raise reader.error(key, "two items have the same name")


def _agent(reader: JsonObject, num_worlds: int) -> AgentSpec:
    path = reader.get("path")
    if path is not None and not isinstance(path, str):
        raise reader.unexpected("path", "a text or null", path)
    path = None if path is None else printable(path)
    return AgentSpec(world=reader.integer("world", 0, num_worlds - 1), path=path)


def _entry(reader: JsonObject) -> ObservationEntry:
    sizes = reader.items("shape")
    if not 1 <= len(sizes) <= MAX_DIMENSIONS:
        raise reader.error("shape", f"expected a list of 1 to {MAX_DIMENSIONS} sizes")
    for size in sizes:
        if reader.number("shape", size) < 1 or size != int(size):
            raise reader.unexpected("shape", "positive integers", size)
    shape = tuple(int(size) for size in sizes)
    size = math.prod(shape)
    if size > MAX_ENTRY_ELEMENTS:
        raise reader.error("shape", f"more than {MAX_ENTRY_ELEMENTS} elements")
    return ObservationEntry(
        reader.name("name", MAX_NAME_LENGTH),
        reader.choice("dtype", tuple(DTYPES)),
        shape,
        *_bounds(reader, size, math.inf),
    )


def _component(reader: JsonObject) -> ActionComponent:
    name = reader.name("name", MAX_NAME_LENGTH)
    if reader.choice("kind", ("discrete", "continuous")) == "discrete":
        return DiscreteAction(name, reader.integer("n", 1, 1 << 20))
    size = reader.integer("size", 1, 1 << 16)
    return ContinuousAction(name, size, *_bounds(reader, size, None))


def _bounds(reader: JsonObject, size: int, unbounded: float | None) -> tuple[Bound, Bound]:
    """Return ``low`` and ``high``; null stands for -/+ ``unbounded``, if that is a number."""
    low = _bound(reader, "low", size, None if unbounded is None else -unbounded)
    high = _bound(reader, "high", size, unbounded)
    lows, highs = np.broadcast_arrays(low, high)
    for i in np.flatnonzero(lows > highs):
        raise reader.error("low", f"{lows.flat[i]} is above high, {highs.flat[i]}")
    return low, high


def _bound(reader: JsonObject, key: str, size: int, unbounded: float | None) -> Bound:
    value = reader.optional(key)
    if value is None:
        if unbounded is None:
            raise reader.error(key, "missing")
        return unbounded
    if not isinstance(value, list):
        return reader.number(key, value)
    numbers = cast(list[Any], value)
    if len(numbers) != size:
        raise reader.error(key, f"expected {size} numbers, got {len(numbers)}")
    return tuple(reader.number(key, number) for number in numbers)
