"""The declarations of an engine (PROTOCOL.md §4): worlds, policies, entries, actions.

No input or output happens here; :mod:`ludus.wire.spec_reader` builds a spec from JSON.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "ActionComponent",
    "AgentSpec",
    "ContinuousAction",
    "DiscreteAction",
    "ObservationEntry",
    "PolicySpec",
    "Spec",
]

Bound = float | tuple[float, ...]
EpisodeMode = Literal["agent", "world"]

DTYPES: dict[str, np.dtype[Any]] = {
    "float32": np.dtype("<f4"),
    "uint8": np.dtype("u1"),
    "int64": np.dtype("<i8"),
}


@dataclass(frozen=True)
class ObservationEntry:
    """One named array of an observation.

    Attributes:
        name: Key in the observation dictionary.
        dtype: ``"float32"``, ``"uint8"`` (images, channels last) or ``"int64"``.
        shape: Shape for one agent; a single number has shape ``(1,)``, since ``()`` is not allowed.
        low: Smallest value, one for all elements or one per element; ``-inf`` if unbounded.
        high: Largest value, like ``low``.
    """

    name: str
    dtype: str
    shape: tuple[int, ...]
    low: Bound = -math.inf
    high: Bound = math.inf

    @cached_property
    def numpy_dtype(self) -> np.dtype[Any]:
        """Little-endian NumPy dtype of the wire."""
        return DTYPES[self.dtype]

    @cached_property
    def size(self) -> int:
        """Number of elements for one agent."""
        return math.prod(self.shape)

    @cached_property
    def num_bytes(self) -> int:
        """Number of bytes for one agent."""
        return self.size * self.numpy_dtype.itemsize

    def bounds(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return ``(low, high)`` as arrays of this entry's shape and dtype."""
        return self._bound(self.low), self._bound(self.high)

    def _bound(self, bound: Bound) -> NDArray[Any]:
        values = np.asarray(bound, dtype=np.float64)
        if self.dtype != "float32":
            info = np.iinfo(self.numpy_dtype)
            values = np.clip(values, float(info.min), float(info.max))
            if self.dtype == "int64":  # float(2**63 - 1) rounds up and would overflow
                values = np.clip(values, -(2.0**62), 2.0**62)
        full = np.broadcast_to(values.reshape(self.shape) if values.ndim else values, self.shape)
        return full.astype(self.numpy_dtype)

    def to_json(self) -> dict[str, Any]:
        """Return the object of PROTOCOL.md §4."""
        return {
            "name": self.name,
            "dtype": self.dtype,
            "shape": list(self.shape),
            "low": _bound_to_json(self.low),
            "high": _bound_to_json(self.high),
        }


@dataclass(frozen=True)
class DiscreteAction:
    """A choice among ``n`` alternatives, ``0 … n - 1``."""

    name: str
    n: int

    def to_json(self) -> dict[str, Any]:
        """Return the object of PROTOCOL.md §4."""
        return {"name": self.name, "kind": "discrete", "n": self.n}


@dataclass(frozen=True)
class ContinuousAction:
    """``size`` numbers in ``[low, high]``; bounds are one number or one per element."""

    name: str
    size: int
    low: Bound = -1.0
    high: Bound = 1.0

    def to_json(self) -> dict[str, Any]:
        """Return the object of PROTOCOL.md §4."""
        return {
            "name": self.name,
            "kind": "continuous",
            "size": self.size,
            "low": _bound_to_json(self.low),
            "high": _bound_to_json(self.high),
        }


ActionComponent = DiscreteAction | ContinuousAction


@dataclass(frozen=True)
class AgentSpec:
    """Location of a slot's agent: world index, and node path in that world (None: free slot)."""

    world: int
    path: str | None

    def __str__(self) -> str:
        return f"world {self.world}, agent {self.path or '(joined later)'}"

    def to_json(self) -> dict[str, Any]:
        """Return the object of PROTOCOL.md §4."""
        return {"world": self.world, "path": self.path}


