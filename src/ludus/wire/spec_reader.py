"""Read a spec from the JSON of a `SPEC` frame (PROTOCOL.md §4); errors name the place."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from reprlib import repr as _short
from typing import Any, cast

from ludus.errors import ProtocolError
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
from ludus.wire.step import max_batch_bytes

__all__ = ["read_spec"]

MAX_AGENTS = 65_536
MAX_POLICIES = 64
MAX_ENTRIES = 64
MAX_DIMENSIONS = 8
MAX_NAME_LENGTH = 128
MAX_ENTRY_ELEMENTS = 1 << 26
_MAX_FLOAT = sys.float_info.max


def read_spec(value: Any) -> Spec:
    """Build a spec from the JSON of a ``SPEC`` frame.

    Raises:
        ProtocolError: A key is missing, of the wrong type or over a limit.
    """
    reader = _Reader(value, "spec")
    num_worlds = reader.integer("num_worlds", 1, MAX_WORLDS)
    policies = tuple(
        _policy(item, num_worlds) for item in reader.items("policies", 1, MAX_POLICIES)
    )
    if len({policy.name for policy in policies}) != len(policies):
        raise reader.error("policies", "two policies have the same name")
    spec = Spec(
        num_worlds=num_worlds,
        layout=reader.choice("layout", ("isolated", "grid")),
        ticks_per_step=reader.integer("ticks_per_step", 1, 100_000),
        tick_rate=reader.positive("tick_rate"),
        policies=policies,
        scene=reader.text("scene", default=""),
    )
    num_bytes = max_batch_bytes(spec)
    if num_bytes > MAX_BINARY_BYTES:
        raise ProtocolError(
            f"spec: a BATCH may need {num_bytes} bytes, the limit is {MAX_BINARY_BYTES}",
            hint="use fewer worlds or agents, or smaller observations",
        )
    return spec


class _Reader:
    """Typed access to one JSON object, with errors that name the place."""

    def __init__(self, value: Any, where: str) -> None:
        self.where = where
        if not isinstance(value, dict):
            raise ProtocolError(f"{where}: expected an object, got {type(value).__name__}")
        self._object = cast(dict[str, Any], value)

    def error(self, key: str, what: str) -> ProtocolError:
        return ProtocolError(
            f"{self.where}.{key}: {what}",
            hint="add-on and ludus may be of different versions; run `ludus addon install PROJECT`",
        )

    def get(self, key: str) -> Any:
        if key not in self._object:
            raise self.error(key, "missing")
        return self._object[key]

    def integer(self, key: str, low: int, high: int) -> int:
        value = self.get(key)
        # Godot's JSON writes every number as a float.
        if isinstance(value, bool) or not isinstance(value, int | float) or value != value // 1:
            raise self.error(key, f"expected an integer, got {_short(value)}")
        if not low <= value <= high:
            raise self.error(key, f"expected {low} to {high}, got {value}")
        return int(value)

    def positive(self, key: str) -> float:
        value = self._finite(key, self.get(key))
        if value <= 0.0:
            raise self.error(key, f"expected a positive number, got {value}")
        return value

    def text(self, key: str, default: str | None = None) -> str:
        value = self._object.get(key, default) if default is not None else self.get(key)
        if not isinstance(value, str):
            raise self.error(key, f"expected a text, got {_short(value)}")
        return value

    def name(self) -> str:
        value = self.text("name")
        if not 1 <= len(value) <= MAX_NAME_LENGTH:
            raise self.error("name", f"expected 1 to {MAX_NAME_LENGTH} characters")
        return value

    def choice(self, key: str, choices: Sequence[str]) -> str:
        value = self.text(key)
        if value not in choices:
            raise self.error(key, f"expected one of {', '.join(choices)}, got {_short(value)}")
        return value

    def flag(self, key: str) -> bool:
        value = self.get(key)
        if not isinstance(value, bool):
            raise self.error(key, f"expected true or false, got {_short(value)}")
        return value

    def items(self, key: str, low: int, high: int) -> list[_Reader]:
        value = self.get(key)
        if not isinstance(value, list):
            raise self.error(key, f"expected a list, got {type(value).__name__}")
        values = cast(list[Any], value)
        if not low <= len(values) <= high:
            raise self.error(key, f"expected {low} to {high} items, got {len(values)}")
        return [_Reader(item, f"{self.where}.{key}[{i}]") for i, item in enumerate(values)]

    def bound(self, key: str, size: int, unbounded: float | None) -> Bound:
        value = self._object.get(key)
        if value is None:
            if unbounded is None:
                raise self.error(key, "missing")
            return unbounded
        if isinstance(value, list):
            numbers = cast(list[Any], value)
            if len(numbers) != size:
                raise self.error(key, f"expected {size} numbers, got {len(numbers)}")
            return tuple(self._finite(key, number) for number in numbers)
        return self._finite(key, value)

    def _finite(self, key: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(key, f"expected a number, got {_short(value)}")
        if not -_MAX_FLOAT <= value <= _MAX_FLOAT:  # JSON integers may exceed any float
            raise self.error(key, f"expected a finite number, got {_short(value)}")
        return float(value)

    def bounds(self, size: int, unbounded: float | None) -> tuple[Bound, Bound]:
        low = self.bound("low", size, None if unbounded is None else -unbounded)
        high = self.bound("high", size, unbounded)
        count = max(len(bound) for bound in (low, high, (0.0,)) if isinstance(bound, tuple))
        lows = low if isinstance(low, tuple) else (low,) * count
        highs = high if isinstance(high, tuple) else (high,) * count
        for smallest, largest in zip(lows, highs, strict=True):
            if smallest > largest:
                raise self.error("low", f"{smallest} is above high, {largest}")
        return low, high


def _policy(reader: _Reader, num_worlds: int) -> PolicySpec:
    agents = tuple(_agent(item, num_worlds) for item in reader.items("agents", 1, MAX_AGENTS))
    if reader.integer("num_agents", 1, MAX_AGENTS) != len(agents):
        raise reader.error("num_agents", f"the list of agents has {len(agents)}")
    per_world = reader.integer("agents_per_world", 1, MAX_AGENTS)
    _check_slots(reader, agents, per_world, num_worlds)
    action = tuple(_component(item) for item in reader.items("action", 1, MAX_ENTRIES))
    observation = tuple(_entry(item) for item in reader.items("observation", 1, MAX_ENTRIES))
    settings = reader.get("settings")
    if not isinstance(settings, dict):
        raise reader.error("settings", "expected an object")
    limit = reader.get("max_episode_steps")
    policy = PolicySpec(
        name=reader.name(),
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
    _check_names(reader, "observation", [entry.name for entry in observation])
    _check_names(reader, "action", [part.name for part in action])
    if policy.has_action_mask and not policy.nvec:
        raise reader.error("has_action_mask", "there is no discrete action to mask")
    return policy


def _check_slots(
    reader: _Reader, agents: Sequence[AgentSpec], per_world: int, num_worlds: int
) -> None:
    if len(agents) != per_world * num_worlds:
        count = f"{len(agents)} agents in {num_worlds} worlds"
        raise reader.error("agents_per_world", f"{per_world} does not fit {count}")
    for slot, agent in enumerate(agents):
        if agent.world != slot // per_world:
            what = f"expected {slot // per_world} (slots go world by world), got {agent.world}"
            raise reader.error(f"agents[{slot}].world", what)


def _check_names(reader: _Reader, key: str, names: Sequence[str]) -> None:
    if len(set(names)) != len(names):
        raise reader.error(key, "two items have the same name")


def _agent(reader: _Reader, num_worlds: int) -> AgentSpec:
    path = reader.get("path")
    if path is not None and not isinstance(path, str):
        raise reader.error("path", "expected a text or null")
    return AgentSpec(world=reader.integer("world", 0, num_worlds - 1), path=path)


def _entry(reader: _Reader) -> ObservationEntry:
    shape_value = reader.get("shape")
    if (
        not isinstance(shape_value, list)
        or not 1 <= len(cast(list[Any], shape_value)) <= MAX_DIMENSIONS
    ):
        raise reader.error("shape", f"expected a list of 1 to {MAX_DIMENSIONS} sizes")
    shape = tuple(_dimension(reader, size) for size in cast(list[Any], shape_value))
    size = math.prod(shape)
    if size > MAX_ENTRY_ELEMENTS:
        raise reader.error("shape", f"more than {MAX_ENTRY_ELEMENTS} elements")
    low, high = reader.bounds(size, math.inf)
    return ObservationEntry(
        name=reader.name(),
        dtype=reader.choice("dtype", tuple(DTYPES)),
        shape=shape,
        low=low,
        high=high,
    )


def _dimension(reader: _Reader, size: Any) -> int:
    if isinstance(size, bool) or not isinstance(size, int | float) or size != size // 1 or size < 1:
        raise reader.error("shape", f"expected positive integers, got {_short(size)}")
    return int(size)


def _component(reader: _Reader) -> ActionComponent:
    kinds: dict[str, Callable[[_Reader], ActionComponent]] = {
        "discrete": _discrete,
        "continuous": _continuous,
    }
    return kinds[reader.choice("kind", tuple(kinds))](reader)


def _discrete(reader: _Reader) -> DiscreteAction:
    return DiscreteAction(reader.name(), reader.integer("n", 1, 1 << 20))


def _continuous(reader: _Reader) -> ContinuousAction:
    size = reader.integer("size", 1, 1 << 16)
    low, high = reader.bounds(size, None)
    return ContinuousAction(reader.name(), size, low, high)
