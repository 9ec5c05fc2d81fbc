"""From what a game says of itself to policies with their spaces, and from JSON to observations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.errors import GameError
from ludus.legacy.gdrl.messages import EnvInfo
from ludus.legacy.spaces import to_array
from ludus.wire.json_object import JsonObject

__all__ = ["Entry", "PolicyAgents", "group_agents"]

_MAX_SIZE = 1 << 24
_MAX_RANK = 8
_MAX_NAME = 64
_IMAGE_MARK = "2d"
"""Observations with this in their name are images."""
_HINT = "get_obs() must return what get_obs_space() of the AIController says"
_NEEDS_WINDOW = "cameras draw only with show_window=True"


@dataclass(frozen=True)
class Entry:
    """One named part of an observation.

    Attributes:
        name: As the game calls it.
        space: What an agent observes. Images are ``uint8[height, width, channels]``, as the game
            sends them, although it declares channels first; a discrete one is one-hot.
        num_choices: Values of a discrete one; 0 for others.
        is_image: Whether it comes as hexadecimal digits.
    """

    name: str
    space: spaces.Box
    num_choices: int = 0
    is_image: bool = False

    def read(self, values: list[Any]) -> NDArray[Any]:
        """Return what all agents of a policy observe, ``dtype[n, *shape]``.

        Raises:
            GameError: Something does not fit the space.
        """
        if self.is_image:
            return np.stack([self._read_image(value) for value in values])
        shape, dtype = self.space.shape, cast("np.dtype[Any]", self.space.dtype)
        if self.num_choices:
            shape, dtype = (), np.dtype(np.int64)
            values = [_single(value) for value in values]
        try:
            shape = (len(values), *shape)
            numbers = to_array(shape, dtype, values, f"the observation {self.name}")
        except GameError as error:
            raise GameError(error.message, _HINT) from error
        return self._one_hot(numbers) if self.num_choices else numbers

    def _one_hot(self, choices: NDArray[np.int64]) -> NDArray[np.float32]:
        if (choices < 0).any() or (choices >= self.num_choices).any():
            raise GameError(
                f"the observation {self.name} does not fit: {choices.tolist()} came, expected one "
                f"of 0 to {self.num_choices - 1} per agent",
                _HINT,
            )
        return np.eye(self.num_choices, dtype=np.float32)[choices]

    def _read_image(self, value: Any) -> NDArray[np.uint8]:
        if value is None:
            raise GameError(f"the camera {self.name} has no picture", _NEEDS_WINDOW)
        shape = self.space.shape
        try:
            pixels = np.frombuffer(bytes.fromhex(value), np.uint8)
        except (TypeError, ValueError) as error:
            raise GameError(f"the image {self.name} is not hexadecimal: {error}", _HINT) from error
        if shape[2:] == (3,) and pixels.size == 4 * math.prod(shape[:2]):  # drawn by OpenGL
            return pixels.reshape(*shape[:2], 4)[:, :, :3]
        if pixels.size != math.prod(shape):
            raise GameError(
                f"the image {self.name} has {pixels.size} bytes, expected {math.prod(shape)} "
                f"({' x '.join(map(str, shape))})",
                hint=f"{_HINT}; {_NEEDS_WINDOW}",
            )
        return pixels.reshape(shape)


@dataclass(frozen=True)
class PolicyAgents:
    """Agents that share a policy.

    Attributes:
        name: Of the policy.
        rows: Their places among all agents.
        entries: What each observes.
        actions: What each does, by component.
    """

    name: str
    rows: tuple[int, ...]
    entries: tuple[Entry, ...]
    actions: spaces.Dict

    @property
    def observation_space(self) -> spaces.Dict:
        """What one agent observes."""
        return spaces.Dict([(entry.name, entry.space) for entry in self.entries])

    def read(self, observations: Sequence[Mapping[str, Any]]) -> dict[str, NDArray[Any]]:
        """Return what some agents of the policy observe: by entry, ``dtype[n, *shape]``.

        Raises:
            GameError: Something is missing, or does not fit its space.
        """
        found: dict[str, NDArray[Any]] = {}
        for entry in self.entries:
            try:
                values = [observation[entry.name] for observation in observations]
            except KeyError as error:
                raise GameError(f"an observation has no entry {entry.name!r}", _HINT) from error
            found[entry.name] = entry.read(values)
        return found


def group_agents(info: EnvInfo) -> list[PolicyAgents]:
    """Return the policies of a game, in order of their first agents.

    Raises:
        ProtocolError: A space cannot be read.
        GameError: Agents of one policy differ.
    """
    rows: dict[str, list[int]] = {}
    for row, name in enumerate(info.policies):
        rows.setdefault(name, []).append(row)
    return [_group(info, name, tuple(places)) for name, places in rows.items()]


def _group(info: EnvInfo, name: str, rows: tuple[int, ...]) -> PolicyAgents:
    found = [
        PolicyAgents(name, rows, _entries(info.observations[row]), _actions(info.actions[row]))
        for row in rows
    ]
    for what, parts in (("obs", found[0].entries), ("action", found[0].actions.spaces)):
        if not parts:
            raise GameError(
                f"the agents of policy {name} declare nothing in get_{what}_space()",
                hint=f"let get_{what}_space() of the AIController return at least one entry",
            )
    for row, agents in zip(rows, found, strict=True):
        if agents != found[0]:
            raise GameError(
                f"agents {rows[0]} and {row} of policy {name} have different spaces",
                hint="give AIControllers that differ a policy_name of their own",
            )
    return found[0]


def _single(value: Any) -> Any:
    """Return a number that may come as a list of one."""
    if isinstance(value, list):
        items = cast(list[Any], value)
        return items[0] if len(items) == 1 else items
    return value


def _entries(declared: JsonObject) -> tuple[Entry, ...]:
    return tuple(_entry(declared, name) for name in declared.names())


def _entry(declared: JsonObject, name: str) -> Entry:
    declared.check_name(name, name, _MAX_NAME)
    part = declared.child(name)
    if part.choice("space", ("box", "discrete")) == "discrete":
        num = _size(part)
        return Entry(name, spaces.Box(0.0, 1.0, (num,), np.float32), num_choices=num)
    shape = _shape(part)
    if _IMAGE_MARK in name:
        pixels = (*shape[1:], shape[0]) if len(shape) == 3 else shape
        return Entry(name, spaces.Box(0, 255, pixels, np.uint8), is_image=True)
    # A game that says no bounds means -1 to 1, and seldom keeps to them.
    low, high = (
        part.number(key, part.get(key)) if part.optional(key) is not None else bound
        for key, bound in (("low", -np.inf), ("high", np.inf))
    )
    if low >= high:
        raise part.error("low", f"{low} is not below high, {high}")
    return Entry(name, spaces.Box(low, high, shape, np.float32))


def _actions(declared: JsonObject) -> spaces.Dict:
    parts: list[tuple[str, spaces.Space[Any]]] = []
    for name in declared.names():
        declared.check_name(name, name, _MAX_NAME)
        part = declared.child(name)
        kind, size = part.choice("action_type", ("discrete", "continuous")), _size(part)
        parts.append((name, spaces.Discrete(size) if kind == "discrete" else _unit_box(size)))
    return spaces.Dict(parts)


def _unit_box(size: int) -> spaces.Box:
    return spaces.Box(-1.0, 1.0, (size,), np.float32)


def _size(part: JsonObject) -> int:
    """Return a size that is a number, or a list of one."""
    if isinstance(part.get("size"), list):
        return math.prod(_shape(part))
    return part.integer("size", 1, _MAX_SIZE)


def _shape(part: JsonObject) -> tuple[int, ...]:
    sizes = part.items("size")
    if not 1 <= len(sizes) <= _MAX_RANK:
        raise part.unexpected("size", f"1 to {_MAX_RANK} numbers", sizes)
    numbers = [part.number(f"size[{index}]", size) for index, size in enumerate(sizes)]
    if any(number < 1 or number % 1 for number in numbers) or math.prod(numbers) > _MAX_SIZE:
        raise part.unexpected("size", f"whole numbers whose product is up to {_MAX_SIZE}", sizes)
    return tuple(int(number) for number in numbers)