@dataclass(frozen=True)
class PolicySpec:
    """Agents that share a network: their observation, their action, their slots.

    Attributes:
        name: Policy name.
        observation: Entries in wire order.
        action: Components in wire order.
        agents: One per slot.
        agents_per_world: Slots in each world.
        has_action_mask: Whether batches carry ``action_mask``.
        episode: ``"agent"`` or ``"world"``, PROTOCOL.md §4.
        max_episode_steps: Steps after which an episode is truncated; None: never.
        settings: Training settings from the scene.
    """

    name: str
    observation: tuple[ObservationEntry, ...]
    action: tuple[ActionComponent, ...]
    agents: tuple[AgentSpec, ...]
    agents_per_world: int = 1
    has_action_mask: bool = False
    episode: EpisodeMode = "agent"
    max_episode_steps: int | None = None
    settings: Mapping[str, Any] = field(default_factory=dict[str, Any])

    @cached_property
    def num_agents(self) -> int:
        """Slots of this policy in one engine."""
        return len(self.agents)

    def world_slots(self, world: int) -> slice:
        """Return the slots of one world."""
        return slice(world * self.agents_per_world, (world + 1) * self.agents_per_world)

    @cached_property
    def nvec(self) -> tuple[int, ...]:
        """``n`` of each discrete component, in order."""
        return tuple(part.n for part in self.action if isinstance(part, DiscreteAction))

    @cached_property
    def num_discrete(self) -> int:
        """Number of discrete components."""
        return len(self.nvec)

    @cached_property
    def continuous_size(self) -> int:
        """Number of elements of all continuous components together."""
        return sum(part.size for part in self.action if isinstance(part, ContinuousAction))

    @cached_property
    def mask_size(self) -> int:
        """Elements of one agent's action mask: the sum of ``nvec``; 0 without masks."""
        return sum(self.nvec) if self.has_action_mask else 0

    def continuous_bounds(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return ``(low, high)``, each ``float32[continuous_size]``."""
        parts = [part for part in self.action if isinstance(part, ContinuousAction)]
        low = [np.broadcast_to(np.asarray(part.low, np.float32), (part.size,)) for part in parts]
        high = [np.broadcast_to(np.asarray(part.high, np.float32), (part.size,)) for part in parts]
        empty = np.zeros(0, np.float32)
        return np.concatenate([empty, *low]), np.concatenate([empty, *high])

    def without_mask(self) -> PolicySpec:
        """Return the same policy without action masks."""
        return replace(self, has_action_mask=False)

    def was_unmasked(self, fingerprint: str) -> bool:
        """Return whether a network of ``fingerprint`` fits in all but the masks it never saw."""
        return self.has_action_mask and fingerprint == self.without_mask().fingerprint()

    def change_since(self, trained: Mapping[str, Any]) -> str:
        """Return in words the first change since a spec whose JSON was saved; empty if none shows.

        Only what :meth:`fingerprint` covers counts.
        """
        for kind, parts in (("observation", self.observation), ("action", self.action)):
            now = {part.name: part.to_json() for part in parts}
            before = {part["name"]: part for part in trained[kind]}
            for name in [*before, *now]:
                if name not in now:
                    return f'the {kind} "{name}" is gone'
                if name not in before:
                    return f'the {kind} "{name}" is new'
                if change := _json_difference(before[name], now[name], ""):
                    return f'{kind} "{name}": {change}'
            if [*now] != [*before]:
                return f"the {kind}s come in another order: {', '.join(now)}"
        has_lost_masks = trained["has_action_mask"] and not self.has_action_mask
        return "the game no longer sends action masks" if has_lost_masks else ""

    def fingerprint(self) -> str:
        """Return a hash of everything that a trained network depends on."""
        content = {
            "observation": [entry.to_json() for entry in self.observation],
            "action": [part.to_json() for part in self.action],
            "has_action_mask": self.has_action_mask,
        }
        text = json.dumps(content, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def to_json(self) -> dict[str, Any]:
        """Return the object of PROTOCOL.md §4."""
        return {
            "name": self.name,
            "num_agents": self.num_agents,
            "agents_per_world": self.agents_per_world,
            "episode": self.episode,
            "max_episode_steps": self.max_episode_steps,
            "observation": [entry.to_json() for entry in self.observation],
            "action": [part.to_json() for part in self.action],
            "has_action_mask": self.has_action_mask,
            "agents": [agent.to_json() for agent in self.agents],
            "settings": dict(self.settings),
        }


@dataclass(frozen=True)
class Spec:
    """All declarations of one engine.

    Attributes:
        num_worlds: Worlds in this engine.
        layout: ``"isolated"`` or ``"grid"``.
        ticks_per_step: Physics ticks per decision.
        tick_rate: Ticks per second of game time.
        policies: In wire order.
        scene: Scene that the worlds were made from, for messages.
        warnings: What is probably wrong with the game, though it runs.
    """

    num_worlds: int
    layout: str
    ticks_per_step: int
    tick_rate: float
    policies: tuple[PolicySpec, ...]
    scene: str = ""
    warnings: tuple[str, ...] = field(default=(), compare=False)

    def policy(self, name: str) -> PolicySpec:
        """Return the policy called ``name``; raise ``KeyError`` if there is none."""
        for policy in self.policies:
            if policy.name == name:
                return policy
        raise KeyError(name)

    def to_json(self) -> dict[str, Any]:
        """Return the object of PROTOCOL.md §4."""
        return {
            "num_worlds": self.num_worlds,
            "layout": self.layout,
            "ticks_per_step": self.ticks_per_step,
            "tick_rate": self.tick_rate,
            "scene": self.scene,
            **({"warnings": list(self.warnings)} if self.warnings else {}),
            "policies": [policy.to_json() for policy in self.policies],
        }


def spec_difference(one: Spec, two: Spec) -> str:
    """Return the first difference between two specs in words: name, its value in each."""
    return _json_difference(one.to_json(), two.to_json(), "") or "nothing that shows in JSON"


def _json_difference(one: Any, two: Any, name: str) -> str:
    if isinstance(one, dict) and isinstance(two, dict):
        first, second = cast(dict[str, Any], one), cast(dict[str, Any], two)
        for key in [*first, *(key for key in second if key not in first)]:
            if key != "warnings" and first.get(key) != second.get(key):
                return _json_difference(first.get(key), second.get(key), f"{name}.{key}")
    if isinstance(one, list) and isinstance(two, list):
        ours, theirs = cast(list[Any], one), cast(list[Any], two)
        if len(ours) != len(theirs):
            return f"{name.lstrip('.')} has {len(theirs)} items instead of {len(ours)}"
        for i, (mine, other) in enumerate(zip(ours, theirs, strict=True)):
            if mine != other:
                return _json_difference(mine, other, f"{name}[{i}]")
    return "" if one == two else f"{name.lstrip('.')} is {two!r} instead of {one!r}"


def _bound_to_json(bound: Bound) -> float | list[float] | None:
    if isinstance(bound, tuple):
        return list(bound)
    return bound if math.isfinite(bound) else None
